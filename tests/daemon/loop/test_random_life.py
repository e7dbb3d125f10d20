"""The random life of a controller: the real gate and the real step, 100 000 samples of commands by
two clients, trajectories, faults, reloads, late samples and ends.

Invariants: the range; the slew over every pair of samples, by the clock; nothing moves in READY and
FAULT; only the holder of the lease moves anything, by the test's own record of the lease; and
whatever happened before, an end reaches the safe voltage within the ramp's time.
"""

import math
from typing import ClassVar

import hypothesis.strategies as st
import numpy as np
from hypothesis import settings
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule, run_state_machine_as_test
from tests.daemon.loop.test_step import GAIN, MAX_V, MIN_V, PERIOD_NS, SLEW, Bench, compensator
from tests.daemon.loop.test_step import model as stage_model

from dehyst.daemon.bus.messages import Request, Setpoint
from dehyst.daemon.gateway.admission import Admission
from dehyst.daemon.gateway.lease import Lease
from dehyst.daemon.loop.records_in_memory import SETTINGS
from dehyst.daemon.rings.records import COMMAND, LoopCommand, State

SAFE_V, RAMP_V_PER_S, LEASE_NS = 3.0, 40.0, 500_000_000
CLIENTS = st.sampled_from([11, 22])
STEPS = 100_000
WIDE = 64  # samples before a rule that are checked together with those of the rule


