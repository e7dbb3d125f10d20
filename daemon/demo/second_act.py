"""Second part of the demo: the stage changes while it runs, and the service finds out.

The daemon follows a trajectory with the model of the first part. An effect drawn at random
(dehyst.daemon.demo.chance) appears; the mismatch watch flags it, the doctor names it and offers a
model, the model is accepted, and the error falls. This file does not know what was drawn.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.bus.messages import DoctorReport, FoundEffect
from dehyst.daemon.client.client import Client
from dehyst.daemon.demo.busy import (
    IT_WAS_NOT,
    SO_IT_WAS,
    TOO_BUSY,
    Busy,
    Patience,
    busy_between,
    read_spent,
)
from dehyst.daemon.demo.chance import Chance
from dehyst.daemon.rings.records import Flag
from dehyst.models.errors import DehystError
from dehyst.models.recording import Floats
from dehyst.models.signals.error_size import rms

WAVES: dict[str, tuple[tuple[float, float], ...]] = {
    "step": (),
    "way": (),
    "full": ((1.0, 1.0),),
    "fast": ((0.4, 2.0), (0.22, 5.0), (0.11, 10.0)),
    "half": ((0.7, 1.5),),
}
SEGMENTS = (
    ("full", 0.0, 2.0),
    ("step", 0.6, 2.5),
    ("fast", 0.0, 3.0),
    ("step", -0.35, 2.0),
    ("fast", 0.3, 2.0),
    ("way", -0.8, 2.5),
    ("half", -0.2, 2.0),
    ("step", 0.85, 2.5),
)
"""Kind, position (share of half the reach), seconds after arriving there."""
LEARN_S = 60.0  # instead of the default of 400 s, to keep the demo short
SETTINGS = f"""
[watch]
learn_s = {LEARN_S:g}
before_s = 20.0
after_s = 20.0

[doctor]
test_s = 10.0
trial_s = 10.0
time_s = 600.0
"""
READY_S = 3.0 * LEARN_S + 60.0
FLAG_S, WORD_S, TRIAL_S = 30.0, 240.0, 60.0
"""READY_S, FLAG_S, WORD_S, TRIAL_S: time limits on a quiet machine for a stage in order, the flag,
the doctor's report, and the end of the trial; longer on a busy machine (Busy.stretch)."""
LAST_S, BEFORE_S = 20.0, 20.0  # spans of which the error is stated: most of a pass of 24 s
APPEARS_S, CHANGES_S = 1.0, 3.0  # left out: the effect's beginning, the change of the model
OFFERED = (("trial", "the offer, on trial"), ("after", "accepted"))
OVER = ("accepted", "returned", "rejected")
NOT_TRACKED = int(Flag.APPROACH | Flag.SENSOR_INVALID | Flag.SENSOR_HELD)


def pattern(middle: float, half: float, rate_hz: float) -> tuple[Floats, Floats]:
    """Return (t_s, target) of about 24 s that ends where it begins: waves of many sizes and
    speeds, slow moves, steps and holds. They resemble a stage's daily work, and distinguish
    effects."""
    parts: list[Floats] = []
    place = 0.0
    for kind, to, seconds in SEGMENTS:
        way_s = 0.15 if kind == "step" else 0.1 + 0.5 * abs(to - place)
        parts.append(_way(place, to, way_s, rate_hz))
        place, room = to, 0.95 - abs(to)
        t = np.arange(round(seconds * rate_hz)) / rate_hz
        wave = np.zeros(t.size)
        for size, hz in WAVES[kind]:
            wave += room * size * np.sin(2 * np.pi * hz * t)
        parts.append(place + wave)
    parts.append(_way(place, 0.0, 1.0, rate_hz))
    one = np.concatenate(parts)
    width = max(3, round(0.03 * rate_hz) | 1)
    window = np.hanning(width + 2)[1:-1]
    padded = np.concatenate([one[-width:], one, one[:width]])
    one = np.convolve(padded, window / window.sum(), "same")[width:-width]
    return np.arange(one.size) / rate_hz, middle + half * one


