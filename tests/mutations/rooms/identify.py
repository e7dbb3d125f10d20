"""Figures that an identification shows."""

from tests.mutations.change import Change, room

UNCERTAINTY = "models/identify/uncertainty.py"
RESULT = "models/identify/identification.py"
LAGS, START = "models/identify/lags.py", "models/identify/start.py"
CHOICE = "models/identify/choice.py"
TUNING, COUPLING = "models/identify/tuning.py", "models/identify/coupling.py"
BAND, VALIDATION = "models/identify/band.py", "models/identify/validation.py"

CHANGES = room(
    ("tests/models/identify/test_validation.py",),
    Change(
        "late-rows-are-judged",
        VALIDATION,
        "judged_at = _find_settled(u, read) & ~late",
        "judged_at = _find_settled(u, read)",
        "set-up on a busy machine refuses a good model",
    ),
    Change(
        "every-stamp-is-late",
        VALIDATION,
        "return late if np.mean(late) <= RARE else",
        "return late if np.mean(late) <= 1.0 else",
        "hardly any row is judged in a recording with jittering time stamps",
    ),
    Change(
        "readings-only-at-late-rows",
        VALIDATION,
        "judged_at, late = read, np.zeros(u.size, dtype=bool)",
        "pass",
        "a gauge that is read rarely ends validate with a traceback",
    ),
    Change(
        "rows-without-a-reading-are-enough",
        VALIDATION,
        "enough = np.count_nonzero(out & read) >= ENOUGH * np.count_nonzero(read)",
        "enough = np.count_nonzero(out) >= ENOUGH * u.size",
        "a few of many readings are judged where the gauge stopped early",
    ),
) + room(
    ("tests/models/identify/test_intervals.py",),
    Change(
        "errors-halved", RESULT, "errors = Params.unpacked(np.sqrt(",
        "errors = Params.unpacked(0.5 * np.sqrt(", "intervals are half as wide as they should be",
    ),
    Change(
        "errors-a-twentieth", RESULT, "errors = Params.unpacked(np.sqrt(",
        "errors = Params.unpacked(0.05 * np.sqrt(",
        "intervals are a twentieth of what they should be",
    ),
    Change(
        "errors-doubled", RESULT, "errors = Params.unpacked(np.sqrt(",
        "errors = Params.unpacked(2.0 * np.sqrt(", "intervals are twice as wide as they should be",
    ),
    Change(
        "one-stretch-for-each-sample", UNCERTAINTY,
        "stretch = max(1, total // TUNING.stretches)", "stretch = 1",
        "correlated noise is treated as independent",
    ),
    Change(
        "few-stretches", TUNING, "stretches: int = 30", "stretches: int = 4",
        "intervals are computed from only four stretches",
        survives="Student's factor for so few stretches keeps the coverage",
    ),
) + room(
    ("tests/models/identify/test_timing.py",),
    Change(
        "a-lag-within-a-sample-is-the-sensors", LAGS,
        "if lag is not None and lag.delay_s > self.period]", "if lag is not None]",
        "one set-up in ten leaves a lag that chance shows, and tracks half as well",
    ),
    Change(
        "any-start-is-believed", START, "if not setup.virgin:",
        "if True:", "a stage that was exercised before is fitted with the virgin curve",
    ),
    Change(
        "start-may-cost-much", START, "TUNING.quarter * beyond", "2.0 * beyond",
        "a wrong initial state is accepted",
    ),
    Change(
        "any-lag-that-helps", LAGS, "(1.0 - TUNING.minor) * now", "0.999 * now",
        "a lag that the stage does not have is accepted for a small improvement",
        survives="a second gate behind it, paired over the stretches, refuses the same",
    ),
) + room(
    ("tests/models/identify/test_dynamics.py",),
    Change(
        "no-lag-beats-jitter", LAGS, "> TUNING.far * self._measure", "> 1e9 * self._measure",
        "no lag is ever found",
    ),
    Change(
        "every-lag-is-the-drives", LAGS, "if better:", "if False:",
        "a slow sensor is mistaken for a slow drive and compensated",
    ),
    Change(
        "untold-side-not-said", LAGS, "            return given, False\n",
        "            return given, True\n",
        "a side that the recording does not determine is reported without a warning",
    ),
) + room(
    ("tests/models/identify/test_start.py",),
    Change(
        "start-without-time", START, "= out[:, 0] - u\n", "= 0.0\n",
        "a lag hides that the stage was moved before",
    ),
) + room(
    ("tests/models/identify/test_coupling.py",),
    Change(
        "coupling-never-pays", COUPLING, "TUNING.small * powers[0]", "2.0 * powers[0]",
        "no model contains the coupling from other axes",
    ),
    Change(
        "coupling-always-pays", COUPLING,
        "        trials = [trial for trial in trials if trial[2]]\n", "",
        "a model contains a coupling although there is none",
    ),
) + room(
    ("tests/daemon/commands/test_scan.py",),
    Change(
        "scan-out-of-reach", "daemon/scan_check.py", "(UNREACHABLE, \"out of reach\")",
        "(0, \"out of reach\")", "a path is written that an axis cannot follow",
    ),
    Change(
        "scan-too-fast", "daemon/scan_check.py", "(sample.SLEW, ", "(0, ",
        "a path is written that is faster than the slew limit",
    ),
) + room(
    ("tests/daemon/acquire/test_axes.py",),
    Change(
        "axes-in-step", "daemon/acquire/axes.py", "PACES = (1.0, 0.83, 0.71)",
        "PACES = (1.0, 1.0, 1.0)",
        "axes that move together are not recognised as indistinguishable",
    ),
)  # fmt: skip
CHANGES += room(
    ("tests/models/identify/test_equations.py",),
    Change(
        "turns-after-a-rest-are-passed-over",
        "models/identify/equations.py",
        "            if before <= now <= then or before >= now >= then:\n"
        "                continue\n",
        "            onwards = before <= now <= then or before >= now >= then\n"
        "            before = now\n            if onwards:\n                continue\n",
        "the plays miss a turn of a drive that rests before it",
    ),
)
CHANGES += room(
    ("tests/models/identify/test_outside.py",),
    Change(
        "own-input-not-tried",
        RESULT,
        "    said = require_own_input(result.model, found.setup.rows, result.used, noises)\n",
        "    said: tuple[str, ...] = ()\n",
        "a butterfly and a friction loop are accepted",
    ),
    Change(
        "dynamics-from-one-loop",
        "models/identify/choice.py",
        "lags = not repeats_one_loop(drives)",
        "lags = True",
        "a lag is reported that another rate refutes",
    ),
    Change(
        "dynamics-from-a-drift",
        CHOICE,
        "    return period_s is not None and found.search",
        "    return True or found.search",
        "a drift under loops of several sizes is reported as a lag",
    ),
    Change(
        "longest-lag-of-the-edges",
        LAGS,
        "max(map(_find_mean_rate, setup.rows))",
        "max(setup.rate_max, 1e-300)",
        "a lag of a drive in steps is not found, as its edges are fast",
    ),
    Change(
        "held-out-of-another-model",
        RESULT,
        "fit = Fit(left, fitted.held_rms(left), noise",
        "fit = Fit(left, fitted.scored.held_rms, noise",
        "held-out rows are said to be predicted better than the rows of the fit",
    ),
    Change(
        "drift-in-the-fit",
        CHOICE,
        "    if ramp := _find_ramp(found):\n",
        "    if ramp := 0.0:\n",
        "a drift of the reading is taken for hysteresis and curve",
    ),
    Change(
        "drift-that-predicts-nothing",
        CHOICE,
        "        if flat.best.held_rms**2 < (1.0 - TUNING.minor) * found.best.held_rms**2:\n",
        "        if True:\n",
        "a slow scan is taken for a drift, and an ordinary recording is refused",
    ),
    Change(
        "intervals-with-the-offset-of-the-end",
        RESULT,
        "        fitted.equations, fitted.shape, fitted.params, fitted.free, fitted.normal\n",
        "        fitted.equations, fitted.shape, found.params, fitted.free, fitted.normal\n",
        "after a drift the interval holds the drift, which the offset of the end has taken",
    ),
    Change(
        "one-offset-for-all-periods",
        "models/identify/search.py",
        "lot._replace(group=at) for lot, at in",
        "lot for lot, at in",
        "a drift under loops of several sizes is reported as a lag",
    ),
    Change(
        "jitter-of-a-wrong-structure",
        LAGS,
        "            powers.append(0.5 * np.diff(e[at])[keep] ** 2)\n",
        "            powers.append(e[at][1:][keep] ** 2)\n",
        "a lag that two rates show is missed if the first structure is wrong",
        survives="few stages show it: the benchmark `outside` then counts 35 of 40",
    ),
) + room(
    (
        "tests/models/identify/test_stated_interval.py",
        "tests/models/signals/test_drive_segments.py",
    ),
    Change(
        "rivals-that-cannot-be-inverted",
        BAND,
        "if not other.invertible or other.superseded:",
        "if False:",
        "an interval includes the error of a structure that could never be chosen",
    ),
    Change(
        "interval-beside-misfit",
        BAND,
        "return fit.leaves_mostly_noise and not beyond",
        "return not beyond",
        "an interval is stated for what a model leaves out, and holds for every second waveform",
    ),
    Change(
        "interval-far-beyond-the-noise",
        BAND,
        "and not beyond and band",
        "and band",
        "an interval includes the drift of the recording, and is too wide for any other",
    ),
    Change(
        "drift-is-misfit",
        "models/model.py",
        "claim, noise = self.claim, self.noise_rms",
        "claim, noise = self.holdout_rms, self.noise_rms",
        "a recording that drifts states no interval, though its drift is no part of the claim",
    ),
    Change(
        "no-interval-for-no-reason",
        "daemon/api/identification_summary.py",
        "if fit.band is None and fit.holdout_rms and not fit.leaves_mostly_noise:",
        "if False:",
        "other loops are asked for where the model leaves out what no loop would change",
        tests=(
            "tests/daemon/commands/test_identify.py::test_an_interval_or_why_there_is_none[0.2]",
        ),
    ),
    Change(
        "missing-interval-unsaid",
        "daemon/report/validation.py",
        "    if not v.has_interval:\n",
        "    if False:\n",
        "validate does not say why it judges no interval",
        tests=(
            "tests/daemon/commands/test_validate.py::test_a_model_without_an_interval_is_called_so",
        ),
    ),
    Change(
        "rows-without-an-interval-count",
        "models/identify/validation.py",
        "share = 0.0 if fit.band is None else share",
        "pass",
        "a model without an interval seems to state one for most rows",
    ),
    Change(
        "misfit-is-noise",
        BAND,
        "np.quantile(np.abs(jackknife.left_out), 0.95)",
        "Z95 * np.std(jackknife.left_out)",
        "an interval is wider than the whole misfit of the model",
    ),
    Change(
        "one-waveform-is-all",
        BAND,
        "left_out *= TUNING.near**2",
        "left_out *= 1.0",
        "an interval from one recording is as narrow as one from several",
    ),
    Change(
        "stretch-not-left-out",
        UNCERTAINTY,
        "left_out.append(err + jac @ move)",
        "left_out.append(err)",
        "rows are judged by a model that was fitted to them",
    ),
    Change(
        "holds-are-covered",
        VALIDATION,
        "stated = ~(outside | _find_slower(model, u, t))",
        "stated = ~outside",
        "an interval is judged on holds that no recording contained",
    ),
    Change(
        "wide-is-right",
        VALIDATION,
        "NARROW, WIDE = 0.85, 0.99",
        "NARROW, WIDE = 0.85, 2.0",
        "an interval of any width counts as correct",
    ),
    Change(
        "first-direction-turns",
        "models/signals/drive_segments.py",
        "turns += [low] if direction else []",
        "turns += [low]",
        "a single loop that begins in its middle counts as two sizes",
    ),
)
CHANGES += (
    room(
        ("tests/models/identify/test_rounded_reading.py",),
        Change(
            "rounding-is-no-noise",
            UNCERTAINTY,
            "    if step <= noise:\n",
            "    if True:\n",
            "a coarse gauge has no noise or twice its noise, and a good model is sent to diagnosis",
        ),
        Change(
            "coarse-gauge-judges-the-band",
            VALIDATION,
            'return "" if self.coarse else "too wide"',
            'return "too wide"',
            "a band is called too wide by a gauge that cannot show it",
        ),
    )
    + room(
        ("tests/models/diagnosis/test_data_first.py",),
        Change(
            "rounding-is-a-ripple",
            "models/physics/sensor.py",
            "coarse = quantum(data.y) > COARSEST * float(np.ptp(data.y))",
            "coarse = False",
            "a pattern is searched between the steps of a reading",
        ),
        Change(
            "ripple-of-one-step",
            "models/physics/sensor.py",
            "RESOLVED * quantum(data.y))",
            "0.0)",
            "the rounding of a gauge is reported as a fault of the sensor",
        ),
        Change(
            "ripple-beyond-the-reading",
            "models/physics/sensor.py",
            "return float(np.hypot(*amplitudes) <= self._range)",
            "return 1.0",
            "a sensor is said to err by more than it reads",
        ),
    )
    + room(
        ("tests/models/identify/test_outside.py",),
        Change(
            "noise-is-a-butterfly",
            "models/identify/plausibility/own_input.py",
            "return ways > 0 and backs > 0.5 * ways and _follows(u, y)",
            "return ways > 0 and backs > 0.5 * ways",
            "a gauge that is disconnected is reported as a ferroelectric",
        ),
    )
    + room(
        ("tests/models/identify/test_validation.py",),
        Change(
            "noisier-gauge-makes-it-worse",
            VALIDATION,
            "np.hypot(CLAIM * self.claim, self.noisier)",
            "CLAIM * self.claim",
            "a good model is refused because of the gauge that it is judged with",
        ),
        Change(
            "a-wrong-gain-is-noise",
            VALIDATION,
            "estimate_noise(_without_motion(error, predicted), step)",
            "estimate_noise(error, step)",
            "a wrong gain is the gauge's noise where there are few rows to a cycle",
        ),
        Change(
            "noise-excuses-all",
            VALIDATION,
            "power = (noise * (1.0 + doubt)) ** 2",
            "power = np.nanvar(error)",
            "a wrong model is as good as it claims",
        ),
    )
    + room(
        ("tests/daemon/commands/test_simulate.py",),
        Change(
            "band-beyond-the-validity",
            "daemon/commands/simulate.py",
            "if max(found.outside.values(), default=0.0) < NEARLY_ALL:",
            "if True:",
            "an interval is stated for a drive that lies outside the model's validity",
        ),
    )
    + room(
        ("tests/models/identify/test_own_starts.py",),
        Change(
            "one-start-for-all",
            "models/identify/setup.py",
            "virgin = any(one.virgin for one in rows) and trust_start",
            "virgin = all(one.virgin for one in rows) and trust_start",
            "a recording that begins in the middle takes the known start from the others",
        ),
        Change(
            "settled-by-the-widest",
            "models/identify/data/rows.py",
            "_settle(u, resets, SWEPT * own, settled)",
            "_settle(u, resets, 2.0 * SWEPT * own, settled)",
            "a recording of another size is refused",
        ),
        Change(
            "rests-are-judged-by-a-line",
            "models/identify/plausibility/recordings.py",
            "if int(some.sum()) < TUNING.fewest_rows or np.ptp(one.u[some]) < TUNING.half * own:",
            "if False:",
            "a recording that ends in rests is refused",
        ),
        Change(
            "exact-times-jitter",
            "models/identify/data/rows.py",
            "or off < REGULAR * usual:",
            "or off < 0.0:",
            "exact times are said to jitter",
        ),
        Change(
            "a-pause-is-a-glitch",
            "models/identify/data/outliers.py",
            "beside[np.clip(last + k, 0, t.size - 1)] = True",
            "pass",
            "correct drive values beside a pause are left out",
        ),
        Change(
            "a-pause-is-bridged",
            "models/identify/setup.py",
            "least = TUNING.minor if virgin else 0.3",
            "least = 0.3",
            "the rows after an early pause are fitted as if nothing had been lost",
        ),
        Change(
            "a-dead-gauge-is-like-the-others",
            "models/identify/plausibility/recordings.py",
            "stays if silent else ratio",
            "ratio",
            "another recording than that of the dead gauge is named",
        ),
        Change(
            "the-odd-recording-stays",
            "models/diagnosis/steps.py",
            'if settles or others.verdict in ("clean", "explained"):',
            "if False:",
            "one recording of another stage makes a clean stage unknown",
        ),
        Change(
            "hum-keeps-the-odd-recording",
            "models/diagnosis/steps.py",
            'if settles or others.verdict in ("clean", "explained"):',
            'if others.verdict in ("clean", "explained"):',
            "one recording of another stage stays among others that have hum",
        ),
        Change(
            "what-a-model-lacks-is-another-stage",
            "models/diagnosis/steps.py",
            "settles = has_unknown(judged.findings) and not has_unknown(others.findings)",
            "settles = not has_unknown(others.findings)",
            "a recording that shows most of a rate is said not to belong to the others",
            tests=(
                "tests/benchmarks/models/test_proof.py::"
                "test_a_recording_that_shows_most_of_an_effect_belongs_to_the_others",
            ),
        ),
    )
    + room(
        ("tests/models/identify/test_outside.py",),
        Change(
            "jumps-at-turns-are-taken",
            "models/identify/plausibility/own_input.py",
            "float(np.median(jumps)) > JUMP:",
            "float(np.median(jumps)) > 1.0:",
            "a model of dry friction is written",
        ),
        Change(
            "stick-slip-is-taken",
            "models/identify/plausibility/own_input.py",
            "if share > IN_JUMPS and count >= FEWEST_JUMPS:",
            "if share > 2.0 and count >= FEWEST_JUMPS:",
            "a model of stick-slip is written",
        ),
        Change(
            "no-hysteresis-within-the-noise",
            "models/identify/plausibility/own_input.py",
            "return float(min(1.0, WIDTH * np.sqrt(chance / max(1, rows))))",
            "return 1.0",
            "a loop that many rows show is said not to be there",
        ),
    )
    + room(
        ("tests/models/identify/test_repeated_rows.py",),
        Change(
            "repeats-are-misfit",
            "models/identify/data/rows.py",
            "            y = np.where(out, np.nan, y)\n",
            "",
            "the model of a gauge that repeats its reading now and then is off by twice its noise",
        ),
        Change(
            "judged-on-repeats",
            VALIDATION,
            "y = np.where(again | stuck, np.nan, y)",
            "y = np.where(stuck, np.nan, y)",
            "a good model is called worse than it claims on a gauge that repeats its reading",
        ),
        Change(
            "judged-where-stuck",
            VALIDATION,
            "y = np.where(again | stuck, np.nan, y)",
            "y = np.where(again, np.nan, y)",
            "a good model is called worse than it claims where the gauge was stuck",
        ),
    )
    + room(
        ("tests/models/signals/test_jumps.py",),
        Change(
            "jumps-either-way",
            "models/signals/jumps.py",
            "< (1.0 - 1.0 / SIGMAS) * at.size:",
            "< 0:",
            "hum is refused as stick-slip",
        ),
        Change(
            "held-readings-jump",
            "models/signals/jumps.py",
            "[[True], np.diff(y) != 0.0]",
            "[[True], np.diff(y) < np.inf]",
            "a gauge that is polled slowly is refused as stick-slip",
        ),
        Change(
            "quick-ramps-jump",
            "models/signals/jumps.py",
            "    if float(fastest.sum()) > EVEN * float(np.abs(du).sum()):\n",
            "    if False:\n",
            "a recording of holds, read late, is refused as stick-slip",
        ),
    )
    + room(
        ("tests/models/identify/test_failed_fits.py",),
        Change(
            "a-perfect-fit-has-no-noise",
            "models/identify/equations.py",
            "max(self.misfit_at(p), least, TINY)",
            "max(self.misfit_at(p), 1e-300)",
            "a column that copies another ends with an overflow on some processors",
        ),
        Change(
            "drift-of-a-decay",
            "models/identify/choice.py",
            "[0, 1]) <= WITH_TIME)",
            "[0, 1]) <= 1.0)",
            "loops that shrink are said to drift",
        ),
        Change(
            "a-drift-counts-against-the-model",
            "models/identify/identification.py",
            "require_better_than_a_line(found.flat, found.residuals_without_drift(), picks)",
            "require_better_than_a_line(found.setup, residuals, picks)",
            "a recording with a large drift is refused as one that shows no loop",
        ),
        Change(
            "failed-fit-is-taken",
            "models/identify/choice.py",
            "        strays = left > min(TUNING.twice * best.held_rms, line)\n",
            "        strays = False\n",
            "a fit that did not converge is written",
            survives="no recording of the tests fails so: those that did had a rate-dependence",
        ),
        Change(
            "another-class-is-another-stage",
            "models/identify/plausibility/recordings.py",
            "ratio = np.array(together) / np.maximum(alone, usual)",
            "ratio = np.array(together) / np.maximum(alone, 1e-300)",
            "recordings of one stage are refused as of different ones",
        ),
        Change(
            "an-interval-for-all-sizes",
            "models/identify/identification.py",
            "shown = is_stated(fit, band, stroke) and not has_one_size(found.drives)",
            "shown = is_stated(fit, band, stroke)",
            "an interval is stated for loops of sizes that were not driven",
        ),
        Change(
            "the-drift-is-claimed",
            "models/model.py",
            "        if self.steady_rms is not None:\n",
            "        if False:\n",
            "a wrong model is as good as it claims, as its recording drifted",
        ),
        Change(
            "rounded-copies-are-taken",
            "models/identify/plausibility/own_input.py",
            "rounding = ROUNDED * step * float(np.ptp(y)) if step < EXACT else 0.0",
            "rounding = 0.0",
            "a copied column is identified as a stage",
        ),
    )
    + room(
        ("tests/daemon/report/test_choice.py",),
        Change(
            "static-for-no-reason",
            "models/identify/search.py",
            "        self.static_because = NO_GAIN\n",
            "",
            "the report does not say why weights do not depend on the rate",
        ),
        Change(
            "the-best-of-all-is-without",
            "daemon/report/choice.py",
            "others = [c for c in result.tried if not has(c)]",
            "others = list(result.tried)",
            "the report says that a lag gains nothing",
        ),
    )
    + room(
        ("tests/models/identify/test_lag_kinds.py",),
        Change(
            "no-lag-beside-weights",
            "models/identify/search.py",
            "if best.shape.rate and best.held_rms > TUNING.far * least:",
            "if best.held_rms > TUNING.far * least:",
            "weights that depend on the rate are taken for a delay",
        ),
        Change(
            "a-delay-is-a-mode",
            "models/identify/lags.py",
            "better = pays(drive, sensor, clear=0.0) if richer else",
            "better =",
            "a delay is reported as a resonance",
        ),
        Change(
            "a-delay-is-a-lag",
            "models/identify/lags.py",
            "of_drive, of_sensor = [before, late], [behind, second]",
            "of_drive, of_sensor = [before], [behind, second]",
            "a delay is reported as a lag where the first fit takes it for one",
        ),
        Change(
            "one-lag-of-a-structure-chosen-without",
            "models/identify/lags.py",
            "return sorted(at_drive, key=lambda c: c.held_rms)[:1] + first + higher",
            "return (sorted(at_drive, key=lambda c: c.held_rms)[:1] + higher) or first",
            "a lag of the sensor under a raster is reported as a rate-dependence and a resonance",
        ),
        Change(
            "every-lag-is-fed-by-lines",
            "models/identify/lags.py",
            "better = [c for c in steps if predicts_better(c, lines)]",
            "better = []",
            "a lag that is found from steps is half a sample off on other drives",
        ),
        Change(
            "a-held-output-moves-in-lines",
            "models/identify/dynamics.py",
            "        if held or late:",
            "        if late:",
            "a slow sensor that reads a held output is half a sample off on other drives",
        ),
        Change(
            "held-since-the-sample-before",
            "models/identify/dynamics.py",
            "now = before[i] if late else row[i]",
            "now = row[i]",
            "a slow sensor of an output held from each sample on is a sample off",
        ),
    )
    + room(
        ("tests/models/identify/test_rate.py",),
        Change(
            "a-delay-before-weights",
            "models/identify/search.py",
            "        if static.has_lag and not alike",
            "        if False and not alike",
            "weights that depend on the rate are taken for a delay about a bias",
        ),
    )
    + room(
        ("tests/models/identify/test_own_starts.py",),
        Change(
            "late-edges-are-lone",
            "models/identify/setup.py",
            "jumps &= measure_driven_jumps(one.y, one.u) < DRIVEN * off",
            "",
            "readings after an edge that a stage follows late are left out",
        ),
        Change(
            "noise-is-lone",
            "models/identify/setup.py",
            "scatter = float(np.median(middle)) / JUMP",
            "scatter = 0.727 * float(np.median(middle)) / JUMP",
            "readings are left out of every long recording for their noise",
        ),
        Change(
            "peaks-are-lone",
            "models/identify/setup.py",
            "(off > TUNING.small * size) & (jump > TWO * off)",
            "off > TUNING.small * size",
            "the peaks of a mode that rings are left out",
        ),
    )
    + room(
        ("tests/models/signals/test_lone.py",),
        Change(
            "ringing-is-lone",
            "models/signals/lone.py",
            "& (rest < ALONE * off)",
            "",
            "readings of a mode that rings are left out",
        ),
        Change(
            "edges-are-lone",
            "models/signals/lone.py",
            "& (driven < DRIVEN * off)",
            "",
            "readings of a drive with pulses are left out",
        ),
        Change(
            "frequent-is-lone",
            "models/signals/lone.py",
            "if 0 < at.size <= max(1.0, FEW * known.size):",
            "if at.size:",
            "what a gauge does often is left out",
        ),
    )
)
CHANGES += room(
    ("tests/models/identify/test_what_is_shown.py",),
    Change(
        "a-vague-lag-stays",
        CHOICE,
        "            return _without_vague_lag(rich, options, progress)",
        "            return rich",
        "a static stage of another class is given a lag",
    ),
    Change(
        "a-clear-lag-goes",
        CHOICE,
        "found.search.compare_without_lag(best, found.tried) < TUNING.most:",
        "found.search.compare_without_lag(best, found.tried) < 0.0:",
        "a lag that explains all that is left is denied",
    ),
    Change(
        "one-rate-is-not-doubted",
        CHOICE,
        "            rich.notes.append(",
        "            [].append(",
        "a delay that the loop's shape imitates is reported as a fact",
    ),
    Change(
        "a-lag-within-a-minute",
        LAGS,
        "if self.period > TUNING.longest_lag_s:",
        "if False:",
        "rows a minute apart are refused with words of a block's bounds",
    ),
    Change(
        "a-fly-back-is-a-way",
        "models/identify/data/rows.py",
        "        rise, fall = slow_rise, slow_fall  # a sawtooth",
        "        pass  # a sawtooth",
        "half a loop is reported as a loop of a quarter of its width",
    ),
    Change(
        "any-order-of-rows",
        "models/identify/plausibility/own_input.py",
        "            _require_order(its.name, its.u)\n",
        "            pass\n",
        "rows in no order of time give a model without hysteresis, and a narrow interval",
    ),
    Change(
        "a-stop-is-a-saturation",
        "models/identify/plausibility/own_input.py",
        "        said += _note_stop(one.name, its.u, its.y, unit)\n",
        "",
        "a stage at its stop is modelled without a word of it",
    ),
    Change(
        "valid-without-readings",
        RESULT,
        "low, high = find_measured_range(rows)",
        "low, high = setup.drive_min, setup.drive_max",
        "a model claims the range in which the gauge stood at its limit",
    ),
    Change(
        "nearly-no-loop-is-a-loop",
        "models/identify/plausibility/own_input.py",
        "    elif figures.hysteresis < TUNING.trace:",
        "    elif False:",
        "0.00 % hysteresis is reported without a remark",
    ),
    Change(
        "creep-is-a-lag",
        "models/identify/search.py",
        "found.lag.delay_s > TRAILS * period_s:",
        "found.lag.delay_s > 0.0:",
        "creep in slow loops becomes a lag, which is wrong at every other rate",
        ("tests/models/identify/test_what_is_shown.py",),
    ),
    Change(
        "hum-is-noise",
        UNCERTAINTY,
        "        second = calmest if _typical(calmest) < PLAINLY * _typical(second) else second\n",
        "",
        "a model that leaves nothing but 50 Hz is reported to be at the noise",
        ("tests/models/identify/test_rounded_reading.py",),
    ),
    Change(
        "few-rows-are-jumps",
        "models/identify/plausibility/recordings.py",
        "min(TUNING.fewest_rows, TUNING.half * u.size)",
        "TUNING.fewest_rows",
        "a sine of 64 rows is refused as a square wave",
        ("tests/models/identify/test_outside.py",),
    ),
    Change(
        "a-pause-is-a-slow-drive",
        "models/signals/pace.py",
        "        if begins[i]:\n",
        "        if False:\n",
        "a model is valid for drives as slow as a pause in its recording was long",
        ("tests/models/signals/test_pace.py",),
    ),
    Change(
        "wrong-unit-is-a-stage",
        "models/identify/data/rows.py",
        "        if span > 0.0 and not SMALLEST <= span <= LARGEST:\n",
        "        if False:\n",
        "a displacement in a wrong unit ends in a traceback, or becomes a model of 1e-12 um",
        ("tests/models/identify/test_scale.py",),
    ),
)
