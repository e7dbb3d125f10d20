"""An effect, drawn at random, that appears in the simulated stage while it runs.

The demo does not look inside: it triggers the effect, and asks at the end what was drawn. The same
seed draws the same effect.
"""

import json
import random
import socket
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Drawn:
    """name: as in the diagnosis; says: description; stage: settings of the simulated stage; wait_s:
    time before the effect appears."""

    name: str
    says: str
    stage: dict[str, float]
    wait_s: float


def _creep(chance: random.Random) -> tuple[str, dict[str, float]]:
    gain = chance.uniform(0.04, 0.05)
    return f"creep of {100 * gain:.1f} % per decade (before: 1.2)", {"creep_gain_per_decade": gain}


def _lag(chance: random.Random) -> tuple[str, dict[str, float]]:
    tau = chance.uniform(0.01, 0.02)
    return f"a lag of the amplifier of {1e3 * tau:.1f} ms", {"amplifier_tau_s": tau}


def _delay(chance: random.Random) -> tuple[str, dict[str, float]]:
    delay = chance.uniform(0.01, 0.02)
    return f"a delay of {1e3 * delay:.1f} ms", {"sensor_delay_s": delay}


def _friction(chance: random.Random) -> tuple[str, dict[str, float]]:
    half = chance.uniform(0.2, 0.4)
    return f"friction of the guide, {1e3 * half:.0f} nm in both directions", {"friction_um": half}


def _resonance(chance: random.Random) -> tuple[str, dict[str, float]]:
    hz, damping = chance.uniform(11.0, 15.0), chance.uniform(0.1, 0.2)
    return (
        f"a mode of {hz:.0f} Hz with a damping ratio of {damping:.2f}",
        {"mode_hz": hz, "mode_damping": damping, "mode_share": 0.8},
    )


EFFECTS: dict[str, Callable[[random.Random], tuple[str, dict[str, float]]]] = {
    "creep": _creep,
    "delay": _delay,
    "friction": _friction,
    "lag": _lag,
    "resonance": _resonance,
}


class Chance:
    """Draws an effect. seed: None: a new one. `appear` triggers the effect; `drawn` reveals it."""

    def __init__(self, seed: int | None, control: str) -> None:
        self.seed = random.SystemRandom().randrange(1, 1_000_000) if seed is None else seed
        self._control = control
        chance = random.Random(self.seed)
        name = chance.choice(sorted(EFFECTS))
        says, stage = EFFECTS[name](chance)
        self._drawn = Drawn(name, says, stage, chance.uniform(2.0, 10.0))

    @property
    def wait_s(self) -> float:
        """Time that the stage continues unchanged [s]."""
        return self._drawn.wait_s

    def appear(self) -> None:
        """Change the stage from now on, without moving it."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as link:
            order = {"stage": self._drawn.stage}
            link.sendto(json.dumps(order).encode(), str(Path(self._control)))

    def drawn(self) -> Drawn:
        """Return what was drawn; called at the end."""
        return self._drawn
