"""The steps of a set-up, in order, as one table."""

import shlex
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from dehyst.daemon.api.functions import identify, validate
from dehyst.daemon.config.text import SLEW_SPANS, limits_within, write_commented
from dehyst.daemon.files.known_units import ACTUATOR, SENSOR, forget_unit
from dehyst.daemon.files.models import write_text
from dehyst.daemon.loop.checks import check_unopened, devices_of, highest_rate
from dehyst.daemon.setup import comparison, moving
from dehyst.daemon.setup.units import (
    ANY_UNIT,
    FoundUnit,
    known_ports,
    measure_rate,
    output_of,
    units_at,
)
from dehyst.daemon.setup.workbench import CONFIG, MADE, MODEL, Workbench
from dehyst.drivers.serial_port import list_serial_ports
from dehyst.models.errors import BadInput, NotNow

RATE_SHARE = 0.95  # of the rate at which these units still have time for late replies
MOST_HZ = 1000.0  # highest loop rate, even if the units sustain more

UNITS_OPTIONS = ("ports", "axis", "axes")

Result = dict[str, Any]
"""Result of a step. `words`: summary for the user; the rest: for later steps and --json."""


@dataclass(frozen=True)
class Step:
    """One step. options: fields of Wishes that it uses; a changed value repeats the step; moves:
    describes what will move and how far, None if nothing moves."""

    name: str
    title: str
    run: Callable[[Workbench], Result]
    options: tuple[str, ...] = ()
    moves: Callable[[Workbench], str] | None = None


def find_units(bench: Workbench) -> Result:
    """Find the units and their ports; move nothing."""
    if bench.has_own_config():
        return {"words": f"those of the existing {CONFIG}"}
    wishes, known = bench.wishes, known_ports()
    axes = wishes.axes or _axes_asked_for(bench)
    found: dict[str, list[FoundUnit]] = {"actuator": [], "sensor": []}
    for path in wishes.ports or tuple(known):
        units = units_at(path, axes[0], known.get(path, ANY_UNIT))
        if not units:
            bench.say(f"   {path}: no unit that dehyst knows answers")
        for unit in units:
            bench.say(f"   {path}: {unit.spec.identity or unit.driver}")
            found[unit.kind].append(unit)
    actuator = _one_of(bench, found["actuator"], "amplifier")
    if len(axes) > 1:
        return _units_of_axes(axes, actuator, found["sensor"])
    sensor = _one_of(bench, found["sensor"], "gauge reader")
    result: Result = {"axis": axes[0], "actuator": _described(actuator)}
    result |= {"sensor": _described(sensor)}
    result["sustained_hz"] = highest_rate([(actuator.spec, sensor.spec)], [])
    names = [f"{unit.driver} at {unit.port}" for unit in (actuator, sensor)]
    return result | {"words": ", ".join(names)}


def _axes_asked_for(bench: Workbench) -> tuple[str, ...]:
    if bench.wishes.axis or bench.ask.yes:
        return (bench.wishes.axis or "x",)
    text = "axis that drives the stage, or several of this amplifier"
    choices = ["x", "y", "z", "x,y", "x,z", "y,z", "x,y,z"]
    return tuple(bench.ask.choice(text, "--axis", choices).split(","))


def _units_of_axes(axes: tuple[str, ...], actuator: FoundUnit, gauges: list[FoundUnit]) -> Result:
    """Describe one amplifier and a gauge for each axis, for now in the order of the ports; the
    gentle loops show later which gauge belongs to which axis."""
    if not output_of(actuator.driver, axes[0]):
        raise BadInput(f"--axes {','.join(axes)}: a {actuator.driver} has one output; use --axis")
    if len(gauges) < len(axes):
        raise NotNow(
            f"the axes {', '.join(axes)} need a gauge reader each, but {len(gauges)} answer; plug "
            "the others in, name their ports with --ports, or name fewer axes with --axes"
        )
    if len(gauges) > len(axes):
        ports = ", ".join(gauge.port for gauge in gauges)
        raise NotNow(
            f"{len(gauges)} gauge readers answer ({ports}) for the axes {', '.join(axes)}: name "
            "the amplifier's port and those of this stage with --ports"
        )
    return {
        "axes": list(axes),
        "actuator": _described(actuator),
        "sensors": {axis: _described(gauge) for axis, gauge in zip(axes, gauges, strict=True)},
        "sustained_hz": measure_rate(actuator, axes, gauges),
        "words": f"{actuator.driver} at {actuator.port}, and {len(gauges)} gauge readers; the "
        "gentle loops will show which axis each belongs to",
    }


