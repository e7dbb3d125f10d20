"""The compensator: upcoming targets in, drive out, one sample at a time.

One object holds what is fixed (model, mode, limits); one state object holds what changes, in
arrays made once. `step` proposes a drive, `applied` tells which drive really went out (a limiter
or a converter's step may have changed it): the model's memory follows the applied drive.

    compensator = Compensator(model, period_s, drive_min, drive_max, slew_per_s)
    state = compensator.init(drive_now)
    compensator.step(state, window, n_valid, channels)
    state.result[DRIVE] ...
    compensator.applied(state, drive)

A sample without targets (n_valid = 0) holds. Fewer targets than the mode wants are continued from
the past (dehyst.models.inverse_causal), so that preview fades into causal without a jump.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dehyst.models import compensate
from dehyst.models import inverse_places as places
from dehyst.models import inverse_preview as pv
from dehyst.models.blocks import clip, slew
from dehyst.models.cascade_step import (
    AT_DRIVE,
    AT_STAGE,
    CODE,
    P_FROM,
    PLACE,
    Packed,
    lead_drive,
    pack,
)
from dehyst.models.errors import BadInput
from dehyst.models.forward import simulate
from dehyst.models.inverse_static import static_inverse
from dehyst.models.model import Floats, Model
from dehyst.models.monotone import nearest_monotone
from dehyst.models.play import play_step

# Places in state.result.
DRIVE, PREDICTED, READING, MODE, FLAGS = range(5)
MODES = ("hold", "static", "causal", "preview")
HOLD, STATIC, CAUSAL, PREVIEW = range(4)

# Bits in state.result[FLAGS].
FLAG_BEYOND_SATURATION = compensate.BEYOND_SATURATION
FLAG_BEYOND_DRIVE = compensate.BEYOND_DRIVE
FLAG_SLEW = compensate.SLEW
FLAG_STARVED = compensate.STARVED
FLAG_BAD_TARGET = compensate.BAD_TARGET
FLAG_OUTSIDE_VALIDITY = compensate.OUTSIDE
FLAG_NAMES = {
    FLAG_BEYOND_SATURATION: "target beyond the saturation",
    FLAG_BEYOND_DRIVE: "target beyond the drive range",
    FLAG_SLEW: "limited by the slew rate",
    FLAG_STARVED: "fewer targets ahead than the mode wants",
    FLAG_BAD_TARGET: "target not finite: held",
    FLAG_OUTSIDE_VALIDITY: "outside the range or rate that the model was identified in",
}

RATE_MARGIN = 1.25  # a rate-dependent model is used up to this multiple of its validity's rate
NOISE_SHARE = 0.004  # of the stroke, where the model states no noise
SWEEPS = 2
TOO_FAR = 0.1  # part of the stroke that the nearest monotone model may differ by
CAUSAL_WINDOW_S = 0.1


class Choice(NamedTuple):
    """mode: "static", "causal" or "preview"; reason: why, for telemetry; planned: whether a
    window of drive values is solved for, or the exact static inverse walks."""

    mode: str
    reason: str
    planned: bool


@dataclass
class CompensatorState:
    """What changes from sample to sample; see dehyst.models.compensate and inverse_preview.
    result: (5,) see DRIVE ... FLAGS; pending: a drive is proposed and not yet applied."""

    numbers: Floats
    plays: Floats
    work: Floats
    blocks: Floats
    scratch: Floats
    inner: Floats
    ring: Floats
    seq: Floats
    y: Floats
    result: Floats
    channels: Floats
    pending: bool = False


def choose(model: Model, price: float, mode: str, preview_s: float) -> Choice:
    """Which mode suits the model and the look-ahead that the stream can give.

    price: rms difference of the nearest monotone model; mode: "auto" or the user's wish.
    """
    h = model.hysteresis
    unit = model.displacement_unit
    stroke = _slope(model, model.validity.drive_min, model.validity.drive_max) * (
        model.validity.drive_max - model.validity.drive_min
    )
    if price > TOO_FAR * stroke:
        why = f"the weights are so far from monotone ({price:.3g} {unit} rms) that only the"
        return Choice("static", f"{why} nearest monotone model is of use", False)
    moving = [b.kind for b in model.blocks if b.place in ("drive", "stage")]
    dynamic = sorted({k for k in moving if k in ("delay", "lag", "resonance")})
    if not h.static:
        why = "the model depends on the rate"
        planned = True
    elif price > 0.0:
        why = f"the weights are not monotone (static alone costs {price:.3g} {unit} rms)"
        planned = True
    elif dynamic:
        why = f"the model has {' and '.join(dynamic)}"
        planned = False
    else:
        why, planned = "the model is rate-independent and monotone", False
        if mode == "auto":
            return Choice("static", why, False)
    if mode == "static":
        return Choice("static", "asked for", False)
    if mode == "auto":
        if not h.static or dynamic:
            mode = "preview" if preview_s > 0.0 else "causal"
            why += ", targets are known ahead" if preview_s > 0.0 else ", no look-ahead"
        else:
            mode = "static"
            planned = False
        return Choice(mode, why, planned)
    return Choice(mode, f"asked for; {why}", planned)


class Compensator:
    """Inverts a model within a loop of fixed period.

    model: any model; where its weights are not monotone the nearest monotone model is what the
    static inverse inverts, and `price` is their rms difference [displacement unit]. period_s: the
    loop's period; drive_min, drive_max, slew_per_s: limits that every proposed drive keeps
    [drive unit, drive unit / s]; the model's validity narrows them further (`low`, `high`,
    `rate`). mode: "auto", "static", "causal" or "preview"; preview_s: longest look-ahead.
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
        _check(period_s, drive_min, drive_max, slew_per_s, mode, preview_s)
        self.model, self.period_s = model, period_s
        self._packed = pack(model, period_s)
        self.channels = self._packed.channels
        self.low, self.high, self.rate = _limits(
            model, self._packed, drive_min, drive_max, slew_per_s
        )
        monotone, self.price = nearest_monotone(model)
        self.static = static_inverse(monotone, self.low, self.high)
        choice = choose(model, self.price, mode, preview_s)
        self.mode, self.reason, planned = choice
        per_node = max(1, round(pv.NODE_S / period_s)) if planned else 1
        late = self._packed.delay_s / period_s if self.mode == "preview" else 0.0
        wanted = 0
        if planned:
            seconds = preview_s if self.mode == "preview" else CAUSAL_WINDOW_S
            nodes = min(max(4, round(seconds / (per_node * period_s))), 2000)
            wanted = nodes if self.mode == "preview" else 0
            self.window_samples = nodes * per_node if wanted else 1
        else:
            nodes = 4
            self.window_samples = 2 if self.mode == "preview" else 1
        if self.mode == "preview":
            self.window_samples += math.ceil(late)
            wanted = wanted or self.window_samples - 1
        self.latency_s = (self.window_samples - 1) * period_s
        h = model.hysteresis
        b = self.static.branch
        self.weights = np.ascontiguousarray(np.stack([h.r, h.b, h.k, self.static.b]))
        self.c, self._knots = np.ascontiguousarray(h.c), np.ascontiguousarray(b.z_knots)
        self._weights, self._c = self.weights, self.c  # under these names for compiled callers
        self.slope = _slope(model, self.low, self.high)
        noise = model.fit.noise_rms or model.fit.rms or 0.0
        noise = max(noise, 1e-6 * self.slope * (self.high - self.low))
        if not (model.fit.noise_rms or model.fit.rms):
            noise = NOISE_SHARE * self.slope * (self.high - self.low)
        self.noise = noise
        fixed = np.zeros(places.N_FIXED)
        fixed[[places.U_OFFSET, places.Y_FIRST, places.Y_LAST]] = h.u_offset, b.y_first, b.y_last
        fixed[[places.LOW, places.HIGH, places.RATE]] = self.low, self.high, self.rate
        fixed[[places.PERIOD, places.PER_NODE]] = period_s, per_node
        fixed[[places.NOISE, places.SLOPE, places.SWEEPS]] = noise, self.slope, SWEEPS
        fixed[places.PRICE] = self.price
        self._fixed = fixed
        v = model.validity
        setting = np.zeros(compensate.N_SETTING)
        setting[[compensate.PLANNED, compensate.LATE]] = planned, late
        setting[compensate.STAGE_BLOCKS] = np.any(self._packed.table[:, PLACE] == AT_STAGE)
        setting[compensate.BLOCKS_BESIDE] = self._packed.beside
        setting[[compensate.VALID_LOW, compensate.VALID_HIGH]] = v.drive_min, v.drive_max
        setting[compensate.VALID_RATE] = v.rate_max if v.rate_max and not h.static else math.inf
        setting[compensate.NODES_WANTED] = wanted
        self._setting, self._nodes, self._per_node = setting, nodes, per_node
        self.planned, self.delay_s = bool(planned), self._packed.delay_s
        self.table, self.params = self._packed.table, self._packed.params
        self.has_stage_blocks = bool(setting[compensate.STAGE_BLOCKS])

    def init(self, drive_now: float, displacement: float | None = None) -> CompensatorState:
        """State for a stage that stands at drive_now, driven there from de-energised.

        displacement: where the stage is known to be; the plays are led there by the loop that
        ends at drive_now, where the model allows it.
        """
        h = self.model.hysteresis
        n = h.n
        plays = np.zeros((places.N_PLAYS, n))
        play_step(h.r, plays[places.REAL], drive_now - h.u_offset)
        if displacement is not None and math.isfinite(displacement):
            plays[places.REAL] = self._led_to(drive_now, displacement)
        y = float(simulate(h, np.array([drive_now], np.float64), 1.0, plays[places.REAL])[0])
        blocks = self._packed.settle(self.model, drive_now, y)
        numbers = np.zeros(places.N_STATE)
        numbers[[places.LAST, places.X_0, places.X_BEFORE, places.SHADOW]] = drive_now
        numbers[places.TARGET_NOW] = np.nan
        plays[places.SHADOW_PLAYS] = plays[places.REAL]
        work = np.zeros((places.N_WORK, self._nodes))
        work[places.SMOOTHNESS] = pv.smoothness(
            self._nodes, self._per_node * self.period_s, self.slope
        )
        inner = np.zeros(compensate.N_INNER)
        inner[[compensate.V, compensate.COMMAND]] = drive_now
        inner[compensate.TIME] = -self.period_s
        state = CompensatorState(
            numbers=numbers, plays=plays, work=work, blocks=blocks, scratch=blocks.copy(),
            inner=inner, ring=np.zeros(4 * self._per_node + 8),
            seq=np.zeros(compensate.PAST + max(self._nodes, 1)), y=np.zeros(5),
            result=np.zeros(5), channels=np.full(len(self.channels), np.nan),
        )  # fmt: skip
        self.applied(state, drive_now)
        return state

    def step(self, state: CompensatorState, window: Floats, n_valid: int, channels: Floats) -> None:
        """Propose a drive: writes state.result. window: (P,) targets from the present one on, of
        which n_valid count; channels: values in the order of `self.channels`."""
        if state.pending:
            self.applied(state, state.result[DRIVE])
        if state.channels.size:
            state.channels[:] = channels[: state.channels.size]
        compensate.step(
            self.weights, self.c, self._knots, self._fixed, self._setting, self._packed.table,
            self._packed.params, state.numbers, state.plays, state.work, state.blocks,
            state.scratch, state.inner, state.ring, state.seq, state.y, window, n_valid,
            state.channels, state.result,
        )  # fmt: skip
        state.pending = True

    def applied(self, state: CompensatorState, drive: float) -> None:
        """The drive that really went out; the model's memory follows it. One call is one sample."""
        compensate.applied(
            self.weights, self.c, self._knots, self._fixed, self._setting, self._packed.table,
            self._packed.params, state.numbers, state.plays, state.blocks, state.inner, state.y,
            state.channels, drive, state.pending, state.result,
        )  # fmt: skip
        state.pending = False

    def command(self, inside: Floats, start: float) -> Floats:
        """Commands (N,) whose drive blocks pass on the drive `inside` (N,), within the limits.

        A delay of the drive is taken to be in the targets already.
        """
        rate = np.gradient(inside, self.period_s) if inside.size > 1 else np.zeros(inside.size)
        out = np.empty(inside.size)
        now = start
        travel = self.rate * self.period_s
        for i in range(inside.size):
            u = lead_drive(self.table, self.params, inside[i], rate[i])
            now = min(max(u, now - travel, self.low), now + travel, self.high)
            out[i] = now
        return out

    def outside(self, drive: Floats, start: float) -> NDArray[np.bool_]:
        """(N,) where a drive leaves the range or the rate that the model was identified in."""
        v = self.model.validity
        rate = np.abs(np.diff(drive, prepend=start)) / self.period_s
        fast = rate > self._setting[compensate.VALID_RATE] * (1.0 + 1e-9)
        return fast | (drive < v.drive_min) | (drive > v.drive_max)

    def _led_to(self, drive: float, displacement: float) -> Floats:
        """Plays at `drive` whose displacement is the nearest to `displacement` that a single loop
        from either end of the range reaches."""
        h = self.model.hysteresis
        best, plays = math.inf, np.zeros(h.n)
        for end in np.concatenate(
            [np.linspace(drive, self.low, 60), np.linspace(drive, self.high, 60)]
        ):
            for first in (self.low, self.high):
                trial = np.zeros(h.n)
                for u in (first, float(end), drive):
                    play_step(h.r, trial, u - h.u_offset)
                y = float(simulate(h, np.array([drive]), 1.0, trial)[0])
                if abs(y - displacement) < best:
                    best, plays = abs(y - displacement), trial
        return plays


