"""Tracking on a plant with other physics than the model's: the simulated stage; see inverse.py."""

import numpy as np

from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage
from dehyst.models.arrays import Floats
from dehyst.models.cascade.step import invert_stage_blocks, pack
from dehyst.models.identify import Options, identify
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.physics import KINDS
from dehyst.models.recording import Recording

RATE_HZ = 1000.0
TOP_V = 150.0
SETTINGS = StageSettings()


def _run(volts: Floats) -> tuple[Floats, Floats]:
    """Return true displacement and reading one period after each voltage was commanded."""
    stage = SimulatedStage(SETTINGS)
    t = np.arange(volts.size + 1) / RATE_HZ
    true, reading = stage.run(t, np.append(volts, volts[-1]))
    return true[1:], reading[1:]


def _excitation() -> Floats:
    """Return twelve seconds: loops of all sizes at 0.5 to 25 Hz within 0 to 150 V."""
    t = np.arange(round(12 * RATE_HZ)) / RATE_HZ
    size = 0.55 + 0.45 * np.cos(2 * np.pi * t / 6)
    wave = 0.55 * np.sin(2 * np.pi * 0.5 * t - np.pi / 2) + 0.2 * np.sin(2 * np.pi * 5 * t)
    wave += 0.15 * np.sin(2 * np.pi * 12 * t) + 0.1 * np.sin(2 * np.pi * 25 * t)
    u = 0.5 * TOP_V * (1 + 0.98 * size * wave)
    return np.concatenate([np.linspace(0, u[0], 300), u])


def _blocks() -> tuple[Block, ...]:
    """Return the stage's real properties besides hysteresis, as blocks."""
    s = SETTINGS
    return (
        Block("lag", "drive", {"tau_s": s.rc_tau_s}),
        Block("creep", "stage", {"gain_per_decade": s.creep_gain_per_decade, "tau_min_s": 0.01,
                                 "tau_max_s": 1000.0}),
        Block("resonance", "stage", {"frequency_hz": s.mode_hz, "damping": s.mode_damping,
                                     "share": s.mode_share}),
        Block("lag", "sensor", {"tau_s": s.sensor_tau_s}),
    )  # fmt: skip


def _identified(u: Floats, y: Floats, blocks: tuple[Block, ...]) -> Model:
    """Identify on a recording from which the blocks are removed, and add them again."""
    t = np.arange(u.size) / RATE_HZ
    bare = Model(_line(), Validity(0.0, TOP_V), blocks=blocks)
    packed = pack(bare, 1 / RATE_HZ)
    for block in blocks:
        if block.place == "drive":
            kind = KINDS[block.kind]
            u = kind.run(kind.values(block), u, t)
    seq = np.concatenate([[y[0]], y])
    if blocks:
        sensor = [b for b in blocks if b.place == "sensor"]
        tau = sum(float(b.params["tau_s"]) for b in sensor)  # type: ignore[arg-type]
        seq[1:] = y + tau * np.gradient(y, 1 / RATE_HZ)
        states = packed.settle(0.0, float(y[0]))
        dt = 1 / RATE_HZ
        invert_stage_blocks(packed.chain, states, states.copy(), np.zeros(0), 1, dt, dt, seq)
    model = identify([Recording(t, u, seq[1:])], Options()).model
    return Model(
        model.hysteresis, model.validity, model.drive_unit, model.displacement_unit, blocks,
        model.fit,
    )  # fmt: skip


def _line() -> Hysteresis:
    return Hysteresis(r=[0.0], b=[1.0], c=[0.0, 1.0])


def table() -> None:
    """Print the errors."""
    u = _excitation()
    _, y = _run(u)
    models = {"without blocks": _identified(u, y, ()), "with blocks": _identified(u, y, _blocks())}
    gain, zero = np.polyfit(u, y, 1)
    print("\nplant: the simulated stage (another hysteresis, creep, mode, RC); rms in nm of the")
    print("true displacement after the first period, target 8 um around 8 um at 1 Hz, 6, 4, 3 um")
    for name, model in models.items():
        fit = model.fit.rms or 0.0
        print(f"model {name}: {'static' if model.hysteresis.static else 'rate-dependent'}, "
              f"{model.hysteresis.n} operators, fit {1e3 * fit:.0f} nm")  # fmt: skip
    print(f"{'target':10}{'linear':>9}" + "".join(
        f"{mode + ' ' + which:>18}" for which in ("bare", "blocks")
        for mode in ("static", "causal", "preview")
    ))  # fmt: skip
    for f, size in ((1.0, 8.0), (5.0, 6.0), (10.0, 4.0), (20.0, 3.0)):
        n = round(max(4.0, 4.0 / f) * RATE_HZ)
        target = 8.0 - 0.5 * size * np.cos(2 * np.pi * f * np.arange(n) / RATE_HZ)
        skip = round(RATE_HZ / f)
        errors = [_error(np.clip((target - zero) / gain, 0, TOP_V), target, skip)]
        for model in models.values():
            for mode, preview_s in (("static", 0.0), ("causal", 0.0), ("preview", 0.1)):
                c = Compensator(model, 1 / RATE_HZ, 0.0, TOP_V, 40_000.0, mode, preview_s)
                errors.append(_error(_drive(c, target), target, skip))
        print(f"{f:4g} Hz   {errors[0]:9.0f}" + "".join(f"{e:18.0f}" for e in errors[1:]),
              flush=True)  # fmt: skip


def _conditioning() -> Floats:
    """Return one loop over the range before each run, for equal history of plant and model."""
    up = 0.5 * (1 - np.cos(2 * np.pi * np.arange(2000) / 2000))
    return 0.88 * TOP_V * up


def _drive(c: Compensator, target: Floats) -> Floats:
    """Return what the daemon would write for this target, after the conditioning."""
    state = c.init(0.0)
    for volts in _conditioning().tolist():
        c.applied(state, volts)
    out, nothing = np.empty(target.size), np.zeros(0)
    for i in range(target.size):
        window = target[i : i + c.window_samples]
        c.step(state, window, window.size, nothing)
        out[i] = state.drive
        c.applied(state, out[i])
    return out


def _error(volts: Floats, target: Floats, skip: int) -> float:
    before = _conditioning()
    true, _ = _run(np.concatenate([before, volts]))
    return 1e3 * float(np.sqrt(np.mean((true[before.size :] - target)[skip:] ** 2)))
