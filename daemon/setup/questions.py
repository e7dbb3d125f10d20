"""Ask the questions of the guided set-up, or take default answers if nobody can be asked."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TextIO

from rich.console import Console
from rich.prompt import Confirm, FloatPrompt, Prompt

from dehyst.models.errors import BadInput, NotNow


@dataclass(frozen=True)
class Wishes:
    """Values given on the command line; None or (): not given, so asked for, measured or default.

    ports: serial ports that may be probed; axis: the amplifier's axis; axes: its axes, if there are
    several; range_v: lowest and highest voltage for the stage [V]; slew_v_per_s: largest rate of
    the voltage; name: the controller's name; rate_hz: loop rate; band_hz: fastest motion to
    identify; seconds: duration of each recording."""

    ports: tuple[str, ...] = ()
    axis: str | None = None
    range_v: tuple[float, float] | None = None
    slew_v_per_s: float | None = None
    name: str | None = None
    rate_hz: float | None = None
    band_hz: float | None = None
    seconds: float | None = None
    axes: tuple[str, ...] = ()


class UserPrompts:
    """Prompts for the user. yes: take defaults and continue without asking; console: shows the
    questions; answers: stream from which answers are read, None: the terminal."""

    def __init__(self, yes: bool, console: Console, answers: TextIO | None = None) -> None:
        self.yes, self._console, self._answers = yes, console, answers

    def number(
        self, text: str, option: str, low: float, high: float, default: float | None = None
    ) -> float:
        """Ask for a number from low to high. option: the command-line option that gives it. Raises
        BadInput if nobody can be asked and there is no default."""
        if self.yes:
            if default is None:
                what = text.partition(",")[0]
                raise BadInput(f"--yes needs {option}: the {what} has no default")
            return default

        def ask() -> float:
            if default is None:
                return FloatPrompt.ask(text, console=self._console, stream=self._answers)
            return FloatPrompt.ask(
                text, console=self._console, stream=self._answers, default=default
            )

        return self._until(ask, lambda value: low <= value <= high, f"from {low:g} to {high:g}")

    def choice(self, text: str, option: str, choices: list[str]) -> str:
        """Ask for one of the choices. Raises BadInput if nobody can be asked and there are
        several."""
        if len(choices) == 1:
            return choices[0]
        if self.yes:
            raise BadInput(f"{text}: {', '.join(choices)}; choose with {option}")
        shown = f"{text}: {' | '.join(choices)}"
        asked = Prompt(shown, console=self._console, choices=choices, show_choices=False)
        return str(asked(default=choices[0], stream=self._answers))

    def go_on(self, step: str) -> None:
        """Ask whether to go on; raise NotNow if the user declines this step."""
        if self.yes:
            return
        asked = Confirm("go on?", console=self._console)
        if not asked(default=True, stream=self._answers):
            raise NotNow(f"ended before {step}; the same command resumes there")

    def _until(
        self, ask: Callable[[], float], good: Callable[[float], bool], allowed: str
    ) -> float:
        while not good(value := ask()):
            self._console.print(f"it must be {allowed}")
        return value
