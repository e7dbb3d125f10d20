"""Play a drive in volts open loop, and record what the stage does: for a stage without a model."""

import argparse
import json
import sys
from pathlib import Path

from dehyst.daemon.config import Config, load_config, load_controller
from dehyst.daemon.files.foreign.reading import add_reading
from dehyst.daemon.files.outputs import add_force, check_outputs, file_of_axis
from dehyst.daemon.rings import run_folder
from dehyst.daemon.terminal.progress import progress_bar
from dehyst.models.recording import Recording
from dehyst.models.units import how_many


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("drive", metavar="DRIVE.csv", help="columns t_s, u_v (see dehyst excite)")
    parser.add_argument("--config", required=True, metavar="FILE", help="configuration (TOML)")
    parser.add_argument("-o", "--output", required=True, metavar="REC.csv")
    parser.add_argument(
        "--exercise",
        type=float,
        default=5.0,
        metavar="S",
        help="time of full loops before the recording, which let creep decay (default: 5 s)",
    )
    parser.add_argument(
        "--axis", default="", metavar="NAME", help="record only this axis of several"
    )
    add_reading(parser)
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="result as JSON on stdout")
    parser.epilog = """Ctrl-C ends it: the output returns to its earlier voltage, and the samples
recorded so far are written.
On a controller with several axes, each axis plays the drive alone while the others rest, then all
play together, each at its own pace. REC-x.csv, REC-y.csv, ... have the columns axis_y_um and
axis_y_drive_v of the other axes, from which `dehyst identify` finds the coupling. --axis NAME
selects a single axis.
Exit 0: the whole drive was recorded; 1: the recording ended early; 2: nothing was recorded.

example: dehyst acquire drive.csv --config stage.toml -o recording.csv"""


def run(args: argparse.Namespace) -> int:
    from dehyst.daemon.acquire.axes import acquire_axes
    from dehyst.daemon.acquire.early_end import signals_noted
    from dehyst.daemon.acquire.one_axis import acquire
    from dehyst.daemon.files.given_recordings import read_one_given

    controller = load_controller(args.config)
    several = len(controller.axes) > 1 and not args.axis
    configs = controller.axes if several else (load_config(args.config, args.axis),)
    output = Path(args.output)
    files = {c.axis: file_of_axis(output, c.axis) if several else output for c in configs}
    inputs = [args.drive, args.config, *(c.model.file for c in configs)]
    check_outputs(list(files.values()), inputs, args.force)
    drive = read_one_given(Path(args.drive), args, 2)
    with (
        run_folder.at_work(controller.directory, run_folder.OUTPUT, "acquire", args.config),
        progress_bar("recording") as progress,
        signals_noted() as stopped,
    ):

        def stop() -> str:
            return "it was interrupted" if stopped else ""

        given = drive.t_s, drive.drive, drive.drive_unit, args.exercise, progress, stop
        if several:
            found, ended = acquire_axes(configs, *given)
        else:
            one, ended = acquire(configs[0], *given)
            found = {configs[0].axis: one}
        for config in configs:
            _write(files[config.axis], found[config.axis], config)
    if args.json:
        (size,) = {one.size for one in found.values()}
        names = [str(file) for file in files.values()]
        result = {"files": names} if several else {"file": names[0]}
        print(json.dumps({**result, "samples": size, "ended": ended}))
    else:
        early = f", before the drive's end: {ended}" if ended else ""
        for axis, recording in found.items():
            print(f"{files[axis]}: {how_many(recording.size, 'sample')}{early}", file=sys.stderr)
            if defects := recording.defects():
                print(defects, file=sys.stderr)
    return 1 if ended else 0


def _write(path: Path, recording: Recording, config: Config) -> None:
    from dehyst.daemon.files.axis_columns import to_columns
    from dehyst.daemon.files.recordings import write_recording

    assert recording.displacement is not None
    columns = {
        recording.drive_column: recording.drive,
        recording.displacement_column: recording.displacement,
    }
    columns |= to_columns(recording.channels, recording.displacement_unit, recording.drive_unit)
    notes = {"source": f"dehyst acquire, {config.name}", "actuator": config.actuator.driver}
    write_recording(path, recording.t_s, columns, notes)
