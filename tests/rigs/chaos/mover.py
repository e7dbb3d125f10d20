"""A client process of the chaos tests: plays a trajectory repeatedly, whatever happens."""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from tests.rigs.chaos.rig import trajectory

from dehyst.daemon.client.client import Client
from dehyst.models.errors import DehystError


def main(address: str, name: str, seconds: float) -> None:
    """Play until killed; each trajectory lasts `seconds`."""
    seed = 0
    while True:
        try:
            with Client(name, address, label="mover") as client:
                while True:
                    seed += 1
                    played = client.play(*trajectory(seconds, seed))
                    print("played", played.completed, played.reason, flush=True)
                    if not played.completed:
                        time.sleep(0.2)
        except DehystError as error:
            print("error", error, flush=True)
            time.sleep(0.2)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]))
