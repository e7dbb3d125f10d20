"""Tables from the rows of bench_diagnosis: confusion, detection against size, false alarms."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from tests.benchmarks.bars import Bars

Row = dict[str, Any]
BINS = ((0.0, 0.2), (0.2, 0.35), (0.35, 0.7), (0.7, 1.4), (1.4, float("inf")))
LEAST_INTERVALS, COVERAGE = 200, (90.0, 98.0)
"""Coverage of 95 % intervals is judged on so many, and on both sides [%]."""


def first(row: Row) -> str:
    """The strongest effect that was named; "clean" or "unknown" without one."""
    if row["effects"]:
        return str(row["effects"][0]["name"])
    return "clean" if row["verdict"] == "clean" else "unknown"


def named(row: Row) -> list[str]:
    return [e["name"] for e in row["effects"]]


def first_right(row: Row) -> bool:
    """The strongest effect named is one of the hidden ones."""
    return first(row) in {h["name"] for h in row["hidden"]}


def right_or_tied(row: Row) -> bool:
    """As first_right, or the hidden one stands in the first effect's stated near-ties."""
    ties = row["effects"][0]["ambiguous_with"] if row["effects"] else []
    return first_right(row) or bool({h["name"] for h in row["hidden"]} & set(ties))


def false_alarm(row: Row) -> bool:
    """Something was named, or found unexplained, where nothing is hidden."""
    return row["verdict"] != "clean"


def _rate(rows: list[Row], test: Callable[[Row], bool]) -> str:
    if not rows:
        return "-"
    hits = sum(map(test, rows))
    return f"{100 * hits / len(rows):.0f} % ({hits}/{len(rows)})"


def tables(rows: Iterable[Row]) -> str:
    """All tables as text."""
    everything = list(rows)
    failed = [r for r in everything if "failed" in r]
    kinds = _by_kind(everything)
    single = kinds["single"] + kinds["own"]
    parts = [_confusion(kinds), _sizes(single), _by_effect(single), _beside(everything)]
    parts += [_coverage(kinds["own"])]
    if failed:
        parts.append(
            f"{len(failed)} cases failed:\n"
            + "\n".join(f"  {r['seed']}: {r['failed'].splitlines()[-1]}" for r in failed)
        )
    parts.append("Against the bars\n" + judge(everything).table())
    return "\n\n".join(p for p in parts if p)


def _confusion(kinds: dict[str, list[Row]]) -> str:
    rows = kinds["single"] + kinds["own"] + kinds["outside"] + kinds["clean"]
    if not rows:
        return ""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for row in rows:
        hidden = row["hidden"][0]["name"] if row["hidden"] else "clean"
        if row["kind"] == "single" and row["hidden"][0]["ratio"] < 0.35:
            hidden += " <.35"
        counts[hidden][first(row)] += 1
    columns = sorted({name for c in counts.values() for name in c})
    lines = ["Hidden (down) against named first (across); '<.35': leaves less than 0.35 sigma"]
    lines.append(f"{'':17s}" + "".join(f"{c[:9]:>10s}" for c in columns))
    for hidden in sorted(counts):
        cells = "".join(f"{counts[hidden][c] or '.':>10}" for c in columns)
        lines.append(f"{hidden:17s}{cells}")
    return "\n".join(lines)


def _sizes(single: list[Row]) -> str:
    if not single:
        return ""
    lines = [
        "Single effects by what they leave after the best refit of the rich base, over the noise",
        f"{'left / sigma':>14s}{'cases':>7s}{'not clean':>18s}{'named first':>18s}"
        f"{'or stated tie':>18s}{'misfit removed':>16s}",
    ]
    for low, high in BINS:
        group = [r for r in single if low <= r["ratio"] < high]
        if not group:
            continue
        removed = f"{100 * np.median([r['removed'] for r in group]):.0f} %"
        label = f"{low:g} - {high:g}" if np.isfinite(high) else f">= {low:g}"
        lines.append(
            f"{label:>14s}{len(group):>7d}{_rate(group, false_alarm):>18s}"
            f"{_rate(group, first_right):>18s}{_rate(group, right_or_tied):>18s}{removed:>16s}"
        )
    return "\n".join(lines)


def _by_effect(single: list[Row]) -> str:
    if not single:
        return ""
    lines = ["Single effects that leave 0.35 sigma and more, by effect"]
    names = sorted({r["hidden"][0]["name"] for r in single})
    for name in names:
        group = [r for r in single if r["hidden"][0]["name"] == name and r["ratio"] >= 0.35]
        if group:
            removed = 100 * np.median([r["removed"] for r in group])
            lines.append(
                f"  {name:11s} named first {_rate(group, first_right):>15s}, or stated tie "
                f"{_rate(group, right_or_tied):>15s}, removed {removed:.0f} %"
            )
    return "\n".join(lines)


