"""The bars of the proof, and further tables, from its rows."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from tests.benchmarks.bars import Bars

Row = dict[str, Any]
AGREES = 1.05  # factor between a reported rms and the written model's
NEAR = 1.5  # factor by which the reported noise may be off, in the additional table
LEFT = 1.5  # residual that `explained` may leave of the held-out recording [rms of the noise]
TWICE = 2.0  # residual of the model in use from which a shape must be named [rms of the noise]


def judged(rows: Iterable[Row]) -> list[Row]:
    """Return the rows of cases that did not fail."""
    return [r for r in rows if "failed" not in r]


def singles(rows: Iterable[Row]) -> list[Row]:
    """Return the rows with one effect of the library, separable, and nothing outside it."""
    return [r for r in rows if len(_physics(r)) == 1 == len(r["score"]["asked"])]


def several(rows: Iterable[Row]) -> list[Row]:
    """Return the rows with two or three effects, each separable."""
    return [
        r for r in rows if len(_physics(r)) > 1 and len(r["score"]["asked"]) == len(_physics(r))
    ]


def without(rows: Iterable[Row]) -> list[Row]:
    """Return the rows without an effect, except matters of shape."""
    return [r for r in rows if not _physics(r) and not r["truth"]["outside"]]


def shapes(rows: Iterable[Row]) -> list[Row]:
    """Return those whose loop is not the model's and whose model in use leaves twice the noise."""
    return [r for r in without(rows) if r["truth"]["bent"] and r["figures"]["model"] >= TWICE]


def outside(rows: Iterable[Row]) -> list[Row]:
    """Return the rows with an effect of no library that a rich base cannot absorb."""
    return [
        r for r in rows
        if any(h["name"] == "unknown" and h["separable"] for h in r["truth"]["hidden"])
    ]  # fmt: skip


def worse_held_out(row: Row) -> bool:
    """Whether the augmented model predicts worse than the model in use, by more than the noise."""
    f = row["figures"]
    return bool(f["held_augmented"] > f["held_model"] + 1.0)


def models_of_physics(rows: Iterable[Row]) -> list[Row]:
    """Return the rows in which an effect of the drive or the stage is named, shape aside."""
    return [
        r for r in rows
        if any(e["acts_on"] in ("drive", "stage") and e["name"] not in ("shape", "unknown")
               for e in r["answer"]["effects"])
    ]  # fmt: skip


def _predicts_better(row: Row) -> bool:
    f = row["figures"]
    return bool(f["held_augmented"] < f["held_model"])


def _explains_nothing(row: Row) -> bool:
    """Return whether the verdict is `explained` although the held-out recording is not."""
    said = row["answer"]["verdict"] == "explained"
    return bool(said and row["figures"]["held_augmented"] > LEFT)


def bars_of(rows: Iterable[Row]) -> Bars:
    """Return the bars; a bar without a case could not be judged."""
    everything, bars = list(rows), Bars()
    good = judged(everything)

    def share(name: str, group: list[Any], test: Callable[[Any], bool], **bar: float) -> None:
        if not group:
            bars.cannot(name, "no such case in this run")
            return
        held = sum(map(test, group)) / len(group)
        words = (
            f"<= {100 * bar['most']:.0f} %" if "most" in bar else f">= {100 * bar['least']:.0f} %"
        )
        inside = held <= bar["most"] if "most" in bar else held >= bar["least"]
        bars.add(name, rate(group, test), words, inside)

    share("single effect named first", singles(good), _first, least=0.95)
    share("two or three effects: all named", several(good), _all, least=0.9)
    share("no effect: no physics named", without(good), _nothing_named, least=1.0)
    share("shape named", shapes(good), lambda r: bool(r["score"]["shape"]), least=0.9)
    reported = lambda r: bool(r["score"]["reported"])  # noqa: E731
    share("outside the library: reported", outside(good), reported, least=0.95)
    said = [name for r in good for name in r["score"]["said"]]
    spurious = sum(len(r["score"]["spurious"]) for r in good)
    if said:
        figure = f"{100 * spurious / len(said):.1f} % ({spurious}/{len(said)})"
        bars.add("names that are spurious", figure, "<= 3 %", spurious <= 0.03 * len(said))
    else:
        bars.cannot("names that are spurious", "nothing was named in this run")
    share("exclusion limits, asked again: false", _limits(good), lambda x: not x["true"], most=0.01)
    bars.none("limits that what is there proves false", sum(map(_contradictions, good)))
    parameters = [p for r in good for p in r["score"]["parameters"]]
    share("parameters inside their interval", parameters, lambda p: bool(p["inside"]), least=0.92)
    bars.none("answers against their own rules", sum(bool(r["score"]["rules"]) for r in good))
    bars.none("rms stated that the written model does not have", sum(map(_disagrees, good)))
    named = models_of_physics(good)
    share("written model better held out, where named", named, _predicts_better, least=0.92)
    bars.none("written model worse held out by a noise", sum(map(worse_held_out, good)))
    bars.none("explained, and over 1.5 noises left held out", sum(map(_explains_nothing, good)))
    bars.none("cases that failed", len(everything) - len(good))
    return bars


