"""Check whether a model is monotone, measure how far it is from that, find the nearest one.

After a reversal the operators start to move one after the other: operator i follows once the drive
has travelled more than 2 r_i. Over the travel from 2 r_j to 2 r_{j+1} the slope dz/du is the
partial sum P_j = b_0 + ... + b_j (rate-dependent: P_j + Q_j du/dt with Q_j = k_0 + ... + k_j).
A Prandtl-Ishlinskii model can be inverted if all of these have the same sign (K. Kuhnen, "Modeling,
identification and compensation of complex hysteretic nonlinearities", 2003). For rates up to R
the condition is P_j +- R Q_j >= margin. These are bounds on alpha = P + R Q and beta = P - R Q, in
which a model with given thresholds and saturation is linear.
"""

from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.errors import NotInvertible
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.hysteresis.play import play_matrix
from dehyst.models.model import Floats, Hysteresis, Model
from dehyst.models.units import spell_unit

MARGIN = 0.05  # smallest slope of the nearest monotone model, relative to the full-travel slope


@dataclass(frozen=True)
class Reversal:
    """A reversal after which the output moves the wrong way. Over the travel from 2 r of `operator`
    to travel_to [drive unit] the slope dz/du is `slope` (the correct sign is `sign`) at the input
    rate `rate`; wrong_way: the largest displacement in the wrong direction."""

    operator: int
    travel_to: float
    slope: float
    sign: float
    rate: float
    wrong_way: float

    def sentence(self, drive_unit: str, displacement_unit: str) -> str:
        """Describe the error for the user."""
        drive_unit = spell_unit(drive_unit)
        at = f" at {self.rate:g} {drive_unit}/s" if self.rate else ""
        return (
            f"after each reversal the output runs the wrong way until the drive has travelled "
            f"{self.travel_to:.4g} {drive_unit} back{at} (partial sum {self.operator + 1} of the "
            f"weights is {self.slope:.4g}), by up to {self.wrong_way:.3g} {displacement_unit}"
        )


def measure_half_range(h: Hysteresis, drive_min: float, drive_max: float) -> float:
    """Return the largest |u - u_offset| over the drive range; wider operators never move."""
    return max(abs(drive_min - h.u_offset), abs(drive_max - h.u_offset))


def find_direction(h: Hysteresis, drive_min: float, drive_max: float) -> float:
    """Return +1 if z increases with the drive over the full travel, -1 if it decreases."""
    live = h.r < measure_half_range(h, drive_min, drive_max)
    total = float(np.sum(h.b[live]))
    return 1.0 if total >= 0.0 else -1.0


def _find_steepest(h: Hysteresis, drive_min: float, drive_max: float) -> float:
    z = z_range(h, drive_min, drive_max)
    at = np.linspace(*z, 65)
    return float(np.max(np.abs(np.polynomial.polynomial.polyval(at, _differentiate(h.c)))))


def _differentiate(c: Floats) -> Floats:
    return c[1:] * np.arange(1, c.size)


def z_range(h: Hysteresis, drive_min: float, drive_max: float) -> tuple[float, float]:
    """Return the lowest and highest z, of 0 and the major loop of the drive range (static weights),
    with a margin of half of that range on either side."""
    ends = np.array([drive_max, drive_min, drive_max, drive_min, drive_max]) - h.u_offset
    z = play_matrix(h.r, ends, np.zeros(h.n)) @ h.b
    z = np.concatenate([z, [0.0]])
    low, high = float(z.min()), float(z.max())
    pad = 0.5 * (high - low) if high > low else 1.0
    return low - pad, high + pad


def find_wrong_way(
    h: Hysteresis, drive_min: float, drive_max: float, rate: float | Floats = 0.0
) -> Reversal | None:
    """Return the last interval of travel after a reversal in which the slope has the wrong sign, or
    None. Of several rates the one with the largest wrong_way counts.

    rate: rates from -rate to +rate are considered [drive unit / s]; (n,): one for the slope after
    each operator (dehyst.models.hysteresis.z_range.find_rates).
    """
    sign = find_direction(h, drive_min, drive_max)
    rates = np.broadcast_to(np.asarray(rate, np.float64), h.r.shape)
    live = h.r < measure_half_range(h, drive_min, drive_max)
    ends = np.minimum(np.append(h.r[1:], np.inf), measure_half_range(h, drive_min, drive_max))
    worst: Reversal | None = None
    for at in (0.0 * rates, rates, -rates) if rates.any() else (rates,):
        slopes = sign * (np.cumsum(h.b) + at * np.cumsum(h.k))
        width = 2.0 * (ends - h.r) * live
        bad = np.flatnonzero((slopes <= 0.0) & (width > 0.0))
        if bad.size == 0:
            continue
        path = np.cumsum(np.where(live, slopes * np.maximum(width, 0.0), 0.0))
        back = max(0.0, -float(path.min()))
        wrong = back * _find_steepest(h, drive_min, drive_max)
        j = int(bad[-1])
        found = Reversal(
            j,
            2.0 * float(ends[j]),
            sign * float(slopes[j]),
            sign,
            float(at[j]),
            wrong,
        )
        if worst is None or found.wrong_way > worst.wrong_way:
            worst = found
    return worst


