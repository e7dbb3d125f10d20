"""Prediction of the next recording by a model from one: other waveforms, sizes and rates.

    python -m tests.benchmarks.models.prediction [paper peer bias real static band turns public]

It prints a table for each part and, last, its bars; for the exit status see
tests/benchmarks/bars.py. Real recordings are read from $DEHYST_DATA.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from tests.benchmarks.bars import Bars  # noqa: E402
from tests.benchmarks.models import (  # noqa: E402
    identify_faults,
    prediction_turns,
    public_operator,
)
from tests.benchmarks.models import prediction_cases as cases  # noqa: E402

from dehyst.daemon.files.recordings import read_recording  # noqa: E402
from dehyst.models.cascade.simulate import simulate  # noqa: E402
from dehyst.models.errors import DehystError  # noqa: E402
from dehyst.models.identify import Identification, Options, identify  # noqa: E402
from dehyst.models.model import Model  # noqa: E402
from dehyst.models.recording import Floats, Recording  # noqa: E402

SEEDS = range(9900, 9906)  # nothing was tuned on these
NM = 1e3
TEN = cases.times(10.0)


def predict(model: Model, u: Floats, period_s: float = cases.T_S) -> Floats:
    """Return (N,) the model's prediction for a drive from rest."""
    return simulate(model, period_s, u)


def _differ(model: Model, run: Callable[[Floats], Floats], u: Floats) -> float:
    return cases.rms(predict(model, u) - run(u))


def paper(bars: Bars) -> None:
    """1: Eq. 12 as the truth, the paper's two sines, both conventions of the rate; nm rms."""
    u = cases.sines(TEN, (2, 10), (3, 5))
    drives = {
        "truth": u,
        "triangle": cases.triangle(TEN, 0.0, 7.5),
        "sweep": cases.sweep(TEN, 3.0, 7.0),
        "four sines": cases.sines(TEN, (1, 10), (1, 7.5), (1, 5), (2, 4)),
    }
    most = {"fit": 48.8, "truth": 19.0, "triangle": 25.0, "sweep": 32.0, "four sines": 50.0}
    for central in (False, True):
        name = "central difference" if central else "backward difference"
        truth = cases.paper(central)
        rows = []
        for seed in SEEDS:
            rec = cases.record(truth.run, u, 0.045, seed)
            found = identify([rec])
            fit = cases.rms(rec.displacement - predict(found.model, u))
            rows.append([fit, *(_differ(found.model, truth.run, d) for d in drives.values())])
            figures = " ".join(f"{NM * x:8.1f}" for x in rows[-1])
            print(f"{name:20} seed {seed} {figures}  {_structure(found)}", flush=True)
        for column, (what, bar) in enumerate(most.items()):
            bars.most(f"{name}: {what}", NM * max(r[column] for r in rows), bar, "nm")


def _structure(found: Identification) -> str:
    blocks = ", ".join(f"{b.kind} at {b.place} {b.params}" for b in found.model.blocks)
    return f"{found.shape.name}, {found.model.hysteresis.n} operators; {blocks}"


def peer(bars: Bars) -> None:
    """2: against a bounded fit of 40 operators with a light ridge; rms to the truth, %.

    The stage is of the other's own class: a saturation, which it has not, would flatter us.
    """
    truth = replace(cases.smooth(), c=np.array([0.0, 1.0]))
    stroke = truth.run(np.array([0.0, 10.0]))[1]
    better = worst = count = 0
    for name, share, period, seconds in (
        ("0.4 % noise", 0.004, 1e-3, 10.0),
        ("100 Hz", 0.004, 1e-2, 10.0),
        ("3 % noise", 0.03, 1e-3, 10.0),
        ("0.4 s", 0.004, 1e-3, 0.4),
        ("20 % noise", 0.2, 1e-3, 10.0),
    ):
        u = cases.sines(cases.times(seconds, period), (2, 10), (3, 5))
        cells = []
        for seed in SEEDS:
            rec = cases.record(truth.run, u, share * stroke, seed, period)
            model, other = identify([rec]).model, cases.fit_peer(rec)
            row = []
            for d in _peer_drives().values():
                want = truth.run(d)
                row.append([cases.rms(predict(model, d) - want), cases.rms(other(d) - want)])
            cells.append(row)
        mean = 100 / stroke * np.sqrt(np.mean(np.square(cells), axis=0))
        print(f"{name:12} " + "  ".join(
            f"{what} {a:.3f} ({b:.3f})" for what, (a, b) in zip(_peer_drives(), mean, strict=True)
        ), flush=True)  # fmt: skip
        for what, (ours, theirs) in zip(_peer_drives(), mean, strict=True):
            bars.most(f"{name}, {what}: over the peer's", ours / theirs, 1.2)
            better += ours < theirs
            worst = max(worst, ours / theirs)
            count += 1
    bars.least(f"cells of {count} in which it is better than the peer", better, count / 2)


