"""A client of a dehyst daemon that uses only zenoh and msgpack: it finds, moves, plays and reads.

docs/topics.md describes the messages. Start a daemon first (`dehyst run`), then:
python docs/examples/plain_client.py [tcp/127.0.0.1:7447]
"""

import array
import math
import random
import sys
import time

import msgpack
import zenoh

ADDRESS = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"


class Stage:
    """The only controller at an address."""

    def __init__(self, session):
        tokens = session.liveliness().get("dehyst/@v1/*/alive", timeout=2.0)
        names = [str(one.ok.key_expr).split("/")[-2] for one in tokens if one.ok]
        if len(names) != 1:
            raise SystemExit(f"one controller is expected at {ADDRESS}, found: {names or 'none'}")
        self.session, self.root = session, f"dehyst/@v1/{names[0]}"
        self.client, self.lease, self.sequence = random.getrandbits(62) | 1, 0, 0
        self.unit = self.ask("status")["unit"]

    def ask(self, method, payload=b""):
        """The first answer to a question, as a map."""
        for one in self.session.get(f"{self.root}/rpc/{method}", payload=payload, timeout=3.0):
            if one.ok:
                return msgpack.unpackb(one.ok.payload.to_bytes())
            raise SystemExit(one.err.payload.to_bytes().decode())
        raise SystemExit(f"nobody answers {self.root}/rpc/{method}")

    def command(self, schema, **fields):
        """Send one command; return the reply, or exit with the daemon's reason."""
        who = {"client": self.client, "lease": self.lease, "sent_ns": time.monotonic_ns()}
        message = {"schema": schema, "version": 1, **who, **fields}
        reply = self.ask("command", msgpack.packb(message))
        if not reply["ok"]:
            raise SystemExit(f"refused: {reply['text']} [{reply['code']}]")
        return reply

    def acquire(self):
        self.lease = self.command("dehyst.request", action="acquire", label="plain")["lease"]

    def go(self, value):
        self.sequence += 1
        self.command("dehyst.setpoint", sequence=self.sequence, value=value, unit=self.unit)

    def play(self, offsets_ns, values):
        """Send a short trajectory in one chunk; return its number."""
        number = random.getrandbits(62) | 1
        points = {"offset_ns": little("q", offsets_ns), "value": little("d", values)}
        self.command(
            "dehyst.trajectory", trajectory=number, index=0, unit=self.unit, last=True, **points
        )
        return number

    def has_played(self, number):
        """Whether this trajectory has ended: at its last point, or because something stopped it."""
        status = self.ask("status")  # up to a second old
        ended = status["trajectory_done"] or status["state"] != "running"
        return status["trajectory"] == number and ended

    def stop(self):
        self.command("dehyst.request", action="stop")


def little(kind, numbers):
    """Little-endian bytes of 8-byte numbers."""
    found = array.array(kind, numbers)
    if sys.byteorder == "big":
        found.byteswap()
    return found.tobytes()


def column(batch, name, kind="d"):
    """The numbers of one column of telemetry."""
    found = array.array(kind)
    found.frombytes(batch[name])
    if sys.byteorder == "big":
        found.byteswap()
    return found


def connect():
    """A session that connects only to the daemon."""
    settings = zenoh.Config()
    settings.insert_json5("mode", '"client"')
    settings.insert_json5("connect/endpoints", f'["{ADDRESS}"]')
    settings.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(settings)


def main():
    """Go to the middle, play a sine for two seconds and stop; print a summary of the telemetry."""
    with connect() as session:
        stage, samples = Stage(session), []

        def store(sample):  # a callback only stores
            batch = msgpack.unpackb(sample.payload.to_bytes())
            samples.extend(zip(column(batch, "target"), column(batch, "measured"), strict=True))

        listening = session.declare_subscriber(f"{stage.root}/pubsub/telemetry/daemon", store)
        status = stage.ask("status")
        middle = 0.5 * (status["reach_min"] + status["reach_max"])
        half = 0.2 * (status["reach_max"] - status["reach_min"])
        stage.acquire()
        stage.go(middle)
        time.sleep(1.0)
        step_ns = max(status["period_ns"], 5_000_000)
        offsets = range(0, 2_000_000_000, step_ns)
        values = [middle + half * math.sin(2e-9 * math.pi * ns) for ns in offsets]
        number = stage.play(offsets, values)
        while not stage.has_played(number):
            stage.command("dehyst.request", action="renew")
            time.sleep(0.2)
        stage.stop()
        listening.undeclare()
        targets = [target for target, _ in samples if not math.isnan(target)]
        errors = [abs(m - t) for t, m in samples if not math.isnan(m) and not math.isnan(t)]
        print(
            f"{len(samples)} samples, targets from {min(targets):.3f} to {max(targets):.3f} "
            f"{stage.unit}, mean error {sum(errors) / max(1, len(errors)):.3f}"
        )


if __name__ == "__main__":
    main()