def _check(
    period_s: float, low: float, high: float, slew_per_s: float, mode: str, preview_s: float
) -> None:
    if not 0 < period_s < math.inf:
        raise BadInput(f"period_s: must be greater than 0, not {period_s:g}")
    if not low < high:
        raise BadInput(f"drive_min: {low:g} must be below drive_max, {high:g}")
    if not slew_per_s > 0:
        raise BadInput(f"slew_per_s: must be greater than 0, not {slew_per_s:g}")
    if not 0 <= preview_s < 60:
        raise BadInput(f"preview_s: must be from 0 to 60 s, not {preview_s:g}")
    if mode not in ("auto", *MODES[1:]):
        raise BadInput(f"mode: one of auto, {', '.join(MODES[1:])} is needed, not {mode!r}")


def _limits(
    model: Model, packed: Packed, low: float, high: float, rate: float
) -> tuple[float, float, float]:
    """Drive range and rate that limits, validity and clip or slew blocks leave."""
    v = model.validity
    low, high = max(low, v.drive_min), min(high, v.drive_max)
    for row in packed.table[packed.table[:, PLACE] == AT_DRIVE]:
        p = packed.params[row[P_FROM] :]
        if row[CODE] == clip.CODE:
            low, high = max(low, p[0]), min(high, p[1])
        elif row[CODE] == slew.CODE:
            rate = min(rate, p[0])
    if v.rate_max and not model.hysteresis.static:
        rate = min(rate, RATE_MARGIN * v.rate_max)
    if not low < high:
        raise BadInput(
            f"the drive limits leave nothing of the model's range, {v.drive_min:g} to "
            f"{v.drive_max:g} {model.drive_unit}"
        )
    return low, high, rate


def _slope(model: Model, low: float, high: float) -> float:
    """Mean slope of the displacement over the drive range, without its sign."""
    h = model.hysteresis
    ends = simulate(h, np.array([low, high, low, high]), 1e9)
    slope = abs(float(ends[3] - ends[2])) / (high - low)
    return slope if slope > 0.0 and math.isfinite(slope) else 1.0
