"""Explain in a paragraph which structure was identified, and why."""

from collections.abc import Callable

from dehyst.models.identify import Identification
from dehyst.models.identify.structure import TriedStructure
from dehyst.models.units import how_many, spell_unit

Has = Callable[[TriedStructure], bool]


def has_rate(one: TriedStructure) -> bool:
    """Return whether the weights depend on the rate."""
    return one.shape.rate


def has_dynamics(one: TriedStructure) -> bool:
    """Return whether there is a lag, a delay or a lead."""
    return one.lag is not None


def has_saturation(one: TriedStructure) -> bool:
    """Return whether there is a power of z beyond the first."""
    return max((1, *one.shape.powers)) > 1


def is_same(one: TriedStructure, other: TriedStructure) -> bool:
    """Return whether two candidates have the same structure."""
    return (one.shape, one.offset, one.lag) == (other.shape, other.offset, other.lag)


def name_kind(one: TriedStructure) -> str:
    """Return a short name of the kind of a candidate, which differs from others by its parts."""
    parts = ["rate" if has_rate(one) else "static"]
    if has_saturation(one):
        parts.append("saturation")
    if has_dynamics(one):
        parts.append(one.lag.kind if one.lag and one.lag.short else "lag")
    return "\n+ ".join([" + ".join(parts[:2]), *parts[2:]])


def explain_choice(result: Identification) -> str:
    """State what was chosen, what its parts gain in prediction, and what was not taken.

    All figures are rms errors in stretches of the recordings that were held out of the fit.
    """
    chosen, unit = result.chosen, spell_unit(result.model.displacement_unit)
    n = result.model.hysteresis.n
    coarse = chosen.params.slopes.size // (1 + chosen.shape.rate)
    lag = f", {chosen.lag.name}" if chosen.lag is not None else ""
    says = [
        f"Chosen on held-out data: {result.shape.name}{lag}; {how_many(n, 'operator')}. "
        f"Of {len(result.tried)} structures, compared with {coarse} operators, it leaves "
        f"{chosen.held_rms:.3g} {unit} rms in stretches that were held out of the fit.",
    ]
    parts: tuple[tuple[str, Has], ...] = (
        ("rate-dependent weights", has_rate),
        (f"the {_find_kind(chosen)}", has_dynamics),
        ("a saturation", has_saturation),
    )
    used = [(name, _best_without(result, has)) for name, has in parts if has(chosen)]
    gains = [f"{one.held_rms:.3g} {unit} without {name}" for name, one in used if one]
    if gains:
        says.append(f"The best alternatives leave {', '.join(gains)}.")
    if not has_rate(chosen):
        says.append(_tell_of_rate(result, unit))
    if not has_dynamics(chosen):
        says.append(_tell_of_dynamics(result, unit))
    return " ".join(one for one in says if one)


def _tell_of_rate(result: Identification, unit: str) -> str:
    """State why the weights do not depend on the rate."""
    others = [c for c in result.tried if has_rate(c)]
    if not others:
        return "Rate-dependent weights were not tried."
    best = min(others, key=lambda c: c.held_rms)
    because = f": {result.static_because}" if result.static_because else ""
    return f"Rate-dependent weights leave {best.held_rms:.3g} {unit}{because}."


def _tell_of_dynamics(result: Identification, unit: str) -> str:
    """State why there are no dynamics. A drive of one rate has a note of its own."""
    others = [
        c for c in result.tried if has_dynamics(c) and c.shape.rate == result.chosen.shape.rate
    ]
    if not others:
        return ""
    best = min(others, key=lambda c: c.held_rms)
    kind = _find_kind(best)
    return f"With a {kind} it leaves {best.held_rms:.3g} {unit}, no significant improvement."


def _best_without(result: Identification, has: Has) -> TriedStructure | None:
    """Return the candidate that predicts best among those without a part that have the other parts
    of the chosen one, as far as any does; None: none was tried."""
    others = [c for c in result.tried if not has(c)]
    for other in (has_rate, has_dynamics):
        same = [c for c in others if other is has or other(c) == other(result.chosen)]
        others = same or others
    return min(others, key=lambda c: c.held_rms) if others else None


def _find_kind(one: TriedStructure) -> str:
    """Return the name of its dynamics without figures."""
    return "" if one.lag is None else one.lag.name.split(",")[0]
