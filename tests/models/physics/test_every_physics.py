"""The folder of physics, file by file: what every one of them must have, found by walking it."""

import importlib
import pkgutil
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dehyst.models
from dehyst.models.cascade.simulate import channels_of, simulate
from dehyst.models.cascade.step import (
    fill_parallel_contribution,
    invert_stage_blocks,
    lead_drive,
    pack,
)
from dehyst.models.diagnosis.base import rich_base
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.screen import Screen
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.physics import KINDS, PHYSICS, check_block, split_off_one_recording
from dehyst.models.physics.candidate import Candidate, Context
from dehyst.models.physics.entry import Scales
from dehyst.models.physics.kind import Led, Limited, Never, Shifted, Solved, Subtracted
from dehyst.models.physics.registry import FRAME
from dehyst.models.recording import Recording

ROOT = Path(dehyst.models.__file__).parent
FILES = [m.name for m in pkgutil.iter_modules([str(ROOT / "physics")]) if m.name not in FRAME]
DT = 1e-3
SCALES = Scales(0.0, 10.0, 2000.0, DT, 6.0, 10.0, "v", "um")
# over 0 to 10 V the thresholds are the rich base's own
LOOPS = Hysteresis(
    r=[0.0, 0.25, 0.8, 1.7, 3.0], b=[0.7, 0.1, 0.1, 0.06, 0.04], c=[0.0, 1.0], u_offset=0.0
)


def recordings(*blocks: Block, noise: float = 0.01) -> list[Recording]:
    """Return two runs of a stage with these blocks: sines of many speeds, levels with holds."""
    rng = np.random.default_rng(11)
    t = np.arange(4000) * DT
    lines = ((2.2, 0.7, 0.3), (1.2, 3.1, 1.0), (0.8, 11.0, 2.0), (0.4, 43.0, 0.1))
    waves = sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in lines)
    waves = (5 + waves * 4.8 / np.abs(waves).max()) * np.clip(t / 0.3, 0, 1)
    levels = np.r_[0.0, 10.0, rng.uniform(0.5, 9.5, 7)][(t / 0.45).astype(int)]
    out = []
    for k, u in enumerate((waves, levels)):
        channels = {
            "temp_c": 22 + 0.5 * np.sin(2 * np.pi * t / 3.3 + k),
            "u2_v": 5 + 3 * np.sin(2 * np.pi * 2.3 * t + 2 * k) + rng.normal(0, 1, t.size),
        }
        model = Model(LOOPS, Validity(0.0, 10.0), blocks=blocks)
        y = simulate(model, t, u, channels) + noise * rng.standard_normal(t.size)
        out.append(Recording(t, u, y, channels=channels, name=f"run{k}.csv"))
    return out


@pytest.fixture(scope="module")
def plain():
    return prepare(recordings())


def examples(name: str, data) -> list[Block]:
    """Return blocks of a physics: the first specimen of each kind at each place, and what its
    candidates would write."""
    physics = PHYSICS[name]
    out = []
    for one in physics.specimens.values():
        out += {(b.kind, b.place): b for b in reversed(one.variants(SCALES))}.values()
    for candidate in physics.candidates(data):
        for fed in (data, replace(data, stepped=True)):
            out += candidate.blocks(*strength(candidate, data), fed)
    return out


def strength(candidate: Candidate, data) -> tuple[tuple[float, ...], np.ndarray]:
    """Return nonlinear parameters and amplitudes of an effect; additive: 0.6 % of the stroke."""
    theta = typical(candidate, data)
    if candidate.mode != "columns":
        return theta, np.zeros(0)
    columns = candidate.columns(data, Context(data.u, data.y), theta)
    size = np.sqrt(np.mean(columns**2, axis=0))
    return theta, 0.006 * np.ptp(data.y) / np.maximum(size, 1e-12) / columns.shape[1]


