"""Paths in the plane: raster, spiral, Lissajous figure. Targets of two axes over time.

Every path begins and ends at rest at one place, so that it can be repeated, and has no corner:
during a turn of a raster the speed is half a cosine, v cos(pi t / T), which continues smoothly from
the line before and overshoots its end by v T / pi; spiral and Lissajous figure accelerate along
their own path.
"""

from dataclasses import dataclass

import numpy as np

from dehyst.models.errors import BadInput
from dehyst.models.recording import Bools, Floats

MOST_SAMPLES = 5_000_000  # of a path: 40 MB an axis
FINE = 20_000  # points of a path, from which its timing is computed


@dataclass(frozen=True)
class Scan:
    """A path. t_s: (N,) from 0, evenly spaced; x, y: (N,) targets in the unit of the sizes; image:
    (N,) True where the scan proper runs, False in turns and on the way in, out and back; says: a
    description in words."""

    t_s: Floats
    x: Floats
    y: Floats
    image: Bools
    says: str

    @property
    def speed(self) -> tuple[float, float]:
        """Largest speed of either axis [unit/s]."""
        step = self.t_s[1] - self.t_s[0]
        return float(np.max(np.abs(np.diff(self.x)))) / step, float(
            np.max(np.abs(np.diff(self.y)))
        ) / step


def scan_raster(
    width: float, height: float, lines: int, line_s: float, period_s: float, turn: float = 0.2
) -> Scan:
    """Return a raster: lines back and forth along x, `height` apart in y from the first to the
    last.

    line_s: duration of a line and its turn; turn: share of it that the turn takes, while y moves to
    the next line. The lines themselves run at constant speed over the whole width. Raises BadInput.
    """
    _require_above_0(width=width, height=height, line_s=line_s, period_s=period_s)
    if lines < 2:
        raise BadInput(f"a raster has at least 2 lines, not {lines}")
    if not 0.02 <= turn <= 0.9:
        raise BadInput(f"turn: a share of the line from 0.02 to 0.9, not {turn:g}")
    turn_s = turn * line_s
    way_s = line_s - turn_s
    speed = width / way_s
    beyond = speed * turn_s / np.pi
    # half a turn from rest, the lines with turns between them, half a turn to rest
    scan_s = lines * way_s + (lines - 1) * turn_s + turn_s
    back_s = _time_back(width + 2.0 * beyond, height, speed)
    t = _times(scan_s + back_s, period_s)
    edge = 0.5 * width
    k = np.clip(np.floor((t - 0.5 * turn_s) / line_s), 0, lines - 1)
    local = t - 0.5 * turn_s - k * line_s  # since the start of the line
    way = 1.0 - 2.0 * (k % 2)
    image = (local >= 0.0) & (local <= way_s)
    share = np.where(local < 0.0, local, np.maximum(local - way_s, 0.0)) / turn_s
    x = way * (np.clip(speed * local, 0.0, width) - edge + beyond * np.sin(np.pi * share))
    next_line = _smooth(np.where(k < lines - 1, np.maximum(share, 0.0), 0.0))
    y = (k + next_line) * height / (lines - 1) - 0.5 * height
    back = t > scan_s
    at = edge + beyond if lines % 2 else -edge - beyond
    share = _smooth(np.minimum((t[back] - scan_s) / back_s, 1.0))
    x[back] = at + share * (-edge - beyond - at)
    y[back] = 0.5 * height - share * height
    says = (
        f"raster of {width:g} x {height:g}, {lines} lines of {line_s:g} s, of which the turn takes "
        f"{turn_s:.3g} s and goes {beyond:.3g} beyond the line"
    )
    return Scan(t, x, y, image, says)