def require_monotone(model: Model) -> None:
    """Raise NotInvertible if the model is not monotone. The message states the reversal, by how
    much, and how far away the nearest monotone model is."""
    v = model.validity
    found = find_wrong_way(model.hysteresis, v.drive_min, v.drive_max, 0.0)
    if found is not None:
        price = nearest_monotone(model)[1]
        says = found.sentence(model.drive_unit, model.displacement_unit)
        raise NotInvertible(
            f"the model is not monotone: {says}; the nearest monotone model "
            f"differs by {price:.3g} {model.displacement_unit} rms over a typical drive"
        )


def make_typical_drive(drive_min: float, drive_max: float, rate: float) -> tuple[Floats, float]:
    """Return a drive (N,) over the whole range with nested loops of all sizes, and its period [s].

    rate: its largest |du/dt|, reached in the larger loops; 0: one range per second.
    """
    span = drive_max - drive_min
    rate = rate or span
    phase = np.arange(4000) / 4000.0  # samples: 200 to each of 20 loops
    size = 0.5 * (1.0 + np.cos(2 * np.pi * phase)) * 0.98 + 0.02  # of the half range, from 1
    wave = size * np.cos(2 * np.pi * 20 * phase) * (1 - 0.15 * np.cos(2 * np.pi * 3 * phase))
    wave += 0.15 * np.cos(2 * np.pi * 3 * phase) * size  # of the half range: the centre wanders
    rise = np.linspace(0.0, 1.0, 200, endpoint=False)
    u = drive_min + 0.5 * span * np.concatenate([rise * (1 + wave[0]), 1 + wave])
    u = np.clip(u, drive_min, drive_max)
    return u, float(np.max(np.abs(np.diff(u))) / rate)


def nearest_monotone(model: Model, rate: float = 0.0) -> tuple[Model, float]:
    """Return the monotone model nearest to `model`, and their rms difference over a typical drive
    [displacement unit]. Thresholds, saturation and blocks are kept. A model that is already
    monotone is returned unchanged, with difference 0.

    rate: the result is monotone at rates from -rate to +rate, and the models are compared over a
    drive with these rates; 0: only the static weights b are used, and the slopes k are set to 0.
    """
    h, v = model.hysteresis, model.validity
    if rate == 0.0 and not h.static:
        model = replace(model, hysteresis=replace(h, k=np.zeros(h.n)))
        h = model.hysteresis
    if find_wrong_way(h, v.drive_min, v.drive_max, rate) is None:
        return model, 0.0
    from scipy.optimize import lsq_linear  # the import is half of the daemon's start; rarely needed

    sign = find_direction(h, v.drive_min, v.drive_max)
    live = h.r < measure_half_range(h, v.drive_min, v.drive_max)
    u, dt = make_typical_drive(v.drive_min, v.drive_max, rate)
    plays = play_matrix(h.r, u - h.u_offset, np.zeros(h.n))
    rates = np.concatenate([[0.0], np.diff(u)]) / dt
    z = plays @ h.b + rates * (plays @ h.k)
    weight = np.abs(np.polynomial.polynomial.polyval(z, _differentiate(h.c)))
    weight = np.maximum(weight, 1e-3 * weight.max())  # rows on a flat saturation count a little
    steps = plays.copy()
    steps[:, :-1] -= plays[:, 1:]  # column j is multiplied by the partial sum j
    full = abs(float(np.sum(h.b[live]))) or float(np.max(np.abs(h.b))) or 1.0
    low = MARGIN * full
    if rate > 0.0:
        slow, fast = 0.5 * steps, 0.5 * steps * (rates / rate)[:, None]
        columns = np.hstack([slow + fast, slow - fast])
    else:
        columns = steps
    columns = sign * columns * weight[:, None]
    # Operators that never move give empty columns; a weak prior at the old values determines them.
    old = sign * np.cumsum(h.b)
    if rate > 0.0:
        turn = sign * rate * np.cumsum(h.k)
        old = np.concatenate([old + turn, old - turn])
    faint = 1e-9 * float(np.linalg.norm(columns)) * np.eye(columns.shape[1])
    a = np.vstack([columns, faint])
    b = np.concatenate([z * weight, faint @ np.maximum(old, low)])
    q, triangle = np.linalg.qr(a)
    sums = lsq_linear(triangle, q.T @ b, bounds=(low, np.inf), method="bvls").x
    sums = sign * np.maximum(sums, low)
    if rate > 0.0:
        up, down = sums[: h.n], sums[h.n :]
        p, q_sum = 0.5 * (up + down), 0.5 * (up - down) / rate
    else:
        p, q_sum = sums, np.zeros(h.n)
    near = replace(h, b=np.diff(p, prepend=0.0), k=np.diff(q_sum, prepend=0.0))
    apart = simulate_hysteresis(near, u, dt) - simulate_hysteresis(h, u, dt)
    price = float(np.sqrt(np.mean(apart**2)))
    return replace(model, hysteresis=near), price
