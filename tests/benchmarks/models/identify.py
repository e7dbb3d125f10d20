"""Figures of identification: accuracy, speed, the paper's experiments, real recordings, faults.

    python tests/benchmarks/models/identify.py [accuracy speed length paper real faults]

It prints one table each. `speed` takes several minutes, nearly all of it for the paper's method.
"""

import sys
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from tests.benchmarks.bars import Bars  # noqa: E402
from tests.benchmarks.models import identify_cases as cases  # noqa: E402
from tests.benchmarks.models import identify_faults  # noqa: E402

from dehyst.daemon.api.prediction import outside_validity  # noqa: E402
from dehyst.daemon.files.recordings import read_recording  # noqa: E402
from dehyst.drivers.simulated.settings import StageSettings  # noqa: E402
from dehyst.drivers.simulated.stage import SimulatedStage  # noqa: E402
from dehyst.models.errors import DehystError  # noqa: E402
from dehyst.models.hysteresis.forward import simulate_hysteresis  # noqa: E402
from dehyst.models.identify import Identification, Options, identify  # noqa: E402
from dehyst.models.model import Hysteresis  # noqa: E402
from dehyst.models.modelfile import shipped  # noqa: E402
from dehyst.models.recording import Floats, Recording  # noqa: E402

NOISE_UM = 0.045
NM = 1e3


def accuracy(bars: Bars) -> None:
    """The paper's two-sine recording with Eq. 12 as the truth."""
    truth = shipped("paper-eq12").hysteresis
    u = cases.two_sines()
    drives = {
        "triangle": cases.triangle(7.5),
        "sweep": cases.sweep(3.0, 7.0),
        "four sines": cases.four_sines(),
    }
    print("Two sines, 10 s at 1 kHz, Eq. 12 as truth, 45 nm noise; all in nm rms")
    print(f"{'seed':>4} {'fit':14} {'operators':>9} {'recording':>10} {'truth':>7} "
          + " ".join(f"{name:>10}" for name in drives) + "  outside validity")  # fmt: skip
    for seed in range(3):
        rec = cases.recording(u, truth, NOISE_UM, seed)
        for name, options in (
            ("unconstrained", Options(monotone=False)),
            ("monotone", Options()),
            ("monotone, 10", Options(order=10)),
        ):
            model = identify([rec], options).model
            h = model.hysteresis
            fit = cases.rms(rec.displacement - simulate_hysteresis(h, u, cases.T_S)) * NM
            if name == "unconstrained":  # the truth belongs to its class
                bars.most(f"seed {seed}: fit over the noise", fit / (NM * NOISE_UM), 1.02)
            elif name == "monotone":  # the truth is not monotone
                bars.most(f"seed {seed}: monotone fit over the noise", fit / (NM * NOISE_UM), 1.1)
            against = (
                cases.rms(
                    simulate_hysteresis(h, u, cases.T_S) - simulate_hysteresis(truth, u, cases.T_S)
                )
                * NM
            )
            errors = [
                cases.rms(
                    simulate_hysteresis(h, d, cases.T_S) - simulate_hysteresis(truth, d, cases.T_S)
                )
                * NM
                for d in drives.values()
            ]
            flags = [
                f"{name} ({max(shares.values()):.0%} of rows)"
                for name, d in drives.items()
                if max((shares := outside_validity(model, _plain(d))).values()) > 0
            ]
            print(f"{seed:4} {name:14} {h.n:9} {fit:10.2f} {against:7.2f} "
                  + " ".join(f"{e:10.1f}" for e in errors) + "  " + ", ".join(flags))  # fmt: skip


def _plain(u: Floats) -> Recording:
    return Recording(np.arange(u.size) * cases.T_S, u)


def _timed(work: Callable[[], Identification], times: int = 3) -> tuple[float, Identification]:
    best = np.inf
    if times > 0:
        work()  # compiles everything first
    for _ in range(max(1, times)):
        start = time.process_time()
        result = work()
        best = min(best, time.process_time() - start)
    return best, result


def speed(bars: Bars) -> None:
    """Speed relative to the paper's method, and as a function of the length of the recording."""
    truth = shipped("paper-eq12").hysteresis
    rec = cases.recording(cases.two_sines(), truth, NOISE_UM, 0)
    same = Options(order=10, rate=True, saturation=5, bias=False)
    rows = []
    for name, options in (
        ("dehyst, everything chosen", Options()),
        ("dehyst, structure given", same),
        ("dehyst, structure given, unconstrained",
         Options(order=10, rate=True, saturation=5, bias=False, monotone=False)),
    ):  # fmt: skip
        seconds, result = _timed(lambda options=options: identify([rec], options))
        rows.append((name, seconds, (result.model.fit.rms or 0.0) * NM, 0))
    for name, compiled, most in (
        ("general solver, compiled forward", True, 400),
        ("general solver, numpy forward (the paper's way)", False, 400),
    ):
        cases.paper_way(rec, True, 2)
        start = time.process_time()
        fit = cases.paper_way(rec, compiled, most)
        rows.append((name, time.process_time() - start, fit.rms * NM, fit.forward_runs))
    print("10 000 samples (processor seconds; how many times faster than each way below)")
    slow = rows[-2:]
    print(f"{'':48} {'seconds':>9} {'nm rms':>8} {'x compiled':>11} {'x paper':>9}")
    for name, seconds, rms_nm, runs in rows:
        times = [f"{other[1] / seconds:.0f}" for other in slow]
        note = f"  {runs} forward runs" if runs else ""
        print(f"{name:48} {seconds:9.3f} {rms_nm:8.2f} {times[0]:>11} {times[1]:>9}{note}")
    bars.least("the paper's way over everything chosen, time", slow[-1][1] / rows[0][1], 200.0)
    bars.least("compiled solver over structure given, time", slow[0][1] / rows[1][1], 5.0)


