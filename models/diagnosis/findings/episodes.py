"""Effects that are present for part of the time: a line in some stretches, a slip, a change in
mid-record.

They are searched for in the residual of the final fit. A recording is cut into stretches; a line
must tower over its neighbours in consecutive stretches, and be absent in others; a slip is one step
of the level; a change is an excess that begins, or ends, at a time.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dehyst.models.diagnosis.result import Finding, Value
from dehyst.models.physics import line_for_a_time
from dehyst.models.physics.candidate import format_length
from dehyst.models.signals.error_size import Z95, rms
from dehyst.models.signals.joined import Bools, Data, Floats, Ints
from dehyst.models.signals.lines import is_drive_line

STRETCHES = 24
LEAST = 128  # samples of a stretch, at least
TOWERS = 6.0  # times the median of its neighbours, for a line in a stretch
ABSENT = 0.35  # of the largest amplitude: below, the line is absent
MOST_OF_TIME = 0.75  # present for longer, it is no episode
NEIGHBOURS = 20  # bins to either side
SAME_LINE = 0.01  # relative distance of frequencies
BAND = 1.25  # factor of frequency to either side, within which a line must be alone:
LEFT = 0.3  # of its power, at most, may remain there, and be there at other times
SLIP = 0.4  # of the excess, which one step of the level must explain
CHANGE = 0.6  # of the excess, which must lie on one side of a time,
CHANGES_BY = 5.0  # with a power this many times that on the other side


@dataclass(frozen=True)
class Episode:
    """A finding and the (N,) contribution that it removes from the residual. of_stage: the stage
    itself changes, so that a model is judged by the readings with the change in them."""

    finding: Finding
    removed: Floats
    of_stage: bool = False


def find_episodes(data: Data, residual: Floats, sigma: float) -> Episode | None:
    """Return the strongest line that is present for part of the time, with all its times; None if
    there is none."""
    first = find_line(data, residual, sigma)
    if first is None:
        return None
    frequency = first.finding.parameters["frequency_hz"].value
    removed, found = first.removed, [first.finding]
    for _ in data.names:
        more = find_line(data, residual - removed, sigma)
        if more is None:
            break
        if abs(more.finding.parameters["frequency_hz"].value / frequency - 1.0) > SAME_LINE:
            break
        removed = removed + more.removed
        found.append(more.finding)
    where = {**first.finding.where, "time": "; ".join(one.where["time"] for one in found)}
    spans = [_span(one.where) for one in found]
    every = " and ".join([", ".join(spans[:-1]), spans[-1]] if len(spans) > 1 else spans)
    says = first.finding.says.replace(spans[0], every)
    share = float(np.sum(removed**2)) / max(int(data.rows.sum()), 1)
    return Episode(replace(first.finding, share=share, where=where, says=says), removed)


def _span(where: Mapping[str, Any]) -> str:
    """Return from when to when a line is present, and in which recording."""
    return f"{where['from_s']:.3g} to {where['to_s']:.3g} s of {where['recording']}"


def find_line(data: Data, residual: Floats, sigma: float) -> Episode | None:
    """Return the strongest line that is present in part of one recording."""
    found = [
        line
        for i in range(len(data.names))
        for line in _lines_of(data, residual, i)
        if _is_alone(data, residual, sigma, line)
        and not is_drive_line(data, residual, line.here, line.frequency)
    ]
    if not found:
        return None
    line = max(found, key=lambda one: float(np.sum(one.removed**2)))
    here, f = line.here, line.frequency
    start, end = float(data.t[here].min()), float(data.t[here].max())
    size = float(np.sqrt(2.0 * np.mean(line.removed[here] ** 2)))
    half = max(Z95 * float(np.std(line.sizes)), 0.1 * size)
    name = data.names[line.recording]
    where: dict[str, Any] = {"recording": name, "from_s": start, "to_s": end}
    where["time"] = f"{name}, {start:.3g} to {end:.3g} s"
    sure = 0.5 / max(end - start, 1e-9)
    finding = Finding(
        **line_for_a_time(f, format_length((size, data.unit)), _span(where)),
        share=float(np.sum(line.removed**2)) / max(int(data.rows.sum()), 1),
        evidence={"removed_rms": rms(line.removed[here])},
        parameters={
            "frequency_hz": Value(f, f - sure, f + sure, "Hz"),
            f"amplitude_{data.unit}": Value(
                size, max(size - half, 0.1 * size), size + half, data.unit
            ),
        },
        ambiguous_with=(),
        where=where,
    )
    return Episode(finding, line.removed)


@dataclass(frozen=True)
class _Line:
    """A line in some stretches of a recording. here, removed: (N,) where it is, and its waveform;
    sizes: its amplitude by stretch."""

    recording: int
    frequency: float
    sizes: list[float]
    here: Bools
    removed: Floats


def _lines_of(data: Data, residual: Floats, i: int) -> list[_Line]:
    """Return lines that tower in consecutive stretches, and are absent in others."""
    at = np.flatnonzero((data.rec == i) & (data.raw_index >= 0))
    each = at.size // STRETCHES
    if each < LEAST:
        return []
    e = residual[at[: each * STRETCHES]].reshape(STRETCHES, each)
    u = data.u[at[: each * STRETCHES]].reshape(STRETCHES, each)
    window = np.hanning(each)
    amplitude = np.abs(np.fft.rfft((e - e.mean(axis=1, keepdims=True)) * window)) / (each / 4)
    driven = np.abs(np.fft.rfft((u - u.mean(axis=1, keepdims=True)) * window)) / (each / 4)
    floor = _floor(amplitude)
    towers = (amplitude > TOWERS * floor) & (driven < TOWERS * _floor(driven) + 1e-9)
    towers[:, :4] = False
    dt = float(data.dt[at[0]])
    out: list[tuple[float, int, Ints]] = []
    for k in np.flatnonzero(towers.sum(axis=0) >= 2).tolist():
        a = amplitude[:, k - 1 : k + 2].max(axis=1)
        runs = np.flatnonzero(a > ABSENT * a.max())
        together = runs.size == runs[-1] - runs[0] + 1
        if runs.size > MOST_OF_TIME * STRETCHES or runs.size < 2 or not together:
            continue
        if towers[runs, k].any():
            out.append((float(np.sum(a[runs] ** 2)), k, runs))
    lines = []
    for _, k, runs in sorted(out, key=lambda one: -one[0])[:3]:
        first, last = at[runs[0] * each], at[min((runs[-1] + 1) * each, at.size) - 1]
        here = (data.rec == i) & (data.t >= data.t[first]) & (data.t <= data.t[last])
        peak = int(k - 1 + np.argmax(np.sum(amplitude[runs, k - 1 : k + 2] ** 2, axis=0)))
        f, removed = _fit_line(data, residual, here, peak / (each * dt))
        inner = runs[1:-1] if runs.size > 3 else runs
        sizes = amplitude[inner, k - 1 : k + 2].max(axis=1).tolist()
        lines.append(_Line(i, f, sizes, here, removed))
    return lines


def _is_alone(data: Data, residual: Floats, sigma: float, line: _Line) -> bool:
    """Return whether the line holds most of the power near its frequency while it is present, and
    there is little at other times: a component that wanders, or rings now and then, is no line."""
    here = line.here
    if float(np.sum(line.removed[here] ** 2)) < (5.0 * sigma) ** 2 * 8:
        return False
    whole = data.rec == line.recording
    dt = float(data.dt[whole][0])
    before = _band(residual[whole], dt, line.frequency)
    after = _band((residual - line.removed)[whole], dt, line.frequency)
    inside = here[whole]
    noise = 2.0 * sigma**2 * dt * line.frequency * (BAND - 1.0 / BAND)
    power = float(np.mean(before[inside] ** 2))
    left = max(float(np.mean(after[inside] ** 2)) - noise, 0.0)
    other = max(float(np.mean(before[~inside] ** 2)) - noise, 0.0) if np.any(~inside) else 0.0
    return left < LEFT * power and other < LEFT * power


def _band(x: Floats, dt: float, f: float) -> Floats:
    """Return the part of a signal near a frequency."""
    spectrum = np.fft.rfft(x - x.mean())
    at = np.fft.rfftfreq(x.size, dt)
    spectrum[(at < f / BAND) | (at > f * BAND)] = 0.0
    return np.fft.irfft(spectrum, x.size).astype(np.float64)


def describe_residual_change(
    data: Data, residual: Floats, sigma: float
) -> tuple[str, dict[str, float | str]]:
    """Return, in words and as places, when the level or the size of the residual changes; "" and {}
    where it does not."""
    spans: list[tuple[float, str, dict[str, float | str]]] = []
    whole = float(np.sum(residual[data.rows] ** 2)) - sigma**2 * int(data.rows.sum())
    for i, name in enumerate(data.names):
        at = np.flatnonzero((data.rec == i) & data.rows)
        if at.size < 10 * STRETCHES:
            continue
        e, t = residual[at], data.t[at]
        step, jump, gain = _best_step(e)
        if gain > SLIP * whole and abs(jump) > sigma:
            text = (
                f"the level slips by {format_length((jump, data.unit))} at {t[step]:.3g} s of "
                f"{name}"
            )
            spans.append((gain, text, {"recording": name, "from_s": float(t[step])}))
        step, _, _ = _best_step(e**2)
        before, after = (float(np.mean(x**2)) - sigma**2 for x in (e[:step], e[step:]))
        share = max(after * (e.size - step), before * step) / max(whole, 1e-300)
        low, high = sorted((max(before, 0.05 * sigma**2), max(after, 0.05 * sigma**2)))
        inside = 0.05 * e.size < step < 0.95 * e.size
        if inside and share > CHANGE and high > CHANGES_BY * low:
            when = "from" if after > before else "until"
            text = f"it is there {when} {t[step]:.3g} s of {name}"
            places: dict[str, float | str] = {"recording": name, f"{when}_s": float(t[step])}
            spans.append((0.5 * whole * share, text, places))
    if not spans:
        return "", {}
    return max(spans, key=lambda one: one[0])[1:]


def _best_step(x: Floats) -> tuple[int, float, float]:
    """Return index, size and fall of the sum of squares of the best single step of a mean."""
    n = x.size
    c = np.cumsum(x - x.mean())
    k = np.arange(1, n)
    gain = c[:-1] ** 2 * n / (k * (n - k))
    edge = max(5, n // 50)
    gain[:edge] = gain[-edge:] = 0.0
    at = int(np.argmax(gain)) + 1
    return at, float(x[at:].mean() - x[:at].mean()), float(gain[at - 1])


def _floor(amplitude: Floats) -> Floats:
    """Return the median over each bin's neighbours, stretch by stretch."""
    n = amplitude.shape[1]
    out = np.empty_like(amplitude)
    for k in range(n):
        a, b = max(0, k - NEIGHBOURS), min(n, k + NEIGHBOURS + 1)
        out[:, k] = np.median(amplitude[:, a:b], axis=1)
    return out + 1e-300


def _fit_line(data: Data, residual: Floats, here: Bools, f0: float) -> tuple[float, Floats]:
    """Return the frequency near f0 that removes most, and the line (N,), 0 elsewhere."""
    t, e = data.t[here], residual[here] - residual[here].mean()
    width = 1.5 / max(float(np.ptp(t)), 1e-9) * 4
    best = (-1.0, f0, np.zeros(t.size))
    for f in f0 + np.linspace(-width, width, 97):
        a = np.column_stack([np.sin(2 * np.pi * f * t), np.cos(2 * np.pi * f * t)])
        line = a @ np.linalg.lstsq(a, e, rcond=None)[0]
        power = float(line @ line)
        if power > best[0]:
            best = (power, float(f), line)
    out = np.zeros(data.n)
    out[here] = best[2]
    return best[1], out
