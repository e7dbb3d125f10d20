"""A step scan and a fly scan of the stage under bluesky's RunEngine.

Start a daemon first (`dehyst run`), `pip install 'dehyst[bluesky]'`, then:
python docs/examples/bluesky_scan.py
"""

import bluesky.plan_stubs as do
import bluesky.plans as plans
import numpy as np
from bluesky import RunEngine
from bluesky.preprocessors import run_decorator

from dehyst.bluesky import Stage
from dehyst.client import DehystError


@run_decorator()
def fly(stage: Stage, t_s: np.ndarray, target: np.ndarray):
    """One run with every sample of a trajectory."""
    yield from do.prepare(stage, (t_s, target), wait=True)
    yield from do.kickoff(stage, wait=True)
    yield from do.complete(stage, wait=True)
    yield from do.collect(stage)


def main() -> None:
    """Five positions with their readings, then one second of a 2 Hz sine."""
    stage = Stage("stage", average_s=0.05)
    try:
        engine, events, pages = RunEngine(), [], []
        engine.subscribe(lambda _, document: events.append(document["data"]), "event")
        engine.subscribe(lambda _, document: pages.append(document["data"]), "event_page")
        low, high = stage.limits
        middle, radius = 0.5 * (low + high), 0.2 * (high - low)
        engine(plans.scan([stage], stage, middle - radius, middle + radius, 5))
        for event in events:
            print(f"set {event['stage_setpoint']:.3f}, read {event['stage']:.3f}")
        t_s = np.arange(0.0, 1.0, 0.005)
        engine(fly(stage, t_s, middle + radius * np.sin(4 * np.pi * t_s)))
        error = np.subtract(pages[0]["stage"], pages[0]["stage_setpoint"])
        print(f"{error.size} samples of the flight, rms error {np.std(error):.4f}")
    finally:
        stage.close()


if __name__ == "__main__":
    try:
        main()
    except DehystError as error:  # no daemon, or a refusal: the text gives the reason
        raise SystemExit(str(error)) from None
