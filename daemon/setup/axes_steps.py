"""The steps of a set-up of several axes: the steps of steps.py, with the same names, for all axes.

They make one configuration with [axis.x], [axis.y], ..., and a model, a report, a validation and a
comparison for each axis. A step's result has `axes`, with the result of each axis.
"""

import json
from collections.abc import Mapping
from pathlib import Path

from dehyst.daemon.api.functions import identify
from dehyst.daemon.config.text import limits_within, write_commented
from dehyst.daemon.loop.checks import check_unopened
from dehyst.daemon.setup import moving_axes
from dehyst.daemon.setup.steps import (
    UNITS_OPTIONS,
    Result,
    Step,
    ask_limits,
    chosen_rate,
    find_units,
    quoted,
    rate_found,
    replace_configuration,
    say_what_next,
    settings_of_unit,
    validate_on,
)
from dehyst.daemon.setup.workbench import CONFIG, Workbench
from dehyst.models.errors import BadInput


def together(axes: Mapping[str, Result], more: str = "") -> Result:
    """Combine the axes' results into the result of a step. more: a further line of its words."""
    lines = [f"{axis}: {one['words']}" for axis, one in axes.items()]
    return {"words": "\n".join([*lines, more] if more else lines), "axes": dict(axes)}


def ask_limits_of_all(bench: Workbench) -> Result:
    """Ask for one set of limits for all axes; if the user wrote the configuration, take its
    limits."""
    if not bench.has_own_config():
        return ask_limits(bench)
    return together(
        {
            axis: {"words": f"{moving_axes.range_in_words(one)}, {one.limits.slew_v_per_s:g} V/s"}
            for axis, one in bench.configs().items()
        },
        f"as in {CONFIG}",
    )


def write_axes_configuration(bench: Workbench) -> Result:
    """Choose a rate that the units sustain with all axes driven, and write the configuration with
    comments."""
    if bench.has_own_config():
        configs = bench.configs()
        for axis, config in configs.items():
            try:
                check_unopened(config)
            except BadInput as error:
                raise BadInput(f"axis {axis}: {error}") from None
        rate_hz = next(iter(configs.values())).loop.rate_hz
        return {"words": f"{CONFIG} is used unchanged", "rate_hz": rate_hz}
    rate_hz = chosen_rate(bench)
    replace_configuration(bench, _text_of(bench, rate_hz))
    for config in bench.configs().values():
        check_unopened(config)
    return rate_found(bench, rate_hz)


def _text_of(bench: Workbench, rate_hz: float) -> str:
    units, limits = bench.journal.result("units"), bench.journal.result("limits")
    actuator = units["actuator"]
    text = write_commented(
        {
            "": {"name": bench.name},
            "loop": {"rate_hz": rate_hz},
            "actuator": {"driver": actuator["driver"], "settings": settings_of_unit(actuator)},
            **limits_within(limits["min_v"], limits["max_v"], limits["slew_v_per_s"]),
        }
    )
    text += (
        "\n# The axes: the settings above apply to all axes; a section of an axis overrides them.\n"
    )
    for axis, gauge in units["sensors"].items():
        text += (
            f'\n[axis.{axis}.model]\nfile = "{bench.model_path_of(axis).name}"\n'
            f'[axis.{axis}.actuator.settings]\naxis = "{axis}"\n'
            f'[axis.{axis}.sensor]\ndriver = "{gauge["driver"]}"\n'
            f"[axis.{axis}.sensor.settings]\n"
        )
        # JSON strings are valid TOML strings
        text += "".join(f"{k} = {json.dumps(v)}\n" for k, v in settings_of_unit(gauge).items())
    return text


def exercise_axes_gently(bench: Workbench) -> Result:
    """Move one axis after the other in small loops to find which gauge belongs to which axis; then
    move all axes through their full ranges."""
    owners = moving_axes.find_owners(bench)
    wrong = [axis for axis, owner in owners.items() if axis != owner]
    words = ", ".join(f"{axis} moves the gauge of {owners[axis]}" for axis in wrong)
    if wrong and bench.has_own_config():
        raise BadInput(
            f"{CONFIG} has the gauge readers in another order: {words}; exchange their sections "
            "[axis.NAME.sensor], and run this command again"
        )
    if wrong:
        units, options = bench.journal.result("units"), bench.journal.options("units")
        units["sensors"] = {axis: units["sensors"][owner] for axis, owner in owners.items()}
        bench.journal.keep("units", options, units)
        bench.say(f"   the gauge readers are in another order: {words}")
        write_axes_configuration(bench)
    return together(moving_axes.exercise_fully(bench), "each gauge responds to its axis")


def identify_models(bench: Workbench) -> Result:
    """Identify a model of each axis, including the other axes' influence, and write its report."""
    axes = {}
    for axis, config in bench.configs().items():
        found = identify(bench.recording("record", axis))
        path = bench.model_path_of(axis)
        found.save(path)
        found.report(bench.in_folder("report.html", axis), path.name)
        share = (found.rms or 0.0) / found.figures.stroke
        follows = [block.channel for block in found.model.blocks if block.channel]
        words = f"{path.name}: residual {share:.2%} of the stroke"
        words += f", follows {', '.join(follows)}" if follows else ""
        if Path(config.model.file).name != path.name:
            bench.say(f"   {CONFIG} has {config.model.file} for axis {axis}: put {path.name} there")
        axes[axis] = {"words": words, "rms": found.rms, "noise_rms": found.noise_rms}
    return together(axes, "report-NAME.html")


def validate_models(bench: Workbench) -> Result:
    """Check how well each model predicts a recording with another drive, all axes moving
    together."""
    fresh = moving_axes.record_fresh(bench)
    axes = {}
    for axis, kept in fresh.items():
        bench.say(f"   {axis}: {kept['words']}")
        report = bench.in_folder("validation.html", axis)
        axes[axis] = validate_on(bench.model_path_of(axis), kept, report)
    return together(axes, "validation-NAME.html")


def offer_axes_service(bench: Workbench) -> Result:
    """Print the next commands to type; install nothing."""
    return say_what_next(
        bench,
        map(bench.model_path_of, bench.axes),
        f"dehyst scan raster --size 2 2 --config {quoted(bench.config_path)} -o raster.csv",
        "dehyst play raster.csv",
    )


AXES_STEPS = (
    Step("units", "find the units", find_units, UNITS_OPTIONS),
    Step("limits", "limits of the axes", ask_limits_of_all, ("range_v", "slew_v_per_s")),
    Step(
        "configuration",
        "measure the rate, write the configuration",
        write_axes_configuration,
        ("name", "rate_hz"),
    ),
    Step("exercise", "exercise gently", exercise_axes_gently, (), moving_axes.describe_gentle_axes),
    Step(
        "record",
        "excite and record",
        lambda bench: together(moving_axes.record_axes_in_turn(bench)),
        ("band_hz", "seconds"),
        moving_axes.describe_record,
    ),
    Step("identify", "identify a model of each axis", identify_models),
    Step(
        "validate",
        "validate them on new drives",
        validate_models,
        (),
        moving_axes.describe_fresh,
    ),
    Step(
        "track",
        "track sines without and with the models",
        lambda bench: together(moving_axes.track_sines(bench)),
        (),
        moving_axes.describe_sines,
    ),
    Step("service", "run it", offer_axes_service),
)
