"""A running rig of the chaos tests for one fault after another, rebuilt after a failure."""

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.rigs.chaos import commands, faults, pairs, units
from tests.rigs.chaos.rig import Rig
from tests.rigs.processes import ATTEMPTS, say_repeated
from tests.rigs.stage_model import kept_model

from dehyst.daemon.files.models import save_model

SPARING: tuple[Callable[..., str], ...] = (
    faults.sensor_invalid,
    faults.sensor_range,
    faults.sensor_unplug,
    faults.disk_read_only,
    faults.clock_stepped,
    faults.model_files,
    commands.two_clients,
    pairs.sensor_lost_while_reloading,
    units.gauge_damaged,
    units.gauge_foreign,
)
"""Faults that do not concern the amplifier, and after which the loop must never have faulted."""


class KeptRig:
    """A rig that is kept between faults. make: builds the rig in a folder with a model."""

    def __init__(self, place: Callable[[], Path], make: Callable[[Path, Path], Rig] = Rig) -> None:
        self._place, self._make = place, make
        self._rig: Rig | None = None

    def _running(self) -> Rig:
        if self._rig is None:
            folder = self._place()
            model = folder / "identified.toml"
            save_model(kept_model(), model)
            self._rig = self._make(folder, model)
            self._recording = folder / "whole.csv"
            self._rig.run()
            self._rig.record(self._recording)
        return self._rig

    def inflict(self, fault: Callable[..., str], **options: float) -> faults.Outcome:
        """Apply a fault; if it fails, a new rig is built for the next one. If it fails because the
        machine stood still, it is repeated, ATTEMPTS times in all; then it is not judged."""
        why = ""
        for attempt in range(ATTEMPTS):
            if attempt:
                say_repeated(fault.__name__, why)
            in_order = False
            try:
                outcome = faults.inflict(self._running(), self._recording, fault, **options)
                in_order = True
                return outcome
            except AssertionError:
                why = self._excuse(fault)
                if not why:
                    raise
            finally:
                if not in_order:
                    self.close()
        pytest.skip(f"not judged, {ATTEMPTS} times: {why}")

    def _excuse(self, fault: Callable[..., str]) -> str:
        """Return what shows that the machine stood still and the amplifier therefore timed out,
        during a fault that does not concern it; "" if nothing does."""
        rig = self._rig
        if rig is None or rig.listener is None or fault not in SPARING:
            return ""
        late = [e for e in rig.events().splitlines() if e.startswith("actuator: DeviceTimeout")]
        pause_s = rig.witness.longest_s(rig.since_ns)
        if not late or not pause_s:
            return ""
        return f"the machine stood still for {pause_s:.1f} s, and {late[0]}"

    def close(self) -> None:
        """Close the rig; the next user gets a new one."""
        rig, self._rig = self._rig, None
        if rig is not None:
            rig.close()
