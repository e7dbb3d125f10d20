"""Two daemons of one name, one run folder or one port: the second is refused and names the first.

Real processes, real locks, real pseudo terminals.
"""

import os
from pathlib import Path

import pytest
from tests.rigs.processes import EmulatedBench, Rings, core, dehyst, end, simulated_config, until

from dehyst.daemon.rings.records import LoopCommand


def refusal(*arguments: str) -> str:
    """Return what a command prints that must end with exit status 2."""
    process = dehyst(*arguments)
    _, words = process.communicate(timeout=60)
    assert process.returncode == 2, words
    assert "Traceback" not in words
    return words


@pytest.mark.parametrize("command", ["core", "safe", "run"])
def test_a_second_one_on_the_same_run_folder_names_the_first(
    tmp_path: Path, model: Path, command: str
) -> None:
    first = simulated_config(tmp_path, 200.0, model)
    second = tmp_path / "second.toml"
    second.write_text(first.read_text().replace('stage = "t"', 'stage = "other"'))
    with core(first) as running:
        rings = Rings(tmp_path)
        words = refusal(command, "--config", str(second))
        assert str(running.pid) in words
        assert str(first) in words
        run = rings.read("telemetry")["seq"]
        rings.drive(3.0, lambda last: last["target"] == 3.0)  # the first one is not disturbed
        assert rings.read("telemetry")["seq"][0] == run[0]


def test_a_second_run_of_the_same_name_is_refused(tmp_path: Path, model: Path) -> None:
    """A second `dehyst run` or gateway of the same name is refused and names the first. The two
    configurations have two amplifiers, one name and the default run folder."""
    paths = []
    for name in ("a", "b"):
        folder = tmp_path / name
        folder.mkdir()
        path = simulated_config(folder, 200.0, model)
        lines = [line for line in path.read_text().splitlines() if "run_dir" not in line]
        path.write_text("\n".join(lines))
        paths.append(path)
    home = tmp_path / "xdg"
    home.mkdir(mode=0o700)
    os.environ["XDG_RUNTIME_DIR"], before = str(home), os.environ.get("XDG_RUNTIME_DIR")
    try:
        with_port = [f'bus = {{listen = ["tcp/127.0.0.1:{port}"]}}\n' for port in (17461, 17462)]
        for path, line in zip(paths, with_port, strict=True):
            path.write_text(line + path.read_text())
        first = dehyst("run", "--config", str(paths[0]))
        try:
            ring = home / "dehyst-test" / "telemetry.ring"
            until(ring.exists, 110.0, "the first one's rings")
            words = refusal("run", "--config", str(paths[1]))
            assert f"process {first.pid} " in words
            assert str(paths[0]) in words
            words = refusal("gateway", "--config", str(paths[1]))
            assert "dehyst gateway of" in words
            assert str(paths[0]) in words
        finally:
            assert end(first) == 0
    finally:
        if before is None:
            del os.environ["XDG_RUNTIME_DIR"]
        else:
            os.environ["XDG_RUNTIME_DIR"] = before


def test_one_port_two_run_folders(tmp_path: Path, model: Path) -> None:
    """One process holds the amplifier's port; the second one is refused and names it."""
    bench = EmulatedBench(tmp_path)
    try:
        config = bench.config(100.0, model)
        other = tmp_path / "other.toml"
        other.write_text(config.read_text().replace(str(tmp_path / "run"), str(tmp_path / "run2")))
        with core(config) as running:
            rings = Rings(tmp_path)
            rings.drive(5.0, lambda last: last["volts"] > 20.0)
            words = refusal("core", "--config", str(other))
            assert bench.ports["mdt693b"] in words
            assert str(running.pid) in words
            assert str(config) in words
            rings.command(LoopCommand.SETPOINT, 5.0)
            assert running.poll() is None
    finally:
        bench.close()
