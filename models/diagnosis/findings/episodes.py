"""Effects that are present for part of the time: a line in some stretches, a slip, a change in
mid-record.

They are searched for in the residual of the final fit. A recording is cut into stretches; a line
must tower over its neighbours in consecutive stretches, and be absent in others; a slip is one step
of the level; a change is an excess that begins, or ends, at a time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dehyst.models.diagnosis.result import Finding, Value
from dehyst.models.physics import line_for_a_time
from dehyst.models.physics.candidate import format_length
from dehyst.models.signals.error_size import Z95, rms
from dehyst.models.signals.joined import Bools, Data, Floats, Ints
from dehyst.models.signals.lines import is_drive_line

STRETCHES = 24  # of each recording: its 4 % is the resolution in time
LEAST = 128  # samples of a stretch, at least
TOWERS = 6.0  # times the median of its neighbours, for a line in a stretch
ABSENT = 0.35  # of the largest amplitude: below, the line is absent
MOST_OF_TIME = 0.75  # present for longer, it is no episode
NEIGHBOURS = 20  # bins to either side
SAME_LINE = 0.01  # relative distance of frequencies
FREQUENCIES = 97  # tried near an expected one, and again within a step of the best of these
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
    """Return the strongest line that is present for part of the time, with all its times, which may
    be the whole of another recording; None if there is none."""
    first = _find_line(data, residual, sigma)
    if first is None:
        return None
    lines, removed = [first], first.removed
    for _ in data.names:
        more = _find_line(data, residual - removed, sigma)
        if more is None or abs(more.frequency / first.frequency - 1.0) > SAME_LINE:
            break
        removed = removed + more.removed
        lines.append(more)
    for i in sorted(set(range(len(data.names))) - {line.recording for line in lines}):
        whole = _line_throughout(data, residual, i, first)
        if whole is not None and _is_from_outside(data, residual, sigma, whole):
            removed = removed + whole.removed
            lines.append(whole)
    return Episode(_report(data, lines), removed)


@dataclass(frozen=True)
class _Line:
    """A line in some stretches of a recording. here, removed: (N,) where it is, and its waveform;
    sizes: its amplitude by stretch."""

    recording: int
    frequency: float
    sizes: list[float]
    here: Bools
    removed: Floats

    @property
    def power(self) -> float:
        """Sum of its squares."""
        return float(np.sum(self.removed**2))


def _report(data: Data, lines: Sequence[_Line]) -> Finding:
    """Return the finding for a line with all its times; the values are those of its longest or
    strongest presence."""
    lines = sorted(lines, key=lambda one: int(np.argmax(one.here)))
    names = [data.names[one.recording] for one in lines]
    ends = [(float(data.t[one.here].min()), float(data.t[one.here].max())) for one in lines]
    times = [f"{name}, {a:.3g} to {b:.3g} s" for name, (a, b) in zip(names, ends, strict=True)]
    spans = [f"{a:.3g} to {b:.3g} s of {name}" for name, (a, b) in zip(names, ends, strict=True)]
    where: dict[str, Any] = {"recording": names[0], "from_s": ends[0][0], "to_s": ends[0][1]}
    every = " and ".join([", ".join(spans[:-1]), spans[-1]] if len(spans) > 1 else spans)
    there = np.any([one.here for one in lines], axis=0)
    if len(lines) > 1 and there[np.argmax(there) :].all():  # once begun, it has not ended
        every = f"{ends[0][0]:.3g} s of {names[0]} on"
        del where["to_s"]
    most = max(lines, key=lambda one: one.power)
    f, size = most.frequency, float(np.sqrt(2.0 * np.mean(most.removed[most.here] ** 2)))
    half = max(Z95 * float(np.std(most.sizes)), 0.1 * size)  # few sizes may agree by chance
    sure = 0.5 / max(float(np.ptp(data.t[most.here])), 1e-9)  # Hz: half a bin
    return Finding(
        **line_for_a_time(f, format_length((size, data.unit)), every),
        share=sum(one.power for one in lines) / max(int(data.rows.sum()), 1),
        evidence={"removed_rms": rms(most.removed[most.here])},
        parameters={
            "frequency_hz": Value(f, f - sure, f + sure, "Hz"),
            f"amplitude_{data.unit}": Value(
                size, max(size - half, 0.1 * size), size + half, data.unit
            ),
        },
        ambiguous_with=(),
        where={**where, "time": "; ".join(times)},
    )


def _find_line(data: Data, residual: Floats, sigma: float) -> _Line | None:
    """Return the strongest line that is present in part of one recording."""
    found = [
        line
        for i in range(len(data.names))
        for line in _lines_of(data, residual, i)
        if _is_from_outside(data, residual, sigma, line)
    ]
    return max(found, key=lambda one: one.power, default=None)


def _is_from_outside(data: Data, residual: Floats, sigma: float, line: _Line) -> bool:
    """Return whether this is a single line, and not one of the drive."""
    by_drive = is_drive_line(data, residual, line.here, line.frequency)
    return _is_alone(data, residual, sigma, line) and not by_drive


class _Stretches(NamedTuple):
    """Spectra of a recording's stretches. at: indices of its samples; each: samples of a stretch;
    amplitude, towers: (STRETCHES, bins), towers: True where there is a line that the drive does not
    have."""

    at: Ints
    each: int
    bin_hz: float
    amplitude: Floats
    towers: Bools


def _stretches_of(data: Data, residual: Floats, i: int) -> _Stretches | None:
    """Return the spectra of a recording; None where it is too short."""
    at = np.flatnonzero((data.rec == i) & (data.raw_index >= 0))
    each = at.size // STRETCHES
    if each < LEAST:
        return None
    e = residual[at[: each * STRETCHES]].reshape(STRETCHES, each)
    u = data.u[at[: each * STRETCHES]].reshape(STRETCHES, each)
    window = np.hanning(each)
    amplitude = np.abs(np.fft.rfft((e - e.mean(axis=1, keepdims=True)) * window)) / (each / 4)
    driven = np.abs(np.fft.rfft((u - u.mean(axis=1, keepdims=True)) * window)) / (each / 4)
    towers = (amplitude > TOWERS * _floor(amplitude)) & (driven < TOWERS * _floor(driven) + 1e-9)
    towers[:, :4] = False  # bins: what is slower in a stretch is drift
    return _Stretches(at, each, 1.0 / (each * float(data.dt[at[0]])), amplitude, towers)


def _lines_of(data: Data, residual: Floats, i: int) -> list[_Line]:
    """Return lines that tower in consecutive stretches, and are absent in others."""
    cut = _stretches_of(data, residual, i)
    if cut is None:
        return []
    at, each, amplitude, towers = cut.at, cut.each, cut.amplitude, cut.towers
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
    for _, k, runs in sorted(out, key=lambda one: -one[0])[:3]:  # the strongest
        ends = runs[-1] == STRETCHES - 1  # the last one lacks the division's rest
        first, last = at[runs[0] * each], at[-1 if ends else (runs[-1] + 1) * each - 1]
        here = (data.rec == i) & (data.t >= data.t[first]) & (data.t <= data.t[last])
        peak = int(k - 1 + np.argmax(np.sum(amplitude[runs, k - 1 : k + 2] ** 2, axis=0)))
        f, removed = _fit_line(data, residual, here, peak * cut.bin_hz)
        inner = runs[1:-1] if runs.size > 3 else runs  # the line may begin or end in others
        sizes = amplitude[inner, k - 1 : k + 2].max(axis=1).tolist()
        lines.append(_Line(i, f, sizes, here, removed))
    return lines


def _line_throughout(data: Data, residual: Floats, i: int, same: _Line) -> _Line | None:
    """Return another recording's line in this recording, where it is present for most of the
    time."""
    cut = _stretches_of(data, residual, i)
    if cut is None:
        return None
    k = round(same.frequency / cut.bin_hz)
    near = slice(max(k - 1, 0), k + 2)
    if cut.towers[:, near].any(axis=1).sum() < 2:
        return None
    sizes = cut.amplitude[:, near].max(axis=1)
    if np.count_nonzero(sizes > ABSENT * np.mean(same.sizes)) <= MOST_OF_TIME * STRETCHES:
        return None
    here = data.rec == i
    f, removed = _fit_line(data, residual, here, same.frequency)
    alike = abs(f / same.frequency - 1.0) < SAME_LINE
    return _Line(i, f, sizes.tolist(), here, removed) if alike else None


def _is_alone(data: Data, residual: Floats, sigma: float, line: _Line) -> bool:
    """Return whether the line holds most of the power near its frequency while it is present, and
    there is little at other times: a component that wanders, or rings now and then, is no line."""
    here = line.here
    # 200 noise variances: the best of 1e5 lines in white noise holds about 25
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
        if at.size < 10 * STRETCHES:  # rows: too few to find a time
            continue
        e, t = residual[at], data.t[at]
        step, jump, gain = _best_step(e)
        if gain > SLIP * whole and abs(jump) > sigma:
            text = (
                f"the level shifts by {format_length((jump, data.unit))} at {t[step]:.3g} s of "
                f"{name}"
            )
            spans.append((gain, text, {"recording": name, "from_s": float(t[step])}))
        step, _, _ = _best_step(e**2)
        before, after = (float(np.mean(x**2)) - sigma**2 for x in (e[:step], e[step:]))
        share = max(after * (e.size - step), before * step) / max(whole, 1e-300)
        # 0.05 of the noise power: its estimate is no surer, and the ratio stays finite
        low, high = sorted((max(before, 0.05 * sigma**2), max(after, 0.05 * sigma**2)))
        inside = 0.05 * e.size < step < 0.95 * e.size  # at an end, few rows decide
        if inside and share > CHANGE and high > CHANGES_BY * low:
            when = "from" if after > before else "until"
            text = f"it is present {when} {t[step]:.3g} s of {name}"
            places: dict[str, float | str] = {"recording": name, f"{when}_s": float(t[step])}
            spans.append((0.5 * whole * share, text, places))  # a shift of the level says more
    if not spans:
        return "", {}
    return max(spans, key=lambda one: one[0])[1:]


def _best_step(x: Floats) -> tuple[int, float, float]:
    """Return index, size and fall of the sum of squares of the best single step of a mean."""
    n = x.size
    c = np.cumsum(x - x.mean())
    k = np.arange(1, n)
    gain = c[:-1] ** 2 * n / (k * (n - k))
    edge = max(5, n // 50)  # rows: at an end, few of them look like a step
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
    """Return the frequency near f0 whose fit to the counted rows removes most, and the line (N,), 0
    elsewhere."""
    t, counted = data.t[here], data.rows[here]
    if not counted.any():
        return f0, np.zeros(data.n)
    e = residual[here][counted] - residual[here][counted].mean()
    width = 1.5 / max(float(np.ptp(t)), 1e-9) * 4  # Hz: 6 bins of its length
    best = (-1.0, f0, np.zeros(t.size))
    for _ in range(2):
        for f in best[1] + np.linspace(-width, width, FREQUENCIES):
            a = np.column_stack([np.sin(2 * np.pi * f * t), np.cos(2 * np.pi * f * t)])
            line = a @ np.linalg.lstsq(a[counted], e, rcond=None)[0]
            power = float(np.sum(line[counted] ** 2))
            if power > best[0]:
                best = (power, float(f), line)
        width /= FREQUENCIES // 2  # one of the steps
    out = np.zeros(data.n)
    out[here] = best[2]
    return best[1], out
