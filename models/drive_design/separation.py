"""Choose the experiment that distinguishes two candidates.

For every drive of waveforms.py: simulate the stage with candidate A at a typical strength, refit
the base and candidate B (over its whole parameter range) to that, and take the rms of the residual;
then swap A and B. The drive whose smaller residual is largest separates best.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.cascade.simulate import simulate
from dehyst.models.drive_design.waveforms import WAVEFORMS, Limits, Waveform
from dehyst.models.errors import BadInput
from dehyst.models.hysteresis.play import play_matrix
from dehyst.models.model import Hysteresis, Model, Validity
from dehyst.models.physics import PHYSICS
from dehyst.models.physics.entry import OTHER_AXIS, TEMPERATURE, Scales
from dehyst.models.recording import Floats

PLAYS = 10  # operators of the base that is refitted with the rival
EFFECTS = {name: one for p in PHYSICS.values() for name, one in p.specimens.items()}


@dataclass(frozen=True)
class Separation:
    """One drive judged: residual rms of A after B was refitted, and of B after A [displacement]."""

    waveform: Waveform
    left_a: float
    left_b: float

    @property
    def worth(self) -> float:
        """The smaller of the two."""
        return min(self.left_a, self.left_b)


@dataclass(frozen=True)
class SeparatingDrive:
    """The chosen drive (N,) with its times, its separation, and all that were tried."""

    t_s: Floats
    drive: Floats
    chosen: Separation
    tried: tuple[Separation, ...]
    says: str


def separate(a: str, b: str, limits: Limits, model: Model | None = None) -> SeparatingDrive:
    """Return the drive that distinguishes effect a from effect b. model: of the stage; None: a
    typical one.

    Raises BadInput on unknown names and on equal ones.
    """
    for name in (a, b):
        if name not in EFFECTS:
            raise BadInput(f"{name!r} cannot be separated; known are {', '.join(EFFECTS)}")
    if a == b:
        raise BadInput(f"{a!r} and {b!r} are the same effect")
    in_base = EFFECTS[a].in_base or EFFECTS[b].in_base  # a rich base would absorb them
    bare = replace(model, blocks=()) if model else _make_typical(limits)
    tried = []
    for waveform in WAVEFORMS:
        drive = waveform.make(limits)
        channels = _make_channels(limits)
        still = simulate(bare, limits.times, drive, channels)
        columns = _make_base_columns(drive, limits, rich=not in_base)
        scales = Scales(
            drive_min=limits.drive_min,
            drive_max=limits.drive_max,
            rate_max=limits.rate_max,
            period_s=limits.period_s,
            seconds=limits.seconds,
            stroke=_measure_stroke(bare, limits),
            drive_unit=bare.drive_unit,
            unit=bare.displacement_unit,
        )
        added = [
            [
                simulate(replace(bare, blocks=(block,)), limits.times, drive, channels) - still
                for block in EFFECTS[name].variants(scales)
            ]
            for name in (a, b)
        ]
        tried.append(
            Separation(
                waveform,
                _fit_rival(added[0][0], columns, added[1]),
                _fit_rival(added[1][0], columns, added[0]),
            )
        )
    tried.sort(key=lambda s: -s.worth)
    best = tried[0]
    return SeparatingDrive(
        limits.times, best.waveform.make(limits), best, tuple(tried), _explain(a, b, best, bare)
    )


def _fit_rival(target: Floats, columns: Floats, rivals: Sequence[Floats]) -> float:
    """Return the rms of the target after the base and the best variant of the rival were
    refitted."""
    basis, _ = np.linalg.qr(columns)

    def outside(x: Floats) -> Floats:
        return np.asarray(x - basis @ (basis.T @ x))

    rest = outside(target)
    smallest = float(rest @ rest)
    for rival in rivals:
        r = outside(rival)
        power = float(r @ r)
        # a negative amount of an effect is unphysical
        amount = max(0.0, float(r @ rest)) / power if power > 0 else 0.0
        smallest = min(smallest, float(np.sum((rest - amount * r) ** 2)))
    return float(np.sqrt(max(smallest, 0.0) / target.size))


def _make_base_columns(drive: Floats, limits: Limits, rich: bool) -> Floats:
    r = np.r_[0.0, np.geomspace(0.01, 0.5, PLAYS - 1)] * limits.span
    plays = play_matrix(r, drive - limits.drive_min, np.zeros(PLAYS)) / limits.span
    parts = [np.ones((drive.size, 1)), plays]
    return np.hstack([*parts, plays**2, plays**3] if rich else parts)


def _make_channels(limits: Limits) -> dict[str, Floats]:
    """Return a temperature that rises while it oscillates, and another axis that moves
    independently."""
    s = limits.times / limits.seconds
    other = limits.middle + 0.4 * limits.span * np.sin(2 * np.pi * 7.3 * s)  # in step with no drive
    return {TEMPERATURE: 22.0 + s + 0.2 * np.sin(9.0 * s), OTHER_AXIS: other}


def _measure_stroke(model: Model, limits: Limits) -> float:
    ends = np.linspace(limits.drive_min, limits.drive_max, 200)
    return max(float(np.ptp(simulate(model, limits.period_s, ends))), 1e-9)


def _make_typical(limits: Limits) -> Model:
    """Return a model with 15 % hysteresis on a stroke of one micrometre per unit of drive."""
    r = np.geomspace(0.01, 0.5, 8) * limits.span
    h = Hysteresis(
        r=np.r_[0.0, r],
        b=np.r_[0.8, np.full(8, 0.025)],
        c=np.array([0.0, 1.0]),
        u_offset=limits.drive_min,
    )
    return Model(h, Validity(limits.drive_min, limits.drive_max))


def _explain(a: str, b: str, best: Separation, model: Model) -> str:
    k, unit = (1e3, "nm") if model.displacement_unit == "um" else (1.0, model.displacement_unit)
    text = (
        f"To distinguish {a} from {b}: {best.waveform.says}. A typical {a} leaves "
        f"{k * best.left_a:.3g} {unit} rms that no {b} explains, a typical {b} "
        f"{k * best.left_b:.3g} {unit} that no {a} explains."
    )
    hints = [hint for name in (a, b) if (hint := EFFECTS[name].hint)]
    return " ".join([text, *(f"{hint[0].upper()}{hint[1:]}." for hint in hints)])
