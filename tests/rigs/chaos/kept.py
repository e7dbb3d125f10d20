"""A running rig of the chaos tests for one fault after another, rebuilt after a failure."""

from collections.abc import Callable
from pathlib import Path

from tests.rigs.chaos import faults
from tests.rigs.chaos.rig import Rig
from tests.rigs.stage_model import kept_model

from dehyst.daemon.files.models import save_model


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
        """Apply a fault; if it fails, a new rig is built for the next one."""
        in_order = False
        try:
            outcome = faults.inflict(self._running(), self._recording, fault, **options)
            in_order = True
            return outcome
        finally:
            if not in_order:
                self.close()

    def close(self) -> None:
        """Close the rig; the next user gets a new one."""
        rig, self._rig = self._rig, None
        if rig is not None:
            rig.close()
