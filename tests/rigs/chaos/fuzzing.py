"""Random commands to a running rig, valid, wrong and damaged, with device faults, kills and reloads
of the model between them. The caller checks the required properties in the amplifier's own log."""

import math
import os
import random
import signal
import time
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.rigs.chaos.kills import processes_of
from tests.rigs.chaos.rig import Rig

from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.messages import Chunk, HistoryRequest, Reply, Request, Setpoint
from dehyst.daemon.bus.session import Sender
from dehyst.daemon.bus.topics import SETPOINT, subject
from dehyst.daemon.client.client import Client
from dehyst.daemon.files.models import load_model, save_model
from dehyst.models.errors import DehystError

ODD = (math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 1e6, -1e6, 0.0, -0.0)
ACTIONS = ("acquire", "take-over", "take-over", "renew", "give-up", "stop", "release", "clear")
PATIENCE_S = 0.5
DEVICE_FAULTS = (
    {"fault": "unplug", "device": "mdt693b"}, {"fault": "unplug", "device": "ksg101"},
    {"fault": "unplug", "device": "both"}, {"amplifier": {"hang": True}},
    {"amplifier": {"garbage": True}}, {"amplifier": {"half": True}},
    {"amplifier": {"readback_error_v": 150.0}}, {"fault": "stuck"}, {"fault": "nan"},
    {"fault": "range"}, {"fault": "late", "late_s": 0.04},
)  # fmt: skip


class Commander:
    """One client that sends anything; it connects again after the daemon was away."""

    def __init__(self, rig: Rig, name: str, chance: random.Random, counts: Counter[str]) -> None:
        self.rig, self.name, self.random, self.counts = rig, name, chance, counts
        self.client: Client | None = None
        self.sender: Sender | None = None
        self.lease = self.sequence = self.trajectory = self.index = 0
        self.reach = (0.0, 10.0)

    def connected(self) -> Client | None:
        """Return the client; None while the daemon is away."""
        if self.client is None:
            with suppress(DehystError):
                self.client = Client(self.name, self.rig.address, label="fuzz")
                self.client.patience_s = 0.0
        return self.client

    def act(self) -> None:
        """Do one operation."""
        client = self.connected()
        if client is None:
            time.sleep(0.1)
            return
        chosen = self.random.choices(
            (self.setpoint, self.burst, self.chunk, self.request, self.damaged, self.question),
            (4, 2, 4, 3, 3, 1),
        )[0]
        try:
            chosen(client)
        except DehystError as error:
            self.counts[type(error).__name__] += 1
            if self.random.random() < 0.1:
                self.close()

    def close(self) -> None:
        """Close the connection; the next act opens another."""
        client, self.client, self.sender = self.client, None, None
        if client is not None:
            with suppress(DehystError):
                client.close()

    # -- operations -----------------------------------------------------------------------------

    def setpoint(self, client: Client) -> None:
        """Send one set-point, asked or put, within reach, beyond it, or not a number."""
        self.give(client, encoding.encode(self._setpoint(client)), self.random.random() < 0.5)

    def burst(self, client: Client) -> None:
        """Go from one end of the reach to the other and back, as fast as possible."""
        low, high = self.reach
        for i in range(self.random.randrange(2, 60)):
            message = self._setpoint(client, (low, high)[i % 2])
            self.give(client, encoding.encode(message), False)

    def chunk(self, client: Client) -> None:
        """Send points of a trajectory: noise over the whole reach, a walk, or a jump; sometimes
        with times that do not increase or targets that are not numbers."""
        r, (low, high) = self.random, self.reach
        n = r.choice((1, 2, 10, 100, 1000))
        offset = np.cumsum(np.full(n, round(10 ** r.uniform(6.0, 8.0))))
        offset += self.index * int(offset[-1])
        rng = np.random.default_rng(r.randrange(2**32))
        value = rng.uniform(low, high, n)
        if r.random() < 0.5:
            value = np.clip(low + np.cumsum(rng.normal(0.0, 0.3, n)), low, high)
        if r.random() < 0.1:
            value[r.randrange(n)] = r.choice(ODD)
        if r.random() < 0.1:
            rng.shuffle(offset)
        if self.index == 0 or r.random() < 0.2:
            self.trajectory, self.index = r.randrange(1, 2**62), 0
            offset -= offset[0]
        message = Chunk(
            client=client.client, lease=self.lease, trajectory=self.trajectory, index=self.index,
            sent_ns=self._sent(), unit=self._unit(), offset_ns=offset.astype("<i8").tobytes(),
            value=value.astype("<f8").tobytes(), last=r.random() < 0.2,
            allow_unreachable=r.random() < 0.5,
        )  # fmt: skip
        reply = self.give(client, encoding.encode(message), True)
        self.index = self.index + 1 if reply is not None and reply.ok and not message.last else 0

    def request(self, client: Client) -> None:
        """Request a lease, a stop or a release."""
        action = self.random.choice(ACTIONS)
        message = Request(
            client=client.client, lease=self.lease, sent_ns=self._sent(), action=action,
            trajectory=self.random.choice((0, self.trajectory)), label="fuzz",
        )  # fmt: skip
        reply = self.give(client, encoding.encode(message), True)
        if reply is not None and reply.ok and reply.lease:
            self.lease = reply.lease
            status = client.status()
            self.reach = (status.reach_min, status.reach_max)

    def damaged(self, client: Client) -> None:
        """Send a valid message with some bytes changed, or only random bytes."""
        r = self.random
        payload = bytearray(encoding.encode(self._setpoint(client)))
        for _ in range(r.choice((1, 1, 2, 8))):
            at = r.randrange(len(payload))
            payload[at : at + r.choice((0, 1, 1, 4))] = r.randbytes(r.choice((0, 1, 1, 4)))
        if r.random() < 0.1:
            payload = bytearray(r.randbytes(r.randrange(2000)))
        self.give(client, bytes(payload), r.random() < 0.5)

    def question(self, client: Client) -> None:
        """Query status, model or history, or send nonsense to these topics."""
        r = self.random
        if r.random() < 0.3:
            method = r.choice(("history", "status", "model", "configuration"))
            list(client.bus.ask(client.keys.rpc(method), r.randbytes(20), PATIENCE_S))
            return
        first = r.randrange(2**40)
        question = HistoryRequest(first_seq=first, end_seq=first + 100, seconds=r.uniform(0, 2))
        list(client.bus.ask(client.keys.rpc("history"), encoding.encode(question), PATIENCE_S))

    # -- parts ----------------------------------------------------------------------------------

    def give(self, client: Client, payload: bytes, ask: bool) -> Reply | None:
        """Ask and count the answer by its code, or put."""
        if not ask:
            if self.sender is None:
                key = client.keys.pubsub(subject(SETPOINT, "um"), str(client.client))
                self.sender = client.bus.sender(key, SETPOINT)
            self.sender.put(payload)
            self.counts["put"] += 1
            return None
        for answer in client.bus.ask(client.keys.rpc("command"), payload, PATIENCE_S):
            reply: Reply = encoding.decode(Reply, answer)
            self.counts[reply.code] += 1
            return reply
        return None

    def _setpoint(self, client: Client, value: float | None = None) -> Setpoint:
        r, (low, high) = self.random, self.reach
        if value is None:
            value = r.choice(ODD) if r.random() < 0.2 else r.uniform(low - 1.0, high + 1.0)
        self.sequence += 1
        return Setpoint(
            client=client.client, lease=self.lease if r.random() < 0.95 else r.randrange(2**62),
            sequence=self.sequence if r.random() < 0.95 else r.randrange(2**62),
            sent_ns=self._sent(), value=value, unit=self._unit(),
            allow_unreachable=r.random() < 0.5,
        )  # fmt: skip

    def _sent(self) -> int:
        odd = self.random.random() < 0.05
        return self.random.randrange(-(2**62), 2**62) if odd else time.monotonic_ns()

    def _unit(self) -> str:
        return self.random.choice(("nm", "", "V")) if self.random.random() < 0.03 else "um"