def typical(candidate: Candidate, data) -> tuple[float, ...]:
    """Return the middle one of the starts that it finds in a residual with a line."""
    line = 0.05 * np.sin(2 * np.pi * 61.3 * data.t)
    starts = candidate.starts(data, line)
    return tuple(starts[len(starts) // 2])


@pytest.mark.parametrize("name", FILES)
def test_it_is_documented(name: str, plain) -> None:
    module = importlib.import_module(f"dehyst.models.physics.{name}")
    assert re.search(r"[=<]|exp|sin", module.__doc__ or ""), "the docstring has no equation"
    physics = PHYSICS[name]
    assert physics.kinds
    for kind in physics.kinds:
        assert kind.says
        assert set(kind.places) <= {"drive", "stage", "sensor"}
        for p in kind.params:
            assert p.meaning, (kind.name, p.name)
            assert p.low < p.high, (kind.name, p.name)
    for c in physics.candidates(plain):
        words = (c.title, c.equation, c.source, c.name)
        assert all(words), c.key
        assert c.name == physics.name
        assert c.confused_with or c.refines, c.key


@pytest.mark.parametrize("name", FILES)
def test_it_has_an_experiment_and_blocks_that_a_model_file_takes(name: str, plain) -> None:
    physics = PHYSICS[name]
    assert physics.specimens, "no experiment shows it"
    blocks = examples(name, plain)
    for block in blocks:
        check_block(block, "v", "um")
    assert {b.kind for b in blocks} >= {k.name for k in physics.kinds}, "a kind without example"
    assert {rival for p in PHYSICS.values() for rival in p.distinguished_by} <= {
        p.name for p in PHYSICS.values()
    }


@pytest.mark.parametrize("name", FILES)
def test_what_its_candidates_write_has_the_units_of_the_recordings(name: str, plain) -> None:
    foreign = replace(plain, drive_unit="counts", unit="nm")
    for candidate in PHYSICS[name].candidates(foreign):
        for block in candidate.blocks(*strength(candidate, foreign), foreign):
            check_block(block, "counts", "nm")


@pytest.mark.parametrize("name", FILES)
def test_forward_is_finite_settled_and_the_same_sample_by_sample(name: str, plain) -> None:
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.5, 2.0, 600)) * DT
    x = 5 + 2 * np.sin(2 * np.pi * 3 * t)
    channel = 20 + np.sin(2 * np.pi * 2 * t)
    for block in examples(name, plain):
        kind = KINDS[block.kind]
        values = kind.values(block, "v", "um")
        y = kind.run(values, x, t, channel if kind.channel else None)
        assert np.all(np.isfinite(y))
        p, size = kind.numbers(values, float(np.diff(t).min()))
        s = np.zeros(size)
        kind.start(p, s, float(x[0]))
        steps = np.diff(t, prepend=t[0])
        ch = channel if kind.channel else np.zeros(t.size)
        one = [kind.step(p, s, *now) for now in zip(x, t, steps, ch, strict=True)]
        assert np.array_equal(one, y), block.kind


def moved(block: Block, seq: np.ndarray, first: float) -> np.ndarray:
    """Return the block's output for inputs at the sampling period, settled at `first`."""
    kind = KINDS[block.kind]
    p, size = kind.numbers(kind.values(block, "v", "um"), DT)
    s = np.zeros(size)
    kind.start(p, s, first)
    kind.step(p, s, first, -DT, DT, 21.0)
    return np.array([kind.step(p, s, x, i * DT, DT, 21.0) for i, x in enumerate(seq)])


