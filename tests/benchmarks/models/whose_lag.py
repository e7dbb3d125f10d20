"""Whose lag is it? A lag before the hysteresis is compensated; one after it belongs to the sensor
and is not. The side must be reported correctly, or be reported as in doubt.

    python -m tests.benchmarks.models.whose_lag [--from SEED] [--lags MS ...] [--stage plane]

A static stage whose drive or sensor has a first-order lag, simulated in steps of a tenth of the
sampling period, so that neither the lag nor the hysteresis comes from the product. Five waveforms
of 12 s at 200 Hz over the full range, each with 20 and with 45 nm noise. Ends with 0, 1 or 77 as
tests/benchmarks/bars.py says.
"""

import argparse
import sys
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from tests.benchmarks.bars import Bars  # noqa: E402
from tests.benchmarks.models import prediction_cases as cases  # noqa: E402

from dehyst.models.identify import Identification, identify  # noqa: E402
from dehyst.models.recording import Floats, Recording  # noqa: E402

PERIOD_S, SECONDS, FULL_V, FINE = 5e-3, 12.0, 10.0, 10
LAGS_MS = (2.0, 5.0, 10.0, 20.0, 30.0)
LONG_MS = 20.0  # from here on the difference of the sides exceeds the noise of these recordings
NOISES_UM = (0.020, 0.045)
DRIVES = ("decaying sine", "two sines", "random", "triangle", "sweep")
STAGES = ("smooth", "plane")
FIRST_SEED = 98000  # nothing was tuned on these
SIDES = ("drive", "sensor")


def make_drive(name: str, t: Floats, rng: np.random.Generator) -> Floats:
    """Return (N,) a drive from 0 V over the full range; frequencies and sizes are random."""
    f = float(rng.uniform(1.0, 3.0))
    size = np.interp(t / t[-1], [0.0, 0.2, 0.6, 1.0], [1.0, 1.0, 0.15, 1.0])
    if name == "decaying sine":
        u = 1.0 - size * np.cos(2 * np.pi * f * t)
    elif name == "two sines":
        u = 2.0 - np.cos(2 * np.pi * f * t) - np.cos(2 * np.pi * f * rng.uniform(1.3, 2.5) * t)
    elif name == "random":  # linear between random levels
        at = np.cumsum(rng.uniform(0.08, 0.5, 200))
        u = np.interp(t, np.r_[0.0, at], np.r_[0.0, rng.uniform(0.0, 1.0, 200)])
    elif name == "triangle":
        u = 1.0 - size * (2.0 * np.abs(2.0 * ((f * t) % 1.0) - 1.0) - 1.0)
    else:
        u = 1.0 - np.cos(2 * np.pi * (0.5 * t + (6.0 - 0.5) / (2 * t[-1]) * t**2))
    u = u - u.min()
    return u / u.max() * FULL_V * np.minimum(1.0, t / 0.25)


def pass_on(x: Floats, tau_s: float, step_s: float) -> Floats:
    """Return (N,) the signal after a first-order lag, initially settled."""
    keep = float(np.exp(-step_s / tau_s))
    return x[0] + lfilter([1.0 - keep], [1.0, -keep], x - x[0])


def record(
    stage: str, drive: str, side: str, tau_s: float, noise_um: float, seed: int
) -> Recording:
    """Make one recording."""
    rng = np.random.default_rng(seed)
    step = PERIOD_S / FINE
    t = cases.times(SECONDS, step)
    u = make_drive(drive, t, rng)
    run = cases.smooth().run if stage == "smooth" else cases.preisach
    v = pass_on(u, tau_s, step) if side == "drive" else u
    y = run(v)
    y = pass_on(y, tau_s, step) if side == "sensor" else y
    y = y[::FINE]
    y = y + noise_um * rng.standard_normal(y.size)
    return Recording(t[::FINE], u[::FINE], y, name=f"seed-{seed}.csv")


@dataclass(frozen=True)
class Told:
    """The result of an identification. side: "drive", "sensor" or "none"; delay_s: delay of a slow
    move; doubt: it reports that the sides cannot be distinguished."""

    side: str
    delay_s: float
    doubt: bool
    words: str


def read(found: Identification) -> Told:
    """Extract the result of an identification."""
    doubt = any(
        "cannot show whether the drive or the sensor causes it" in note for note in found.notes
    )
    blocks = [b for b in found.model.blocks if b.kind in ("lag", "delay", "resonance")]
    if not blocks:
        return Told("none", 0.0, doubt, found.shape.name)
    delay = 0.0
    for one in blocks:
        p = one.params
        if one.kind == "resonance":
            delay += float(p["damping"]) / (np.pi * float(p["frequency_hz"]))
        else:
            delay += float(p["tau_s" if one.kind == "lag" else "delay_s"])
    one = blocks[-1]  # before it, a delay of a period where its input is held
    return Told(one.place, delay, doubt, f"{one.kind} {one.place}; {found.shape.name}")


def judge(stage: str, side: str, ms: float, first: int) -> list[Told]:
    """Run all waveforms and noises of one lag, and print a line for each."""
    out = []
    for number, (drive, noise) in enumerate(product(DRIVES, NOISES_UM)):
        seed = first + number
        reported = read(identify([record(stage, drive, side, 1e-3 * ms, noise, seed)]))
        out.append(reported)
        print(
            f"  {ms:4g} ms of the {side:6} {drive:14} {1e3 * noise:3.0f} nm: "
            f"{1e3 * reported.delay_s:6.2f} ms, {reported.words}"
            f"{', in doubt' if reported.doubt else ''}",
            flush=True,
        )
    return out


def main() -> int:
    """Run all lags on both sides; print a line for each, and the bars."""
    parser = argparse.ArgumentParser(description="Whose lag is it?")
    parser.add_argument("--from", dest="first", type=int, default=FIRST_SEED)
    parser.add_argument("--lags", type=float, nargs="+", default=LAGS_MS, metavar="MS")
    parser.add_argument("--stage", default="smooth", choices=STAGES)
    args = parser.parse_args()
    bars, lines = Bars(), []
    silent, right, long, off = 0, 0, 0, []
    for ms, side in product(args.lags, SIDES):
        rows = judge(args.stage, side, ms, args.first)
        good = [x for x in rows if x.side == side]
        other = [x for x in rows if x.side not in (side, "none")]
        mute = sum(not x.doubt for x in other)
        errors = [abs(1e3 * x.delay_s / ms - 1.0) for x in rows if x.side != "none"]
        lines.append(
            f"| {ms:g} ms of the {side} | {len(good)} | {sum(x.doubt for x in good)} | "
            f"{len(other)} | {mute} | {len(rows) - len(good) - len(other)} | "
            f"{np.median(errors or [np.nan]):.1%} | {max(errors, default=np.nan):.1%} |"
        )
        silent += mute
        if ms >= LONG_MS:
            long, right, off = long + len(rows), right + len(good), off + errors
    print("| lag | side right | of these in doubt | other side | of these without a word | "
          "no lag | error of tau, median | largest |")  # fmt: skip
    print("\n".join(["|---" * 8 + "|", *lines]))
    count = 10 * len(SIDES) * len(args.lags)
    bars.most(f"other side without a word, of {count}", silent, 0.05 * count)
    if long:
        known = len(off)
        print(f"no lag is chosen in {long - known} of {long} from {LONG_MS:g} ms on")
        bars.least(f"side right, of {known} such lags that are chosen", right, 0.8 * known)
        bars.most("median error of these lags", 100 * float(np.median(off or [np.nan])), 3.0, "%")
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
