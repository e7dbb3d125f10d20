"""Tables from the rows of bench_diagnosis: confusion, detection against size, false alarms."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

Row = dict[str, Any]
BINS = ((0.0, 0.2), (0.2, 0.35), (0.35, 0.7), (0.7, 1.4), (1.4, float("inf")))


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
    good = [r for r in everything if "failed" not in r]
    kinds: dict[str, list[Row]] = defaultdict(list)
    for row in good:
        kinds[row["kind"]].append(row)
    single = kinds["single"] + kinds["own"]
    parts = [_confusion(kinds), _sizes(single), _by_effect(single), _summary(kinds, single)]
    parts += [_coverage(kinds["own"])]
    if failed:
        parts.append(
            f"{len(failed)} cases failed:\n"
            + "\n".join(f"  {r['seed']}: {r['failed'].splitlines()[-1]}" for r in failed)
        )
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


def _summary(kinds: dict[str, list[Row]], single: list[Row]) -> str:
    strong = [r for r in single if r["ratio"] >= 0.7]
    middle = [r for r in single if 0.35 <= r["ratio"] < 0.7]
    pairs = [r for r in kinds["pair"] if min(h["ratio"] for h in r["hidden"]) >= 0.35]
    outside = [r for r in kinds["outside"] if r["ratio"] >= 0.35]
    lines = ["Against the bars"]

    def add(text: str, value: str, bar: str) -> None:
        lines.append(f"  {text:58s} {value:>16s}   bar {bar}")

    add("single, leaves >= 0.7 sigma: named first", _rate(strong, first_right), ">= 90 %")
    add("  the same, its own name among the stated near-ties", _rate(strong, right_or_tied), "-")
    add("single, leaves 0.35 to 0.7: named first", _rate(middle, first_right), ">= 75 %")
    add("pairs (each leaves >= 0.35): both named", _rate(pairs, _both), ">= 60 %")
    add("pairs: one of them first", _rate(pairs, first_right), ">= 90 %")
    add("clean: false alarms", _rate(kinds["clean"], false_alarm), "<= 2 %")
    add(
        "outside the library (leaves >= 0.35): unknown or partly",
        _rate(outside, lambda r: r["verdict"] in ("unknown", "partly")),
        ">= 80 %",
    )
    add("  of these something of the library named all the same", _rate(outside, _wrongly), "-")
    if strong:
        removed = np.median([r["removed"] for r in strong])
        add("misfit removed, held out, median (>= 0.7)", f"{100 * removed:.0f} %", ">= 85 %")
        beyond = np.median([1.0 - (r["model_um"] / r["rich_um"]) ** 2 for r in strong])
        add("  of what the rich base leaves on it", f"{100 * beyond:.0f} %", "-")
    times = [r["seconds"] for group in kinds.values() for r in group]
    if times:
        add("time a case, median / longest", f"{np.median(times):.0f} / {max(times):.0f} s", "60 s")
        busy = [r["cpu_s"] for group in kinds.values() for r in group if "cpu_s" in r]
        if busy:  # the machine may have had other work
            add("  of it on the processor", f"{np.median(busy):.0f} / {max(busy):.0f} s", "60 s")
    return "\n".join(lines)


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
    with_interval = [p for p in stated if p["stated"]]
    lines.append(f"  all: {_rate(with_interval, lambda p: p['inside'])}   bar >= 85 %")
    return "\n".join(lines)
