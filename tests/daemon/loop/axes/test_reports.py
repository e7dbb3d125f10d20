"""The sample in which an amplifier is asked for its report: if there is no time for a set and the
report, the output stays for this sample and moves on in the next one. In virtual time."""

import numpy as np
import pytest
from tests.rigs.two_loops import Rig, setpoint

from dehyst.daemon.loop.python_loop import PythonLoop
from dehyst.daemon.loop.readback import ReadbackCheck
from dehyst.drivers.simulated.devices import SimulatedActuator, SimulatedSensor

STEP_V = 4.0  # 4000 V/s at 1 kHz


class Reporting(SimulatedActuator):
    """An amplifier that can report its output; lists the calls."""

    def __init__(self, *given: object) -> None:
        super().__init__(*given)  # type: ignore[arg-type]
        self.done: list[str] = []

    def write(self, volts: float) -> None:
        super().write(volts)
        self.done.append("set")

    def readback(self) -> float:
        self.done.append("report")
        return self.output()


@pytest.mark.parametrize("room", [True, False])
def test_a_report_takes_the_place_of_a_set_where_both_do_not_fit(room: bool) -> None:
    settings = {"stage": f"report-{room}", "period_s": 1e-3}
    amplifier = Reporting.from_settings(settings)
    devices = amplifier, SimulatedSensor.from_settings(settings)
    for device in devices:
        device.open()
    rig = Rig(f"report-{room}", devices=devices)
    runner = PythonLoop(
        rig.monitor,
        rig.clock.now,
        rig.clock.sleep_until,
        ReadbackCheck(2.0, 0.0),
        crowded={} if room else {0: (0,)},
    )
    for i in range(175):  # 5.25 s, always in motion: one report in 5 s
        rig.rings["command"].push_many(setpoint((9.0, 2.0)[i % 2]))
        runner.run(rig.monitor.samples + 30)
    records = rig.rings["telemetry"].read(0)[0]
    reports = [k for k, what in enumerate(amplifier.done) if what == "report"]
    assert len(reports) == 1
    sample = int(np.flatnonzero(records["flags"] & 16)[0])  # no gauge is read in that sample
    assert len(amplifier.done) == records.size + (1 if room else 0)
    steps = np.abs(np.diff(records["volts"]))
    assert (steps[sample - 1] > 0.0) == room
    assert steps[sample - 2] > 0.0
    assert steps[sample] > 0.0
    assert steps.max() <= STEP_V + 1e-9
    assert np.unique(records["state"][1:]).tolist() == [2]  # RUNNING throughout
