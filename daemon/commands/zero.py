"""Report where gauge and model disagree, and set the gauge's zero."""

import argparse
import math
from typing import TYPE_CHECKING, Any

from dehyst.daemon.client.connection import add_connection, connect_axes, say
from dehyst.daemon.json_text import print_json
from dehyst.daemon.rings.status import OTHER_STAGE, USUAL_SHIFT
from dehyst.daemon.terminal.number_options import finite, within
from dehyst.daemon.terminal.what_follows import after_a_stop, after_the_last
from dehyst.models.errors import BadInput

if TYPE_CHECKING:
    from dehyst.daemon.client.client import Client
    from dehyst.daemon.client.zero import Disagreement

EPILOG = """After power-on or warm-up, a stage is not where its model predicts: its history is
unknown, and the gauge's zero drifts. This command compares gauge and model, and shifts the gauge's
zero by their mean difference, so that `dehyst send 5` goes to 5 on the gauge. Without --exercise
nothing moves, and the difference is measured at the present position. --exercise first moves slowly
through the reach twice, within the limits, after which the model knows the stage's history.
On a controller with several axes it treats one axis after the other, or only that of --to
stage-1-x. The shift lasts until the loop's process ends; the command prints the configuration line
that keeps it.
Exit 0: done; 1: the gauge gives no reading; 2: refused or no daemon.

examples: dehyst zero --look
          dehyst zero --exercise
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst zero`."""
    parser.epilog = EPILOG
    parser.add_argument(
        "--exercise", action="store_true", help="move slowly through the reach first"
    )
    parser.add_argument(
        "--share",
        type=_share,
        default=0.9,
        metavar="X",
        help="share of the reach that --exercise covers, about its middle (default: 0.9)",
    )
    parser.add_argument(
        "--seconds",
        type=within(2.0, 600.0),
        default=10.0,
        metavar="S",
        help="duration of one cycle, there and back",
    )
    parser.add_argument("--look", action="store_true", help="only print the difference")
    parser.add_argument(
        "--take-over", action="store_true", help="take the command from another client"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    add_connection(parser)


def _share(text: str) -> float:
    value = finite(text)
    if not 0.0 < value <= 1.0:
        raise argparse.ArgumentTypeError("must be above 0 and at most 1")
    return value


def run(args: argparse.Namespace) -> int:
    """Exercise if requested, compare, and set the zero of each axis; return the exit status."""
    if args.exercise and args.look:
        raise BadInput("--look moves nothing; leave out --exercise")
    with connect_axes(args, "zero") as stage:
        stage.wait_until_started(on_wait=say)
        if args.take_over:
            stage.take_over()
        results = {axis: zero_of(client, args) for axis, client in stage.clients.items()}
    if args.json:
        print_json(results if len(results) > 1 else next(iter(results.values())))
    return 0 if all(result["samples"] for result in results.values()) else 1


def zero_of(client: "Client", args: argparse.Namespace) -> dict[str, Any]:
    """Exercise one axis if requested, compare, and set its zero; return its result."""
    from dehyst.daemon.client import zero

    config = client.config()
    if args.exercise:
        of = f"{client.name}: " if config.axis else ""
        say(
            f"{of}moving through {100 * args.share:g} % of the reach, there and back twice, "
            f"{args.seconds:g} s each; the second time counts"
        )
        try:
            found = zero.exercise_and_compare(client, args.share, args.seconds)
        except KeyboardInterrupt:  # the motion has been stopped
            say(f"{of}stopped early, so the zero was not set; the stage {after_a_stop(config)}")
            raise
        say(f"{of}done; the stage {after_the_last(config)}")
    else:
        found = zero.compare_zero(client)
    status = client.status()  # includes any shift made before this command
    shift = 0.0 if args.look else -found.mean
    if found.samples and shift:
        client.move_zero(shift)
    keep = config.sensor.zero + status.gauge_zero + shift
    if not args.json:
        if config.axis:
            print(f"{client.name}:")
        section = f"[axis.{config.axis}.sensor]" if config.axis else "[sensor]"
        part = abs(shift) / (status.reach_max - status.reach_min)
        usual = how_usual(part, args.exercise)
        print_disagreement(found, shift, usual, f"{section} zero = {keep:.6g}", status.unit)
    return {
        "unit": status.unit,
        "samples": found.samples,
        "gauge_minus_model": found.mean,
        "by_place": [
            {"from": p.low, "to": p.high, "gauge_minus_model": p.mean} for p in found.places
        ],
        "zero_moved_by": shift if found.samples else 0.0,
        "sensor_zero_that_keeps_it": keep,
    }


def print_disagreement(
    found: "Disagreement", shift: float, usual: str, keep: str, unit: str
) -> None:
    """Print the disagreement. usual: a remark on the size of the shift; keep: the configuration
    line that keeps the zero."""
    if not found.samples:
        print("the gauge gives no valid reading, so the zero was not set")
        return
    for place in found.places:
        if math.isfinite(place.mean):
            at = f"from {place.low:.4g} to {place.high:.4g} {unit}"
            print(
                f"{at if len(found.places) > 1 else f'at {place.low:.4g} {unit}'}: the gauge is "
                f"{place.mean:+.4g} {unit} from the model"
            )
    print(f"on average the gauge is {found.mean:+.4g} {unit} from the model")
    if shift:
        print(
            f"the gauge's zero was moved by {shift:+.4g} {unit}, and gauge and model now agree on "
            f"average. {usual}\n"
            f"to keep it beyond this run of the daemon: {keep}"
        )


def how_usual(part: float, exercised: bool) -> str:
    """Judge a shift of the gauge's zero by its part of the reach, in words. exercised: the history
    of the stage is known."""
    if part <= USUAL_SHIFT:
        return "This is usual: after power-on a gauge's zero is arbitrary"
    said = f"That is {100 * part:.0f} % of the reach"
    if exercised:
        return f"{said}, which is unusual: {OTHER_STAGE}"
    return (
        f"{said}: the unknown history of the stage may be the cause, which `dehyst zero "
        f"--exercise` erases; otherwise {OTHER_STAGE}"
    )
