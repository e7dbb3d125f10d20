"""Digests of numerical results, to compare before and after a change that must not alter them.

    python -m tests.benchmarks.models.digests > before.txt
    python -m tests.benchmarks.models.digests --only forward static

It prints one line per section: its name, the number of arrays and the SHA-256 of their bytes.
Versions that agree to the last bit print the same lines. Random models are generated from seeds
(tests.rigs.random_models); recordings and round 1 are read from $DEHYST_DATA, else ../shared.
"""

import argparse
import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: one order of summation

import numpy as np
from tests.rigs.random_models import driven, random_case

from dehyst.daemon.files.recordings import read_recording
from dehyst.models.cascade.simulate import simulate as simulate_model
from dehyst.models.diagnosis import diagnose
from dehyst.models.errors import DehystError, NotInvertible
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.identify import Options, identify
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.inverse.offline import invert_trajectory
from dehyst.models.inverse.static import static_inverse
from dehyst.models.mismatch.monitor import MismatchMonitor
from dehyst.models.modelfile import dumps, shipped
from dehyst.models.recording import Recording

DATA = Path(os.environ.get("DEHYST_DATA", Path(__file__).resolve().parents[4] / "shared"))
Arrays = Iterator[np.ndarray]


def recordings() -> Iterator[Recording]:
    for path in sorted((DATA / "recordings").glob("*.csv")):
        yield read_recording(path, need_displacement=True)


def text(words: str) -> np.ndarray:
    return np.frombuffer(words.encode(), np.uint8)


def forward(models: int) -> Arrays:
    """Return the drive along the target's own samples, scaled to the range."""
    for seed in range(models):
        model, target, period, *_ = random_case(seed)
        v = model.validity
        low, high = target.min(), target.max()
        part = (target - low) / max(high - low, 1e-300)
        yield simulate_hysteresis(
            model.hysteresis, v.drive_min + part * (v.drive_max - v.drive_min), period
        )
    for recording in recordings():
        for name in ("paper-eq11", "paper-eq12"):
            h = shipped(name).hysteresis
            u = recording.drive
            u = 10 * (u - np.nanmin(u)) / np.ptp(u[np.isfinite(u)])
            yield simulate_hysteresis(h, u, recording.period_s)


def static(models: int) -> Arrays:
    for seed in range(models):
        model, target, *_ = random_case(seed)
        try:
            inverse = static_inverse(model)
        except NotInvertible as error:
            yield text(str(error))
            continue
        at = model.validity.drive_min
        start = np.zeros(model.hysteresis.r.size)
        yield from inverse.run(target, start, at)


def moded(mode: str, models: int) -> Arrays:
    for seed in range(models):
        model, target, period, slew, _, starves = random_case(seed)
        v = model.validity
        c = Compensator(model, period, v.drive_min, v.drive_max, slew, mode, 0.1)
        yield driven(c, target, starves, v.drive_min)


def trajectory(models: int) -> Arrays:
    for seed in range(0, models, 20):
        model, target, period, slew, *_ = random_case(seed)
        v = model.validity
        c = Compensator(model, period, v.drive_min, v.drive_max, slew, "preview", 0.1)
        yield invert_trajectory(c, target).drive


def identified(models: int) -> Arrays:
    for recording in recordings():
        for options in (Options(), Options(rate=False)):
            try:
                yield text(dumps(identify([recording], options).model))
            except DehystError as error:
                yield text(str(error))


def diagnosed(models: int) -> Arrays:
    folders = sorted((DATA / "concealed" / "round-1").glob("case-*"))
    for folder in folders[: max(1, min(len(folders), models // 50))]:
        given = [
            read_recording(folder / n, need_displacement=True)
            for n in ("identify.csv", "check.csv", "hold.csv")
        ]
        found = diagnose(given)
        yield text(json.dumps(found.to_dict(), sort_keys=True))
        held = read_recording(folder / "holdout.csv")
        yield simulate_model(found.model, held.t_s, held.drive, held.channels)


def watched(models: int) -> Arrays:
    for recording in recordings():
        try:
            model = identify([recording], Options(rate=False)).model
        except DehystError as error:
            yield text(str(error))
            continue
        u, period = recording.drive, recording.period_s
        v = model.validity
        c = Compensator(model, period, v.drive_min, v.drive_max, 1e9, "static", 0.1)
        state = c.init(float(u[0]))
        predicted = np.empty(u.size)
        for i, x in enumerate(u.tolist()):
            predicted[i] = state.reading
            c.applied(state, x)
        watch = MismatchMonitor(model, period)
        per = max(1, round(1.0 / period))
        for lap in range(12):
            for i in range(0, u.size - per, per):
                part = slice(i, i + per)
                y = recording.displacement[part]
                watch.update(u[part], predicted[part], y, np.isfinite(y))
            yield np.array([lap, watch.health, watch.learning, *watch.thresholds.values()])


SECTIONS: dict[str, Callable[[int], Arrays]] = {
    "forward": forward,
    "static": static,
    "preview": lambda n: moded("preview", n),
    "causal": lambda n: moded("causal", n),
    "trajectory": trajectory,
    "watch": watched,
    "identify": identified,
    "diagnosis": diagnosed,
}


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--models", type=int, default=1000, help="random models (default 1000)")
    args = parser.parse_args()
    for name in args.only:
        digest, count = hashlib.sha256(), 0
        for array in SECTIONS[name](args.models):
            digest.update(np.ascontiguousarray(array).tobytes())
            count += 1
        print(f"{name:11s} {count:5d} {digest.hexdigest()}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
