"""Random kills and stops of a running rig's processes, one after another, and how it recovers."""

import os
import random
import signal
import time
from dataclasses import dataclass, field
from pathlib import Path

from tests.rigs.chaos.rig import Rig, lives, readable_rows, until

WHO = ("core", "gateway", "both", "client", "safe")
LONGEST_STOP_S = 5.0
"""Well below the time after which the supervisor considers a process hung (10 s, 20 s): none of
these stops may reach it."""
LONGEST_RECOVERY_S = 60.0
FAULTS_A_RECORDING = 5


@dataclass
class Account:
    """The results. recovery_s: (who, how, seconds until the trajectory ran again); rows: of each
    recording; in words, faults from which the rig did not recover and unreadable recordings."""

    recovery_s: list[tuple[str, str, float]] = field(default_factory=list)
    rows: list[int] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    unreadable: list[str] = field(default_factory=list)
    orphans: set[int] = field(default_factory=set)


def processes_of(config: Path) -> dict[int, tuple[str, int]]:
    """Return (command, parent) of every live `dehyst ... --config <this one>`, by process id."""
    found = {}
    for entry in Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_bytes().decode("utf-8", "replace").split("\0")
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
        except (OSError, ValueError):  # not such a process, or it has just gone
            continue
        if str(config) in words and "dehyst.daemon.main" in words and lives(int(entry.name)):
            found[int(entry.name)] = words[words.index("dehyst.daemon.main") + 1], parent
    return found


class Kills:
    """Kills and stops processes of a running rig."""

    def __init__(self, rig: Rig, seed: int) -> None:
        self.rig, self.random, self.account = rig, random.Random(seed), Account()

    def run(self, count: int) -> Account:
        """Run `count` faults, each after recovery from the previous one; stop if there is none."""
        recording, path = None, Path()
        for number in range(count):
            if number % FAULTS_A_RECORDING == 0:
                self._end_recording(recording, path)
                path = self.rig.folder / f"kills-{number}.csv"
                recording = self.rig.record(path, name=f"record-{number}")
            if not self.one(number, self.random.choice(WHO), self.random.choice(("kill", "stop"))):
                break
        self._end_recording(recording, path)
        return self.account

    def one(self, number: int, who: str, how: str) -> bool:
        """Cause one fault and wait until the trajectory runs again; return whether it did."""
        rig = self.rig
        rig.mark()
        time.sleep(self.random.uniform(0.0, 1.0))
        self._inflict(who, how)
        begun = time.monotonic()
        try:
            rig.until_running(LONGEST_RECOVERY_S)
        except AssertionError as error:
            self.account.lost.append(f"{number}: {how} {who}: {' '.join(str(error).split())[:300]}")
            return False
        seconds = time.monotonic() - begun
        self.account.recovery_s.append((who, how, seconds))
        self.account.orphans |= self._orphans()
        print(f"{number:4d}  {how} {who:8s} {seconds:6.2f} s", flush=True)
        return True

    def _inflict(self, who: str, how: str) -> None:
        """Kill or stop a process; after a stop, let it continue."""
        rig = self.rig
        if who == "safe":
            self._kill([self._only("core")])
            pid = until(lambda: self._find("safe"), 20.0, "`dehyst safe` is called")
            time.sleep(self.random.uniform(0.0, 1.5))
            pids = [pid] if lives(pid) else []  # it may already have finished
        elif who == "client":
            pids = [rig.pid("client")]
        else:
            names = ("core", "gateway") if who == "both" else (who,)
            pids = [self._only(name) for name in names]
        if how == "kill":
            self._kill(pids)
        else:
            self._stop(pids, self.random.uniform(0.2, LONGEST_STOP_S))
        if who == "client" and how == "kill":
            assert rig.mover is not None
            rig.mover.wait(5.0)
            rig.start_mover()

    def _kill(self, pids: list[int]) -> None:
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        until(lambda: not any(map(lives, pids)), 10.0, "they are gone")

    def _stop(self, pids: list[int], seconds: float) -> None:
        for pid in pids:
            os.kill(pid, signal.SIGSTOP)
        time.sleep(seconds)
        for pid in pids:
            os.kill(pid, signal.SIGCONT)

    def _find(self, command: str) -> int:
        found = [pid for pid, (name, _) in processes_of(self.rig.config).items() if name == command]
        return found[0] if found else 0

    def _only(self, command: str) -> int:
        """Wait for the only process of this command: the gateway may still be starting while
        samples flow again."""
        return int(until(lambda: self._find(command), 60.0, f"a {command}"))

    def _orphans(self) -> set[int]:
        """Return the processes of this daemon that have no supervisor."""
        run = self.rig.daemon.pid
        return {
            p for p, (_, parent) in processes_of(self.rig.config).items() if run not in (p, parent)
        }

    def _end_recording(self, process: object, path: Path) -> None:
        """End the recording by Ctrl-C or a kill; it must be readable."""
        if process is None:
            return
        number = self.random.choice((signal.SIGINT, signal.SIGKILL))
        process.send_signal(number)  # type: ignore[attr-defined]
        process.wait(30.0)  # type: ignore[attr-defined]
        try:
            self.account.rows.append(readable_rows(path))
        except Exception as error:  # the benchmark reports any error
            self.account.unreadable.append(f"{path.name}: {error}")