def _way(start: float, end: float, seconds: float, rate_hz: float) -> Floats:
    """Return a move from one position to another that starts and ends at rest."""
    s = np.arange(max(2, round(seconds * rate_hz))) / max(1, round(seconds * rate_hz))
    return start + (end - start) * s * s * (3.0 - 2.0 * s)


@dataclass
class Story:
    """Times of the events [s since the first sample]; telemetry: t_s, target, measured (N,)."""

    seed: int = 0
    drawn: str = ""
    drawn_says: str = ""
    appeared_s: float = np.nan
    flagged_s: float = np.nan
    reported_s: float = np.nan
    accepted_s: float = np.nan
    over_s: float = np.nan
    report: DoctorReport | None = None
    rms: dict[str, float] = field(default_factory=dict)
    t_s: Floats = field(default_factory=lambda: np.zeros(0))
    target: Floats = field(default_factory=lambda: np.zeros(0))
    measured: Floats = field(default_factory=lambda: np.zeros(0))
    missed: int = 0
    why: str = ""
    busy: Busy = field(default_factory=Busy)

    @property
    def named(self) -> str:
        """First effect that the doctor named; "" if none."""
        return self.report.effects[0].name if self.report and self.report.effects else ""

    @property
    def state(self) -> str:
        """Outcome of the offer."""
        return self.report.state if self.report else ""

    @property
    def named_right(self) -> bool:
        """Whether the first name, or one that the doctor cannot distinguish from it, is correct."""
        return self.says_right(self.report.effects if self.report else ())

    def says_right(self, effects: Sequence[FoundEffect]) -> bool:
        """Whether the first of these effects names what was drawn."""
        return bool(effects) and self.drawn in (effects[0].name, *effects[0].ambiguous_with)

    @property
    def helped(self) -> bool:
        """Whether the error after acceptance is nearer to that before the effect than to that
        during it."""
        before, during, after = (self.rms.get(k, np.nan) for k in ("before", "during", "after"))
        return self.state == "accepted" and after < 0.5 * (before + during)

    @property
    def too_busy(self) -> str:
        """Reason why this run cannot be judged; "" if it can: a success counts in spite of other
        load and of late samples, which only add to the error."""
        return "" if self.named_right and self.helped else self.busy.why

    @property
    def exit_status(self) -> int:
        """Exit status of `dehyst demo`: 0 named correctly and helped, 1 not, 77 cannot be
        judged."""
        if self.too_busy:
            return TOO_BUSY
        return SO_IT_WAS if self.named_right and self.helped else IT_WAS_NOT