def length() -> None:
    """Speed as a function of the length of the recording, up to 160 MB a column."""
    truth = shipped("paper-eq12").hysteresis
    print("length of the recording (processor seconds, peak of what is allocated beside it)")
    for count in (10_000, 100_000, 1_000_000, 20_000_000):
        long = cases.recording(cases.two_sines(count * cases.T_S), truth, NOISE_UM, 0)
        seconds, _ = _timed(lambda long=long: identify([long]), 1 if count <= 1_000_000 else 0)
        tracemalloc.start()
        identify([long])
        peak = tracemalloc.get_traced_memory()[1] / 2**20
        tracemalloc.stop()
        print(f"{count:9} samples {seconds:8.2f} s {peak:8.0f} MiB")


def paper() -> None:
    """The paper's experiments on the simulated stage with 100 nm sensor noise."""

    def measure(u: Floats, seed: int) -> Recording:
        stage = SimulatedStage(StageSettings(stroke_um=11.6, sensor_noise_um=0.1, seed=seed))
        t = np.arange(u.size) * cases.T_S
        return Recording(t, u, stage.run(t, 15.0 * u)[1])

    t = cases.times(10.0)
    sine = measure(cases.sines(t, (5, 1)), 1)
    two = measure(cases.sines(t, (2, 10), (3, 5)), 2)
    tri = measure(cases.triangle(10.0), 3)
    four = measure(cases.four_sines(), 4)
    swept = measure(cases.sweep(3.0, 7.0), 5)
    slow = identify([sine], Options(rate=False)).model.hysteresis
    fast = identify([two], Options(rate=True)).model.hysteresis

    def error(h: Hysteresis, rec: Recording) -> Floats:
        return (rec.displacement - simulate_hysteresis(h, rec.drive, cases.T_S)) * NM

    def show(name: str, e: Floats, printed: str) -> None:
        print(f"{name:44} {np.mean(e):8.2f} +- {np.std(e):6.2f}   {printed}")

    print("The paper's experiments on the simulated stage, 100 nm sensor noise; mean +- std, nm")
    print(f"{'':44} {'here':>18}   the paper")
    show("1 Hz sine, rate-independent, fit", error(slow, sine), "5.287 +- 62.41")
    show("two sines, rate-dependent, fit", error(fast, two), "3.526 +- 45.55")
    show("1 Hz triangle, rate-independent", error(slow, tri), "79.56 +- 77.60")
    show("four sines, rate-independent", error(slow, four), "88.10 +- 86.29")
    show("four sines, rate-dependent", error(fast, four), "-48.77 +- 57.22")
    last = error(fast, swept)[-1000:]
    show("sweep, rate-dependent, last second", last, "maximum 94.11")
    print(f"{'':44} maximum {np.max(np.abs(last)):.2f}")


def real() -> None:
    """Real recordings: fit on the first 60 %, held out the last 40 %; % of the span."""
    folder = identify_faults.data_folder(ROOT)
    if folder is None:
        print("no recordings found; set DEHYST_DATA")
        return
    print("Held-out last 40 %, rms in % of span (in brackets without its mean, which is drift)")
    names = ("dehyst", "dehyst static", "odd polynomial, static", "10 uniform, NNLS")
    print(f"{'':16}" + "".join(f"{name:>26}" for name in names))
    for name in ("stack-1hz", "stack-am", "afm-triangle-a", "lightsheet"):
        rec = read_recording(folder / "recordings" / f"{name}.csv")
        cut = int(0.6 * rec.size)
        part = Recording(
            rec.t_s[:cut], rec.drive[:cut], rec.displacement[:cut], rec.drive_unit,
            rec.displacement_unit, name=rec.name,
        )  # fmt: skip
        cells = []
        for options in (Options(), Options(rate=False), Options(rate=False, bias=False)):
            h = identify([part], options).model.hysteresis
            cells.append(_held(rec, simulate_hysteresis(h, rec.drive, rec.period_s), cut))
        cells.append(_held(rec, cases.uniform_pi(rec, cut), cut))
        print(f"{name:16}" + "".join(f"{c:>26}" for c in cells))


def _held(rec: Recording, model: Floats, cut: int) -> str:
    error = 100 * (rec.displacement - model)[cut:] / np.ptp(rec.displacement)
    return f"{cases.rms(error):.3f} ({np.std(error):.3f})"


def faults() -> None:
    """Damaged and poor recordings: either a good model or one clear sentence."""
    truth = shipped("paper-eq12").hysteresis
    drives = {
        "recording": cases.two_sines(),
        "triangle": cases.triangle(7.5),
        "sweep": cases.sweep(3.0, 7.0),
        "four sines": cases.four_sines(),
    }
    print(f"Against the truth, nm rms: {', '.join(drives)}")
    for name, rec in identify_faults.recordings(truth):
        try:
            found = identify([rec])
        except DehystError as error:
            print(f"{name:20} {error}")
            continue
        h = found.model.hysteresis
        errors = [
            cases.rms(
                np.abs(simulate_hysteresis(h, u, cases.T_S))
                - np.abs(simulate_hysteresis(truth, u, cases.T_S))
            )
            for u in drives.values()
        ]
        print(f"{name:20} " + " ".join(f"{NM * e:5.1f}" for e in errors)
              + f"  {'; '.join(found.notes)[:150]}")  # fmt: skip


def main() -> int:
    """Run the parts named on the command line, or all; `accuracy` and `speed` have bars."""
    bars = Bars()
    parts = {f.__name__: f for f in (accuracy, speed, length, paper, real, faults)}
    for name in sys.argv[1:] or parts:
        parts[name](bars) if name in ("accuracy", "speed") else parts[name]()
        print()
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
