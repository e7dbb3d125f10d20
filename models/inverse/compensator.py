"""Convert upcoming targets into a drive, one sample at a time.

`Compensator` holds what is fixed (model, mode, limits); `CompensatorState` holds what changes, in
preallocated arrays. `step` proposes a drive; `applied` takes the drive that was really applied (a
limiter or the converter's resolution may have changed it). The model's memory follows the applied
drive.

    compensator = Compensator(model, period_s, drive_min, drive_max, slew_per_s)
    state = compensator.init(drive_now)
    compensator.step(state, window, n_valid, channels)
    state.drive ...
    compensator.applied(state, drive)

If fewer targets arrive than the mode needs, the targets known from the previous sample are still
used and the plan is followed along them; when they run out, the static inverse takes over. A sample
without a known target holds the drive.
"""

import math

import numpy as np
from numpy.typing import NDArray

from dehyst.models.addresses import Addresses
from dehyst.models.cascade.step import lead_drive, pack, with_delays_behind
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.hysteresis.monotone import nearest_monotone
from dehyst.models.hysteresis.operators import operators
from dehyst.models.hysteresis.play import play_step
from dehyst.models.inverse import lookahead, preview, sample
from dehyst.models.inverse.choice import (
    check_inverse_settings,
    choose_mode,
    limits_of,
    mean_slope,
    noise_of,
)
from dehyst.models.inverse.state import FRAME, RESULT, SETTING, STATE, Inverse, Nodes
from dehyst.models.inverse.static import static_inverse
from dehyst.models.inverse.tuning import TUNING
from dehyst.models.model import Floats, Model

FLAG_NAMES = {
    sample.BEYOND_SATURATION: "target beyond the saturation",
    sample.BEYOND_DRIVE: "target beyond the drive range",
    sample.SLEW: "limited by the slew rate",
    sample.STARVED: "fewer targets ahead than the mode needs",
    sample.BAD_TARGET: "target not finite: held",
    sample.OUTSIDE: "outside the range or rate that the model was identified in",
}
"""What each bit of the state's flags means."""


class CompensatorState:
    """State that changes from sample to sample. inverse: all arrays that the kernels use; table:
    their addresses, for compiled callers; pending: a drive is proposed and not yet applied."""

    def __init__(self, inverse: Inverse) -> None:
        self.inverse, self.pending = inverse, False
        self.table = Addresses.of(inverse)
        self.address = self.table.address

    @property
    def drive(self) -> float:
        """Return the drive that was proposed or applied last."""
        return float(self.inverse.result["drive"][0])

    @property
    def predicted(self) -> float:
        """Return the displacement of the stage that the model predicts for that drive."""
        return float(self.inverse.result["predicted"][0])

    @property
    def reading(self) -> float:
        """Return the sensor reading that the model predicts for that drive."""
        return float(self.inverse.result["reading"][0])

    @property
    def mode(self) -> int:
        """Return how the drive was computed: HOLD, STATIC, CAUSAL or PREVIEW."""
        return int(self.inverse.result["mode"][0])

    @property
    def flags(self) -> int:
        """Return the flags as bits of FLAG_NAMES."""
        return int(self.inverse.result["flags"][0])

    @property
    def channels(self) -> Floats:
        """Return (n_channels,) newest values of the model's further channels; NaN: not measured."""
        return self.inverse.channels