class SecondAct:
    """One run. say: prints a line for the user; the daemon answers at `endpoint`."""

    def __init__(self, endpoint: str, chance: Chance, say: Callable[[str], None]) -> None:
        self._endpoint, self._chance, self._say = endpoint, chance, say
        self._parts: list[NDArray[Any]] = []
        self.story = Story(seed=chance.seed)
        self._first_ns = self._counted = 0
        self._appeared_ns = 0

    def run(self) -> Story:
        """Run from learning to the end, while another process plays a trajectory."""
        story, say = self.story, self._say
        looks = [read_spent()]
        with Client(connect=self._endpoint, label="the demo") as client:
            self._client, self._stream, self._feed = client, client.stream(), client.feed()
            if not self._is_in_order(self._chance.wait_s):
                story.why = (
                    "the watch did not learn the stage in time, or flagged it before the change"
                )
            else:
                self._appeared_ns = clock.monotonic_ns()
                self._chance.appear()
                story.appeared_s = self._now_s()
                say("7. something changes in the stage")
                looks.append(read_spent())
                self._flag_to_end()
        looks.append(read_spent())
        self._conclude()
        # load while the watch learned spoils all that follows, just as later load does
        late = story.missed / max(1, self._counted)
        story.busy = max(
            (busy_between(a, b, late) for a, b in pairwise(looks)),
            key=lambda busy: busy.others + busy.stolen,
        )
        return story

    def _is_in_order(self, seconds: float) -> bool:
        """Return whether the watch learns the stage in time, and then flags nothing for
        `seconds`."""
        patience = Patience(READY_S, "for the watch to know the stage", self._say)
        while not patience.over:
            if not self._until(lambda: self._health() > 0.0 and not self._mismatch(), patience):
                return False
            if not self._wait(seconds, lambda: bool(self._mismatch())):
                return True
        return False

    def _flag_to_end(self) -> None:
        story, say = self.story, self._say
        patience = Patience(FLAG_S, "for the watch to flag it", say)
        if not self._until(lambda: bool(self._mismatch()), patience):
            story.why = f"the watch flagged nothing within {patience.spent_s:.0f} s"
            return
        story.flagged_s = self._now_s()
        say(f"8. flagged after {story.flagged_s - story.appeared_s:.0f} s; the doctor diagnoses it")
        patience = Patience(WORD_S, "for the doctor, which runs at the lowest priority", say)
        if not self._until(lambda: self._word() not in ("", "working"), patience):
            story.why = f"the doctor reported nothing within {patience.spent_s:.0f} s"
            return
        story.reported_s = self._now_s()
        report = story.report
        assert report is not None
        say(f"   {report.says}")
        if report.offer is None:
            story.why = "the doctor offers no model"
            return
        self._client.decide_offer("accept", report.offer.number)
        story.accepted_s = self._now_s()
        say(f"9. accepted; on trial for {report.offer.trial_s:g} s of motion")
        patience = Patience(TRIAL_S, "for the end of the trial", say)
        if not self._until(lambda: self._word() in OVER, patience):
            story.why = f"the trial did not end within {patience.spent_s:.0f} s"
            return
        story.over_s = self._now_s()
        if story.state != "accepted":
            story.why = story.report.says if story.report is not None else ""
            return
        self._wait(LAST_S - min(LAST_S, story.over_s - story.accepted_s - 4.0) + LAST_S)

    # -- what the daemon publishes ----------------------------------------------------------------

    def _look(self) -> None:
        samples = self._stream.read(0.2)
        if samples.size:
            self._first_ns = self._first_ns or int(samples["scheduled_ns"][0])
            self._parts.append(samples)

    def _wait(self, seconds: float, happened: Callable[[], bool] = lambda: False) -> bool:
        """Read samples for `seconds`; return True if `happened` becomes true before that."""
        end_ns = clock.monotonic_ns() + round(max(0.0, seconds) * clock.NS)
        while not happened():
            if clock.monotonic_ns() > end_ns:
                return False
            self._look()
        return True

    def _until(self, happened: Callable[[], bool], patience: Patience) -> bool:
        """Return whether it happens before patience is over."""
        while not happened():
            if patience.over:
                return False
            patience.look()
            self._look()
        return True

    def _now_s(self) -> float:
        """Return the time of the newest sample received."""
        self._look()
        return (int(self._parts[-1]["scheduled_ns"][-1]) - self._first_ns) * 1e-9

    def _health(self) -> float:
        """Return the health: above 0 once the watch has learned, 0 before it has begun."""
        return self._feed.status.gateway.health if self._feed.status is not None else -1.0

    def _mismatch(self) -> str:
        return self._feed.status.gateway.mismatch if self._feed.status is not None else ""

    def _word(self) -> str:
        while self._feed.doctor:
            report, known = self._feed.doctor.popleft(), self.story.report
            if report.time_ns < self._appeared_ns:
                continue  # about a flag raised before the effect
            # a flag that drops and rises again opens a second case: the first one reported counts
            if known is None or known.state == "working" or known.case == report.case:
                self.story.report = report
        return self.story.state

    # -- figures --------------------------------------------------------------------------------

    def _conclude(self) -> None:
        """Compute the errors before, during and after the effect, and record what was drawn."""
        story, drawn = self.story, self._chance.drawn()
        story.drawn, story.drawn_says = drawn.name, drawn.says
        if not self._parts:
            raise DehystError("no telemetry arrived")
        samples = np.concatenate(self._parts)
        self._counted = samples.size
        story.missed = int(np.count_nonzero(samples["flags"] & int(Flag.MISSED)))
        good = np.isfinite(samples["target"]) & np.isfinite(samples["measured"])
        good &= (samples["flags"] & NOT_TRACKED) == 0
        samples = samples[good]
        story.t_s = (samples["scheduled_ns"] - self._first_ns) * 1e-9
        story.target, story.measured = samples["target"], samples["measured"]
        last_s, accepted = story.t_s[-1], np.isfinite(story.accepted_s)
        spans = {
            "before": (story.appeared_s - BEFORE_S, story.appeared_s),
            "during": (story.appeared_s + APPEARS_S, story.accepted_s if accepted else last_s),
        }
        changed_s = story.accepted_s + CHANGES_S
        if accepted and story.state == "accepted":
            spans["after"] = (max(changed_s, last_s - LAST_S), last_s)
        elif accepted:
            spans["trial"] = (changed_s, story.over_s)
        for name, (first_s, end_s) in spans.items():
            part = (story.t_s >= first_s) & (story.t_s < end_s)
            error = (story.measured - story.target)[part]
            story.rms[name] = rms(error)