def _described(unit: FoundUnit) -> dict[str, Any]:
    return {
        "driver": unit.driver,
        "port": unit.port,
        "settings": unit.settings,
        "minimum": unit.spec.minimum,
        "maximum": unit.spec.maximum,
    }


def settings_of_unit(unit: dict[str, Any]) -> dict[str, Any]:
    """Return the driver settings of a unit that was found; an older journal has only the port."""
    return dict(unit.get("settings") or {"port": unit["port"]})


def _one_of(bench: Workbench, units: list[FoundUnit], what: str) -> FoundUnit:
    if not units:
        here = ", ".join(p.path for p in list_serial_ports()) or "none"
        raise NotNow(
            f"no {what} answers; plug it in, or name the ports that may be probed with --ports "
            f"(serial ports here: {here}). Other drivers: write {bench.config_path} with `dehyst "
            "config init`, and run this command again"
        )
    port = bench.ask.choice(f"port of the {what}", "--ports", [u.port for u in units])
    return next(u for u in units if u.port == port)


def ask_limits(bench: Workbench) -> Result:
    """Ask for the stage's voltage limits; the amplifier's are never taken instead."""
    if bench.has_own_config():
        limits = bench.config().limits
        low, high, slew = limits.min_v, limits.max_v, limits.slew_v_per_s
        return {"words": f"{low:g} to {high:g} V, {slew:g} V/s, as in {CONFIG}"}
    unit, wishes, ask = bench.journal.result("units")["actuator"], bench.wishes, bench.ask
    least, most = unit["minimum"], unit["maximum"]
    if wishes.range_v:
        low, high = wishes.range_v
    else:
        bench.say(f"   the amplifier gives {least:g} to {most:g} V; see the stage's own data sheet")
        low = ask.number("lowest voltage of the stage, V", "--range MIN MAX", least, most, None)
        high = ask.number("highest voltage of the stage, V", "--range MIN MAX", low, most, None)
    if not least <= low < high <= most:
        raise BadInput(
            f"--range {low:g} {high:g}: the amplifier gives {least:g} to {most:g} V, and the "
            "second must be above the first"
        )
    slew = wishes.slew_v_per_s or ask.number(
        "largest rate of the voltage, V/s", "--slew", 1.0, 1e6, SLEW_SPANS * (high - low)
    )
    return {
        "words": f"{low:g} to {high:g} V at no more than {slew:g} V/s",
        "min_v": low,
        "max_v": high,
        "slew_v_per_s": slew,
    }


def write_configuration(bench: Workbench) -> Result:
    """Choose a rate that the units sustain, and write the configuration with comments."""
    if bench.has_own_config():
        config = bench.config()
        check_unopened(config)
        return {"words": f"{CONFIG} is used unchanged", "rate_hz": config.loop.rate_hz}
    units, limits = bench.journal.result("units"), bench.journal.result("limits")
    rate_hz = chosen_rate(bench)
    text = write_commented(
        {
            "": {"name": bench.name},
            "model": {"file": MODEL},
            "loop": {"rate_hz": rate_hz},
            "actuator": {
                "driver": units["actuator"]["driver"],
                "settings": settings_of_unit(units["actuator"])
                | output_of(units["actuator"]["driver"], units["axis"]),
            },
            "sensor": {
                "driver": units["sensor"]["driver"],
                "settings": settings_of_unit(units["sensor"]),
            },
            **limits_within(limits["min_v"], limits["max_v"], limits["slew_v_per_s"]),
        }
    )
    replace_configuration(bench, text)
    check_unopened(bench.config())
    return rate_found(bench, rate_hz)