class Compensator:
    """Invert a model within a loop of fixed period.

    model: any model; where its weights are not monotone, the static inverse inverts the nearest
    monotone model, and `price` is their rms difference [displacement unit]. period_s: the loop's
    period; drive_min, drive_max, slew_per_s: limits that every proposed drive respects
    [drive unit, drive unit / s]; the model's validity narrows them further (`low`, `high`,
    `rate`). mode: "auto", "static", "causal" or "preview"; preview_s: longest look-ahead.
    Raises BadInput on bad arguments.

    `mode`, `reason`: the mode that was chosen, and why; `latency_s`: how far ahead targets must be
    known; `window_samples`: how many targets `step` reads; `channels`: names of the further
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
        check_inverse_settings(period_s, drive_min, drive_max, slew_per_s, mode, preview_s)
        self.model, self.period_s = model, period_s
        self._packed = pack(with_delays_behind(model), period_s, TUNING.node_s)
        self.channels = self._packed.channels
        packed = self._packed
        self.low, self.high, self.rate = limits_of(model, packed, drive_min, drive_max, slew_per_s)
        monotone, self.price = nearest_monotone(model)
        self.static = static_inverse(monotone, self.low, self.high)
        self.mode, self.reason, self.planned = choose_mode(
            model, packed.dynamic, self.price, mode, preview_s
        )
        looks = self.mode == "preview"
        nodes, per_node, self.window_samples = 4, 1, 2 if looks else 1
        if self.planned:
            seconds = preview_s if looks else TUNING.causal_window_s
            nodes, per_node = preview.nodes_of(seconds, period_s)
            self.window_samples = nodes * per_node if looks else 1
        late = packed.delay_s / period_s if looks else 0.0
        self.window_samples += math.ceil(late)
        self.latency_s = (self.window_samples - 1) * period_s
        h = model.hysteresis
        self.hysteresis = operators(h, self.static.b)
        self.slope = mean_slope(model, self.low, self.high)
        self.noise = noise_of(model, self.slope, self.low, self.high)
        self.delay_s, self.chain = packed.delay_s, packed.chain
        self.has_stage_blocks = packed.on_stage
        v = model.validity
        self._setting = np.zeros(1, SETTING)
        for name, value in {
            "rate": self.rate,
            "period": period_s,
            "noise": self.noise,
            "slope": self.slope,
            "late": late,
            "valid_low": v.drive_min,
            "valid_high": v.drive_max,
            "valid_rate": v.rate_max if v.rate_max and not h.static else math.inf,
            "per_node": per_node,
            "planned": self.planned,
            "wanted": self.window_samples if looks else 0,
            "stage_blocks": self.has_stage_blocks,
            "beside": packed.has_parallel_blocks,
        }.items():
            self._setting[name] = value
        self._nodes, self._per_node = nodes, per_node

    def init(self, drive_now: float) -> CompensatorState:
        """Return the state of a stage at drive_now that was driven there from de-energised."""
        h = self.model.hysteresis
        plays, nodes = np.zeros(h.n), self._nodes
        play_step(h.r, plays, drive_now - h.u_offset)
        y = float(simulate_hysteresis(h, np.array([drive_now], np.float64), 1.0, plays)[0])
        blocks = self._packed.settle(drive_now, y)
        numbers = np.zeros(1, STATE)
        for name in ("last", "command", "x_0", "x_before"):
            numbers[name] = drive_now
        numbers["target"], numbers["time"] = np.nan, -self.period_s
        smooth = preview.smoothness(nodes, self._per_node * self.period_s, self.slope)
        state = CompensatorState(
            Inverse(
                hysteresis=self.hysteresis,
                chain=self.chain,
                static=self.static.tables,
                nodes=Nodes(
                    target=np.zeros(nodes),
                    trust=np.zeros(nodes),
                    smooth=smooth,
                    rows=np.zeros((4, nodes)),
                    bands=np.zeros((4, nodes)),
                    frame=np.zeros(1, FRAME),
                ),
                setting=self._setting,
                state=numbers,
                result=np.zeros(1, RESULT),
                plays=plays,
                ahead_plays=np.zeros(h.n),
                static_plays=np.zeros(h.n),
                after_plays=np.zeros(h.n),
                plan=np.zeros(nodes),
                trial=np.zeros(nodes),
                blocks=blocks,
                scratch=blocks.copy(),
                ahead=np.zeros(self.window_samples),
                ring=np.zeros(4 * self._per_node + 8),
                seq=np.zeros(lookahead.PAST + nodes),
                y=np.zeros(5),
                channels=np.full(len(self.channels), np.nan),
                targets=np.zeros(self.window_samples + 1),
            )
        )
        self.applied(state, drive_now)
        return state

    def step(self, state: CompensatorState, window: Floats, n_valid: int, channels: Floats) -> None:
        """Propose a drive in state.drive. window: (P,) targets from the present one on, of which
        the first n_valid are valid; channels: values in the order of `self.channels`."""
        if state.pending:
            self.applied(state, state.drive)
        if state.channels.size:
            state.channels[:] = channels[: state.channels.size]
        sample.step_at(state.address, window, n_valid)
        state.pending = True

    def applied(self, state: CompensatorState, drive: float) -> None:
        """Advance the model's memory by one sample with the drive that was really applied."""
        sample.applied_at(state.address, drive, state.pending)
        state.pending = False

    def command(self, inside: Floats, start: float) -> Floats:
        """Return commands (N,), within the limits, that the drive blocks turn into `inside` (N,).

        The targets are assumed to compensate a delay of the drive already.
        """
        rate = np.gradient(inside, self.period_s) if inside.size > 1 else np.zeros(inside.size)
        out = np.empty(inside.size)
        now = start
        travel = self.rate * self.period_s
        for i in range(inside.size):
            u = lead_drive(self.chain, inside[i], rate[i])
            now = min(max(u, now - travel, self.low), now + travel, self.high)
            out[i] = now
        return out

    def outside(self, drive: Floats, start: float) -> NDArray[np.bool_]:
        """Return (N,) where a drive leaves the range or rate that the model was identified in."""
        v = self.model.validity
        rate = np.abs(np.diff(drive, prepend=start)) / self.period_s
        fast = rate > float(self._setting["valid_rate"][0]) * (1.0 + 1e-9)
        return fast | (drive < v.drive_min) | (drive > v.drive_max)