@pytest.mark.parametrize("name", FILES)
def test_round_trip_or_the_words_why_not(name: str, plain) -> None:
    t = np.arange(400) * DT
    target = 5 - 2 * np.cos(2 * np.pi * 3 * t)
    for block in examples(name, plain):
        kind = KINDS[block.kind]
        values = kind.values(block, "v", "um")
        p, _ = kind.numbers(values, DT)
        stage = Block(block.kind, "stage" if "stage" in kind.places else "drive", block.params,
                      block.channel)  # fmt: skip
        packed = pack(Model(LOOPS, Validity(0.0, 10.0), blocks=(stage,)), DT)
        states = packed.settle(float(target[0]), float(target[0]))
        match kind.inverse:
            case Never(why):
                assert len(why.split()) > 3
            case Solved() | Led():
                kind.step(p, states, float(target[0]), ch=21.0)
                x = np.r_[target[0], target]
                channels = np.full(len(packed.channels), 21.0)
                if stage.place == "drive":  # only there: a command leads by its own rate
                    rates = np.diff(x, prepend=x[0]) / DT
                    x = np.array(
                        [lead_drive(packed.chain, *now) for now in zip(x, rates, strict=True)]
                    )
                else:
                    invert_stage_blocks(packed.chain, states, states.copy(), channels, 1, DT, DT, x)
                inside = slice(5, -5)
                off = np.abs(moved(block, x[1:], target[0]) - target)[inside].max()
                bare = np.abs(moved(block, target, target[0]) - target)[inside].max()
                # a lead is as good as its differences are, and the mode rings from the start
                share = 1e-6 if isinstance(kind.inverse, Solved) else 0.2
                assert off < share * bare + 1e-7, (block.kind, off, bare)
            case Shifted(seconds):
                late = np.interp(t - seconds(p), t, target)
                assert np.abs(moved(block, target, target[0]) - late).max() < 1e-3
                assert packed.delay_s == seconds(p) > 0
            case Limited(limits):
                low, high, rate = limits(p)
                assert packed.limits == (low, high, rate)
                slow = np.clip(5 + (target - 5) * min(1.0, 0.2 * rate / 40.0), low, high)
                assert np.abs(moved(block, slow, slow[0]) - slow).max() < 1e-9
                fast = moved(block, 5 + 1e6 * np.sin(2e3 * t), 5.0)
                assert fast.min() >= low
                assert fast.max() <= high
                assert np.abs(np.diff(fast)).max() <= rate * DT * (1 + 1e-9)
            case Subtracted():
                out = np.empty(t.size)
                fill_parallel_contribution(packed.chain, states, states.copy(), DT, target, out)
                kind.start(p, states, float(target[0]))
                one = [kind.step(p, states, x, 0.0, DT) for x in target]
                assert np.array_equal(out, one)
                assert packed.has_parallel_blocks


@pytest.mark.parametrize("name", FILES)
def test_it_is_recognised_in_its_own_simulated_data(name: str, plain) -> None:
    """Its candidate explains what the rich base leaves, from one of its own starts."""
    noise = 1e-3
    data = prepare(recordings(noise=noise))
    floor = Problem(data, rich_base(data)).solve([]).sse  # misfit of the base, plus noise
    for hidden in PHYSICS[name].candidates(plain):
        if hidden.refines or hidden.key.endswith(("-2", "-3")):
            continue
        blocks = hidden.blocks(*strength(hidden, plain), plain)
        data = prepare(recordings(*blocks, noise=noise))
        problem = Problem(data, rich_base(data))
        null = problem.solve([])
        candidate = next(c for c in PHYSICS[name].candidates(data) if c.key == hidden.key)
        starts = Screen(problem, null).starts(candidate)
        fit = problem.refit([Effect(candidate, starts[0][1])], rounds=8, start=null)
        assert null.sse > 2 * floor, (hidden.key, "the base takes it whole")
        explained = (null.sse - fit.sse) / (null.sse - floor)
        shared = any(one.in_base for one in PHYSICS[name].specimens.values())
        assert explained > (0.5 if shared else 0.8), (hidden.key, explained)
        effect = fit.effects[0]
        assert not candidate.implausible(effect.theta, fit.amplitudes[0], data)
        assert candidate.describe(candidate.values(effect.theta, fit.amplitudes[0])).endswith(".")


def test_nobody_else_opens_the_file_of_a_physics() -> None:
    """Cascade, inverse and diagnosis only know the interface, so new physics is one file."""
    opened = re.compile(r"models\.physics(?:\.(\w+))? import ([\w, ()\n]+)")
    for room in ("cascade", "inverse", "diagnosis", "drive_design"):
        for path in sorted((ROOT / room).glob("*.py")):
            for module, names in opened.findall(path.read_text()):
                words = {module, *re.findall(r"\w+", names)}
                assert not words & set(FILES), f"{path.name} imports {words & set(FILES)}"


@pytest.mark.parametrize("name", FILES)
def test_a_controller_runs_no_block_that_moves_while_nothing_else_does(name: str, plain) -> None:
    """Such a block goes on from the recording's first sample: a phase, or a past, of its own."""
    t = np.arange(0.0, 20.0, 0.01)
    for block in examples(name, plain):
        model = Model(LOOPS, Validity(0.0, 10.0), blocks=(block,))
        still = {channel: np.full(t.size, 5.0) for channel in channels_of(model)}
        moves = np.ptp(simulate(model, t, np.full(t.size, 5.0), still)[1:]) > 1e-9
        kept, left_out = split_off_one_recording(model)
        assert (kept.blocks == (), left_out != ()) == (moves, moves), block.kind
        assert kept == replace(model, blocks=kept.blocks)
