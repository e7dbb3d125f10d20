"""Read telemetry two ways: with dehyst's client class, and with zenoh and msgpack alone (as a
program in any other language would).

Start a daemon first (`dehyst run`), then: python docs/examples/telemetry_subscriber.py [--plain]
"""

import os
import sys
import time

import numpy as np


def with_the_client() -> None:
    """Every sample as numpy records; missing ones are fetched from the daemon's history."""
    from dehyst.client import Client, DehystError

    try:
        with Client() as stage:
            begun = time.monotonic()
            for samples in stage.telemetry():
                error = samples["measured"] - samples["target"]
                print(
                    f"samples {samples['seq'][0]} to {samples['seq'][-1]}: "
                    f"measured {samples['measured'][-1]:.4f} {stage.unit}, "
                    f"largest error {np.max(np.abs(error)):.4f}, {samples['volts'][-1]:.3f} V"
                )
                if time.monotonic() - begun > 5.0:
                    break
    except DehystError as error:  # no daemon, or it has ended: the text says which
        raise SystemExit(str(error)) from None


def plain() -> None:
    """The bytes on the bus: one msgpack map a batch, each column raw little-endian numbers."""
    import json

    import msgpack  # pip install msgpack
    import zenoh

    address = os.environ.get("DEHYST_CONNECT", "tcp/127.0.0.1:7447")
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps("client"))
    config.insert_json5("scouting/multicast/enabled", "false")
    try:
        config.insert_json5("connect/endpoints", json.dumps([address]))
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise SystemExit(f"no daemon to be heard: {error}") from None
    with session:
        # the chunk @v1 must be written out: wildcards do not match it
        subscriber = session.declare_subscriber("dehyst/@v1/*/pubsub/telemetry/*")
        end = time.monotonic() + 5.0
        while time.monotonic() < end:
            sample = subscriber.try_recv()
            if sample is None:
                time.sleep(0.01)
                continue
            batch = msgpack.unpackb(sample.payload.to_bytes())
            volts = np.frombuffer(batch["volts"], "<f8")
            print(f"{sample.key_expr}: {batch['count']} samples, {volts[-1]:.3f} V")


if __name__ == "__main__":
    plain() if "--plain" in sys.argv else with_the_client()
