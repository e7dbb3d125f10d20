"""A scan and a flight of an ophyd-async motor under bluesky's RunEngine, as at a beamline."""

import sys

import bluesky.plan_stubs as bps
import bluesky.plans as bp
from bluesky.run_engine import RunEngine
from ophyd_async.core import FlyMotorInfo, init_devices
from ophyd_async.epics.motor import Motor


def fly(motor):
    """Fly from 3 to 5 um at 1 um/s."""
    yield from bps.open_run()
    yield from bps.prepare(
        motor, FlyMotorInfo(start_position=3.0, end_position=5.0, time_for_move=2.0), wait=True
    )
    yield from bps.kickoff(motor, wait=True)
    yield from bps.complete(motor, wait=True)
    yield from bps.close_run()


engine = RunEngine({})
seen = []
engine.subscribe(lambda name, doc: seen.append((name, doc)))
with init_devices():
    motor = Motor(sys.argv[1], name="stage")
engine(bp.scan([], motor, 3.0, 5.0, 3))
readings = [doc["data"]["stage"] for name, doc in seen if name == "event"]
assert len(readings) == 3, readings
assert all(abs(r - p) < 0.5 for r, p in zip(readings, (3.0, 4.0, 5.0), strict=True)), readings
engine(fly(motor))
print("scanned and flown", readings)