class Life(RuleBasedStateMachine):
    """One controller from its start to its end."""

    steps: ClassVar[int] = 0

    def __init__(self) -> None:
        super().__init__()
        self.bench = Bench(20.0)
        self.clock_ns = self.wrote_ns = 0
        self.log: list[tuple[int, float]] = [(0, 20.0)]
        lease = Lease(LEASE_NS)
        self.gate = Admission("um", 30.0, 10.0, lease)
        self.gate.core.alive, self.gate.core.reachable = True, (0.0, 12.0)
        self.gate.core.period_ns = PERIOD_NS
        self.numbers = {11: 0, 22: 0}
        self.sequence = self.trajectory = 0
        # the test's own record of the lease
        self.holder, self.heard_ns = 0, -(10**12)

    # -- what happens ---------------------------------------------------------------------------

    def tick(self, batch: np.ndarray | None = None, late_ns: int = 0) -> None:
        """Run one sample; late_ns: by how much its voltage is late, by the clock."""
        bench, c = self.bench, self.bench.stepper.control
        self.clock_ns = max(bench.now + PERIOD_NS + late_ns, self.clock_ns)
        c["move_ns"] = min(self.clock_ns - self.wrote_ns, PERIOD_NS)
        before, state = bench.stepper.volts, bench.stepper.state
        bench.send(np.zeros(0, COMMAND) if batch is None else batch)
        volts = bench.stepper.volts
        Life.steps += 1
        if batch is None and state in (State.READY, State.FAULT):
            assert volts == before
        if state not in (State.READY, State.FAULT):
            self.wrote_ns = self.clock_ns
        self.log.append((self.clock_ns, volts))

    @property
    def holds(self) -> int:
        """The holder of the lease by the test's own record."""
        return self.holder if self.bench.now - self.heard_ns <= LEASE_NS else 0

    @rule(n=st.integers(1, 400))
    def wait(self, n: int) -> None:
        for _ in range(n):
            self.tick()

    @rule(late_ms=st.floats(0.1, 40.0), n=st.integers(1, 20))
    def late(self, late_ms: float, n: int) -> None:
        """Delay one sample's voltage; the samples after it come as soon as they can."""
        late_ns = round(late_ms * 1e6)
        self.tick(late_ns=late_ns)
        for _ in range(n):
            late_ns = max(0, late_ns - PERIOD_NS)
            self.tick(late_ns=late_ns)

    @rule(client=CLIENTS, action=st.sampled_from(["acquire", "take-over", "give-up", "renew"]))
    def lease(self, client: int, action: str) -> None:
        request = Request(
            client=client, lease=self.numbers[client], sent_ns=self.bench.now, action=action
        )
        reply, records = self.gate.handle(self.bench.now, request, 1000)
        assert not records.size
        held = self.holds
        if action in ("acquire", "take-over"):
            assert reply.ok == (action == "take-over" or held in (0, client))
            if reply.ok:
                self.numbers[client] = reply.lease
                self.holder, self.heard_ns = client, self.bench.now
        else:
            assert reply.ok == (held == client)
            if reply.ok:
                self.heard_ns = self.bench.now
                self.holder = 0 if action == "give-up" else client

    @rule(client=CLIENTS, value=st.floats(-3, 15) | st.just(math.nan), forged=st.booleans())
    def set(self, client: int, value: float, forged: bool) -> None:
        """Send a set-point; forged: under a lease number that the client was never given."""
        self.sequence += 1
        self.gate.core.state = self.bench.stepper.state
        command = Setpoint(
            client=client, lease=self.numbers[client] ^ (5 if forged else 0), unit="um",
            sequence=self.sequence, sent_ns=self.bench.now, value=value,
        )  # fmt: skip
        reply, records = self.gate.handle(self.bench.now, command, 1000)
        follows = self.bench.stepper.state in (State.READY, State.RUNNING, State.HOLDING)
        may = follows and not forged and self.holds == client and self.numbers[client] != 0
        assert reply.ok == (may and -1e-9 <= value <= 12.0 + 1e-9)
        if may:
            self.heard_ns = self.bench.now
        self.tick(records if records.size else None)

    @rule(values=st.lists(st.floats(-3, 15), min_size=1, max_size=40), last=st.booleans())
    def play(self, values: list[float], last: bool) -> None:
        """Bypass the gate: the step itself must withstand any points."""
        self.trajectory += 1
        batch = np.zeros(len(values), COMMAND)
        batch["kind"], batch["trajectory"] = LoopCommand.POINT, self.trajectory
        batch["offset_ns"] = np.arange(len(values)) * PERIOD_NS
        batch["value"], batch["last"][-1:] = values, last
        self.tick(batch)

    @rule(
        kind=st.sampled_from([LoopCommand.STOP_MOTION, LoopCommand.RELEASE, LoopCommand.CLEAR, 77]),
        value=st.floats(allow_nan=True, allow_infinity=True),
    )
    def command(self, kind: int, value: float) -> None:
        batch = np.zeros(1, COMMAND)
        batch["kind"], batch["trajectory"], batch["value"] = kind, self.trajectory, value
        self.tick(batch)

    @rule()
    def fault(self) -> None:
        self.bench.stepper.fault(self.bench.now, "pulled")
        assert self.bench.stepper.state is State.FAULT

    @rule(ramp=st.booleans())
    def back(self, ramp: bool) -> None:
        self.bench.stepper.table.kept[SETTINGS]["ramp_on_fault"] = ramp
        self.bench.stepper.recover(self.bench.now, self.bench.stepper.volts)
        assert self.bench.stepper.state is not State.FAULT

    @rule(scale=st.floats(0.5, 2.0), origin=st.floats(-2.0, 2.0))
    def reload(self, scale: float, origin: float) -> None:
        fresh = compensator(stage_model(scale))
        self.bench.stepper.reload(fresh, fresh.init(self.bench.stepper.volts / GAIN), origin)

    # -- what holds -----------------------------------------------------------------------------

    @invariant()
    def range_and_slew(self) -> None:
        time_ns, volts = (np.array(column) for column in zip(*self.log, strict=True))
        del self.log[:-WIDE]
        assert np.isfinite(volts).all()
        assert volts.min() >= MIN_V
        assert volts.max() <= MAX_V
        # over all pairs, by how much the later exceeds the earlier: the least before each is enough
        allowed = SLEW * (time_ns - time_ns[0]) * 1e-9
        for side in (volts, -volts):
            over = (side - allowed)[1:] - np.minimum.accumulate(side - allowed)[:-1]
            assert over.max(initial=0.0) <= SLEW * PERIOD_NS * 1e-9 + 1e-9

    def teardown(self) -> None:
        """From any state, an end reaches the safe voltage in time."""
        stepper = self.bench.stepper
        stepper.recover(self.bench.now, stepper.volts)
        way_v = abs(stepper.volts - SAFE_V)
        stepper.stop(self.bench.now)
        behind = (self.clock_ns - self.bench.now) // PERIOD_NS + 2  # the clock is ahead of the grid
        for _ in range(math.ceil(way_v / RAMP_V_PER_S / (PERIOD_NS * 1e-9)) + behind):
            self.tick()
        assert stepper.stopped
        assert stepper.volts == SAFE_V


def test_a_hundred_thousand_samples() -> None:
    Life.steps = 0
    rounds = 0
    while Life.steps < STEPS:
        run_state_machine_as_test(Life, settings=settings(max_examples=25, stateful_step_count=40))
        rounds += 1
        assert rounds < 100
