"""Run the daemon in the foreground (without --config: on the simulated stage)."""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from dehyst.daemon.bus.security import check_open
from dehyst.daemon.config import Config, load_controller
from dehyst.daemon.config.sections import check_name
from dehyst.daemon.interrupts import ended_at_once
from dehyst.daemon.printable import printable
from dehyst.daemon.rings import run_folder
from dehyst.models.errors import BadInput, DehystError

if TYPE_CHECKING:  # these import numba
    from dehyst.daemon.bench.simulated import Imitation
    from dehyst.models.model import Model

NAME, LISTEN = "bench", "tcp/127.0.0.1:7447"
DESCRIPTION = """\
Run the daemon in the foreground: the loop and the gateway, with restarts when they fail.

Without --config it runs on the simulated stage: the real serial drivers use an emulated MDT693B and
KSG101 on pseudo terminals.

SIGTERM or Ctrl-C ends it in the state that [safe] names; SIGHUP reloads the model file."""

UNIT_STOP_S, SPARE_S = 90.0, 20.0
"""TimeoutStopSec= of systemd/dehyst.service; time for slow devices in addition to a ramp."""


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = DESCRIPTION
    parser.add_argument("--config", metavar="FILE", type=Path, help="configuration (TOML)")
    parser.add_argument(
        "--check",
        metavar="FILE",
        type=Path,
        help="check a configuration and its model and explain what they mean; nothing moves",
    )
    parser.add_argument(
        "--json", action="store_true", help="with --check: print every setting as JSON on stdout"
    )
    parser.add_argument(
        "--listen",
        metavar="ADDRESS",
        help=f"without --config: where clients connect (default: {LISTEN})",
    )
    parser.add_argument(
        "--model",
        metavar="MODEL.toml",
        help="without --config: this model, on a simulated stage that is scaled to it",
    )
    parser.add_argument(
        "--axes",
        type=int,
        choices=(1, 2, 3),
        help="without --config: number of axes of the simulated stage (default: 1)",
    )
    parser.add_argument("--name", help=f"without --config: the daemon's name (default: {NAME})")
    parser.epilog = (
        "examples: dehyst run\n          dehyst run --model stage.toml\n          "
        "dehyst run --axes 3\n          dehyst run --config /etc/dehyst/stage.toml"
    )


def say_of_run(text: str) -> None:
    """Print one line on stderr."""
    print(f"dehyst run: {text}", file=sys.stderr, flush=True)


def run(args: argparse.Namespace) -> int:
    if args.check:
        return check_configuration(args.check, args.json)
    if args.json:
        raise BadInput("--json goes with --check FILE")
    for option in ("model", "name", "listen", "axes"):
        if args.config and getattr(args, option):
            raise BadInput(f"--{option} goes without --config, which sets it")
    if args.config:
        return supervise(args.config)
    name, listen = args.name or NAME, args.listen or LISTEN
    check_name(name)
    check_open([listen], authenticated=False)
    check_free(listen)
    say_of_run(
        "starting an emulated MDT693B and KSG101 with a simulated stage (no --config was given)"
    )
    from dehyst.daemon.bench.simulated import MAY_STAY, write_axes_bench, write_bench
    from dehyst.daemon.service.supervisor import BenchProcess
    from dehyst.drivers.simulated.settings import AXES

    axes = AXES[: args.axes or 1]
    if args.model and len(axes) > 1:
        raise BadInput("--model goes with one axis; with several each has its own model")
    with ended_at_once("dehyst run"):
        imitation, models = models_of_bench(args.model, axes)

    with tempfile.TemporaryDirectory(prefix="dehyst-") as folder:
        directory = Path(folder)
        several = ["--axes", str(len(axes))] if len(axes) > 1 else []
        bench = BenchProcess(directory, [*imitation.stage, *several])
        try:
            if several:
                path = write_axes_bench(directory, bench.ports, name, listen, models, more=MAY_STAY)
            else:
                (model,) = models.values()
                path = write_bench(
                    directory, bench.ports, name, listen, model, imitation, more=MAY_STAY
                )
            say_of_run(
                f"its configuration is {path}; this folder is deleted when it ends. Try "
                f"`{watching(listen)}` in another terminal"
            )
            return supervise(path)
        finally:
            bench.close()


def watching(listen: str) -> str:
    """Return the command that watches a daemon at this address."""
    return "dehyst watch" if listen == LISTEN else f"dehyst watch --connect {listen}"


def models_of_bench(
    model: str | None, axes: Sequence[str]
) -> "tuple[Imitation, dict[str, Model | Path]]":
    """Return the simulated stage and a model of each axis. The default stage's model is shipped;
    others import numba and may need kernels to be compiled."""
    from dehyst.daemon.bench.simulated import SHIPPED_MODEL, Imitation, simulated_model

    if not model and len(axes) == 1:
        return Imitation(), {axes[0]: SHIPPED_MODEL}
    from dehyst.daemon.files.models import load_model
    from dehyst.daemon.terminal.compiling import compiling_reported
    from dehyst.drivers.simulated.axes import settings_by_axis

    with compiling_reported("dehyst run", in_pipes=True):
        if model:
            loaded = load_model(model)
            return Imitation.of(loaded), {axes[0]: loaded}
        return Imitation(), {
            axis: simulated_model(one) for axis, one in settings_by_axis(axes, {}).items()
        }


