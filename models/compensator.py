"""The compensator: upcoming targets in, drive out, one sample at a time.

One object holds what is fixed (model, mode, limits); one state object holds what changes, in
arrays made once. `step` proposes a drive, `applied` tells which drive really went out (a limiter
or a converter's step may have changed it): the model's memory follows the applied drive.

    compensator = Compensator(model, period_s, drive_min, drive_max, slew_per_s)
    state = compensator.init(drive_now)
    compensator.step(state, window, n_valid, channels)
    state.result[DRIVE] ...
    compensator.applied(state, drive)
"""

from dataclasses import dataclass, field

import numpy as np

from dehyst.models.errors import BadInput
from dehyst.models.forward import forward_step
from dehyst.models.inverse_static import BEYOND_DRIVE, BEYOND_SATURATION, StaticInverse
from dehyst.models.inverse_static import static_inverse as make_static
from dehyst.models.model import Floats, Model
from dehyst.models.monotone import nearest_monotone
from dehyst.models.play import play_step

# Places in state.result.
DRIVE, PREDICTED, READING, MODE, FLAGS = range(5)

MODES = ("hold", "static", "causal", "preview")
HOLD, STATIC, CAUSAL, PREVIEW = range(4)

# Bits in state.result[FLAGS]. The first two are those of the static inverse.
FLAG_BEYOND_SATURATION = BEYOND_SATURATION
FLAG_BEYOND_DRIVE = BEYOND_DRIVE
FLAG_SLEW = 4  # the drive could not follow fast enough
FLAG_STARVED = 8  # fewer targets than the mode needs
FLAG_BAD_TARGET = 16  # the target is not a finite number: held
FLAG_OUTSIDE_VALIDITY = 32  # the drive left the range or rate that the model was identified in
FLAG_NAMES = {
    FLAG_BEYOND_SATURATION: "target beyond the saturation",
    FLAG_BEYOND_DRIVE: "target beyond the drive range",
    FLAG_SLEW: "limited by the slew rate",
    FLAG_STARVED: "preview too short",
    FLAG_BAD_TARGET: "target not finite",
    FLAG_OUTSIDE_VALIDITY: "outside the model's validity",
}


@dataclass
class CompensatorState:
    """What changes from sample to sample. h: (n,) plays of the hysteresis after drive `last[0]`;
    last: (2,) applied drive and the one before; result: (5,) see DRIVE ... FLAGS."""

    h: Floats
    last: Floats
    result: Floats = field(default_factory=lambda: np.zeros(5))
    pending: bool = False


class Compensator:
    """Inverts a model within a loop of fixed period.

    model: any model; where it is not monotone the nearest monotone model is inverted, and
    `price` is their rms difference [displacement unit]. period_s: the loop's period; drive_min,
    drive_max, slew_per_s: limits that every proposed drive keeps [drive unit, drive unit / s].
    mode: "auto", "static", "causal" or "preview"; preview_s: longest look-ahead.
    Raises BadInput on bad arguments.

    `mode`, `reason`: what was chosen and why; `latency_s`: by how much targets must be known
    ahead; `window_samples`: how many targets `step` looks at; `channels`: names of the further
    channels that `step` needs, in order.
    """

    def __init__(
        self,
        model: Model,
        period_s: float,
        drive_min: float,
        drive_max: float,
        slew_per_s: float,
        mode: str = "auto",
        preview_s: float = 0.1,
    ) -> None:
        if not period_s > 0:
            raise BadInput(f"period_s: must be greater than 0, not {period_s:g}")
        if not drive_min < drive_max:
            raise BadInput(f"drive_min: {drive_min:g} must be below drive_max, {drive_max:g}")
        if not slew_per_s > 0:
            raise BadInput(f"slew_per_s: must be greater than 0, not {slew_per_s:g}")
        if mode not in ("auto", *MODES[1:]):
            raise BadInput(f"mode: one of auto, {', '.join(MODES[1:])} is needed, not {mode!r}")
        self.model, self.period_s = model, period_s
        self.drive_min, self.drive_max, self.slew_per_s = drive_min, drive_max, slew_per_s
        monotone, self.price = nearest_monotone(model)
        self.static: StaticInverse = make_static(monotone, drive_min, drive_max)
        self.mode, self.reason = "static", "rate-independent model"
        self.latency_s, self.window_samples = 0.0, 1
        self.channels: tuple[str, ...] = ()

    def init(self, drive_now: float, displacement: float | None = None) -> CompensatorState:
        """State for a stage that stands at drive_now, driven there from de-energised."""
        h = np.zeros(self.model.hysteresis.n)
        play_step(self.model.hysteresis.r, h, drive_now - self.model.hysteresis.u_offset)
        state = CompensatorState(h, np.full(2, float(drive_now)))
        self._predict(state, drive_now)
        return state

    def step(self, state: CompensatorState, window: Floats, n_valid: int, channels: Floats) -> None:
        """Propose a drive: writes state.result. window: (P,) targets from the present one on, of
        which n_valid count; channels: values in the order of `self.channels`."""
        if state.pending:
            self.applied(state, state.result[DRIVE])
        last = state.last[0]
        flags, used = 0, STATIC
        drive = last
        if n_valid < 1:
            flags, used = FLAG_STARVED, HOLD
        elif not np.isfinite(window[0]):
            flags, used = FLAG_BAD_TARGET, HOLD
        else:
            drive, flags = self.static.step(state.h, last, window[0])
        travel = self.slew_per_s * self.period_s
        if abs(drive - last) > travel:
            drive = last + travel if drive > last else last - travel
            flags |= FLAG_SLEW
        self._predict(state, drive)
        state.result[MODE], state.result[FLAGS] = used, flags
        state.pending = True

    def applied(self, state: CompensatorState, drive: float) -> None:
        """The drive that really went out; the model's memory follows it."""
        state.last[1], state.last[0] = state.last[0], drive
        self._predict_into(state, drive, state.h)
        state.pending = False

    def _predict(self, state: CompensatorState, drive: float) -> None:
        self._predict_into(state, drive, state.h.copy())

    def _predict_into(self, state: CompensatorState, drive: float, h: Floats) -> None:
        m = self.model.hysteresis
        y = forward_step(m.r, m.b, m.k, m.c, m.u_offset, h, drive, 0.0)
        state.result[DRIVE], state.result[PREDICTED], state.result[READING] = drive, y, y
