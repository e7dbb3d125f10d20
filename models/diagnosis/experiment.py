"""The experiment that tells two candidates apart.

For every drive of waveforms.py: simulate the stage with candidate A at a typical strength, refit
the base and candidate B (over its whole parameter range) to that, and take the rms that is left;
then the other way round. The drive whose smaller remainder is largest separates best.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.cascade import simulate
from dehyst.models.diagnosis.waveforms import WAVEFORMS, Limits, Waveform
from dehyst.models.errors import BadInput
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.play import play_matrix
from dehyst.models.recording import Floats

TEMPERATURE, OTHER_AXIS = "temp_c", "u2_v"
PLAYS = 10
IN_BASE = ("asymmetry", "friction", "sensor")  # a rich base would take them whole
SQUARE_OF_Z = 4  # the memory block's weights that bend both branches to one side


@dataclass(frozen=True)
class Setup:
    """What the variants of an effect are laid out for."""

    limits: Limits
    drive_unit: str
    unit: str
    stroke: float


Variants = Callable[[Setup], list[Block]]


@dataclass(frozen=True)
class Separation:
    """One drive judged: rms left of A after B was refitted, and of B after A [displacement]."""

    waveform: Waveform
    left_a: float
    left_b: float

    @property
    def worth(self) -> float:
        """The weaker of the two."""
        return min(self.left_a, self.left_b)


@dataclass(frozen=True)
class Experiment:
    """The chosen drive (N,) with its times, what it separates by, and all that were tried."""

    t_s: Floats
    drive: Floats
    chosen: Separation
    tried: tuple[Separation, ...]
    says: str


def _lag(place: str) -> Variants:
    def variants(s: Setup) -> list[Block]:
        t = s.limits.period_s
        return [Block("lag", place, {"tau_s": k * t}) for k in (1.0, 0.2, 0.5, 2.0, 5.0, 20.0)]

    return variants


def _delay(s: Setup) -> list[Block]:
    t = s.limits.period_s
    return [Block("delay", "drive", {"delay_s": k * t}) for k in (1.0, 0.2, 0.5, 2.0, 5.0, 20.0)]


def _resonance(s: Setup) -> list[Block]:
    f = 1.0 / s.limits.period_s
    return [
        Block("resonance", "stage", {"frequency_hz": k * f, "damping": z, "share": 1.0})
        for k, z in ((0.2, 0.02), (0.05, 0.02), (0.1, 0.02), (0.3, 0.02), (0.1, 0.2), (0.2, 0.3))
    ]


def _creep(s: Setup) -> list[Block]:
    long = 3 * s.limits.seconds
    return [
        Block("creep", "stage", {"gain_per_decade": 0.015, "tau_min_s": a, "tau_max_s": long})
        for a in (0.1, 20 * s.limits.period_s, 0.5)
    ]


def _slew(s: Setup) -> list[Block]:
    key = f"rate_{s.drive_unit}_per_s"
    return [Block("slew", "drive", {key: k * s.limits.rate_max}) for k in (0.4, 0.1, 0.2, 0.7, 0.9)]


def _clip(s: Setup) -> list[Block]:
    low, span, u = s.limits.drive_min, s.limits.span, s.drive_unit
    return [
        Block("clip", "drive", {f"min_{u}": low + a * span, f"max_{u}": low + b * span})
        for a, b in ((-1.0, 0.9), (-1.0, 0.8), (0.05, 2.0), (0.05, 0.9))
    ]


def _drift(s: Setup) -> list[Block]:
    key = f"expansion_{s.unit}_per_k"
    return [
        Block("drift", "stage", {"gain_per_k": g, key: b, "reference_c": 22.0}, TEMPERATURE)
        for g, b in ((0.0, 0.01 * s.stroke), (0.01, 0.0))
    ]


def _hum(s: Setup) -> list[Block]:
    return [
        Block(
            "hum", "sensor",
            {"frequency_hz": f, f"amplitude_{s.unit}": 0.005 * s.stroke, "phase_rad": p},
        )
        for f in (50.0, 60.0) for p in (0.3, 1.9)
    ]  # fmt: skip


def _coupling(s: Setup) -> list[Block]:
    gain = 0.02 * s.stroke / s.limits.span
    return [Block("coupling", "stage", {f"gain_{s.unit}_per_unit": gain}, OTHER_AXIS)]


def _sensor(s: Setup) -> list[Block]:
    k = "coefficients"
    return [
        Block("polynomial", "sensor", {k: (0.0, 1.0, 0.02 / s.stroke)}),
        Block("polynomial", "sensor", {k: (0.0, 1.0, 0.0, 0.02 / s.stroke**2)}),
    ]


def _rate(s: Setup) -> list[Block]:
    """Thresholds that dilate by a tenth at half the steepest rate."""
    u, half = s.drive_unit, 0.5 * s.limits.span
    full = 0.5 * s.limits.rate_max / half
    return [
        Block(
            "rate", "stage",
            {
                f"thresholds_{u}": (0.05 * half, 0.2 * half), "slopes": (0.0, 0.0), "power": p,
                "widening": (0.01 * s.stroke / full**p, 0.01 * s.stroke / full**p),
                "smoothing_s": 5 * s.limits.period_s, f"scale_{u}": half,
                f"center_{u}": s.limits.drive_min,
            },
        )
        for p in (0.5, 1.0)
    ]  # fmt: skip


def _friction(s: Setup) -> list[Block]:
    y = s.unit
    return [
        Block(
            "friction", "stage",
            {
                f"length_{y}": k * s.stroke, f"stribeck_{y}_per_s": 2.0 * s.stroke,
                f"sliding_{y}": 0.005 * s.stroke, f"extra_{y}": 0.01 * s.stroke,
            },
        )
        for k in (0.01, 0.003, 0.03)
    ]  # fmt: skip


def _asymmetry(s: Setup) -> list[Block]:
    """Loops that bend over on one side: the square of a Dahl operator."""
    u, zero, size = s.drive_unit, (0.0, 0.0), (0.005 * s.stroke, 0.005 * s.stroke)
    weights = {f"weights_{k}": size if k == SQUARE_OF_Z else zero for k in range(1, 6)}
    half = 0.5 * s.limits.span
    return [
        Block(
            "memory", "stage",
            {
                f"lengths_{u}": (k * half, 2 * k * half), **weights, f"scale_{u}": half,
                f"center_{u}": s.limits.middle,
            },
        )
        for k in (0.3, 0.1, 1.0)
    ]  # fmt: skip


EFFECTS: dict[str, tuple[Variants, str]] = {
    "creep": (_creep, ""),
    "resonance": (_resonance, ""),
    "delay": (_delay, ""),
    "lag": (_lag("drive"), ""),
    "sensor-lag": (_lag("sensor"), "record the amplifier's monitor output as a channel as well"),
    "slew": (_slew, ""),
    "clip": (_clip, ""),
    "drift": (_drift, "record the temperature, and let it change during the run"),
    "hum": (_hum, ""),
    "coupling": (_coupling, "move the other axis on its own, and record its drive"),
    "rate": (_rate, ""),
    "friction": (_friction, ""),
    "asymmetry": (_asymmetry, ""),
    "sensor": (_sensor, "only a calibrated second sensor tells it from the stage for certain"),
}


def separate(a: str, b: str, limits: Limits, model: Model | None = None) -> Experiment:
    """The drive that tells effect a from effect b. model: of the stage; None: a typical one.

    Raises BadInput on unknown names and on equal ones.
    """
    for name in (a, b):
        if name not in EFFECTS:
            raise BadInput(f"{name!r} cannot be separated; known are {', '.join(EFFECTS)}")
    if a == b:
        raise BadInput(f"{a!r} and {b!r} are the same effect")
    bare = replace(model, blocks=()) if model else _typical(limits)
    tried = []
    for waveform in WAVEFORMS:
        drive = waveform.make(limits)
        channels = _channels(limits)
        still = simulate(bare, limits.times, drive, channels)
        columns = _base_columns(drive, limits, rich=a not in IN_BASE and b not in IN_BASE)
        setup = Setup(limits, bare.drive_unit, bare.displacement_unit, _stroke(bare, limits))
        added = [
            [
                simulate(replace(bare, blocks=(block,)), limits.times, drive, channels) - still
                for block in EFFECTS[name][0](setup)
            ]
            for name in (a, b)
        ]
        tried.append(
            Separation(waveform, _left(added[0][0], columns, added[1]),
                       _left(added[1][0], columns, added[0]))
        )  # fmt: skip
    tried.sort(key=lambda s: -s.worth)
    best = tried[0]
    return Experiment(
        limits.times, best.waveform.make(limits), best, tuple(tried), _says(a, b, best, bare)
    )


def _left(target: Floats, columns: Floats, rivals: Sequence[Floats]) -> float:
    """Rms of the target after the base and the best variant of the rival were refitted."""
    basis, _ = np.linalg.qr(columns)

    def outside(x: Floats) -> Floats:
        return np.asarray(x - basis @ (basis.T @ x))

    rest = outside(target)
    smallest = float(rest @ rest)
    for rival in rivals:
        r = outside(rival)
        power = float(r @ r)
        # an effect does not act backwards: a rival needs a positive amount
        amount = max(0.0, float(r @ rest)) / power if power > 0 else 0.0
        smallest = min(smallest, float(np.sum((rest - amount * r) ** 2)))
    return float(np.sqrt(max(smallest, 0.0) / target.size))


def _base_columns(drive: Floats, limits: Limits, rich: bool) -> Floats:
    r = np.r_[0.0, np.geomspace(0.01, 0.5, PLAYS - 1)] * limits.span
    plays = play_matrix(r, drive - limits.drive_min, np.zeros(PLAYS)) / limits.span
    parts = [np.ones((drive.size, 1)), plays]
    return np.hstack([*parts, plays**2, plays**3] if rich else parts)


def _channels(limits: Limits) -> dict[str, Floats]:
    """A temperature that rises while it waves, and an axis that goes its own way."""
    s = limits.times / limits.seconds
    other = limits.middle + 0.4 * limits.span * np.sin(2 * np.pi * 7.3 * s)
    return {TEMPERATURE: 22.0 + s + 0.2 * np.sin(9.0 * s), OTHER_AXIS: other}


def _stroke(model: Model, limits: Limits) -> float:
    ends = np.linspace(limits.drive_min, limits.drive_max, 200)
    return max(float(np.ptp(simulate(model, limits.period_s, ends))), 1e-9)


def _typical(limits: Limits) -> Model:
    """15 % of hysteresis on a stroke of one micrometre per unit of drive."""
    r = np.geomspace(0.01, 0.5, 8) * limits.span
    h = Hysteresis(
        r=np.r_[0.0, r],
        b=np.r_[0.8, np.full(8, 0.025)],
        c=np.array([0.0, 1.0]),
        u_offset=limits.drive_min,
    )
    return Model(h, Validity(limits.drive_min, limits.drive_max))


def _says(a: str, b: str, best: Separation, model: Model) -> str:
    k, unit = (1e3, "nm") if model.displacement_unit == "um" else (1.0, model.displacement_unit)
    text = (
        f"To tell {a} from {b}: {best.waveform.says}. A typical {a} leaves {k * best.left_a:.3g} "
        f"{unit} rms that no {b} explains, a typical {b} {k * best.left_b:.3g} {unit} that no "
        f"{a} explains."
    )
    hints = [hint for name in (a, b) if (hint := EFFECTS[name][1])]
    return " ".join([text, *(f"{hint[0].upper()}{hint[1:]}." for hint in hints)])