def supervise(path: Path) -> int:
    """Run core and gateway of a configuration until a signal, and its emulated bench if it has one
    that does not run yet; return the supervisor's exit status."""
    controller = load_controller(path)
    say_of_run(f"starting {controller.name} with {path}")
    with ended_at_once("dehyst run"):
        from dehyst.daemon.bench.emulated import started_for
        from dehyst.daemon.service.supervisor import Supervisor

    with (
        run_folder.at_work(controller.directory, run_folder.SUPERVISOR, "run", path),
        started_for(controller, say_of_run),
    ):
        return Supervisor(controller, path, say_of_run).run()


def check_free(listen: str) -> None:
    """Raise BadInput if another daemon or program uses the address."""
    from dehyst.daemon.client.finding import listens

    if listen.startswith("tcp/") and listens(listen):
        raise BadInput(
            f"{listen} is in use, by another `dehyst run` for example; end that one, or run a "
            "second one with --listen tcp/127.0.0.1:7448 --name second"
        )


def check_configuration(path: Path, as_json: bool = False) -> int:
    """Check a configuration and print what it means; return 0."""
    from dehyst.daemon.gateway.process import security_of

    controller = load_controller(path)
    said = []
    for config in controller.axes:
        try:
            said.append(axis_words(config))
        except DehystError as error:
            raise type(error)(
                f"axis {config.axis}: {error}" if config.axis else str(error)
            ) from None
    security_of(controller)
    if as_json:
        whole: Any = controller.axes[0]
        if controller.axis_names != ("",):
            whole = {config.axis: config for config in controller.axes}
        print(msgspec.json.format(msgspec.json.encode(whole), indent=2).decode())
    else:
        print(
            f"{path}: ok. Checked: keys and values, models, drivers' settings, rate, trim and bus; "
            "no device was opened"
        )
        for config, words in zip(controller.axes, said, strict=True):
            print(f"{config.name}:")
            for name, text in words.items():
                print(f"  {name:10s}{printable(text)}")
        addresses = ", ".join((*controller.bus.listen, *controller.bus.connect))
        print(f"bus: {addresses}\nrings: {controller.directory}\nall settings: --json")
    if controller.longest_ramp_s > UNIT_STOP_S - SPARE_S and any(
        config.safe.on_stop == "ramp" for config in controller.axes
    ):
        longest_s = controller.longest_ramp_s
        print(
            f"{path}: the output may take {longest_s:.0f} s to reach its safe voltage, longer "
            f"than TimeoutStopSec={UNIT_STOP_S:.0f} of dehyst.service. systemd waits as long as "
            "the daemon asks it to while it ramps; anything else that may end it (another unit, "
            f"docker stop) must allow {longest_s + SPARE_S:.0f} s, or safe.ramp_v_per_s must be "
            "larger",
            file=sys.stderr,
        )
    return 0


def axis_words(config: Config) -> dict[str, str]:
    """Return what an axis' configuration means, by subject. Raises DehystError if `dehyst run`
    would refuse it."""
    from dehyst.daemon.config.drives import drive_range, implausible_ranges
    from dehyst.daemon.files.models import load_model
    from dehyst.daemon.loop.checks import check_unopened, devices_of
    from dehyst.daemon.loop.trim import trim_setting
    from dehyst.daemon.terminal.overview import describe_kind
    from dehyst.models.cascade.reach import displacement_reach, set_point_origin

    check_unopened(config)
    model = load_model(config.model.file)
    drives, doubts = drive_range(config, model), implausible_ranges(config, model)
    reach = displacement_reach(model, *drives)
    low, high = reach.low, reach.high
    sensor = devices_of(config)[1]
    trimmed = trim_setting(config, model, high - low, getattr(sensor, "spec", None))
    zero = set_point_origin(config.setpoint.origin, model, *drives)
    unit = model.displacement_unit
    assumed = f"; this assumes {', '.join(reach.assumes)}" if reach.assumes else ""
    limits, safe = config.limits, config.safe
    return {
        "devices": f"actuator {device_words(config.actuator)}, sensor "
        f"{device_words(config.sensor)}",
        "model": f"{config.model.file}: {describe_kind(model)}",
        **({"warning": "; ".join(doubts)} if doubts else {}),
        "reach": f"set-points from {low - zero:.4g} to {high - zero:.4g} {unit}{assumed}; "
        f"set-point 0 is the model's {zero:.4g} {unit}",
        "rate": f"{config.loop.rate_hz:g} Hz",
        "limits": f"{limits.min_v:g} to {limits.max_v:g} V, at most {limits.slew_v_per_s:g} V/s",
        "trim": trim_words(trimmed[0], unit),
        "safe": f"{safe.voltage_v:g} V; at the end: {safe.on_stop}, on a fault: {safe.on_fault}",
    }


def device_words(device: Any) -> str:
    """Return the device's driver and port."""
    port = device.settings.get("port")
    return f"{device.driver} at {port}" if port else str(device.driver)


def trim_words(p: Any, unit: str) -> str:
    """Return what the [trim] section means."""
    if not p["on"]:
        return "off: open loop"
    return (
        f"by the gauge: time constant {p['time_constant_s']:.3g} s, at most "
        f"{p['limit']:.3g} {unit}, {p['rate']:.3g} {unit} a second"
    )
