"""Predicts the readings with a model that is not in use: advances it along the written voltages,
sample by sample, as the loop does with the model that it runs."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.config import Config
from dehyst.daemon.config.drives import drive_range
from dehyst.models.errors import DehystError
from dehyst.models.inverse.compensator import Compensator, CompensatorState
from dehyst.models.model import Floats, Model
from dehyst.models.physics import split_off_one_recording

LED_SAMPLES = 20_000
"""Past samples along which a model is advanced first, as many as the loop uses for a new model."""
Past = Callable[[int, int], NDArray[Any]]
"""Takes (first, end); returns the TELEMETRY samples first <= seq < end that are still kept."""


class PreviousModel:
    """The model used before the one on trial. Models with further input channels are not advanced,
    as the telemetry does not contain these inputs."""

    def __init__(self, config: Config, model: Model, past: Past) -> None:
        self._gain, self._past = config.actuator.gain, past
        self._compensator: Compensator | None = None
        model, _ = split_off_one_recording(model)
        try:
            low, high = drive_range(config, model)
            slew = config.limits.slew_v_per_s / self._gain
            made = Compensator(model, config.period_ns * 1e-9, low, high, slew, "static")
        except (DehystError, ValueError, ArithmeticError):
            return
        if not made.channels:
            self._compensator = made
        self._state: CompensatorState | None = None
        self._next = -1

    def expect(self, samples: NDArray[Any]) -> Floats:
        """Return the (n,) predicted readings from the model's own origin; NaN where it cannot be
        advanced."""
        out = np.full(samples.size, np.nan)
        compensator = self._compensator
        if compensator is None or not samples.size:
            return out
        for k, (seq, volts) in enumerate(zip(samples["seq"], samples["volts"], strict=True)):
            state = self._state
            if state is None or seq != self._next:
                state = self._state = self._begin(compensator, int(seq))
            if state is not None:
                out[k] = state.reading
                if np.isfinite(volts):
                    compensator.applied(state, float(volts) / self._gain)
            self._next = int(seq) + 1
        return out

    def _begin(self, compensator: Compensator, end: int) -> CompensatorState | None:
        """Return the state after the samples before number `end`; None: there are none."""
        past = self._past(end - LED_SAMPLES, end)["volts"]
        drives = past[np.isfinite(past)] / self._gain
        if not drives.size:
            return None
        state = compensator.init(float(drives[0]))
        for drive in drives.tolist():
            compensator.applied(state, drive)
        return state