def _peer_drives() -> dict[str, Floats]:
    t = cases.times(5.0)
    return {
        "four sines": cases.sines(t, (0.75, 10), (0.75, 7.5), (0.75, 5), (1.5, 4)),
        "sine": cases.sines(t, (3.75, 1)),
        "triangle": cases.triangle(t, 0.0, 7.5),
        "multisine": cases.multisine(t, 0.0, 7.5),
    }


def bias(bars: Bars) -> None:
    """3: about a bias and from rest over a part of the range, against a full-range drive."""
    for name, truth in (
        ("smooth", cases.smooth(rate=True).stretched(10.0)),
        ("Eq. 12", cases.paper().stretched(10.0)),
    ):
        full = cases.sines(TEN, (20, 10), (30, 5)) * (100.0 / 75.6)
        for low, high in ((20, 80), (40, 60), (60, 100), (0, 60)):
            u = low + (high - low) / 100.0 * full / np.max(full) * 100.0
            other = cases.multisine(TEN, low, high)
            lead = np.linspace(0.0, low, 500)
            ratios = []
            for seed in SEEDS:
                errors = []
                for drive, begin in ((u, low), (full, 0)):
                    ahead = np.concatenate([lead, drive]) if begin else drive
                    rec = cases.record(truth.run, ahead, 0.02, seed)
                    rec = cases.begin_late(rec, 500) if begin else rec
                    model = identify([rec]).model
                    once = cases.triangle(cases.times(1.0), low, high)  # wide loops have settled
                    whole = np.concatenate([lead, once, other])
                    e = (predict(model, whole) - truth.run(whole))[1500:]
                    errors.append(float(np.std(e)))
                ratios.append(errors)
            mean = NM * np.sqrt(np.mean(np.square(ratios), axis=0))
            print(f"{name} {low:3} to {high:3} V: {mean[0]:.1f} nm, full range {mean[1]:.1f} nm",
                  flush=True)  # fmt: skip
            bars.most(
                f"{name}, {low} to {high} V: over a full-range drive's", mean[0] / mean[1], 1.5
            )


def real(bars: Bars) -> None:
    """4: first 60 % fitted, last 40 % predicted; % of the span."""
    most = {"stack-1hz": 0.45, "stack-am": 0.33, "lightsheet": 0.08, "afm-triangle-a": 4.5}
    folder = identify_faults.data_folder(ROOT)
    for name in (*most, "mirror-small", "mirror-large"):
        if folder is None:
            bars.cannot(name, "no recordings; set DEHYST_DATA")
            continue
        rec = read_recording(folder / "recordings" / f"{name}.csv")
        cut = int(0.6 * rec.size)
        try:
            found = identify([_part(rec, slice(0, cut))])
        except DehystError as error:
            print(f"{name}: {error}")
            if name in most:
                bars.most(f"{name}, % of span", float("nan"), most[name])
            continue
        e = (rec.displacement - simulate(found.model, rec.t_s, rec.drive))[cut:]
        share = 100 * cases.rms(e) / np.ptp(rec.displacement)
        print(f"{name:16} {share:.3f} % ({100 * np.std(e) / np.ptp(rec.displacement):.3f} without "
              f"its mean); {_structure(found)}", flush=True)  # fmt: skip
        if name in most:
            bars.most(f"{name}, % of span", share, most[name])


def _part(rec: Recording, rows: slice) -> Recording:
    return Recording(
        rec.t_s[rows], rec.drive[rows], rec.displacement[rows], rec.drive_unit,
        rec.displacement_unit, name=rec.name,
    )  # fmt: skip


def static(bars: Bars) -> None:
    """5: a stage without rate-dependence is not given any."""
    t = cases.times(4.0)
    other = cases.multisine(t, 0.0, 10.0)
    bad, worst, given = 0, 0.0, 0
    for seed in range(9950, 9970):
        rng = np.random.default_rng(seed)
        run = cases.preisach if seed % 2 else cases.smooth().run
        parts = [
            (float(a), float(f))
            for a, f in zip(rng.uniform(1, 3, 2), rng.uniform(1, 9, 2), strict=True)
        ]
        u = cases.sines(t, *parts)
        u *= 10.0 / u.max()
        rec = cases.record(run, u, 0.02, seed)
        cut = int(0.7 * t.size)
        errors = []
        for options in (Options(), Options(rate=False)):
            found = identify([_part(rec, slice(0, cut))], options)
            given += found.shape.rate
            e = rec.displacement - predict(found.model, u)
            errors.append([cases.rms(e[cut:]), _differ(found.model, run, other)])
        ratio = max(np.array(errors[0]) / errors[1])
        worst, bad = max(worst, ratio), bad + (ratio > 1.1)
    print(f"rate-dependence given to {given} of 20, worst ratio {worst:.3f}")
    bars.none("seeds of 20 more than 10 % worse than --static", bad)


