"""Malicious files are refused in one line with exit status 2, within bounds of time and memory."""

import gzip
import io
import os
import re
import struct
import subprocess
import sys
import time
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.command_line import exit_status
from tests.rigs.gateway_bench import CONFIG, environment
from tests.rigs.stage_model import model_text

GOOD = "t_s,u_v,y_um\n" + "".join(f"{i / 1000},{i % 7},{i % 7}\n" for i in range(100))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("rec.csv").write_text(GOOD)
    Path("model.toml").write_text(model_text())
    return tmp_path


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Run a command that must be refused; return its one line."""
    assert exit_status(list(words)) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert len(said) < 1000
    return said


def changed(key: str, value: str, text: str = "") -> str:
    """Return the model's text with another value for a key."""
    out, count = re.subn(
        rf"(?m)^{key} = (\[[^\]]*\]|.*)$", f"{key} = {value}", text or model_text()
    )
    assert count == 1
    return out


MODELS = {
    "an integer from 1e309": lambda: changed("drive_max_v", "1" + "0" * 400),
    "one of 4400 digits": lambda: changed("drive_max_v", "1" * 4400),
    "the same in hexadecimal": lambda: changed("drive_max_v", "0x" + "f" * 5000),
    "in a list": lambda: changed("weights", "[" + "9" * 500 + "]"),
    "values of 1e300": lambda: changed("drive_max_v", "1e300"),
    "infinity": lambda: changed("drive_max_v", "inf"),
    "a long list": lambda: changed("weights", "[" + "1.0, " * 20_000 + "]"),
    "many blocks": lambda: model_text() + '\n[[blocks]]\nkind = "delay"\nplace = "stage"\n' * 1000,
    "deep arrays": lambda: "x = " + "[" * 100_000,
}


