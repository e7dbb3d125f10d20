"""Results of dehyst's functions: figures as attributes, text by `print`, and a rendering in a
notebook.

Pictures and pages are made on demand, because importing matplotlib takes time.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst import __version__
from dehyst.daemon.api.identification_summary import describe_result
from dehyst.daemon.api.prediction import Misfit, describe_misfit, outside_validity
from dehyst.daemon.called import python_function
from dehyst.daemon.files.axis_columns import to_columns
from dehyst.daemon.files.models import save_model, write_text
from dehyst.daemon.files.outputs import check_outputs, report_failures
from dehyst.daemon.files.recordings import write_recording
from dehyst.daemon.json_text import json_text
from dehyst.models.diagnosis import Diagnosis, Finding
from dehyst.models.drive_design.coverage import Coverage, measure_coverage
from dehyst.models.identify import Figures, Identification, describe
from dehyst.models.identify.validation import Validation
from dehyst.models.inverse.compensator import FLAG_NAMES
from dehyst.models.inverse.offline import Inverted
from dehyst.models.model import Model, Provenance
from dehyst.models.recording import Floats, Recording
from dehyst.models.units import pick_unit, spell_unit

DIAGNOSIS_FILES = ("diagnosis.json", "model.toml", "report.html")
SAID = {"partly": "partly explained", "unknown": "not explained"}


def write_page(path: Path, text: str) -> Path:
    """Write a report to `path`, creating its folder if needed. Raises BadInput if it cannot be
    written."""
    with report_failures(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    return path


@dataclass(frozen=True)
class Identified:
    """An identified model with its error figures. details: the full identification result."""

    details: Identification = field(repr=False)
    recordings: tuple[Recording, ...] = field(repr=False)

    @cached_property
    def model(self) -> Model:
        """The model, with its creation time and the version of dehyst that made it."""
        made = datetime.now(UTC).isoformat(timespec="seconds")
        provenance = replace(self.details.model.provenance, created=made, version=__version__)
        return replace(self.details.model, provenance=provenance)

    @cached_property
    def figures(self) -> Figures:
        """Stroke, gain, hysteresis and offset."""
        return describe(self.details.model)

    @cached_property
    def coverage(self) -> Coverage:
        """Drive range, rates and loop sizes that the recordings cover."""
        return measure_coverage(list(self.recordings))

    @property
    def rms(self) -> float | None:
        """Rms error of the fit, in the model's displacement unit; None: not known."""
        return self.model.fit.rms

    @property
    def holdout_rms(self) -> float | None:
        """Rms error on held-out stretches, in the model's displacement unit."""
        return self.model.fit.holdout_rms

    @property
    def noise_rms(self) -> float:
        """Rms noise of the recordings, in the model's displacement unit."""
        return self.details.noise_rms

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the result for the user."""
        return self.details.notes

    @python_function
    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write the model as TOML. force: replace an existing file even if it is not a model."""
        check_outputs([path], [], force)
        save_model(self.model, path)
        return Path(path)

    @python_function
    def report(self, path: str | Path, name: str = "the model", force: bool = False) -> Path:
        """Write the report as one HTML file. force: replace an existing file that is no report."""
        check_outputs([path], [], force)
        from dehyst.daemon.report.identification import report_identification

        page = report_identification(self.details, self.recordings, self.coverage, name)
        return write_page(Path(path), page)

    def __str__(self) -> str:
        return describe_result(self.details, self.coverage, Path("MODEL.toml"), None)

    def _repr_html_(self) -> str:
        from dehyst.daemon.report.notebook import show_identification

        return show_identification(self.details, self.recordings, self.figures)


