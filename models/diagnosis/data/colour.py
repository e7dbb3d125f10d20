"""The colour of the noise: misfit that is unrelated to the drive and alike at all times.

The residual of the best fit counts as noise where
    - its spectrum falls smoothly, without lines, and not all of it is slower than a few waves of
      the longest recording (that is drift);
    - it is as strong at all times, at every scale;
    - the drive does not predict it: functions of the drive, and the displacement with an amplitude
      of its own in each block of time, explain no more of it than they do when shifted in time (the
      shifted ones keep the spectra of the drive and the noise, and only the relation is lost);
    - what repeats with a periodic drive is no stronger than what does not.
It is then reported as coloured noise, not as structure.
"""

from itertools import pairwise

import numpy as np

from dehyst.models.diagnosis.data.locate import seconds_since_turn
from dehyst.models.signals.filters import plays
from dehyst.models.signals.joined import Data, Floats, Ints, select_recording
from dehyst.models.signals.lines import find_lines
from dehyst.models.signals.periodic import fundamental_hz

LEAST = 64  # differences at a scale, at least, to judge it: 8 in each group
TOWERS = 6.0  # times the usual size, which no difference may reach: noise does, once in 5e8
GROUPS = 8  # of time, in each recording
EVEN = 0.7  # power in every group over the mean: between this and its inverse; it balances
# noise of changing strength against effects that come and go
CHANCE = 4.0  # allowed in addition: times the scatter of independent samples, once in 16 000
SHIFTS = 29  # time shifts of the drive's functions, of which chance exceeds all once in 30
MORE = 1.5  # times the most that these explain, a margin: above, the drive is related to it
ROWS = 12_000  # used for these 30 fits, to save time
OCTAVES = 10  # bands whose densities are compared, down from the highest frequency
PEAK = 2.5  # times the smallest density of the bands below: no band reaches it by its scatter
WAVES = 6.0  # per longest recording: what is slower is drift,
SLOW = 0.5  # if it holds more than this share of the power beyond the white noise
REPEATS = 2.0  # density at a periodic drive's harmonics over that between: half of it repeats


def is_coloured(data: Data, residual: Floats, sigma: float) -> bool:
    """Return whether the residual (N,) is noise of a colour other than white."""
    return (
        _falls(data, residual)
        and not _is_slow(data, residual, sigma)
        and _is_steady(data, residual)
        and not _repeats(data, residual)
        and not _is_driven(data, residual)
        and not _has_lines(data, residual)
    )


def _has_lines(data: Data, residual: Floats) -> bool:
    """Return whether a line stands out in all recordings, or in one, as of a channel that moves
    differently in each."""
    return bool(find_lines(data, residual)) or any(
        find_lines(select_recording(data, i), residual[data.rec == i], 1)
        for i in range(len(data.names))
    )


