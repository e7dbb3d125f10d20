"""The model in use, whose misfit a diagnosis explains.

A model that the user gives carries the fits: its blocks enclose all that they add. The drive passes
its drive blocks before it reaches the hysteresis, and what is added to the hysteresis' displacement
passes its further blocks, as far as they are linear. A nonlinear block (a ripple of the reading,
friction) acts on the model alone.

Without a given model, the model in use is the plain modified Prandtl-Ishlinskii model (Eq. 6 of Qin
et al., k = 0, no blocks), identified from these recordings. It carries no fit: its response to an
effect that it does not know, such as a wider loop for a delay, would have to be undone first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import nnls

from dehyst.models.cascade.history import HISTORIES, replay, simulate_behind
from dehyst.models.cascade.simulate import channels_of, simulate
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.errors import BadInput, DehystError, OddRecording
from dehyst.models.identify import Options, identify_alone
from dehyst.models.identify.data.stretches import take_stretches
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.physics import KINDS
from dehyst.models.recording import Recording
from dehyst.models.signals.filters import plays
from dehyst.models.signals.joined import Data, Floats
from dehyst.models.signals.pasts import FRESH

# of the drive's range, used where identification gives none; closest where the slope changes most
THRESHOLDS = np.array([0, 0.01, 0.025, 0.05, 0.08, 0.12, 0.17, 0.23, 0.3, 0.37, 0.45])
POWERS = ((2, 3, 4, 5), (2, 3), ())  # tried in order, until the model is monotone
LEAST_SLOPE = 0.1  # of the polynomial over the recorded range: below, it counts as not monotone
ROUNDS = 12  # Gauss-Newton steps of the plain fit
UNRECORDED = 1e-8
"""Prior of neighbouring partial sums being equal, relative to the drive's power: 1e-4 of its range,
less than any play that was recorded does."""
PROBE_SAMPLES = 400  # of the inputs that show whether a block is linear
BY_HEART = 5.0  # held-out rms over fit rms: above, the model predicts no other rows


@dataclass(frozen=True)
class DiagnosedModel:
    """model: the model in use; given: by the user, not identified here; carries: the fits add to
    it; refused: why identification rejected the recordings; odd: the recording that it found not to
    belong to the others; dynamic: the model that identification found, where that has dynamics in
    addition."""

    model: Model
    given: bool = False
    carries: bool = False
    refused: str = ""
    odd: str = ""
    dynamic: Model | None = None

    @cached_property
    def drive_blocks(self) -> tuple[Block, ...]:
        """Blocks before the hysteresis."""
        return tuple(b for b in self.model.blocks if b.place == "drive")

    @cached_property
    def further_blocks(self) -> tuple[Block, ...]:
        """Blocks parallel to the hysteresis and after it."""
        return tuple(b for b in self.model.blocks if b.place != "drive")

    @cached_property
    def linear_blocks(self) -> tuple[Block, ...]:
        """Blocks after the hysteresis that are linear except for a constant term."""
        model = self.model
        behind = [b for b in self.further_blocks if not KINDS[b.kind].is_parallel]
        return tuple(b for b in behind if _is_affine(b, model))

    def drive(self, data: Data, v: Floats) -> Floats:
        """Return the (N,) drive that reaches the hysteresis."""
        if not self.drive_blocks or not self.carries:
            return v
        return self._run(data, v, replace(self.model, blocks=self.drive_blocks), "drive")

    def reading(self, data: Data, v: Floats) -> Floats:
        """Return the (N,) reading for a drive that has passed the drive blocks."""
        if not self.carries:
            return np.zeros(data.n)
        return self._run(data, v, replace(self.model, blocks=self.further_blocks), "reading")

    def apply_linear_blocks(self, data: Data, x: Floats) -> Floats:
        """Return columns (N, k) that are added to the displacement, filtered by the linear
        blocks."""
        if not self.carries or not self.linear_blocks:
            return x
        x = np.array(x)
        m = self.model
        for block in self.linear_blocks:
            kind = KINDS[block.kind]
            values = kind.values(block, m.drive_unit, m.displacement_unit)
            for k in _recordings(data):
                t, channel = data.t[k], data.channels[block.channel][k] if block.channel else None
                zero = kind.run(values, np.zeros(t.size), t, channel)
                for j in range(x.shape[1]):
                    x[k, j] = kind.run(values, x[k, j], t, channel) - zero
        return x

    def predict(self, data: Data) -> Floats:
        """Return the (N,) prediction of the model, each recording with the history that fits it
        best, as `dehyst simulate` writes it."""
        out = np.empty(data.n)
        y = np.where(data.raw_index >= 0, data.y, np.nan)
        for k in _recordings(data):
            channels = {name: data.channels[name][k] for name in channels_of(self.model)}
            out[k] = replay(self.model, data.t[k], data.u[k], channels, y[k]).predicted
        return out

    def _run(self, data: Data, v: Floats, model: Model, which: str) -> Floats:
        """Return (N,) one stage of a model, each recording with the past that its mark gives."""
        out = np.empty(data.n)
        for k in _recordings(data):
            channels = {name: data.channels[name][k] for name in channels_of(model)}
            past = HISTORIES[max(int(data.forgets[k.start]) - FRESH, 0)]
            parts = simulate_behind(model, data.t[k], v[k], channels, past)
            out[k] = getattr(parts, which)
        return out


NO_MODEL = DiagnosedModel(
    Model(Hysteresis(r=np.zeros(1), b=np.ones(1), c=np.array([0.0, 1.0])), Validity(0.0, 1.0))
)


def take_given_model(model: Model, data: Data) -> DiagnosedModel:
    """Return the user's model as the model in use. Raises BadInput where it cannot be run on these
    recordings."""
    for what, ours, theirs in (
        ("drive", data.drive_unit, model.drive_unit),
        ("displacement", data.unit, model.displacement_unit),
    ):
        if ours != theirs:
            raise BadInput(
                f"{data.names[0]}: the {what} is in {ours}, the model's in {theirs}; diagnose with "
                "a model of this stage"
            )
    for name in channels_of(model):
        if name not in data.channels:
            raise BadInput(
                f"{data.names[0]}: the model reads the channel {name}, which is absent or does not "
                "move here"
            )
    return DiagnosedModel(model, given=True, carries=True)


def identify_plain_model(recordings: Sequence[Recording], data: Data) -> DiagnosedModel:
    """Identify the plain model of these recordings. Where identification finds linear dynamics in
    addition to the hysteresis, refuses, or predicts only the rows that it was fitted to, fit the
    hysteresis here without dynamics. Of a long recording, stretches are used, as many rows as the
    fits use of all."""
    refused, odd, dynamic, r = "", "", None, THRESHOLDS * data.span
    own = [take_stretches(one, TUNING.most_rows).recording for one in recordings]
    try:
        model = identify_alone(own, Options(rate=False)).model
    except (DehystError, ValueError) as error:  # also raised when there is no row to fit
        refused = str(error)
        odd = error.recording if isinstance(error, OddRecording) else ""
    else:
        predicts = model.fit.holdout_rms <= BY_HEART * model.fit.rms
        if predicts and not model.blocks:
            return DiagnosedModel(model)
        if predicts:
            r, dynamic = model.hysteresis.r, model
    return DiagnosedModel(fit_plain_model(data, r), refused=refused, odd=odd, dynamic=dynamic)


def fit_plain_model(data: Data, r: Floats) -> Model:
    """Fit plays with thresholds r (n,) followed by a polynomial, by Gauss-Newton. The result can be
    inverted: partial sums of the weights are >= 0 (Kuhnen 2003), and the polynomial is monotone."""
    used = np.flatnonzero(data.rows)
    used = used[:: max(1, used.size // TUNING.search_rows)]
    h = plays(r, data.u - data.u_min, data.forgets)[used]
    # columns whose weights are the partial sums
    h[:, :-1] -= h[:, 1:].copy()
    y, rec = data.y[used], data.rec[used]
    groups = (rec[:, None] == np.arange(len(data.names))[None, :]).astype(float)
    du = data.u[used] - data.u[used].mean()
    sign = 1.0 if float(du @ (y - y.mean())) >= 0 else -1.0
    slope = max(abs(float(du @ (y - y.mean()))) / float(du @ du), 1e-12)
    size = slope * data.span  # the polynomial is in z / size, so its terms are of similar size
    for powers in POWERS:
        fit = _fit_polynomial(h, sign * y, groups, powers, size)
        if fit.least_slope > LEAST_SLOPE:
            break
    coefficients = np.zeros(max((1, *powers)) + 1)
    coefficients[0], coefficients[1] = fit.offset, 1.0
    for p, cp in zip(powers, fit.c, strict=True):
        coefficients[p] = cp / size**p
    sums = np.maximum(fit.sums, 1e-3 * float(fit.sums.max()))  # above 0, as an inverse needs
    b = np.diff(sums, prepend=0.0)
    hysteresis = Hysteresis(r=r, b=b, c=sign * coefficients, u_offset=data.u_min)
    validity = Validity(data.u_min, data.u_min + data.span, period_s=data.period)
    return Model(hysteresis, validity, data.drive_unit, data.unit)


@dataclass(frozen=True)
class _PolynomialFit:
    """Partial sums (n,), coefficients of the powers, mean offset, sum of squares, smallest slope of
    the polynomial."""

    sums: Floats
    c: Floats
    offset: float
    sse: float
    least_slope: float


def _fit_polynomial(
    h: Floats, y: Floats, groups: Floats, powers: tuple[int, ...], size: float
) -> _PolynomialFit:
    """Fit P(h @ sums) + an offset for each group, P(z) = z + sum_p c_p (z / size)^p, by
    Gauss-Newton from the straight fit; each step is halved until it helps."""
    count = np.maximum(groups.sum(axis=0), 1.0)

    def judge(sums: Floats, c: Floats) -> _PolynomialFit:
        z = h @ sums / size
        left = y - h @ sums - sum(cp * z**p for p, cp in zip(powers, c.tolist(), strict=True))
        offsets = groups.T @ left / count
        left = left - groups @ offsets
        turn = 1.0 + sum(p * cp * z ** (p - 1) for p, cp in zip(powers, c, strict=True)) / size
        least = float(np.min(turn)) if powers else 1.0
        return _PolynomialFit(sums, c, float(offsets.mean()), float(left @ left), least)

    n, m = h.shape[1], len(powers)
    sums, _ = _solve_bounded(np.hstack([h, groups, -groups]), y, n, 0)
    best = judge(sums, np.zeros(m))
    for _ in range(ROUNDS if powers else 0):
        z = h @ best.sums / size
        slope = (
            1.0 + sum(p * cp * z ** (p - 1) for p, cp in zip(powers, best.c, strict=True)) / size
        )
        bent = np.stack([z**p for p in powers], axis=1)
        straight = h * np.reshape(slope, (-1, 1))
        # P(z) linearised here: constant + straight @ sums + bent @ c
        constant = h @ best.sums - straight @ best.sums
        x = np.hstack([straight, bent, -bent, groups, -groups])
        sums, c = _solve_bounded(x, y - constant, n, m)
        for part in (1.0, 0.5, 0.25, 0.125):
            trial = judge(best.sums + part * (sums - best.sums), best.c + part * (c - best.c))
            if trial.sse < best.sse:
                break
        else:
            break
        fall, best = best.sse - trial.sse, trial
        if fall < 1e-4 * best.sse:  # of the misfit: further steps gain less
            break
    return best


def _solve_bounded(x: Floats, y: Floats, n: int, m: int) -> tuple[Floats, Floats]:
    """Return weights (n,) >= 0 and free coefficients (m,). x: the weights' columns, the
    coefficients' columns with both signs, then others. Neighbouring weights, which are partial sums
    over the plays, are pulled towards each other: a play of which nothing was recorded gets no
    weight."""
    gram = x.T @ x
    between = np.diff(np.eye(n), axis=0)
    gram[:n, :n] += UNRECORDED * float(gram[:n, :n].sum()) * (between.T @ between)
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-30))
    normed = gram / np.outer(scale, scale) + TUNING.ridge * np.eye(scale.size)
    factor = np.linalg.cholesky(normed)
    # 50: nnls fails at its own limit, 3 steps per unknown; columns this alike may need more
    w, _ = nnls(factor.T, np.linalg.solve(factor, x.T @ y / scale), maxiter=50 * scale.size)
    w = w / scale
    return w[:n], w[n : n + m] - w[n + m : n + 2 * m]


def _recordings(data: Data) -> list[slice]:
    ends = np.r_[np.flatnonzero(np.diff(data.rec)) + 1, data.n]
    return [slice(int(a), int(b)) for a, b in zip(np.r_[0, ends[:-1]], ends, strict=True)]


def _is_affine(block: Block, model: Model) -> bool:
    """Return whether twice the input gives twice the change of the output."""
    kind = KINDS[block.kind]
    values = kind.values(block, model.drive_unit, model.displacement_unit)
    dt = model.validity.period_s or 1e-3  # s: at any period it shows
    t: Floats = (np.arange(PROBE_SAMPLES) * dt).astype(np.float64)
    stroke = max(float(np.abs(simulate(replace(model, blocks=()), t, _sweep(model))).max()), 1e-9)
    x = stroke * np.random.default_rng(1).random(PROBE_SAMPLES)
    channel = np.random.default_rng(2).random(PROBE_SAMPLES) if block.channel else None
    zero, one, two = (kind.run(values, k * x, t, channel) for k in (0.0, 1.0, 2.0))
    change = float(np.abs(one - zero).max())
    return bool(np.abs(two - 2.0 * one + zero).max() <= 1e-6 * max(change, 1e-300))  # rounding


def _sweep(model: Model) -> Floats:
    v = model.validity
    return np.linspace(v.drive_min, v.drive_max, PROBE_SAMPLES).astype(np.float64)
