"""Run the steps of a set-up that are not done yet, in order."""

from typing import Any

from dehyst.daemon.setup.axes_steps import AXES_STEPS
from dehyst.daemon.setup.names import NAMES
from dehyst.daemon.setup.steps import STEPS, Step
from dehyst.daemon.setup.workbench import Workbench


def options_of(bench: Workbench, step: Step) -> dict[str, Any]:
    """Return the step's options that were given, in the form in which JSON stores them."""
    given = {name: getattr(bench.wishes, name) for name in step.options}
    as_lists = {k: list(v) if isinstance(v, tuple) else v for k, v in given.items()}
    return {k: v for k, v in as_lists.items() if v not in (None, [])}


def steps_of(bench: Workbench) -> tuple[Step, ...]:
    """Return the steps for one axis or for several; their names are the same."""
    return AXES_STEPS if bench.axes else STEPS


def first_to_do(bench: Workbench, repeat_from: str | None) -> int:
    """Return the index of the first step that is not done, was done with other options, or is to be
    repeated; len(NAMES) if there is none."""
    for number, step in enumerate(steps_of(bench)):
        if step.name == repeat_from or not bench.journal.done(step.name):
            return number
        before = bench.journal.options(step.name)
        if any(before.get(k) != v for k, v in options_of(bench, step).items()):
            return number
    return len(NAMES)


def do_steps(bench: Workbench, repeat_from: str | None = None, until: str | None = None) -> None:
    """Run all steps from the first one to do, up to `until`. Raises what a step raises; the journal
    then contains the steps before it, and the next call resumes there."""
    first = first_to_do(bench, repeat_from)
    bench.journal.forget(list(NAMES[first:]))
    for number, name in enumerate(NAMES):
        step = steps_of(bench)[number]  # the step that finds the units may find several axes
        title = f"{number + 1}. {step.title}"
        if number < first:
            done = bench.journal.result(step.name)["words"]
            bench.say(
                f"{title}: done {bench.journal.when(step.name)}: {'; '.join(done.splitlines())}"
            )
        else:
            bench.say(title)
            if step.moves is not None:
                bench.say(f"   {step.moves(bench)}")
                bench.ask.go_on(step.name)
            result = step.run(bench)
            bench.journal.keep(step.name, options_of(bench, step), result)
            for line in result["words"].splitlines():
                bench.say(f"   {line}")
        if name == until:
            return
