"""The identification report: its content and order."""

import shlex
from collections.abc import Sequence
from functools import partial

import numpy as np

from dehyst import __version__
from dehyst.daemon.report import coverage as covers
from dehyst.daemon.report import identification_pictures as pictures
from dehyst.daemon.report.choice import explain_choice, is_same
from dehyst.daemon.report.page import Page
from dehyst.daemon.report.verdict import verdict
from dehyst.models.drive_design.coverage import Coverage
from dehyst.models.identify import Identification, describe
from dehyst.models.recording import Recording
from dehyst.models.signals.error_size import Z95
from dehyst.models.units import spell_unit

OF_A_RECORDING = (
    ("Measured and model", (pictures.draw_few_cycles, pictures.draw_hysteresis_loop)),
    (
        "Residual",
        (
            pictures.draw_residual_over_time,
            pictures.draw_residual_over_drive,
            pictures.draw_residual_spectrum,
        ),
    ),
)
ABOUT_PARAMETERS = (
    "The slope after a reversal, dz/du, once the drive has travelled back by twice the threshold: "
    "the partial sums of the weights. These combinations are what the data determine; single "
    "weights of neighbouring operators are not. Intervals are 95 %, with the noise's and the "
    "misfit's correlation in time. Where the weights depend on the rate, slopes are given at the "
    "largest rate up to which they are held positive. z is the hysteresis before the saturation, "
    "its scale fixed by c1 = 1."
)


def report_identification(
    result: Identification, recordings: Sequence[Recording], covered: Coverage, model_name: str
) -> str:
    """Return the whole page as HTML text."""
    unit = spell_unit(result.model.displacement_unit)
    out = Page(f"Identification of {model_name}")
    out.add_text(f"From {', '.join(r.name for r in recordings)}, by dehyst {__version__}.", "soft")
    out.add_text(describe(result.model).sentence(), "lead")
    out.add_bullets(
        [
            f"{one.name}: error {one.rms:.4g} {unit} rms, noise {one.noise:.4g}"
            for one in result.recordings
        ]
    )
    out.add_text(verdict(result), "lead")
    _figures(out, result, recordings)
    _validity(out, result)
    _notes(out, result, covered)
    for number, recording in enumerate(recordings):
        name = f": {recording.name}" if len(recordings) > 1 else ""
        for title, draws in OF_A_RECORDING:
            out.add_heading(title + name)
            out.add_pictures(*(partial(draw, result, recording, number) for draw in draws))
    out.add_heading("What the drive covers")
    unit = recordings[0].drive_unit
    out.add_pictures(
        partial(covers.draw_drive_and_rate, covered, unit), partial(covers.draw_loop_sizes, covered)
    )
    out.add_heading("Structure")
    out.add_text(
        "The simplest structure that no richer one beats in prediction by more than chance is "
        "chosen, and the smoothness of the slopes by the same stretches.",
        "soft",
    )
    out.add_text(explain_choice(result))
    orders = [partial(pictures.draw_orders, result)] if result.orders else []
    out.add_pictures(partial(pictures.draw_structures, result), *orders)
    with out.fold(f"All {len(result.tried)} structures that were tried"):
        _structures(out, result)
    out.add_heading("Parameters")
    out.add_text(ABOUT_PARAMETERS, "soft")
    out.add_pictures(partial(pictures.draw_slopes, result))
    _parameters(out, result)
    out.add_heading("Next step")
    out.add_text(
        "Record another waveform of the same stage, slower and faster, smaller and larger, and "
        f"check that the model predicts it: dehyst validate {shlex.quote(model_name)} REC.csv"
    )
    return out.to_html()