def _is_steady(data: Data, residual: Floats) -> bool:
    """Return whether, at every scale of time, the differences of neighbouring means are equally
    large throughout, and none is an outlier: for noise of any colour they are independent and
    normal (Haar wavelets)."""
    for i in range(len(data.names)):
        means = residual[data.rows & (data.rec == i)]
        while means.size >= 2 * LEAST:
            means = means[: means.size // 2 * 2].reshape(-1, 2)
            d = means[:, 1] - means[:, 0]
            means = means.mean(axis=1)
            whole = float(np.mean(d**2))
            usual = 1.4826 * float(np.median(np.abs(d)))  # std of normal noise
            if usual > 0.0 and float(np.abs(d).max()) > TOWERS * usual:
                return False
            for piece in np.array_split(d**2, GROUPS):
                chance = CHANCE * np.sqrt(2.0 / piece.size)
                power = float(np.mean(piece)) / max(whole, 1e-300)
                if not EVEN / (1.0 + chance) < power < (1.0 + chance) / EVEN:
                    return False
    return True


def _is_driven(data: Data, residual: Floats) -> bool:
    """Return whether functions of the drive explain more of the residual than the same, shifted in
    time."""
    every = max(1, int(data.rows.sum()) // ROWS)
    x = _functions(data)
    rng = np.random.default_rng(0)
    at = [np.flatnonzero(data.rec == i) for i in range(len(data.names))]
    used = np.zeros(data.n, bool)
    used[np.flatnonzero(data.rows)[::every]] = True
    e = residual[used] - residual[used].mean()

    def explained(shifts: Ints) -> float:
        order = np.concatenate([np.roll(k, -s) for k, s in zip(at, shifts, strict=True)])
        z = x[order[used]]
        z = z - z.mean(axis=0)
        size = np.sqrt(np.mean(z**2, axis=0))
        z = z[:, size > 0] / size[size > 0]
        gram = z.T @ z + 1e-6 * z.shape[0] * np.eye(z.shape[1])  # of the power: some are alike
        moment = z.T @ e
        return float(moment @ np.linalg.solve(gram, moment))

    sizes = np.array([k.size for k in at])
    still: Ints = np.zeros(sizes.size, dtype=np.int64)
    chance = [
        explained((sizes * rng.uniform(0.1, 0.9, sizes.size)).astype(np.int64))  # far from 0
        for _ in range(SHIFTS)
    ]
    return explained(still) > MORE * max(chance)


def _functions(data: Data) -> Floats:
    """Return (N, k) functions that misfit caused by the drive might resemble."""
    x = 2.0 * (data.u - data.u_min) / data.span - 1.0
    h = plays(np.array([0.1, 0.5]), x + 1.0, data.forgets) - 1.0  # narrow, wide: of half the range
    rate = np.diff(x, prepend=x[0]) / data.dt
    rate[data.starts] = 0.0
    turned = np.log(seconds_since_turn(data) + data.period)
    blocks = [x * (data.block == b) for b in np.unique(data.block)]
    return np.column_stack(
        [x, x**2, x**3, *h.T, *(h**2).T, rate, np.abs(rate), x * rate, turned, *blocks]
    )


def _repeats(data: Data, residual: Floats) -> bool:
    """Return whether a periodic drive's harmonics hold more of the residual than the frequencies
    between."""
    on, off = [], []
    for i in range(len(data.names)):
        here = data.rec == i
        dt = float(data.dt[here][0])
        first = fundamental_hz(data.u[here], dt)
        e = residual[here]
        if not first or first * e.size * dt < 8.0:  # periods: no bins lie between
            continue
        power = np.abs(np.fft.rfft((e - e.mean()) * np.hanning(e.size))) ** 2
        order = np.fft.rfftfreq(e.size, dt) / first
        apart = np.abs(order - np.round(order)) * first * e.size * dt  # in bins
        for k in range(1, 30):  # harmonics: the strongest are among them
            near = np.abs(order - k) < 0.5
            there, beside = near & (apart < 1.5), near & (apart > 2.5)  # in, beyond a Hann lobe
            if not (there.any() and beside.any()):
                break
            on.append(float(np.mean(power[there])))
            off.append(float(np.mean(power[beside])))
    return bool(on) and sum(on) > REPEATS * sum(off)


def _falls(data: Data, residual: Floats) -> bool:
    """Return whether the density falls from octave to octave, without a peak, in the longest
    part."""
    power, _ = _spectrum(data, residual)
    edges = power.size / 2.0 ** np.arange(OCTAVES, -1, -1)
    density = [
        float(np.mean(power[max(int(a), 2) : int(b)]))
        for a, b in pairwise(edges)
        if int(b) - max(int(a), 2) >= 8  # bins: their mean scatters by a third
    ]
    return all(b < PEAK * min(density[:k]) for k, b in enumerate(density) if k)


def _is_slow(data: Data, residual: Floats, sigma: float) -> bool:
    """Return whether most of the power beyond the white noise is as slow as the recordings are
    long."""
    power, length = _spectrum(data, residual)
    white = sigma**2 * float(np.sum(np.hanning(length) ** 2))
    over = float(np.sum(power[1:] - white))
    return float(np.sum(power[1 : int(WAVES) + 1])) > SLOW * max(over, 0.0)


def _spectrum(data: Data, residual: Floats) -> tuple[Floats, int]:
    """Return the power by bin of the longest part, with a Hann window, and its number of
    samples."""
    part = int(np.argmax(np.bincount(data.part)))
    e = residual[data.part == part]
    power = np.abs(np.fft.rfft((e - e.mean()) * np.hanning(e.size))) ** 2
    return power.astype(np.float64), e.size
