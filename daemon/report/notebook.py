"""Results as shown in a notebook: figures, a table, pictures."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from dehyst.daemon.report import diagnosis_pictures, identification_pictures
from dehyst.daemon.report.diagnosis import TITLES
from dehyst.daemon.report.page import Page
from dehyst.daemon.report.plotting import MEASURED, MODEL, add_legend, thin_rows
from dehyst.daemon.report.validation import draw_left, draw_over_time, say_share
from dehyst.daemon.report.verdict import verdict
from dehyst.models.diagnosis import Diagnosis
from dehyst.models.identify import Figures, Identification
from dehyst.models.identify.validation import Validation
from dehyst.models.inverse.offline import Inverted
from dehyst.models.model import Model
from dehyst.models.recording import Floats, Recording
from dehyst.models.units import how_many, pick_unit, spell_unit


def show_identification(
    result: Identification, recordings: Sequence[Recording], figures: Figures
) -> str:
    """Show the model, its error, and two pictures of the first recording."""
    out = Page("Identified model")
    out.add_text(figures.sentence(), "lead")
    out.add_text(verdict(result))
    unit = result.model.displacement_unit
    out.add_table(
        ["recording", "error rms", "noise rms"],
        [[r.name, _figure(r.rms, unit), _figure(r.noise, unit)] for r in result.recordings],
    )
    out.add_bullets(result.notes)
    out.add_pictures(
        partial(identification_pictures.draw_hysteresis_loop, result, recordings[0], 0),
        partial(identification_pictures.draw_residual_over_time, result, recordings[0], 0),
    )
    return out.to_fragment()


def show_simulation(recording: Recording, y: Floats, unit: str, words: str) -> str:
    """Show the model's displacement together with the measured one; words: the error between
    them."""
    out = Page(f"Model on {recording.name}")
    if words:
        out.add_text(f"Against the measured displacement: {words}", "lead")
    out.add_pictures(partial(_draw_simulation, recording, y, unit))
    return out.to_fragment()


def show_drive(
    t_s: Floats, target: Floats, result: Inverted, model: Model, flagged: Mapping[str, int]
) -> str:
    """Show the drive along a trajectory, and the displacement that the model predicts."""
    out = Page("Drive along the trajectory")
    unit = model.displacement_unit
    error = _figure(result.rms, unit) if np.isfinite(result.rms) else "no target can be reached"
    out.add_cards(
        [
            ("predicted error, rms", error),
            ("made by", result.mode),
            ("samples", str(target.size)),
        ]
    )
    out.add_bullets([f"{how_many(count, 'sample')}: {name}" for name, count in flagged.items()])
    out.add_pictures(
        partial(_draw_drive, t_s, result.drive, model.drive_unit),
        partial(_draw_prediction, t_s, target, result.predicted, unit),
    )
    return out.to_fragment()


def show_validation(rows: Sequence[tuple[str, Recording, Validation]]) -> str:
    """Show one row for each model and recording, and the pictures of the first."""
    out = Page("Validation")
    out.add_table(
        ["model", "recording", "error rms", "share", "claimed", "offset", "residual"],
        [
            [
                name,
                v.name,
                _figure(v.rms, v.unit),
                say_share(v),
                "nothing" if v.claim is None else _figure(v.claim, v.unit),
                _figure(v.offset, v.unit),
                "white" if v.white else "not white",
            ]
            for name, _, v in rows
        ],
    )
    for _, recording, result in rows[:1]:
        out.add_pictures(
            partial(draw_over_time, recording, result), partial(draw_left, recording, result)
        )
    return out.to_fragment()


def show_diagnosis(diagnosis: Diagnosis) -> str:
    """Show the verdict, the findings, and the errors before and after."""
    out = Page(TITLES[diagnosis.verdict])
    out.add_bullets(diagnosis.data.says)
    before, after = diagnosis.before_after
    out.add_cards(
        [
            ("the model in use leaves", _figure(before, diagnosis.unit)),
            ("the augmented model leaves", _figure(after, diagnosis.unit)),
            ("noise of the recordings", _figure(diagnosis.noise, diagnosis.unit)),
        ]
    )
    for finding in diagnosis.findings:
        with out.open_box(warn=finding.name == "unknown"):
            out.add_subheading(finding.title or finding.name)
            out.add_text(finding.says)
            out.add_text(f"{finding.percent} of the explainable misfit", "soft")
    if diagnosis.next_experiment:
        out.add_text(f"Next: {diagnosis.next_experiment}")
    for view in diagnosis.views[:1]:
        out.add_pictures(partial(diagnosis_pictures.draw_model_error, diagnosis, view))
    return out.to_fragment()


def _figure(value: float, unit: str) -> str:
    k, shown = pick_unit(unit, abs(value))
    return f"{k * value:.4g} {spell_unit(shown)}"


def _draw_simulation(recording: Recording, y: Floats, unit: str, axes: Axes) -> str:
    """Draw measured and simulated displacement over time."""
    if recording.displacement is not None and recording.displacement_unit == unit:
        t, m = thin_rows(recording.t_s, recording.displacement)
        axes.plot(t, m, ".", color=MEASURED, ms=2.5, label="measured")
    t, w = thin_rows(recording.t_s, y)
    axes.plot(t, w, color=MODEL, lw=1.2, label="model")
    add_legend(axes, 0.18)
    axes.set(xlabel="time, s", ylabel=f"displacement, {spell_unit(unit)}")
    return "Displacement by the model over time, with the measured one if there is one."


def _draw_drive(t_s: Floats, drive: Floats, unit: str, axes: Axes) -> str:
    """Draw the drive over time."""
    t, u = thin_rows(t_s, drive)
    axes.plot(t, u, color=MODEL, lw=1.2)
    axes.set(xlabel="time, s", ylabel=f"drive, {spell_unit(unit)}", title="drive")
    return "The drive over time."


def _draw_prediction(t_s: Floats, target: Floats, predicted: Floats, unit: str, axes: Axes) -> str:
    """Draw target and prediction over time."""
    t, goal, y = thin_rows(t_s, target, predicted)
    axes.plot(t, goal, color=MEASURED, lw=3, alpha=0.35, label="target")
    axes.plot(t, y, color=MODEL, lw=1.2, label="predicted")
    add_legend(axes, 0.18)
    axes.set(xlabel="time, s", ylabel=f"displacement, {spell_unit(unit)}", title="target, model")
    return "The target over time, and the displacement that the model predicts."
