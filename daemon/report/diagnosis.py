"""The diagnosis report: its content and order, written for a technician."""

from functools import partial

from dehyst.daemon.report import diagnosis_pictures as pictures
from dehyst.daemon.report.diagnosis_pictures import choose_scale
from dehyst.daemon.report.page import Page
from dehyst.models.diagnosis import Diagnosis, Finding, Value
from dehyst.models.signals.error_size import finite_rms
from dehyst.models.units import spell_size, spell_unit

MODELS = ("model in use", "augmented model")
TITLES = {
    "clean": "Diagnosis: these recordings show nothing that the model lacks",
    "explained": "Diagnosis: the model's error is explained",
    "partly": "Diagnosis: part of the model's error is explained",
    "unknown": "Diagnosis: the model's error is not explained",
}
"""Title of the report by verdict."""
MOST_VIEWS = 4  # recordings that are drawn, to keep the report short


def report_diagnosis(diagnosis: Diagnosis, names: list[str]) -> str:
    """Return the page as HTML text: the data first, then the verdict with its pair of figures, the
    findings with their pictures, the excluded effects, and the next experiment. names: the
    recordings' file names."""
    out = Page(TITLES[diagnosis.verdict])
    _data(out, diagnosis, names)
    out.add_text(say_verdict(diagnosis), "lead")
    _cards(out, diagnosis)
    if diagnosis.findings:
        out.add_heading("What the model lacks")
        for finding in diagnosis.findings:
            _finding(out, finding)
    out.add_heading("Before and after")
    out.add_text(
        "Both models as they simulate the recordings, each with its mean error subtracted.", "soft"
    )
    for view in diagnosis.views[:MOST_VIEWS]:
        if len(diagnosis.views) > 1:
            out.add_subheading(view.name)
        out.add_pictures(
            partial(pictures.draw_model_error, diagnosis, view),
            partial(pictures.draw_close_look, diagnosis, view),
        )
    out.add_heading("The loop")
    out.add_pictures(*pictures.list_loop(diagnosis))
    _limits(out, diagnosis)
    if diagnosis.next_experiment:
        out.add_heading("Next experiment")
        out.add_text(diagnosis.next_experiment)
    out.add_heading("Where the misfit occurs")
    out.add_text(
        "Rms error by time, drive, rate and so on. Where orange lies above green, the model in use "
        "misses something; where blue does, the augmented model still does.",
        "soft",
    )
    out.add_pictures(*pictures.list_places(diagnosis))
    out.add_heading("Residual against the noise")
    out.add_pictures(partial(pictures.draw_error_spectrum, diagnosis))
    _errors_by_recording(out, diagnosis)
    return out.to_html()


def say_verdict(diagnosis: Diagnosis) -> str:
    """Return the verdict in one sentence."""
    k, unit = choose_scale(diagnosis)
    before, after = (k * value for value in diagnosis.before_after)
    noise = f"{k * diagnosis.noise:.3g} {unit}"
    first = f"The model in use leaves {before:.3g} {unit} where the noise is {noise}"
    known = list(dict.fromkeys(f.name for f in diagnosis.findings if f.name != "unknown"))
    causes = " and ".join([", ".join(known[:-1]), known[-1]] if len(known) > 1 else known)
    explain = "explain" if len(known) > 1 else "explains"
    if diagnosis.verdict == "clean":
        return f"{first}: these recordings show nothing that it lacks."
    if diagnosis.verdict == "explained":
        return f"{first}; {causes} {explain} it, and the augmented model leaves {after:.3g} {unit}."
    if known and any(f.name == "unknown" for f in diagnosis.findings):
        return f"{first}; {causes} {explain} part of it, and {after:.3g} {unit} remain unexplained."
    if known:
        return (
            f"{first}; {causes} {explain} it, but the augmented model does not predict all of it: "
            f"it leaves {after:.3g} {unit}."
        )
    return f"{first}, and nothing in the library explains it."


def _data(out: Page, diagnosis: Diagnosis, names: list[str]) -> None:
    data = diagnosis.data
    recorded = f"Recordings: {', '.join(names)} ({data.rows} rows)"
    if not data.says:
        out.add_text(f"{recorded}; no reading is missing, and the recorder did not stall.", "soft")
        return
    out.add_text(recorded, "soft")
    with out.open_box(warn=True):
        out.add_subheading("The recordings")
        out.add_bullets([f"{s[0].upper()}{s[1:]}." for s in data.says])


def _cards(out: Page, diagnosis: Diagnosis) -> None:
    k, unit = choose_scale(diagnosis)
    before, after = diagnosis.before_after
    figures = [
        ("noise of the recording", diagnosis.noise),
        ("error, model in use", before),
        ("error, augmented model", after),
    ]
    out.add_cards([(label, f"{k * value:.3g} {unit}") for label, value in figures])


def _finding(out: Page, finding: Finding) -> None:
    known = finding.name != "unknown"
    with out.open_box(warn=not known):
        out.add_subheading(finding.title or finding.name)
        out.add_text(finding.says)
        if known:
            out.add_share(finding.share)
            out.add_text(
                f"explains {finding.percent} of the explainable misfit; acts on the "
                f"{finding.place}",
                "soft",
            )
        if finding.ambiguous_with:
            out.add_text(
                f"These recordings cannot distinguish it from: {', '.join(finding.ambiguous_with)}."
            )
        if finding.parameters:
            out.add_table(
                ["parameter", "value", "95 % interval"],
                [_parameter(key, value) for key, value in finding.parameters.items()],
            )
        if finding.equation:
            out.add_text(f"{finding.equation} ({finding.source})", "soft")


def _parameter(key: str, value: Value) -> list[str]:
    """Return the table row of a parameter; the unit moves from its name to its value."""
    unit = "" if value.unit == "1" else f" {spell_unit(value.unit)}"
    tail = "_" + value.unit.lower().replace("/", "_per_")
    name = (key.removesuffix(tail) if unit else key).replace("_", " ")
    return [name, f"{value.value:.4g}{unit}", f"{value.low:.4g} to {value.high:.4g}{unit}"]


def _limits(out: Page, diagnosis: Diagnosis) -> None:
    if not diagnosis.would_have_seen:
        return
    out.add_heading("Excluded effects")
    out.add_text(
        "Effects that were not found, and the smallest size that these recordings would have "
        "shown.",
        "soft",
    )
    rows = []
    for limit in diagnosis.would_have_seen:
        seen = "cannot be seen with this drive"
        if limit.value is not None:
            seen = f"{limit.side} {spell_size(limit.value, limit.unit)}"
        rows.append([limit.name, seen, limit.why if limit.why != limit.name else ""])
    head = ["effect", "would have been seen", "why"]
    said = 3 if any(row[2] for row in rows) else 2
    out.add_table(head[:said], [row[:said] for row in rows])


def _errors_by_recording(out: Page, diagnosis: Diagnosis) -> None:
    k, unit = choose_scale(diagnosis)
    out.add_heading("Errors by recording")
    rows = []
    for view in diagnosis.views:
        models = (view.base, view.augmented)
        errors = [k * finite_rms((view.displacement - y)[view.counted]) for y in models]
        rows.append([view.name, *(f"{error:.3g} {unit}" for error in errors)])
    out.add_table(["recording", *MODELS], rows)
