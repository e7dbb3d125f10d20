"""A long scan by one `dehyst play` through a daemon whose model changes during it: real processes,
the emulated MDT693B on a pty, real zenoh; the amplifier's own log is the evidence of the output."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from tests.rigs.chaos.rig import RATE_HZ, ROOT, SLEW, Listener, Rig, trajectory, until
from tests.rigs.output import excess
from tests.rigs.stage_model import kept_model

from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import Case, Examined, OfferTest
from dehyst.daemon.files.models import save_model
from dehyst.daemon.rings.records import Flag, State, model_digest
from dehyst.models.model import Model
from dehyst.models.modelfile import dumps

TRIAL_S, LIMIT_S, OVER_S = 5.0, 40.0, 60.0
DOCTOR = f"doctor = {{enabled = false, trial_s = {TRIAL_S}, trial_limit_s = {LIMIT_S}, accept = "
WATCH = "watch = {before_s = 5.0, after_s = 1.0"


def scaled(by: float, share: float = 1.0) -> Model:
    """Return the stage's model with another gain, valid up to this share of its drive range."""
    model = kept_model()
    v = model.validity
    top = v.drive_min + share * (v.drive_max - v.drive_min)
    h = replace(model.hysteresis, c=model.hysteresis.c * by)
    return replace(model, hysteresis=h, validity=replace(v, drive_max=top))


@dataclass
class Change:
    """Something that was done to the daemon: when [s since the scan began], and the result."""

    at_s: float
    what: str
    came: str = ""