def scan_spiral(radius: float, pitch: float, speed: float, most_hz: float, period_s: float) -> Scan:
    """Return an Archimedean spiral from the centre, r = pitch angle / (2 pi), at constant speed
    along the path except near the middle, where it makes at most most_hz turns a second. Raises
    BadInput."""
    _require_above_0(radius=radius, pitch=pitch, speed=speed, most_hz=most_hz, period_s=period_s)
    if pitch > radius:
        raise BadInput(f"pitch {pitch:g}: it is too wide for a spiral of radius {radius:g}")
    b = pitch / (2.0 * np.pi)
    angle = np.linspace(0.0, radius / b, FINE)
    rate = np.minimum(2.0 * np.pi * most_hz, speed / np.hypot(b * angle, b))
    at_s = np.concatenate([[0.0], np.cumsum(np.diff(angle) * 0.5 * (1 / rate[1:] + 1 / rate[:-1]))])
    ramp_s = 0.5 / most_hz  # half of the fastest turn
    along, image = _run_through(float(at_s[-1]), ramp_s, period_s)
    phi = np.interp(along, at_s, angle)
    x = np.asarray(b * phi * np.cos(phi), np.float64)
    y = np.asarray(b * phi * np.sin(phi), np.float64)
    back_s = _time_back(radius, radius, speed)
    n = along.size + _times(back_s, period_s).size
    t = np.arange(n, dtype=np.float64) * period_s
    share = _smooth(np.clip((t[along.size :] - (along.size - 1) * period_s) / back_s, 0.0, 1.0))
    home = 1.0 - share
    x, y = np.concatenate([x, x[-1] * home]), np.concatenate([y, y[-1] * home])
    image = np.concatenate([image, np.zeros(share.size, dtype=bool)])
    says = f"spiral of radius {radius:g}, its turns {pitch:g} apart, {speed:g} a second along it"
    return Scan(t, x, y, image, says)


def scan_lissajous(
    width: float,
    height: float,
    ratio: tuple[int, int],
    figure_s: float,
    period_s: float,
    turns: int = 2,
) -> Scan:
    """Return a Lissajous figure, x = width/2 sin(2 pi a t / figure_s + pi/2), y = height/2 sin(2 pi
    b t / figure_s), for the ratio a : b; `turns` whole figures, slower while it accelerates and
    comes to rest. Raises BadInput."""
    _require_above_0(width=width, height=height, figure_s=figure_s, period_s=period_s)
    a, b = ratio
    if min(a, b) < 1 or turns < 1:
        raise BadInput(f"ratio and turns are whole numbers from 1, not {a}:{b} and {turns}")
    ramp_s = figure_s / 8.0  # gentle: an eighth of a figure
    along, image = _run_through(turns * figure_s, ramp_s, period_s)
    phase = 2.0 * np.pi * along / figure_s
    x = 0.5 * width * np.sin(a * phase + 0.5 * np.pi)
    y = 0.5 * height * np.sin(b * phase)
    t = np.arange(along.size, dtype=np.float64) * period_s
    says = f"Lissajous figure {a}:{b} of {width:g} x {height:g}, {turns} of {figure_s:g} s"
    return Scan(t, x, y, image, says)


def _run_through(length_s: float, ramp_s: float, period_s: float) -> tuple[Floats, Bools]:
    """Return (N,) places from 0 to length_s on a path that takes length_s at full speed, and where
    the speed is 1: it rises from 0 to 1 over the first ramp_s and falls to 0 over the last."""
    whole_s = length_s + ramp_s
    t = _times(whole_s, period_s)
    rise, fall = np.clip(t / ramp_s, 0.0, 1.0), np.clip((whole_s - t) / ramp_s, 0.0, 1.0)

    def gathered(s: Floats) -> Floats:  # the integral of (1 - cos(pi s)) / 2
        return 0.5 * (s - np.sin(np.pi * s) / np.pi)

    along = ramp_s * gathered(rise) + np.clip(t - ramp_s, 0.0, whole_s - 2 * ramp_s)
    along += ramp_s * (0.5 - gathered(fall))
    return np.minimum(along, length_s), (rise >= 1.0) & (fall >= 1.0)


def _smooth(share: Floats) -> Floats:
    """Return a share mapped from 0 to 1 with rest at both ends: 10 s^3 - 15 s^4 + 6 s^5."""
    return np.asarray(share**3 * (10.0 - 15.0 * share + 6.0 * share**2))


def _time_back(width: float, height: float, speed: float) -> float:
    """Return the time of the way back on which the speed never exceeds `speed` (the peak of
    _smooth's slope is 1.875)."""
    return 1.875 * max(width, height) / speed


def _times(length_s: float, period_s: float) -> Floats:
    n = int(np.ceil(length_s / period_s - 1e-9)) + 1  # rounding
    if not 16 <= n <= MOST_SAMPLES:
        raise BadInput(f"the path has {n} samples; 16 to {MOST_SAMPLES} are allowed")
    return np.arange(n, dtype=np.float64) * period_s


def _require_above_0(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 < value < np.inf:
            raise BadInput(f"{name.removesuffix('_s')}: must be above 0, not {value:g}")