def _figures(out: Page, result: Identification, recordings: Sequence[Recording]) -> None:
    fit, unit = result.model.fit, spell_unit(result.model.displacement_unit)
    span = max(
        float(np.nanmax(r.displacement) - np.nanmin(r.displacement))
        for r in recordings
        if r.displacement is not None
    )
    out.add_cards(
        [
            (f"{label}, {value / span:.3%} of the span", f"{value:.4g} {unit}")
            for label, value in (
                ("fit, rms", fit.rms),
                ("held-out rows, rms", fit.holdout_rms),
                ("noise, rms (sample to sample)", fit.noise_rms),
            )
            if value is not None
        ]
    )


def _validity(out: Page, result: Identification) -> None:
    v, unit = result.model.validity, spell_unit(result.model.drive_unit)
    parts = [f"drive {v.drive_min:.4g} to {v.drive_max:.4g} {unit}"]
    if v.rate_max is not None:
        parts.append(f"rates up to {v.rate_max:.4g} {unit}/s")
    if v.acceleration_max is not None:
        parts.append(f"that change by up to {v.acceleration_max:.4g} {unit}/s²")
    if v.band_hz is not None:
        parts.append(f"band {v.band_hz:.3g} Hz")
    if v.period_s is not None:
        parts.append(f"sampled every {v.period_s:.4g} s")
    out.add_text(f"Valid for {', '.join(parts)}; there the model can be inverted everywhere.")


def _notes(out: Page, result: Identification, covered: Coverage) -> None:
    rate = covered.missing_rate if result.shape.rate else ()
    out.add_bullets([*result.notes, *covered.missing, *rate])


def _structures(out: Page, result: Identification) -> None:
    unit, drive_unit = map(spell_unit, (result.model.displacement_unit, result.model.drive_unit))
    rows, chosen = [], None
    for i, c in enumerate(result.tried):
        if is_same(c, result.chosen):
            chosen = i
        held, invertible = f"{c.held_rms:.4g}", "yes" if c.invertible else "no"
        lag = "none" if c.lag is None else c.lag.name
        rows.append([c.shape.name, lag, f"{c.offset:.4g}", held, invertible])
    head = ["structure", "lag", f"drive offset, {drive_unit}", f"held out, {unit} rms"]
    out.add_table([*head, "can be inverted"], rows, chosen)


def _parameters(out: Page, result: Identification) -> None:
    h, unit = result.model.hysteresis, spell_unit(result.model.drive_unit)
    n = h.n
    slopes, errors, bound = result.params.slopes, result.errors.slopes, result.at_bound

    def slope(i: int) -> str:
        if bound[i]:
            return f"{slopes[i]:.4g} (on its bound)"
        return f"{slopes[i]:.4g} ± {Z95 * errors[i]:.2g}"

    if result.shape.rate:
        k, rates = np.asarray(h.k), result.rates
        head = [f"threshold, {unit}", f"rate, {unit}/s", "slope at +rate", "slope at -rate"]
        head += ["weight b", f"rate weight k, s/{unit}"]
        rows = [
            [
                f"{h.r[i]:.5g}",
                f"{rates[i]:.4g}",
                slope(i),
                slope(n + i),
                f"{h.b[i]:.4g}",
                f"{k[i]:.4g}",
            ]
            for i in range(n)
        ]
    else:
        head = [f"threshold, {unit}", "slope", "weight b"]
        rows = [[f"{h.r[i]:.5g}", slope(i), f"{h.b[i]:.4g}"] for i in range(n)]
    out.add_table(head, rows)
    saturation = [
        [f"c{power}", f"{value:.5g} ± {Z95 * error:.2g}"]
        for power, value, error in zip(
            result.shape.powers, h.c[list(result.shape.powers)], result.errors.c, strict=True
        )
    ]
    saturation.insert(min(1, len(saturation)), ["c1", f"{h.c[1]:g} (fixes the scale)"])
    shifts = [
        [f"offset of recording {i + 2}", f"{s:.4g} ± {Z95 * e:.2g}"]
        for i, (s, e) in enumerate(zip(result.params.shifts, result.errors.shifts, strict=True))
    ]
    out.add_table(["saturation", "value"], saturation + shifts)