@dataclass
class LongScan(Rig):
    """The daemon with a model whose gain is 15 % too high; `play` is one scan of `seconds`."""

    folder: Path
    seconds: float
    changes: list[Change] = field(default_factory=list)

    def __post_init__(self) -> None:
        save_model(scaled(1.15), self.folder / "first.toml")
        super().__init__(self.folder, self.folder / "first.toml")

    def configured(self, on_fault: str) -> str:
        """Return a configuration without flags of the watch, because offers are made by hand."""
        text = super().configured(on_fault).replace(WATCH, f"{WATCH}, learn_s = 36000.0")
        return text.replace("watch = ", f"{DOCTOR}false}}\nwatch = ")

    def begin(self) -> None:
        """Start daemon and listener, then the scan; return when it runs."""
        self.daemon = self.start("run", "--config", str(self.config), name="run")
        self.client = until(self._connect, 60.0, f"the gateway\n{self.words('run')}")
        until(lambda: self.status().state == "ready", 300.0, "the loop is ready")
        self.listener = Listener(self._connect() or self.client)
        self.listener.start()
        t, target = trajectory(self.seconds)
        np.savetxt(
            self.folder / "scan.csv",
            np.column_stack([t, target]),
            "%.4f",
            ",",
            header="t_s,target_um",
            comments="",
        )
        self.begun_ns = self.since_ns = time.monotonic_ns()
        command = [sys.executable, "-m", "dehyst.daemon.main", "play", "scan.csv", "--json"]
        self.play = subprocess.Popen(
            [*command, "--connect", self.address],
            env=self.environment, cwd=self.folder, stdout=subprocess.PIPE, text=True,
            stderr=(self.folder / "play.txt").open("w"),
        )  # fmt: skip
        self.until_running(120.0)

    @property
    def now_s(self) -> float:
        """Seconds since the scan began."""
        return (time.monotonic_ns() - self.begun_ns) * 1e-9

    def wait_for(self, at_s: float) -> bool:
        """Wait until this time of the scan; return False if the scan has ended before."""
        while self.now_s < at_s:
            if self.play.poll() is not None:
                return False
            time.sleep(0.1)
        return True

    def end(self) -> dict[str, Any]:
        """Return what `dehyst play` reports at its end."""
        out, _ = self.play.communicate(timeout=self.seconds + 120.0)
        result: dict[str, Any] = json.loads(out)
        return result | {"exit": self.play.returncode, "after_s": self.now_s}

    # -- what is done to it -----------------------------------------------------------------------

    def do(self, at_s: float, what: str, how: Callable[[], str]) -> None:
        """Make one change at this time of the scan; none after its end."""
        if not self.wait_for(at_s):
            return
        change = Change(self.now_s, what)
        self.changes.append(change)
        change.came = how()
        print(f"{change.at_s:7.1f} s  {what}: {change.came}", flush=True)

    def reload(self, model: Model | None) -> str:
        """Send SIGHUP to the core; None: with the file unchanged."""
        if model is not None:
            save_model(model, self.model)
        self.mark()
        os.kill(self.pid("core"), signal.SIGHUP)
        self.until_event("reloaded", 60.0)
        if model is not None:
            until(lambda: self.runs(model), 30.0, "the loop runs it")
        reach = self.status()
        return f"reach {reach.reach_min:.3g} to {reach.reach_max:.3g} um"

    def runs(self, model: Model) -> bool:
        """Return whether the loop runs this model."""
        return model_digest(dumps(self.client.model())) == model_digest(dumps(model))

    def lay(self, number: int, offered: Model) -> None:
        """Write an offer as gateway and doctor would."""
        folder = self.kept / f"mismatch-{number}.case"
        (folder / cases.FOUND).mkdir(parents=True)
        save_model(self.client.model(), folder / cases.IN_USE)
        save_model(offered, folder / cases.OFFERED)
        tested = OfferTest(in_use=1.0, offered=0.05, noise=0.02, seconds=10.0)
        examined = Examined(
            verdict="explained", says="Found: shape.", unit="um", noise=0.02, rms_in_use=1.0,
            rms_augmented=0.05, tested=tested,
        )  # fmt: skip
        case = Case(
            number=number, name=folder.name.removesuffix(cases.SUFFIX), time_ns=1, wall_ns=1,
            figure="whole", low=0.0, high=140.0, slew=SLEW, rate_hz=RATE_HZ, later_s=1.0,
        )  # fmt: skip
        cases.put_record(folder, cases.EXAMINED, examined)
        cases.put_record(folder, cases.CASE, case)
        until(lambda: self.state(number), 30.0, "the offer is there")

    def state(self, number: int) -> str:
        """Return the state of the offer."""
        found = [r for r in self.client.doctor() if r.offer and r.offer.number == number]
        return found[-1].state if found else ""

    def over(self, number: int) -> str:
        """Return the result of the offer, once its trial is over."""
        ended = ("accepted", "returned", "rejected")
        until(lambda: self.state(number) in ended, OVER_S, f"the trial of {number} ends")
        said = [r.says for r in self.client.doctor() if r.offer and r.offer.number == number]
        return f"{self.state(number)}: {said[-1].removeprefix('Found: shape.').strip()}"

    def accept(self, number: int, offered: Model) -> str:
        """Accept the offer by `dehyst accept`."""
        self.lay(number, offered)
        command = [sys.executable, "-m", "dehyst.daemon.main", "accept", "--yes"]
        done = subprocess.run(
            [*command, "--offer", str(number), "--connect", self.address],
            env=self.environment, cwd=ROOT, capture_output=True, text=True, timeout=60.0,
        )  # fmt: skip
        if done.returncode:
            return f"refused: {done.stderr.strip()}"
        return self.over(number)

    def accepts_itself(self, number: int, offered: Model) -> str:
        """Let `doctor.accept = true` accept the offer."""
        self.lay(number, offered)
        return self.over(number)

    def kill_gateway(self) -> str:
        """Kill the gateway with -9; the next one reads `doctor.accept = true`."""
        text = self.config.read_text()
        self.config.write_text(text.replace(f"{DOCTOR}false", f"{DOCTOR}true"))
        begun = time.monotonic()
        pid = self.kill("gateway")
        until(lambda: self.status().gateway.pid != pid, 60.0, "another gateway")
        return f"another gateway after {time.monotonic() - begun:.1f} s"

    # -- results ----------------------------------------------------------------------------------

    def beyond_slew_v(self) -> float:
        """Return the largest movement beyond slew x time in any window of the amplifier's log."""
        return excess(*self.output(), SLEW)[0]

    def flagged(self) -> list[str]:
        """Return a table of the flags between one change and the next."""
        assert self.listener is not None
        s = np.concatenate(self.listener.samples)
        at_s = (s["scheduled_ns"] - self.begun_ns) * 1e-9
        edges = [0.0, *(c.at_s for c in self.changes), np.inf]
        names = ["the scan begins", *(c.what for c in self.changes)]
        rows = [
            "| from [s] | since | samples heard | running | flagged | rms error [um] |",
            "|---|---|---|---|---|---|",
        ]
        for name, low, high in zip(names, edges, edges[1:], strict=False):
            part = s[(at_s >= low) & (at_s < high)]
            runs = part["state"] == State.RUNNING
            counts = {f.name: int(np.sum((part["flags"] & int(f)) != 0)) for f in Flag if f.name}
            words = ", ".join(f"{k} {n}" for k, n in counts.items() if n) or "nothing"
            error = (part["measured"] - part["target"])[runs]
            error = error[np.isfinite(error)]
            rms = float(np.sqrt(np.mean(error**2))) if error.size else float("nan")
            rows.append(
                f"| {low:.1f} | {name} | {part.size} | {runs.sum()} | {words} | {rms:.3f} |"
            )
        return rows