def chosen_rate(bench: Workbench) -> float:
    """Return the loop rate [Hz]. Raises BadInput if the units do not sustain the requested rate."""
    sustained = bench.journal.result("units")["sustained_hz"]
    most_hz = min(RATE_SHARE * sustained, MOST_HZ)
    rate_hz = bench.wishes.rate_hz or 10.0 * (most_hz // 10.0) or most_hz
    if rate_hz > sustained:
        raise BadInput(
            f"--rate {rate_hz:g}: as measured, these units leave time for late replies only up to "
            f"{sustained:g} Hz"
        )
    return rate_hz


def rate_found(bench: Workbench, rate_hz: float) -> Result:
    """Return the step's result with the rate."""
    sustained = bench.journal.result("units")["sustained_hz"]
    words = f"{CONFIG}: {rate_hz:g} Hz (up to {sustained:g} Hz leaves time for late replies)"
    words = "\n".join(filter(None, (words, bench.name_in_words)))
    return {"words": words, "rate_hz": rate_hz, "sustained_hz": sustained}


def replace_configuration(bench: Workbench, text: str) -> None:
    """Write the configuration and keep the previous one under another name. The new file names the
    units that were found, so the units known from an earlier set-up of this name are forgotten."""
    if aside := bench.put_aside(bench.config_path, MADE + text):
        bench.say(f"   the previous configuration is now {aside.name}")
    write_text(bench.config_path, MADE + text)
    for config in bench.configs().values():
        for which in (ACTUATOR, SENSOR):
            forget_unit(config, which)


def identify_model(bench: Workbench) -> Result:
    """Identify the model and write its report."""
    found = identify(bench.recording("record"))
    found.save(bench.model_path)
    found.report(bench.folder / "report.html", MODEL)
    share = (found.rms or 0.0) / found.figures.stroke
    words = (
        f"{MODEL}: {found.model.hysteresis.n} play operators, residual {share:.2%} of the stroke"
    )
    return {"words": f"{words}; report.html", "rms": found.rms, "noise_rms": found.noise_rms}


def validate_model(bench: Workbench) -> Result:
    """Check how well the model predicts a recording with another drive."""
    fresh = moving.record_drive(bench, moving.FRESH, "fresh")
    bench.say(f"   {fresh['words']}")
    found = validate_on(bench.model_path, fresh, bench.folder / "validation.html")
    return found | {"words": f"{found['words']}; validation.html"}


def validate_on(model: Path, fresh: Result, report: Path) -> Result:
    """Return the result of a recording in the folder of the report, with how well the model
    predicts it; write the report."""
    recording = report.parent / fresh["recording"]
    found = validate(model, recording)
    found.report(report)
    one = found.results[0]
    words = f"predicted to within {one.share:.2%} of the span ({one.rms:.3g} {one.unit} rms)"
    if one.worse:
        words += (
            f", worse than it claims ({one.claim:.3g} {one.unit} rms); what it lacks: dehyst "
            f"diagnose {quoted(recording)} --model {quoted(model)} -o "
            f"{quoted(recording.parent / 'findings')}"
        )
    return fresh | {
        "words": words,
        "rms": one.rms,
        "share_of_span": one.share,
        "worse_than_claimed": one.worse,
    }


def quoted(path: Path) -> str:
    """Return a path as an argument of a printed command."""
    return shlex.quote(str(path))


def offer_service(bench: Workbench) -> Result:
    """Print the next commands to type; install nothing."""
    devices_of(bench.config())
    return say_what_next(bench, [bench.model_path])


def say_what_next(bench: Workbench, models: Iterable[Path], *more: str) -> Result:
    """Print the commands that run the daemon. models: the model files; more: commands for a running
    daemon."""
    config = quoted(bench.config_path)
    for line in (
        f"dehyst run --config {config}     # in a terminal; `dehyst watch` in another",
        "dehyst zero --exercise     # once it is running: the stage's history is still unknown",
        *more,
        'as a service: the nine commands of README.md, "Run it as a service", the second one with',
        f"  install -D -m 0640 {config} {' '.join(map(quoted, models))} -t /etc/dehyst",
    ):
        bench.say(f"   {line}")
    return {"words": "ready to run"}


STEPS = (
    Step("units", "find the units", find_units, UNITS_OPTIONS),
    Step("limits", "limits of this stage", ask_limits, ("range_v", "slew_v_per_s")),
    Step(
        "configuration",
        "measure the rate, write the configuration",
        write_configuration,
        ("name", "rate_hz"),
    ),
    Step("exercise", "exercise gently", moving.exercise_gently, (), moving.describe_gentle),
    Step(
        "record",
        "excite and record",
        partial(moving.record_drive, seed=0, stem="recording"),
        ("band_hz", "seconds"),
        partial(moving.describe_drive, seed=0),
    ),
    Step("identify", "identify a model", identify_model),
    Step(
        "validate",
        "validate it on a new drive",
        validate_model,
        (),
        partial(moving.describe_drive, seed=moving.FRESH),
    ),
    Step(
        "track",
        "track a sine without and with the model",
        comparison.track_sine,
        (),
        comparison.describe_sine,
    ),
    Step("service", "run it", offer_service),
)