def tell_end(story: Story) -> list[str]:
    """Return the last lines: errors, what was drawn, what the doctor named."""
    lines = [
        f"  {text:22}{1e3 * story.rms[name]:9.1f} nm rms"
        for name, text in (("before", "before it"), ("during", "with it"), *OFFERED)
        if name in story.rms and np.isfinite(story.rms[name])
    ]
    if story.why:
        lines.append(f"  {story.why}")
    if story.too_busy:
        lines.append(f"  this machine was too busy to judge: {story.too_busy}")
    elif late := Busy(late=story.busy.late).why:
        lines.append(f"  {late}")
    right = "named right" if story.named_right else "not correctly named"
    if story.named_right and story.named != story.drawn:
        right = f"which the doctor cannot distinguish from {story.drawn}: {right}"
    lines.append(f"  drawn:  {story.drawn_says} (seed {story.seed})")
    lines.append(f"  named:  {story.named or 'nothing'}: {right}")
    if story.exit_status != SO_IT_WAS:
        lines.append(f"  to repeat it: dehyst demo --force --seed {story.seed}")
    return lines


def describe_facts(story: Story) -> dict[str, Any]:
    """Return the same facts for `--json`."""
    report = story.report
    return {
        "seed": story.seed,
        "drawn": story.drawn,
        "drawn_says": story.drawn_says,
        "flagged_after_s": _finite(story.flagged_s - story.appeared_s),
        "named": [e.name for e in report.effects] if report else [],
        "ambiguous_with": list(report.effects[0].ambiguous_with) if story.named and report else [],
        "named_right": story.named_right,
        "verdict": report.verdict if report else "",
        "says": report.says if report else "",
        "state": story.state,
        "rms_um": {k: _finite(v) for k, v in story.rms.items()},
        "helped": story.helped,
        "missed": story.missed,
        "exit": story.exit_status,
        "too_busy": story.too_busy,
        "others_share": story.busy.others,
        "samples": int(story.t_s.size),
        "why": story.why,
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def save_story(story: Story, path: Path) -> None:
    """Save the picture."""
    from dehyst.daemon.files.outputs import whole_file
    from dehyst.daemon.report.story import story_picture

    with whole_file(path) as file:
        file.write(story_picture(story))
