"""Tell the whole story on the simulated stage in a few minutes."""

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.terminal.number_options import natural
from dehyst.daemon.terminal.progress import progress_bar
from dehyst.models.errors import DehystError

if TYPE_CHECKING:
    from dehyst.daemon.demo.second_act import Story

OUTPUTS = (
    "recording.csv",
    "trajectory.csv",
    "track-linear.csv",
    "track-compensated.csv",
    "model.toml",
    "demo.png",
    "story.png",
)
"""Files that the demo writes."""
DESCRIPTION = """\
Demonstrate dehyst on the simulated stage in a few minutes: excite and record the stage through the
serial drivers, identify a model, run the daemon, stream a 1 Hz full-stroke sine to it from a
separate process over zenoh, once with a linear gain and once with the identified model, print the
tracking errors and save a plot. In the second part a randomly drawn effect appears in the running
stage: the watch flags it, the doctor names it and offers a model, the demo accepts the model, and
the error falls. The demo saves a plot and prints which effect was drawn."""


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = DESCRIPTION
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("out"),
        metavar="DIR",
        help="folder for plots, recordings and model (default: out)",
    )
    parser.add_argument("--seed", type=natural, metavar="N", help="seed of the second part")
    parser.add_argument(
        "--first-act", action="store_true", help="run the first part only, about a minute"
    )
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="result as JSON on stdout")
    parser.epilog = """exit status: 0: compensation reduced the error in both parts, and the effect
was named correctly; 1: it did not, or the effect was not named correctly; 77: this machine was too
busy to judge (the reason is printed): run it again with less other load.

examples: dehyst demo -o out
          dehyst demo --seed 7 --force"""


def say_on_stderr(text: str) -> None:
    """Print one line on stderr."""
    print(text, file=sys.stderr, flush=True)


def run(args: argparse.Namespace) -> int:
    check_outputs([args.output / name for name in OUTPUTS], [], args.force)
    say_on_stderr(
        "dehyst demo: a stage, an amplifier and a gauge reader are simulated; nothing real moves"
    )
    from dehyst.daemon.demo.busy import TOO_BUSY, busy_between, read_spent

    args.output.mkdir(parents=True, exist_ok=True)
    first = read_spent()
    try:
        return _run(args)
    except DehystError as error:  # usually a wait that timed out
        busy = busy_between(first, read_spent())
        if not busy.why:
            raise
        say_on_stderr(f"dehyst demo: {error}; this machine is too busy to judge: {busy.why}")
        return TOO_BUSY


def _run(args: argparse.Namespace) -> int:
    """Run both acts; return the exit status."""
    from dehyst.daemon.demo.demo import Demo, compare_errors, draw_demo, join_acts

    story = None
    with tempfile.TemporaryDirectory(prefix="dehyst-demo-") as folder:
        demo = Demo(Path(folder), args.output, say_on_stderr)
        try:
            with progress_bar("recording") as progress:
                demo.excite_and_record(progress)
            demo.identify()
            results = demo.track()
            if not args.first_act:
                story = demo.second_act(args.seed)
        finally:
            demo.close()
    picture = args.output / "demo.png"
    draw_demo(demo, picture)
    linear, compensated = results["linear gain"], results["compensated"]
    code, says = compare_errors(linear, compensated, demo.late_share)
    codes = [code]
    facts = {
        "rms_um": results,
        "picture": str(picture),
        "better": compensated < linear,
        "late_share": demo.late_share,
        "says": says,
    }
    if not args.json:
        print(f"\n1 Hz sine, {demo.stroke_um:.1f} um peak to peak, {demo.rate_hz:g} Hz over serial")
        print(f"  {'':14}{'rms error':>12}{'of stroke':>12}")
        for name, rms in results.items():
            print(f"  {name:14}{1e3 * rms:9.1f} nm{100 * rms / demo.stroke_um:10.2f} %")
        print(f"  {says}")
        print(f"  picture: {picture}")
    if story is not None:
        codes.append(_tell_story(story, args.output / "story.png", facts, quiet=args.json))
    facts["exit"] = code = join_acts(codes)
    if args.json:
        print(json.dumps(facts))
    return code


def _tell_story(story: "Story", picture: Path, facts: dict[str, Any], quiet: bool) -> int:
    """Draw and print the second act and add it to the facts; return its exit status."""
    from dehyst.daemon.demo.second_act import describe_facts, save_story, tell_end

    save_story(story, picture)
    facts["second_act"] = describe_facts(story)
    if not quiet:
        print("\nsecond part")
        print("\n".join(tell_end(story)))
        print(f"  picture: {picture}")
    return story.exit_status
