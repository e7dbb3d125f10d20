"""Result of the self-test of `dehyst latency`, for machines and for people."""

from typing import Any

from dehyst.daemon.latency.latency import LatencyOutcome
from dehyst.daemon.loop.timing.histogram import Histogram
from dehyst.daemon.rings.records import MissCause

BAR = 46  # characters of the longest bar


def _figures(histogram: Histogram) -> dict[str, float]:
    names = ("p50_us", "p99_us", "p99_9_us", "max_us")
    return dict(zip(names, (round(v, 1) for v in histogram.summary()), strict=True))


def latency_figures(
    outcome: LatencyOutcome, found: dict[str, str], hints: list[str]
) -> dict[str, Any]:
    """Return the figures as a dictionary. found, hints: from dehyst.daemon.latency.machine.facts
    and advice."""
    setup, obtained = outcome.setup, outcome.obtained
    return {
        "held": outcome.held,
        "rate_hz": setup.rate_hz,
        "seconds": setup.seconds,
        "engine": setup.engine,
        "policy": "fifo" if obtained.fifo else "other",
        "priority": obtained.priority,
        "memory_locked": obtained.locked,
        "idle_states_bounded": obtained.awake,
        "cpus": list(obtained.cpus),
        "samples": outcome.samples,
        "missed": outcome.missed,
        "missed_by": outcome.missed_by,
        "missed_excused_by_witness": outcome.excused,
        "wake": _figures(outcome.wake),
        "execution": _figures(outcome.execution),
        "io": {name: _figures(h) for name, h in outcome.io.items()},
        "witness": {
            "threshold_us": outcome.stall_threshold_us,
            "late": outcome.stall_count,
            "longest_us_of_last_256": max(
                (late * 1e-3 for _, late, _ in outcome.stalls), default=0.0
            ),
            "by": {
                cause.name.lower(): sum(c is cause for _, _, c in outcome.stalls)
                for cause in MissCause
                if any(c is cause for _, _, c in outcome.stalls)
            },
        },
        "machine": found,
        "advice": hints,
    }


def describe_latency(
    outcome: LatencyOutcome, found: dict[str, str], hints: list[str], pictures: bool
) -> list[str]:
    """Return the lines of the text report; pictures: include the histograms."""
    setup, obtained = outcome.setup, outcome.obtained
    policy = f"FIFO {obtained.priority}" if obtained.fifo else "ordinary scheduling"
    memory = "memory locked" if obtained.locked else "memory not locked"
    idle = ", idle states bounded" if obtained.awake else ""
    text = [
        f"{setup.rate_hz:g} Hz for {setup.seconds:g} s, {setup.engine} loop on a simulated stage",
        f"obtained: {policy}, {memory}{idle}, CPUs {', '.join(map(str, obtained.cpus))}",
        "machine: " + "; ".join(f"{name} {value}" for name, value in found.items() if value),
        "",
        f"{'microseconds':24}{'p50':>10}{'p99':>10}{'p99.9':>10}{'max':>10}",
    ]
    rows = {"wake-up lateness": outcome.wake, "execution": outcome.execution, **outcome.io}
    for name, histogram in rows.items():
        text.append(f"{name:24}" + "".join(f"{v:10.1f}" for v in histogram.summary()))
    if pictures:
        for name, histogram in rows.items():
            text += ["", f"{name}, us", *_bars(histogram)]
    text += ["", *_verdict(outcome)]
    if hints:
        text += ["", "advice:", *(f"- {hint}" for hint in hints)]
    return text


def _bars(histogram: Histogram) -> list[str]:
    """Return one line per bin; the length grows with the logarithm of the count, so that rare ones
    show."""
    rows = histogram.rows()
    most = max((n for _, _, n in rows), default=1)
    text = []
    for low, high, n in rows:
        length = round(BAR * n.bit_length() / most.bit_length()) if n else 0
        text.append(f"{low:9.1f} to {high:9.1f} {n:9d} {'#' * length}")
    return text


def _verdict(outcome: LatencyOutcome) -> list[str]:
    own = outcome.missed - outcome.excused
    causes = ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in outcome.missed_by.items())
    text = [f"deadlines: {outcome.missed} of {outcome.samples} missed"]
    if outcome.missed:
        text[0] += f" ({causes})"
        text.append(
            f"  {outcome.excused} of them while the witness, at a higher priority on the same "
            f"CPU, was late as well, so the machine caused them; the program caused {own}"
        )
    if outcome.stalls:
        longest = max(late for _, late, _ in outcome.stalls) * 1e-6
        text.append(
            f"witness: late by more than {outcome.stall_threshold_us:.0f} us "
            f"{outcome.stall_count} times, {longest:.2f} ms at most among the last "
            f"{len(outcome.stalls)}"
        )
    else:
        text.append(f"witness: never late by more than {outcome.stall_threshold_us:.0f} us")
    period_us = 1e6 / outcome.setup.rate_hz
    if outcome.io:
        text.append(
            f"the device calls take {outcome.io_us:.0f} us of the {period_us:.0f} us period: these "
            f"devices allow about {outcome.allowed_hz:.0f} Hz"
        )
    text.append(f"{outcome.setup.rate_hz:g} Hz {'held' if outcome.held else 'NOT held'}")
    return text