def band(bars: Bars) -> None:
    """6: how often the 95 % band of a model holds what the stage does on another drive: one instant
    by chance of each drive, 240 in all where each model states one; and the share of all."""
    t = cases.times(5.0)
    drives = (
        cases.triangle(t, 0.0, 7.5),
        cases.sweep(t, 3.0, 7.0),
        cases.sines(t, (0.75, 10), (0.75, 7.5), (0.75, 5), (1.5, 4)),
        cases.multisine(t, 0.0, 9.0),
    )
    u = cases.sines(TEN, (2, 10), (3, 5))
    hits, unstated = [], 0
    for name, run, noise in (
        ("Eq. 12, backward difference", cases.paper().run, 0.045),
        ("Eq. 12, central difference", cases.paper(True).run, 0.045),
        ("rate-dependent, can be inverted", cases.smooth(rate=True).run, 0.02),
        ("static", cases.smooth().run, 0.02),
        ("Preisach plane", cases.preisach, 0.02),
    ):
        want, widths, shares, errors = [run(d) for d in drives], [], [], []
        for seed in range(9980, 9992):
            model = identify([cases.record(run, u, noise, seed)]).model
            width = model.fit.band
            if width is None:
                unstated += 1
                continue
            rng = np.random.default_rng(seed)
            for d, truth in zip(drives, want, strict=True):
                e = np.abs(predict(model, d) - truth)
                hits.append(e[rng.integers(e.size)] <= width)
                shares.append(np.mean(e <= width))
                errors.append(cases.rms(e))
            widths.append(width)
        if not widths:
            print(f"{name}: no model states a band", flush=True)
            continue
        print(f"{name}: band {NM * np.mean(widths):.1f} nm, error {NM * cases.rms(errors):.1f} nm "
              f"rms, {np.mean(shares):.1%} of all instants within, {len(widths)} of 12 models",
              flush=True)  # fmt: skip
    print(f"{np.mean(hits):.1%} of {len(hits)} instants by chance within the band")
    print(f"{unstated} of 60 models state none")
    bars.least("instants within the band, %", 100 * float(np.mean(hits)), 90.0)
    bars.most("instants within the band, %", 100 * float(np.mean(hits)), 99.0)


def turns(bars: Bars) -> None:
    """7: Eq. 12 with corners in the drive, and tracked; nm rms, largest of the seeds."""
    prediction_turns.measure_corners(SEEDS, bars)
    prediction_turns.measure_tracking(SEEDS, bars)


def public(bars: Bars) -> None:
    """8: a public operator with the parameters that are published with it, on the stack's
    recordings that it came with; rms without the mean, % of span."""
    folder = identify_faults.data_folder(ROOT)
    if folder is None:
        bars.cannot("public operator", "no recordings; set DEHYST_DATA")
        return
    one, other = (
        read_recording(folder / "recordings" / f"{name}.csv") for name in ("stack-1hz", "stack-am")
    )
    cut = int(0.6 * one.size)  # its parameters are fitted to rows 3151 to 3350, which are within
    model = identify([_part(one, slice(0, cut))]).model
    for rec, rows in ((one, slice(cut, None)), (other, slice(200, None))):
        ours = simulate(model, rec.t_s, rec.drive)
        theirs = public_operator.run(rec.drive)
        late = np.r_[theirs[:1], theirs[:-1]]  # sensor one sample late, as its author has it
        span = np.ptp(rec.displacement)
        a, b, c = (100 * np.std((rec.displacement - x)[rows]) / span for x in (ours, theirs, late))
        print(f"{rec.name}: {a:.3f} % (public {b:.3f}, a sample late {c:.3f})", flush=True)
        bars.most(f"{rec.name}: over the public operator's", a / min(b, c), 1.0)


PARTS = (paper, peer, bias, real, static, band, turns, public)


def main() -> int:
    """Run the named parts, or all."""
    bars, parts = Bars(), {part.__name__: part for part in PARTS}
    for name in sys.argv[1:] or parts:
        print(f"\n{parts[name].__doc__}")
        parts[name](bars)
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
