"""Handles the doctor's findings in the gateway: publishes and keeps them, and carries out offers.

The doctor itself (dehyst.daemon.doctor) is a process without network access; the two communicate
through the folder of a case (dehyst.daemon.files.cases). An accepted model is written to the run
folder and the loop is asked to reload, which moves the output gradually, within range and slew
limits. The model is then on trial: if its error has not fallen after a certain amount of motion,
the previous model is restored. An offer accepted during a trial waits until it is over; of several,
only the newest waits.
"""

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue

from dehyst.daemon import clock
from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.messages import DoctorReports, DoctorState
from dehyst.daemon.config import Config
from dehyst.daemon.config.drives import drive_range
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import Case, Decided, Examined
from dehyst.daemon.files.models import load_model
from dehyst.daemon.gateway.doctor_report import Scope, Scopes, describe_report, describe_scopes
from dehyst.daemon.gateway.model_trial import TAKEN_S, ModelTrial
from dehyst.models.cascade.reach import displacement_range
from dehyst.models.errors import DehystError, NotNow

SCAN_S = 0.25  # between two looks at the folder of the cases
LONGEST_REPORT, LONGEST_EVENT = 6 << 20, 500  # bytes: below MAX_BATCH_BYTES; characters of a Text
Report = Callable[[int, str, str], None]
"""Reports an event: (level, code, text)."""
OPEN: tuple[DoctorState, ...] = ("found", "waiting")
AT_WORK: tuple[DoctorState, ...] = ("trial", "accepted")
ALREADY = {"trial": "on trial"}
"""Wording of states whose names do not fit into a sentence."""


