"""What a guided set-up asks, and what it takes for an answer where nobody is there to ask."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TextIO

from rich.console import Console
from rich.prompt import Confirm, FloatPrompt, Prompt

from dehyst.models.errors import BadInput, NotNow


@dataclass(frozen=True)
class Wishes:
    """What the command line gave; None or (): nothing, so it is asked for, measured or a default.

    ports: that may be asked who they are; axis: of the amplifier; axes: of it, where there are
    several; range_v: least and largest
    voltage the stage may see; slew_v_per_s; name: of the controller; rate_hz: of the loop; band_hz:
    fastest motion to be identified; seconds: of each recording."""

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
    """yes: take defaults, and go on without asking. console: where it asks; answers: where they
    are typed, None: the terminal."""

    def __init__(self, yes: bool, console: Console, answers: TextIO | None = None) -> None:
        self.yes, self._console, self._answers = yes, console, answers

    def number(
        self, text: str, option: str, low: float, high: float, default: float | None = None
    ) -> float:
        """A number from low to high. option: what gives it on the command line. Raises BadInput
        where nobody is asked and there is no default."""
        if self.yes:
            if default is None:
                raise BadInput(f"{text}: give it with {option}; --yes assumes no voltage")
            return default

        def ask() -> float:
            if default is None:
                return FloatPrompt.ask(text, console=self._console, stream=self._answers)
            return FloatPrompt.ask(
                text, console=self._console, stream=self._answers, default=default
            )

        return self._until(ask, lambda value: low <= value <= high, f"from {low:g} to {high:g}")

    def choice(self, text: str, option: str, choices: list[str]) -> str:
        """One of these. Raises BadInput where nobody is asked and there are several."""
        if len(choices) == 1:
            return choices[0]
        if self.yes:
            raise BadInput(f"{text}: {', '.join(choices)}; choose with {option}")
        shown = f"{text}: {' | '.join(choices)}"
        asked = Prompt(shown, console=self._console, choices=choices, show_choices=False)
        return str(asked(default=choices[0], stream=self._answers))

    def go_on(self, step: str) -> None:
        """Raise NotNow where the user does not want this step now."""
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