@pytest.mark.parametrize("what", MODELS)
def test_models(what: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("bad.toml").write_text(MODELS[what]())
    assert "bad.toml" in refused(capsys, "simulate", "bad.toml", "rec.csv", "-o", "out.csv")
    assert not Path("out.csv").exists()


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e300", "1" + "0" * 400])
@pytest.mark.parametrize("key", ["sensor.scale", "sensor.zero", "setpoint.origin", "limits.max_v",
                                 "safe.voltage_v", "actuator.gain"])  # fmt: skip
def test_configurations(key: str, value: str, capsys: pytest.CaptureFixture[str]) -> None:
    table, _, name = key.partition(".")
    text = CONFIG.format(run_dir="run", port=7447, cpu=0)
    text = re.sub(rf"(?m)^({table} = \{{.*?)(, {name} = [\d.]+)?\}}$",
                  rf"\1, {name} = {value}}}", text)  # fmt: skip
    text = re.sub(rf"\b{name} = (?!{re.escape(value)})[\d.]+, ?", "", text)
    Path("stage.toml").write_text(text)
    said = refused(capsys, "run", "--check", "stage.toml")
    assert key in said, said


def test_recordings(capsys: pytest.CaptureFixture[str]) -> None:
    with zipfile.ZipFile("nameless.npz", "w") as members:
        members.writestr(".npy", b"")
    refused(capsys, "simulate", "model.toml", "nameless.npz", "-o", "out.csv")
    Path("fast.csv").write_text("t_s,target_um\n" + "".join(f"{i}e-12,1\n" for i in range(50)))
    said = refused(capsys, "invert", "model.toml", "fast.csv", "-o", "u.csv", "--preview", "0.1")
    assert "1e-12 s" in said
    Path("slow.csv").write_text("t_s,target_um\n0,1\n1e9,1\n")
    for period in ("1e-6", "1e-300", "nan", "inf"):
        refused(capsys, "invert", "model.toml", "slow.csv", "-o", "u.csv", "--period", period)
    for value in ("nan", "inf", "1e300"):
        Path("far.csv").write_text(f"t_s,target_um\n0,1\n0.001,{value}\n0.002,1\n")
        refused(capsys, "invert", "model.toml", "far.csv", "-o", "u.csv")
    assert not Path("u.csv").exists()


def test_absurd_names_end_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    long = "m" * 70_000
    refused(capsys, "simulate", long + ".toml", "rec.csv", "-o", "out.csv")
    refused(capsys, "simulate", "model.toml", long + ".csv", "-o", "out.csv")
    refused(capsys, "convert", "rec.csv", long + ".csv")
    refused(capsys, "convert", long + ".npz", "out.csv")
    Path("red.csv").write_text("t_s,\x1b[31mu_v,u_v,y_um\n0,\x1b[2J,1,2\n1,2,3,4\n")
    said = refused(capsys, "simulate", "model.toml", "red.csv", "-o", "out.csv")
    assert "\x1b" not in said


@pytest.mark.parametrize("name", ["token", "type", "key", "attribute"])
def test_an_array_header_that_is_no_python_ends_in_one_line(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A damaged array header is refused in one line. numpy reads the header as a Python literal and
    lets errors of the tokenizer escape."""
    header = {
        "token": b"{'descr': '<f8', 'fortran_order': False, 'shape': (3,",
        "type": b"{'descr': [1, 2], 'fortran_order': False, 'shape': (3,), }",
        "key": b"{'descr': '<f8', [1]: 3, 'fortran_order': False, 'shape': (3,), }",
        "attribute": b"{'descr': ('<f8', {}), 'fortran_order': 1, 'shape': '3', }",
    }[name].ljust(117) + b"\n"
    array = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(24)
    with zipfile.ZipFile("bad.npz", "w") as members:
        members.writestr("t_s.npy", array)
    Path("bad.npy").write_bytes(array)
    for kind in ("npz", "npy"):
        refused(capsys, "convert", f"bad.{kind}", "out.csv")


def test_keys(capsys: pytest.CaptureFixture[str]) -> None:
    make = ("keys", "made", "--controller", "stage", "--host")
    assert "--host" in refused(capsys, *make, "é.com")
    assert "--days" in refused(capsys, *make, "stage.lab", "--days", "999999999")
    assert not Path("made").exists()


def bomb_npz() -> None:
    """Write 2 GiB of zeros, packed once and repeated: a block after a full flush refers to none
    before. The member is written as stored; then both its headers (APPNOTE 4.3.7, 4.3.12) are
    changed to deflated."""
    head, zeros, packer = io.BytesIO(), bytes(8 << 20), zlib.compressobj(1, zlib.DEFLATED, -15)
    array = {"descr": "<f8", "fortran_order": False, "shape": (1 << 28,)}
    np.lib.format.write_array_header_1_0(head, array)
    parts = [packer.compress(b) + packer.flush(zlib.Z_FULL_FLUSH) for b in (head.getvalue(), zeros)]
    packed = parts[0] + 256 * parts[1] + packer.flush()
    check = zlib.crc32(head.getvalue())
    for _ in range(256):
        check = zlib.crc32(zeros, check)
    with zipfile.ZipFile("bomb.npz", "w") as members:
        members.writestr("u_v.npy", packed)
    archive = bytearray(Path("bomb.npz").read_bytes())
    for at in (8, archive.index(b"PK\1\2") + 10):
        struct.pack_into("<H", archive, at, zipfile.ZIP_DEFLATED)
        struct.pack_into("<I", archive, at + 6, check)
        struct.pack_into("<I", archive, at + 14, len(head.getvalue()) + (2 << 30))
    Path("bomb.npz").write_bytes(archive)


def test_the_archive_of_zeros_is_a_whole_one() -> None:
    """The archive of zeros is intact, so that it is refused for its size and not for damage."""
    bomb_npz()
    with zipfile.ZipFile("bomb.npz") as members, members.open("u_v.npy") as member:
        assert members.getinfo("u_v.npy").compress_size < 16 << 20
        assert np.lib.format.read_magic(member) == (1, 0)
        assert np.lib.format.read_array_header_1_0(member)[0] == (1 << 28,)
        assert member.read(1 << 20) == bytes(1 << 20)


def bomb_gz() -> None:
    """Concatenated members are one text, by RFC 1952."""
    block = gzip.compress(b"0,0,0\n" * 100_000)
    Path("bomb.csv.gz").write_bytes(gzip.compress(b"t_s,u_v,y_um\n") + 1500 * block)


def bomb_notes() -> None:
    Path("notes.csv.gz").write_bytes(100 * gzip.compress(b"# x: y\n" * 1_000_000))


HEAVY = {
    "an archive of zeros": (bomb_npz, "simulate model.toml bomb.npz -o out.csv"),
    "a packed text of zeros": (bomb_gz, "simulate model.toml bomb.csv.gz -o out.csv"),
    "notes without end": (bomb_notes, "simulate model.toml notes.csv.gz -o out.csv"),
    "a pipe as a recording": (lambda: os.mkfifo("p.csv"), "simulate model.toml p.csv -o out.csv"),
    "a pipe as a model": (lambda: os.mkfifo("p.toml"), "simulate p.toml rec.csv -o out.csv"),
    "a pipe as a configuration": (lambda: os.mkfifo("p.toml"), "run --check p.toml"),
    "a pipe as credentials": (lambda: os.mkfifo("p"), "send --stop --credentials p"),
    "an endless device": (lambda: None, "simulate /dev/zero rec.csv -o out.csv"),
    "a key of 100 000 parts": (
        lambda: Path("deep.toml").write_text("a" + ".a" * 100_000 + " = 1\n"),
        "simulate deep.toml rec.csv -o out.csv",
    ),
    "the same in quotes": (
        lambda: Path("deep.toml").write_text('"a b"' + '."a b"' * 100_000 + " = 1\n"),
        "run --check deep.toml",
    ),
    "100 000 blocks": (
        lambda: Path("b.toml").write_text(
            model_text() + '\n[[blocks]]\nkind="creep"\nplace="stage"\n' * 100_000
        ),
        "simulate b.toml rec.csv -o out.csv",
    ),
}


@pytest.mark.parametrize("what", HEAVY)
def test_bombs(what: str) -> None:
    make, line = HEAVY[what]
    make()
    with open("said", "wb") as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "dehyst.daemon.main", *line.split()], env=environment(),
            stdin=subprocess.DEVNULL, stderr=said,
        )  # fmt: skip
        end = time.monotonic() + 120.0
        while True:
            pid, status, used = os.wait4(process.pid, os.WNOHANG)
            if pid or time.monotonic() > end:
                break
            time.sleep(0.02)
    if not pid:
        process.kill()
        process.wait()
        pytest.fail("did not end")
    process.returncode = os.waitstatus_to_exitcode(status)
    text = Path("said").read_text()
    assert process.returncode == 2, text
    assert text.count("\n") == 1
    assert used.ru_utime + used.ru_stime < 5.0  # of processor time, imports included
    assert used.ru_maxrss < 1 << 20  # kB