class DoctorDesk:
    """Manages cases and offers. `run` is its thread; `decide` and `reports` are called from others.

    publish: sends a report's bytes; trial: puts models into use."""

    def __init__(
        self,
        config: Config,
        publish: Callable[[bytes], None],
        report: Report,
        trial: ModelTrial,
    ) -> None:
        self._config, self._publish, self._report, self._trial = config, publish, report, trial
        self._lock = threading.Lock()
        self._folders: dict[str, Path] = {}
        self._known: dict[str, tuple[Case, Examined | None, Decided | None]] = {}
        self._scopes: dict[str, Scopes] = {}
        self._wishes: SimpleQueue[tuple[str, str]] = SimpleQueue()
        self._waiting, self._over_ns = "", 0

    # -- called from other threads --------------------------------------------------------------

    def reports(self) -> DoctorReports:
        """Return all reports that are kept, newest last."""
        with self._lock:
            known = [(one, self._scopes.get(name)) for name, one in self._known.items()]
        times = self._times
        return DoctorReports(
            reports=tuple(describe_report(*one, times, scopes) for one, scopes in known)
        )

    @property
    def _times(self) -> tuple[float, float]:
        return self._config.doctor.trial_s, self._trial.limit_s

    def page(self, name: str) -> bytes:
        """Return the report of a case as HTML; "": the newest. Raises NotNow."""
        with self._lock:
            names = [n for n, (_, found, _) in self._known.items() if found is not None]
            folder = self._folders.get(name or (names[-1] if names else ""))
        try:
            if folder is not None and (path := folder / cases.REPORT).stat().st_size:
                with path.open("rb") as file:
                    return file.read(LONGEST_REPORT)
        except OSError:
            pass
        raise NotNow("the doctor has written no report, or it is no longer kept")

    def decide(self, action: str, offer: int) -> str:
        """Accept or reject an offer; return why not, in words, or "" if it is being done."""
        with self._lock:
            found = [n for n, (case, *_) in self._known.items() if case.number == offer]
            if not found:
                return "there is no such offer, or it is no longer kept"
            state = self._state(found[0])
            if action == "accept":
                why = self._why_not(found[0], state)
                if why:
                    return why
            elif state not in (*OPEN, *AT_WORK):
                return f"this offer is already {ALREADY.get(state, state)}"
            self._wishes.put((action, found[0]))
        return ""

    def _state(self, name: str) -> str:
        return describe_report(*self._known[name], self._times).state

    def _why_not(self, name: str, state: str) -> str:
        _, examined, _ = self._known[name]
        if examined is None or examined.tested is None:
            return "there is no offer: the doctor has no better model"
        if state not in OPEN:
            return f"this offer is already {ALREADY.get(state, state)}"
        if self._trial.case_on_trial:
            return ""  # the offer waits and is checked again after the trial
        return self._trial.why_not(self._folders[name] / cases.IN_USE)

    # -- the thread -----------------------------------------------------------------------------

    def run(self, stop: threading.Event) -> None:
        """Scan for cases and carry out decisions until `stop` is set."""
        self._resume()
        while not stop.wait(SCAN_S):
            self._scan()
            try:
                while True:
                    self._carry_out(*self._wishes.get_nowait())
            except Empty:
                pass
            over = self._trial.check_outcome(clock.monotonic_ns())
            if over is not None:
                self._decided(*over)
            self._start_waiting_offer(clock.monotonic_ns())

    def _resume(self) -> None:
        """Load earlier findings, and resume a trial that an earlier gateway has begun."""
        for folder in cases.case_folders(self._config.watch_directory):
            self._read(folder)
        self._trial.resume()
        self._over_ns = clock.monotonic_ns()  # the loop may not have reported yet
        for name in self._known:
            if self._state(name) == "waiting":
                self._wait(name)

    def _wait(self, name: str) -> None:
        """Let an offer wait until the trial is over; it replaces one that already waits."""
        before, self._waiting = self._waiting, name
        if before and before != name and before in self._known:
            self._decided(before, "found", f"it is no longer waiting: {name} waits in its place")
        self._decided(
            name,
            "waiting",
            f"it waits until the trial of {self._trial.case_on_trial or 'another model'} is over",
        )

    def _start_waiting_offer(self, now_ns: int) -> None:
        """Carry out the waiting offer once no trial is running."""
        if self._trial.case_on_trial:
            self._over_ns = now_ns
        elif name := self._waiting:
            why = self._why_not(name, self._state(name)) if name in self._known else ""
            if why and now_ns - self._over_ns < TAKEN_S * clock.NS:
                return  # the loop may still be reloading the previous model
            self._waiting = ""
            if why:
                self._decided(name, "found", f"it was not put into use after waiting: {why}")
            elif name in self._known:
                self._carry_out("accept", name)

    def _scan(self) -> None:
        """Look for new cases and new findings, and forget deleted cases."""
        folders = cases.case_folders(self._config.watch_directory)
        there = {f.name.removesuffix(cases.SUFFIX): f for f in folders}
        with self._lock:
            for name in self._known.keys() - there.keys():
                del self._known[name], self._folders[name]
                self._scopes.pop(name, None)
        for name, folder in there.items():
            before = self._known.get(name)
            if before is not None and before[1] is not None:
                continue
            self._read(folder)
            now = self._known.get(name)
            if now is None or now == before:
                continue
            self._say(name)
            if now[1] is not None:
                self._report_findings(now[0], now[1])
                if self._config.doctor.accept and now[1].tested is not None:
                    refused = self.decide("accept", now[0].number)
                    if refused:
                        self._report(2, "doctor", f"not accepted automatically: {refused}")

    def _read(self, folder: Path) -> None:
        case = cases.get_record(folder, cases.CASE, Case)
        if case is None:
            return
        examined = cases.get_record(folder, cases.EXAMINED, Examined)
        decided = cases.get_record(folder, cases.DECIDED, Decided)
        name = folder.name.removesuffix(cases.SUFFIX)
        if examined is not None and examined.tested is not None and name not in self._scopes:
            with suppress(DehystError):  # the offer is then reported without the reach
                self._scopes[name] = (
                    self._scope_of(folder / cases.IN_USE),
                    self._scope_of(folder / cases.OFFERED),
                )
        with self._lock:
            self._folders[name], self._known[name] = folder, (case, examined, decided)

    def _scope_of(self, file: Path) -> Scope:
        """Return the reach and rate limit of a model on this axis. Raises DehystError."""
        model = load_model(file)
        low, high = displacement_range(model, *drive_range(self._config, model))
        return Scope((low, high), model.validity.rate_max)

    def _report_findings(self, case: Case, found: Examined) -> None:
        more = ""
        if found.tested is not None:
            tested = found.tested
            more = (
                f" A model is offered: {tested.in_use:.3g} becomes {tested.offered:.3g} "
                f"{found.unit} on {tested.seconds:.0f} s of later telemetry"
            )
            if case.name in self._scopes:
                more += f", {describe_scopes(self._scopes[case.name], found.unit)}"
            more += "; dehyst accept, or dehyst reject."
        elif found.experiment:
            more = f" Next: dehyst {' '.join(found.experiment)}"
        text = f"{case.name}: {found.says}"
        self._report(2, "doctor", f"{text[: LONGEST_EVENT - len(more)]}{more}"[:LONGEST_EVENT])

    def _carry_out(self, action: str, name: str) -> None:
        folder, state = self._folders[name], self._state(name)
        if name == self._waiting and action == "reject":
            self._waiting = ""
        if action == "accept" and self._trial.case_on_trial:
            self._wait(name)
        elif action == "accept":
            try:
                if why := self._why_not(name, state):  # two clients may have accepted at once
                    raise NotNow(why)
                case, examined, _ = self._known[name]
                assert examined is not None
                assert examined.tested is not None
                self._trial.begin(name, case.number, folder, examined.tested)
            except (OSError, DehystError) as error:
                self._report(3, "doctor", f"{name}: the offered model is not in use: {error}")
                return
            self._decided(
                name,
                "trial",
                "accepted: the offered model is now in use; the previous one is kept, and "
                f"restored if the error has not fallen after {self._config.doctor.trial_s:g} s of "
                f"motion; the trial ends after {self._trial.limit_s:g} s at the latest",
            )
        elif state in AT_WORK:
            self._decided(
                name, "rejected", self._trial.restore_previous_model(name, "it was rejected")
            )
        else:
            self._decided(name, "rejected", "rejected: the model in use stays")

    def _decided(self, name: str, state: DoctorState, text: str) -> None:
        """Keep, publish and report what became of an offer."""
        decided = Decided(state=state, wall_ns=clock.wall_ns(), because=text)
        try:
            if name in self._folders:
                cases.put_record(self._folders[name], cases.DECIDED, decided)
        except OSError as error:
            text += f" (not kept: {error.strerror})"
        with self._lock:
            if name in self._known:
                case, examined, _ = self._known[name]
                self._known[name] = case, examined, decided
        if name in self._known:  # else the case has been deleted to make room for newer ones
            self._say(name)
        self._report(2 if state == "returned" else 1, "doctor", f"{name}: {text}"[:LONGEST_EVENT])

    def _say(self, name: str) -> None:
        scopes = self._scopes.get(name)
        report = describe_report(*self._known[name], self._times, scopes)
        self._publish(encoding.encode(report))