@dataclass(frozen=True)
class Simulated:
    """Simulation of a model on a recording. displacement: (N,) predicted by the model, NaN where
    the recording lacks a value that the model reads; start: the history assumed before the first
    row; error: against the measured displacement, None without one. `numpy.asarray` returns the
    displacement."""

    displacement: Floats = field(repr=False)
    start: str
    model: Model = field(repr=False)
    recording: Recording = field(repr=False)
    error: Misfit | None

    @property
    def unit(self) -> str:
        """Unit of the displacement."""
        return self.model.displacement_unit

    @property
    def band(self) -> float | None:
        """Half-width of the band that holds 95 % of the displacement within the model's validity,
        in the displacement unit; None: the model states none."""
        return self.model.fit.band

    @property
    def rms(self) -> float | None:
        """Rms of measured minus model over all rows; None without a measured displacement."""
        return self.error.rms if self.error else None

    @cached_property
    def outside(self) -> dict[str, float]:
        """Share of rows outside the model's validity, by kind."""
        return outside_validity(self.model, self.recording)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.displacement, dtype=dtype, copy=True if copy is None else copy)

    @python_function
    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write the recording with the added column y_model_<unit>. force: replace an existing
        recording."""
        check_outputs([path], [], force)
        one = self.recording
        columns = {one.drive_column: one.drive}
        if one.displacement is not None:
            columns[one.displacement_column] = one.displacement
        columns |= to_columns(one.channels, one.displacement_unit, one.drive_unit)
        columns[f"y_model_{self.unit}"] = self.displacement
        write_recording(path, one.t_s, columns, dict(one.metadata))
        return Path(path)

    def __str__(self) -> str:
        return describe_misfit(self.error, self.unit) if self.error else ""

    def _repr_html_(self) -> str:
        from dehyst.daemon.report.notebook import show_simulation

        return show_simulation(self.recording, self.displacement, self.unit, str(self))


@dataclass(frozen=True)
class Drive:
    """Drive along a trajectory. t_s, target: (N,), evenly spaced; result: drive, predicted
    displacement and flags; reason: why this mode was chosen; latency_s: time by which the stage
    lags the target, with a preview; monotone_price: rms difference between the monotone model that
    is inverted and the given one; reach: least and largest displacement. `numpy.asarray` returns
    the drive."""

    t_s: Floats = field(repr=False)
    target: Floats = field(repr=False)
    result: Inverted = field(repr=False)
    model: Model = field(repr=False)
    reason: str
    latency_s: float | None
    monotone_price: float
    reach: tuple[float, float]

    @property
    def drive(self) -> Floats:
        """Drive (N,) in the model's drive unit."""
        return self.result.drive

    @property
    def predicted(self) -> Floats:
        """Displacement (N,) that the model predicts."""
        return self.result.predicted

    @property
    def mode(self) -> str:
        """How the drive was computed."""
        return self.result.mode

    @property
    def rms(self) -> float:
        """Rms of the predicted error where the target can be reached; NaN: nowhere."""
        return self.result.rms

    @property
    def flagged(self) -> dict[str, int]:
        """Number of samples for each flag that was raised."""
        flags = self.result.flags
        counts = {name: int(np.count_nonzero(flags & bit)) for bit, name in FLAG_NAMES.items()}
        return {name: count for name, count in counts.items() if count}

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.drive, dtype=dtype, copy=True if copy is None else copy)

    @python_function
    def save(
        self, path: str | Path, force: bool = False, notes: dict[str, str] | None = None
    ) -> Path:
        """Write t_s, target, drive, prediction and flags. force: replace an existing recording."""
        check_outputs([path], [], force)
        unit = self.model.displacement_unit
        columns = {
            f"target_{unit}": self.target,
            f"u_{self.model.drive_unit}": self.drive,
            f"y_model_{unit}": self.predicted,
            "flags": self.result.flags,
        }
        write_recording(path, self.t_s, columns, {**(notes or {}), "mode": self.mode})
        return Path(path)

    def _repr_html_(self) -> str:
        from dehyst.daemon.report.notebook import show_drive

        return show_drive(self.t_s, self.target, self.result, self.model, self.flagged)