def judge(rows: Iterable[Row]) -> Bars:
    """The bars of these rows; one without a case could not be judged."""
    bars, kinds = Bars(), _by_kind(rows)
    single = kinds["single"] + kinds["own"]
    strong = [r for r in single if r["ratio"] >= 0.7]
    middle = [r for r in single if 0.35 <= r["ratio"] < 0.7]
    pairs = [r for r in kinds["pair"] if min(h["ratio"] for h in r["hidden"]) >= 0.35]
    outside = [r for r in kinds["outside"] if r["ratio"] >= 0.35]

    def share(name: str, group: list[Row], test: Callable[[Row], bool], **bar: float) -> None:
        if not group:
            bars.cannot(name, "no such case in this run")
            return
        held = sum(map(test, group)) / len(group)
        low, high = bar.get("least", 0.0), bar.get("most", 1.0)
        words = f">= {100 * low:.0f} %" if "least" in bar else f"<= {100 * high:.0f} %"
        bars.add(name, _rate(group, test), words, low <= held <= high)

    share("single, leaves >= 0.7 sigma: named first", strong, first_right, least=0.9)
    share("single, leaves 0.35 to 0.7: named first", middle, first_right, least=0.75)
    share("pairs (each leaves >= 0.35): both named", pairs, _both, least=0.6)
    share("pairs: one of them first", pairs, first_right, least=0.9)
    share("clean: false alarms", kinds["clean"], false_alarm, most=0.02)
    share("outside the library (>= 0.35): unknown or partly", outside, _said_so, least=0.8)
    if strong:
        removed = 100 * float(np.median([r["removed"] for r in strong]))
        bars.least("misfit removed, held out, median (>= 0.7)", removed, 85.0, "%")
    stated = [p for r in kinds["own"] for p in r["parameters"] if p["stated"]]
    inside = 100 * sum(p["inside"] for p in stated) / max(1, len(stated))
    if len(stated) < LEAST_INTERVALS:
        few = f"{len(stated)} of at least {LEAST_INTERVALS} intervals"
        bars.cannot("true parameter inside its 95 % interval", few)
    else:
        figure = _rate(stated, lambda p: p["inside"])
        held = COVERAGE[0] <= inside <= COVERAGE[1]
        bars.add("true parameter inside its 95 % interval", figure, "90 to 98 %", held)
    busy = [r["cpu_s"] for group in kinds.values() for r in group if "cpu_s" in r]
    if busy:
        bars.most("longest case, on the processor", max(busy), 60.0, "s")
    bars.none("cases that failed", sum("failed" in r for r in rows))
    return bars


def _beside(rows: list[Row]) -> str:
    """Figures that have no bar."""
    kinds = _by_kind(rows)
    strong = [r for r in kinds["single"] + kinds["own"] if r["ratio"] >= 0.7]
    outside = [r for r in kinds["outside"] if r["ratio"] >= 0.35]
    lines = [
        f"Single, >= 0.7: own name first or among the near-ties: {_rate(strong, right_or_tied)}",
        f"Outside the library, something of it named all the same: {_rate(outside, _wrongly)}",
    ]
    if strong:
        beyond = np.median([1.0 - (r["model_um"] / r["rich_um"]) ** 2 for r in strong])
        lines.append(f"Removed of what the rich base leaves on it (>= 0.7): {100 * beyond:.0f} %")
    times = [r["seconds"] for group in kinds.values() for r in group]
    if times:
        lines.append(f"Time a case, median / longest: {np.median(times):.0f} / {max(times):.0f} s")
    return "\n".join(lines)


def _by_kind(rows: Iterable[Row]) -> dict[str, list[Row]]:
    kinds: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        if "failed" not in row:
            kinds[row["kind"]].append(row)
    return kinds


def _said_so(row: Row) -> bool:
    return row["verdict"] in ("unknown", "partly")


def _both(row: Row) -> bool:
    return {h["name"] for h in row["hidden"]} <= set(named(row))


def _wrongly(row: Row) -> bool:
    return any(name != "unknown" for name in named(row))


def _coverage(own: list[Row]) -> str:
    stated = [p for r in own for p in r["parameters"]]
    if not stated:
        return ""
    lines = ["Textbook forms: true parameter inside its stated 95 % interval"]
    groups: dict[str, list[Row]] = defaultdict(list)
    for p in stated:
        groups[f"{p['name']}.{p['key']}"].append(p)
    for key, group in sorted(groups.items()):
        with_interval = [p for p in group if p["stated"]]
        misses = [
            f"{p['true']:.4g} not in [{p['low']:.4g}, {p['high']:.4g}]"
            for p in with_interval
            if not p["inside"]
        ]
        inside = _rate(with_interval, lambda p: p["inside"])
        lines.append(f"  {key:32s} {inside:>16s}  {'; '.join(misses[:3])}")
    return "\n".join(lines)
