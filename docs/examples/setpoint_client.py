"""Send set-points from your own program: a slow circle in one axis, for ten seconds.

Start a daemon first (`dehyst run`), then: python docs/examples/setpoint_client.py
"""

import math
import time

from dehyst.client import Client, DehystError


def main() -> None:
    """A 0.5 Hz sine around the middle of the reach, one set-point every 10 ms."""
    with Client(label="example set-point client") as stage:
        status = stage.status()
        middle = 0.5 * (status.reach_min + status.reach_max)
        radius = 0.2 * (status.reach_max - status.reach_min)
        print(f"{stage.name}: reach {status.reach_min:g} to {status.reach_max:g} {status.unit}")
        stage.send(middle)  # waits for the daemon's answer; raises Refusal with the reason
        begun = time.monotonic()
        while (t := time.monotonic() - begun) < 10.0:
            # put() does not wait, so it suits loops; the newest set-point counts
            stage.put(middle + radius * math.sin(2 * math.pi * 0.5 * t))
            time.sleep(0.01)
        print("measured", stage.history(0.1)["measured"][-1], status.unit)
    # without further set-points the daemon holds, then ramps to its safe voltage


if __name__ == "__main__":
    try:
        main()
    except DehystError as error:  # no daemon, or a refusal: the text gives the reason
        raise SystemExit(str(error)) from None
