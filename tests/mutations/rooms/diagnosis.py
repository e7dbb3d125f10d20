"""What a diagnosis accepts, and the figures that it shows."""

from tests.mutations.change import Change, room

TUNING, JUDGE = "models/diagnosis/tuning.py", "models/diagnosis/judge.py"
LIMITS, EVIDENCE = "models/diagnosis/findings/limits.py", "models/diagnosis/evidence.py"
INTERVALS, SEARCH = "models/diagnosis/intervals.py", "models/diagnosis/search.py"
WAY = "models/diagnosis/data/way.py"
BRISTLES = "models/physics/bristles.py"
RATE, MODE = "models/physics/rate.py", "models/physics/resonance.py"

CHANGES = [
    *room(
        ("tests/models/diagnosis/test_intervals.py",),
        Change(
            "width-0.6",
            INTERVALS,
            "half = TUNING.interval_width * float(",
            "half = 0.6 * float(",
            "intervals are a third as wide as they should be",
        ),
        Change(
            "width-2.5",
            INTERVALS,
            "half = TUNING.interval_width * float(",
            "half = 2.8 * float(",
            "intervals are wider than they should be",
        ),
        Change(
            "white-alone",
            INTERVALS,
            "    wide = np.maximum(wide, 1.0)\n",
            "    wide = np.ones(wide.size)\n",
            "what the base leaves does not count",
        ),
        Change(
            "leverage-left-out",
            INTERVALS,
            "left = np.sqrt(1.0 - np.minimum(leverage, TUNING.largest_leverage))",
            "left = 1.0",
            "with a rich base the intervals are too narrow",
        ),
        Change(
            "base-for-granted",
            INTERVALS,
            "np.concatenate([base, problem.counted(jac), extra], axis=1)",
            "np.concatenate([0.0 * base, problem.counted(jac), extra], axis=1)",
            "intervals as though the base were known",
        ),
    ),
    *room(
        ("tests/models/diagnosis/test_what_counts.py",),
        Change(
            "price-1",
            TUNING,
            "price: float = 16.0",
            "price: float = 1.0",
            "noise is told as physics",
        ),
        Change(
            "price-for-one",
            JUDGE,
            "* max(count + columns, 1)\n    return",
            "\n    return",
            "causes with many parameters are told too easily",
        ),
        Change(
            "price-not-asked",
            JUDGE,
            "if trial.worth <= 0:",
            "if False:",
            "noise is told as physics",
        ),
        Change(
            "driven-size",
            TUNING,
            "driven_size: float = 0.17",
            "driven_size: float = 0.03",
            "the base's own error is told as physics",
        ),
        Change(
            "free-size",
            TUNING,
            "free_size: float = 0.12",
            "free_size: float = 0.03",
            "traces of noise are told as coupling",
        ),
        Change(
            "static-size",
            TUNING,
            "static_size: float = 0.3",
            "static_size: float = 0.05",
            "hysteresis of another shape is told as physics",
        ),
        Change(
            "size-not-asked",
            JUDGE,
            "elif mean_square < least_power(state, trial.candidate) and",
            "elif False and",
            "traces of noise are told as physics",
        ),
        Change(
            "constancy-off",
            JUDGE,
            "(steady.wrong > 0.3 or steady.spread > trial.candidate.widest_spread)",
            "False",
            "what is there in one recording alone is told of the stage",
        ),
        Change(
            "contradiction-accepted",
            JUDGE,
            "(steady.wrong > 0.3 or steady.spread > trial.candidate.widest_spread)",
            "steady.spread > trial.candidate.widest_spread",
            "a cause that one recording contradicts is told",
            survives="the scatter over the recordings, beside it, refuses what the tests put there",
        ),
        Change(
            "scatter-accepted",
            JUDGE,
            "(steady.wrong > 0.3 or steady.spread > trial.candidate.widest_spread)",
            "steady.wrong > 0.3",
            "a cause that comes and goes is told of the whole",
        ),
        Change(
            "spread-without-blocks",
            EVIDENCE,
            "xr, xx = sums(data.block)",
            "xr, xx = sums(data.rec)",
            "a cause that comes and goes is told of the whole",
        ),
        Change(
            "limits-three-times",
            LIMITS,
            "_guess(look, c, float(np.sqrt(least)))",
            "_guess(look, c, 3.0 * float(np.sqrt(least)))",
            "the user is told of limits that are twice what would be seen",
        ),
        Change(
            "limits-not-asked-again",
            LIMITS,
            "if c.name in seen(c, contribution_of(look, c, here.probe)):",
            "if c.name:",
            "the user is told that effects were excluded that could not be seen",
        ),
        Change(
            "limit-of-what-was-found",
            LIMITS,
            "if c.name in named or not",
            "if not",
            "a cause is told and excluded at once",
        ),
        Change(
            "limit-not-projected",
            LIMITS,
            "np.mean(look.projected(x) ** 2)",
            "np.mean(x**2)",
            "limits as though the base could not imitate the effect",
        ),
        Change(
            "company-forgotten",
            JUDGE,
            "if company and company not in fit.effect_names:",
            "if company in fit.effect_names:",
            "creep that began before the recording is told as a warm-up",
        ),
        Change(
            "company-free-of-charge",
            JUDGE,
            "- price * count",
            "- 0.0 * price * count",
            "a warm-up is told as creep",
        ),
    ),
    *room(
        ("tests/models/diagnosis/test_way.py",),
        Change(
            "one-triangle-tells-all",
            WAY,
            "return stands_still(data) if candidate.slow or candidate.channel else True",
            "return True",
            "a single loop is told as drift",
        ),
        Change(
            "channel-of-one-turn",
            WAY,
            "turns(data, data.channels[candidate.channel]) >= TUNING.few_turns:",
            "True:",
            "what moves with the drive's one turn is told as coupling",
        ),
        Change(
            "hold-tells-nothing",
            WAY,
            "return float(np.mean(still)) > STILL_FOR",
            "return False",
            "drift is not looked for in a recording that holds still",
        ),
    ),
    *room(
        ("tests/models/diagnosis/test_friction.py",),
        Change(
            "friction-by-the-fitted-path",
            BRISTLES,
            "x = self._gain * context.v",
            "x = context.output",
            "friction by which the displacement runs back is not told",
        ),
        Change(
            "friction-that-never-fades",
            BRISTLES,
            "g = 1.0 + excess * math.exp(-((v / stribeck) ** 2))",
            "g = 1.0 + excess",
            "friction that fades with the speed is not told",
        ),
    ),
    *room(
        ("tests/models/diagnosis/test_rate.py",),
        Change(
            "narrower-is-rate",
            RATE,
            "weights.sum() < TOGETHER * np.abs(weights).sum()",
            "False",
            "friction that fades with the speed is told as rate-dependence",
        ),
        Change(
            "dilates-by-no-power",
            RATE,
            "more = p.dilation * s.speed**p.power",
            "more = p.dilation * s.speed",
            "the model's loops widen by another law than the one that was found",
        ),
        Change(
            "mirror-rings",
            MODE,
            "mirrored = abs(frequency - self._rate * round(frequency / self._rate))",
            "mirrored = frequency",
            "a slow change is told as a mode at the sampling frequency",
        ),
    ),
]