def tables(rows: Iterable[Row]) -> str:
    """Return all tables as text, the bars last."""
    everything = list(rows)
    good = judged(everything)
    parts = [_families(good), _beside(good), _failed(everything), _times(good)]
    parts.append("Against the bars\n" + bars_of(everything).table())
    return "\n\n".join(p for p in parts if p)


def rate(group: list[Any], test: Callable[[Any], bool]) -> str:
    """ "97 % (32/33)" """
    if not group:
        return "-"
    hits = sum(map(test, group))
    return f"{100 * hits / len(group):.0f} % ({hits}/{len(group)})"


def wrong(row: Row) -> list[str]:
    """Return in words what is wrong with a row; nothing if it meets all bars."""
    if "failed" in row:
        return [row["failed"].strip().splitlines()[-1]]
    s, out = row["score"], []
    if row in singles([row]) and not _first(row):
        out.append(f"{s['asked'][0]} is not first")
    if row in several([row]) and not _all(row):
        out.append(f"{', '.join(n for n in s['asked'] if n not in s['got'])} not named")
    if row in shapes([row]) and not s["shape"]:
        out.append(f"shape not named where {row['figures']['model']:.1f} noises are left")
    if row in outside([row]) and not s["reported"]:
        out.append("not reported that something is outside the library")
    out += [f"{name} is not there" for name in s["spurious"]]
    out += [
        f"false limit: {x['limit']} ({x['left']:.2f} noises; {x['answer']})"
        for x in row["limits"]
        if not x["true"]
    ]
    out += [f"false limit: {text}" for text in s["contradicted"]]
    out += s["rules"]
    if _disagrees(row):
        out.append(f"an rms is stated {row['figures']['disagrees']:.2f} times off")
    out += [
        f"{p['key']} {p['true']:.4g} not in [{p['low']:.4g}, {p['high']:.4g}]"
        for p in s["parameters"] if not p["inside"]
    ]  # fmt: skip
    if worse_held_out(row) or _explains_nothing(row):
        f = row["figures"]
        out.append(f"held out {f['held_model']:.1f} -> {f['held_augmented']:.1f} noises")
    return out


def _physics(row: Row) -> list[str]:
    shape = ("shape", "asymmetry", "sensor", "unknown")
    return [h["name"] for h in row["truth"]["hidden"] if h["name"] not in shape]


def _first(row: Row) -> bool:
    return bool(row["score"]["first_right"])


def _all(row: Row) -> bool:
    return set(row["score"]["got"]) >= set(row["score"]["asked"])


def _nothing_named(row: Row) -> bool:
    return not row["score"]["spurious"]


def _disagrees(row: Row) -> bool:
    return bool(row["figures"]["disagrees"] > AGREES)


def _limits(rows: Iterable[Row]) -> list[Row]:
    return [one for r in rows for one in r["limits"]]


def _contradictions(row: Row) -> int:
    return len(row["score"]["contradicted"])


def _families(good: list[Row]) -> str:
    lines = [f"{'family':10s}{'cases':>6s}{'nothing wrong':>18s}{'median':>9s}{'longest':>9s}"]
    for family in dict.fromkeys(r["family"] for r in good):
        group = [r for r in good if r["family"] == family]
        times = [r["seconds"] for r in group]
        lines.append(
            f"{family:10s}{len(group):6d}{rate(group, lambda r: not wrong(r)):>18s}"
            f"{np.median(times):7.1f} s{max(times):7.1f} s"
        )
    return "\n".join(lines)


def _beside(good: list[Row]) -> str:
    group = singles(good)
    lines = ["Single effects by name: first, and what was named instead"]
    for name in sorted({r["score"]["asked"][0] for r in group}):
        mine = [r for r in group if r["score"]["asked"] == [name]]
        instead = [r["score"]["first"] or r["answer"]["verdict"] for r in mine if not _first(r)]
        lines.append(f"  {name:11s}{rate(mine, _first):>15s}  {', '.join(instead)}")
    right = [ok for r in good for ok in r["score"]["acts_on"]]
    if right:
        lines.append(f"what it acts on, of those named: {rate(right, bool)}")
    noises = [r["figures"]["noise_said"] for r in good]
    near = rate(noises, lambda x: 1 / NEAR < x < NEAR)
    lines.append(f"noise stated within a factor of {NEAR:g}: {near}")
    faults = [r for r in good if r["fault"]]
    lines.append(f"faults of the recorder said: {rate(faults, _said_of_data)}")
    return "\n".join(lines)


def _said_of_data(row: Row) -> bool:
    return bool(row["answer"]["data"]["says"])


def _failed(everything: list[Row]) -> str:
    lines = []
    for row in everything:
        if found := wrong(row):
            lines.append(f"  {row['case']:12s} {'; '.join(found)}")
    return "\n".join(["Wrong", *lines]) if lines else ""


def _times(good: list[Row]) -> str:
    if not good:
        return ""
    times = [r["seconds"] for r in good]
    return f"Time of a diagnosis: {np.median(times):.1f} s median, {max(times):.1f} s longest"
