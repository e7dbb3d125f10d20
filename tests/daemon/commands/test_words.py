"""A mistake at the command line ends in one line that says what to write instead."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.rigs.command_line import exit_status
from tests.rigs.gateway_bench import environment, free_port

from dehyst.daemon.commands.run import LISTEN, watching
from dehyst.daemon.demo.demo import compare_errors
from dehyst.daemon.main import build_parser, main, open_closed_streams

WRONG = ("Stage", "a.b", "_a", 64 * "a")
SPIRAL = "scan spiral --radius 1 -o s.csv"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("send 8um", "'8um' is not a finite number; write it without a unit"),
        ("send 5,5", "'5,5' is not a finite number; write 5.5, with a point"),
        ("send nan", "not a finite number"),
        ("run --config x.toml --name foo", "--name goes without --config"),
        ("run --config x.toml --listen tcp/127.0.0.1:7447", "--listen goes without --config"),
        ("run --listen foo", "'foo' is not an address; write PROTOCOL/HOST:PORT"),
        ("watch --connect 127.0.0.1:7447", "is not an address; write PROTOCOL/HOST:PORT"),
        ("watch --connect tcp/127.0.0.1:99999", "is not an address"),
        *((f"watch --for {s}", "--for: ") for s in ("nan", "inf", "-1", "0")),
        *((f"watch --window {s}", "--window: ") for s in ("nan", "inf", "-5", "0", "1e12")),
        *((f"record -o r.csv --for {s}", "--for: ") for s in ("nan", "inf", "-1", "0")),
        *((f"accept --wait {s}", "--wait: ") for s in ("nan", "inf", "-1")),
        *((f"zero --seconds {s}", "--seconds: ") for s in ("nan", "inf", "-1", "x")),
        *((f"zero --share {s}", "--share: ") for s in ("nan", "0", "x")),
        *(
            (f"scan spiral --radius 1 -o s.csv --center {s} 0", "--center: ")
            for s in ("nan", "inf")
        ),
        *((f"{SPIRAL} --slew {s}", "--slew: ") for s in ("nan", "0")),
        ("demo --seed -1", "--seed: '-1' is not a whole number of at least 0"),
        ("latency --cpu 1000000000", "--cpu 1e+09 is outside"),
        ("latency --cpu 900", "CPU 900 (--cpu, loop.cpu): this process can use only CPUs"),
        *((f"run --name {name}", f"--name {name!r}: use a-z, 0-9, _ and -") for name in WRONG),
        *((f"config init --range 0 1 --name {n}", f"--name {n!r}: use a-z") for n in WRONG),
        *((f"setup new --yes --range 0 1 --name {n}", f"--name {n!r}: use a-z") for n in WRONG),
    ],
)
def test_one_line(line: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_status(line.split()) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("text", ["-1e1", "-1.5E-3", "-.5e2", "-2"])
def test_a_negative_number_with_an_exponent_is_a_number(text: str) -> None:
    assert build_parser("send").parse_args(["send", text]).target == [("", float(text))]
    scan = ["scan", "raster", "-o", "s.csv", "--center", text, text]
    assert build_parser("scan").parse_args(scan).center == [float(text)] * 2


def test_a_closed_stdout_is_one_line_where_it_is_needed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["drivers", "--json"], no_stdout=True) == 2
    assert capsys.readouterr().err.startswith("dehyst drivers: --json: stdout is closed; ")
    assert main(["completion", "bash"], no_stdout=True) == 0
    assert not open_closed_streams()
    monkeypatch.setattr(sys, "stdout", None)
    assert open_closed_streams()
    with sys.stdout as stdout:
        print("lost", flush=True)
        assert stdout.name == os.devnull


def test_the_hint_of_run_goes_to_the_daemon_that_it_starts() -> None:
    assert watching(LISTEN) == "dehyst watch"
    assert watching("tcp/127.0.0.1:17931") == "dehyst watch --connect tcp/127.0.0.1:17931"


def test_the_demo_judges_itself() -> None:
    assert compare_errors(0.5, 0.05, 0.0) == (
        0,
        "compensation makes the error 10.0 times smaller",
    )
    code, says = compare_errors(0.5, 0.8, 0.0)
    assert code == 1
    assert "did not make the error smaller" in says
    code, says = compare_errors(0.5, 0.1, 0.17)
    assert code == 0
    assert says.endswith("5.0 times smaller, though 17 % of the samples were late")
    code, says = compare_errors(0.5, 0.3, 0.17)
    assert code == 77
    code, says = compare_errors(0.5, 0.8, 0.17)
    assert code == 77
    assert "too busy to judge: 17 %" in says


def test_an_interrupt_during_the_imports_is_one_line(tmp_path: Path) -> None:
    for delay_s in (0.5, 1.0, 2.0):
        process = subprocess.Popen(
            [sys.executable, "-c", "import sys; from dehyst.daemon.main import main; "
             "print('up', flush=True); sys.exit(main())", "latency", "--no-io"],
            env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        time.sleep(delay_s)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=120.0)
        assert "Traceback" not in said
        assert process.returncode == 130, (delay_s, said)


@pytest.mark.parametrize("delay_s", [0.3, 0.5, 0.7, 0.9, 1.2])
def test_an_interrupt_while_the_bench_starts_leaves_nothing_behind(
    tmp_path: Path, delay_s: float
) -> None:
    listen = f"tcp/127.0.0.1:{free_port()}"
    process = subprocess.Popen(
        [sys.executable, "-c", "import sys; from dehyst.daemon.main import main; "
         "print('up', flush=True); sys.exit(main())", "run", "--listen", listen],
        env=environment() | {"TMPDIR": str(tmp_path)}, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "up\n"
    time.sleep(delay_s)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=120.0)
    assert "Traceback" not in said
    assert process.returncode in (0, 130), said
    assert list(tmp_path.iterdir()) == []