@dataclass(frozen=True)
class Validated(Sequence[Validation]):
    """Validations of every model on every recording, ordered by model. names: of the models."""

    names: tuple[str, ...]
    recordings: tuple[Recording, ...] = field(repr=False)
    results: tuple[Validation, ...] = field(repr=False)

    @property
    def worse(self) -> bool:
        """Whether any model is worse than it claims."""
        return any(one.worse for one in self.results)

    @property
    def rows(self) -> list[tuple[str, Recording, Validation]]:
        """(model name, recording, validation) of each pair."""
        return list(zip(self.names, self.recordings, self.results, strict=True))

    def __len__(self) -> int:
        return len(self.results)

    def __getitem__(self, index: Any) -> Any:
        return self.results[index]

    def __iter__(self) -> Iterator[Validation]:
        return iter(self.results)

    @python_function
    def report(self, path: str | Path, force: bool = False) -> Path:
        """Write the report as one HTML file. force: replace an existing file that is no report."""
        check_outputs([path], [], force)
        from dehyst.daemon.report.validation import report_validation

        return write_page(Path(path), report_validation(self.rows))

    def __str__(self) -> str:
        from dehyst.daemon.report.validation import say_validation

        return "\n".join(say_validation(name, one) for name, _, one in self.rows)

    def _repr_html_(self) -> str:
        from dehyst.daemon.report.notebook import show_validation

        return show_validation(self.rows)


@dataclass(frozen=True)
class Diagnosed:
    """Physics that the model in use lacks. details: the full diagnosis."""

    details: Diagnosis = field(repr=False)
    recordings: tuple[Recording, ...] = field(repr=False)

    @property
    def verdict(self) -> str:
        """One of clean, explained, partly and unknown."""
        return self.details.verdict

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Effects that the model lacks, strongest first."""
        return self.details.findings

    @cached_property
    def model(self) -> Model:
        """The augmented model, with the recordings to which it was fitted; the model in use as it
        was given, where no other predicts better."""
        model = self.details.model
        if model.provenance.created and model == self.details.base_model:
            return model
        return with_provenance(model, "dehyst diagnose", self.recordings)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of diagnosis.json."""
        return self.details.to_dict()

    @python_function
    def save(self, folder: str | Path, force: bool = False) -> Path:
        """Write diagnosis.json, model.toml and report.html into a folder; return the report's
        path. force: replace an existing model.toml even if it is not a model."""
        from dehyst.daemon.report.diagnosis import report_diagnosis

        folder = Path(folder)
        check_outputs([folder / name for name in DIAGNOSIS_FILES], [], force)
        said = json_text(self.to_dict(), indent=2) + "\n"
        write_page(folder / "diagnosis.json", said)
        save_model(self.model, folder / "model.toml")
        names = [one.name for one in self.recordings]
        return write_page(folder / "report.html", report_diagnosis(self.details, names))

    def __str__(self) -> str:
        return _describe_diagnosis(self.details)

    def _repr_html_(self) -> str:
        from dehyst.daemon.report.notebook import show_diagnosis

        return show_diagnosis(self.details)


def with_provenance(model: Model, source: str, recordings: Sequence[Recording]) -> Model:
    """Return the model with the recordings to which it was fitted."""
    made = Provenance(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        version=__version__,
        source=source,
        recordings=tuple((r.name, r.sha256) for r in recordings),
    )
    return replace(model, provenance=made)


def _describe_diagnosis(diagnosis: Diagnosis) -> str:
    """Return the text shown on the terminal: the data first, then the verdict with one pair of
    figures, the findings, and what to do next."""
    before, after = diagnosis.before_after
    k, unit = pick_unit(diagnosis.unit, max(before, diagnosis.noise))
    lines = [f"data: {said}" for said in diagnosis.data.says]
    verdict = SAID.get(diagnosis.verdict, diagnosis.verdict)
    lines.append(
        f"{verdict}: the model in use leaves {k * before:.3g} {spell_unit(unit)} rms, the "
        f"augmented model {k * after:.3g} (noise {k * diagnosis.noise:.3g})"
    )
    for f in diagnosis.findings:
        ties = f" (or {', '.join(f.ambiguous_with)})" if f.ambiguous_with else ""
        lines.append(f"  {f.name}{ties}, {f.percent} of the explainable misfit: {f.says}")
    if diagnosis.next_experiment:
        lines.append(f"  next: {diagnosis.next_experiment}")
    return "\n".join(lines)