class Fuzz:
    """Commands of two clients, with disturbances of the daemon at the same time."""

    def __init__(self, rig: Rig, seed: int) -> None:
        self.rig, self.random, self.counts = rig, random.Random(seed), Counter[str]()
        self.commanders = [
            Commander(rig, name, self.random, self.counts) for name in rig.commanded for _ in "ab"
        ]
        self.good = rig.model.read_text()
        self.model = load_model(rig.model)

    def run(self, seconds: float) -> Counter[str]:
        """Run for this long; return how often each action was done and each answer received."""
        end = time.monotonic() + seconds
        due = time.monotonic() + 2.0
        try:
            while time.monotonic() < end:
                self.random.choice(self.commanders).act()
                if time.monotonic() > due:
                    due = time.monotonic() + self.random.uniform(0.5, 5.0)
                    self.disturb()
        finally:
            self.rig.bench_order(clear=True)
            self.rig.model.write_text(self.good)
            for commander in self.commanders:
                commander.close()
        return self.counts

    def disturb(self) -> None:
        """Cause a device fault, a reload, a stop or a kill."""
        chosen = self.random.choices((self.fault, self.reload, self.stop, self.kill), (5, 5, 2, 1))[
            0
        ]
        self.counts[chosen.__name__] += 1
        chosen()

    def fault(self) -> None:
        """Cause a temporary device fault."""
        order = self.random.choice(DEVICE_FAULTS)
        where = {"axis": self.random.choice(self.rig.axes)} if self.rig.axes else {}
        self.rig.bench_order(**order, **where, for_s=self.random.uniform(0.1, 1.5))

    def reload(self) -> None:
        """Load another model, a broken one, or several in a row."""
        for _ in range(self.random.choice((1, 1, 1, 5))):
            self._write_model()
            os.kill(self.rig.daemon.pid, signal.SIGHUP)

    def stop(self) -> None:
        """Stop the loop for a while."""
        for pid in self._pids("core"):
            os.kill(pid, signal.SIGSTOP)
            time.sleep(self.random.uniform(0.02, 1.5))
            os.kill(pid, signal.SIGCONT)

    def kill(self) -> None:
        """Kill loop or network."""
        for pid in self._pids(self.random.choice(("core", "gateway"))):
            os.kill(pid, signal.SIGKILL)

    def _pids(self, command: str) -> list[int]:
        return [pid for pid, (name, _) in processes_of(self.rig.config).items() if name == command]

    def _write_model(self) -> None:
        kind = self.random.choice(("gain", "gain", "good", "cut", "empty", "unit"))
        if kind == "gain":
            h = self.model.hysteresis
            other = replace(h, b=h.b * self.random.uniform(0.7, 1.4))
            fresh = Path(f"{self.rig.model}.fresh")
            save_model(replace(self.model, hysteresis=other), fresh)
            fresh.replace(self.rig.model)
            return
        texts = {
            "good": self.good,
            "cut": self.good[: self.random.randrange(len(self.good))],
            "empty": "",
            "unit": self.good.replace('"um"', '"nm"'),
        }
        self.rig.model.write_text(texts[kind])
