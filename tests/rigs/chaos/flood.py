"""A process of the chaos tests that puts set-points as fast as it can, whatever happens to them.

Arguments: address, key, client and lease (0: none), seconds. It prints on standard output how many
it put, and in how many seconds.
"""

import json
import os
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

import zenoh

from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.messages import Setpoint

BLOCK = 200
"""Number encoded at a time; then the clock is checked."""


def main(address: str, key: str, client: int, lease: int, seconds: float) -> None:
    """Put set-points and never wait for a full link."""
    os.nice(10)  # a real client is on another machine and takes no processor time from the daemon
    config = zenoh.Config()
    for name, value in {
        "mode": "client",
        "connect/endpoints": [address],
        "scouting/multicast/enabled": False,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 1,
    }.items():
        config.insert_json5(name, json.dumps(value))
    with zenoh.open(config) as session:
        publisher = session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.DROP, express=False
        )
        time.sleep(0.3)  # until the route to the daemon is known
        begun, sent = time.monotonic(), 0
        while (now := time.monotonic()) < begun + seconds:
            now_ns, value = time.monotonic_ns(), 4.0 + 6.0 * (int(4 * now) % 2)
            block = [
                encoding.encode(
                    Setpoint(
                        client=client, lease=lease, sequence=now_ns + i, sent_ns=now_ns,
                        value=value, unit="um",
                    )
                )
                for i in range(BLOCK)
            ]  # fmt: skip
            for payload in block:
                publisher.put(payload)
            sent += BLOCK
        print(sent, time.monotonic() - begun, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]), float(sys.argv[5]))
