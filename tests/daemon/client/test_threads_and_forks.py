"""One client used by several threads, and clients in forked processes, against a real daemon."""

import multiprocessing
import os
import subprocess
import sys
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import suppress

import numpy as np
import pytest
from tests.rigs.gateway_bench import ROOT, Bench

from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.client.positioner import Positioner
from dehyst.models.errors import NotNow

INHERITED = "before the process was forked"


def test_one_fresh_client_may_be_used_by_several_threads(shared: Bench) -> None:
    shared.client()
    start = threading.Barrier(8)
    with Client("bench", shared.address) as client:

        def send(value: float) -> None:
            for _ in range(20):
                try:
                    client.send(value)
                    return
                except Refusal as refused:  # the machine stood still while it was on its way
                    if refused.code != "late":
                        raise
            pytest.fail("every set-point was late")

        def work(number: int) -> int:
            start.wait()
            for i in range(20):
                send(4.0 + 0.1 * number)
                client.put(4.0 + 0.01 * i)
                if i % 5 == number % 5:
                    client.renew()
                    client.status()
                    client.history(0.05)
            return number

        with ThreadPoolExecutor(8) as pool:
            assert list(pool.map(work, range(8))) == list(range(8))
        # a set-point that a standstill delays is late, or its lease has ended
        assert client.status().gateway.rejected.keys() <= {"old", "late", "no-lease"}


PROGRAM = """
import multiprocessing as mp, os, sys, threading
from dehyst.client import Client
address, closed, way = sys.argv[1], sys.argv[2] == "closed", sys.argv[3]
parent = Client("bench", address)
stream = parent.stream()
parent.send(4.0)
if closed:
    parent.close()
if way == "locked":  # a thread commands at the very moment
    held = threading.Event()
    def command():
        with parent.commanding:
            held.set()
            threading.Event().wait(3.0)
    threading.Thread(target=command, daemon=True).start()
    held.wait()

def work(out):
    words = []
    for ask in (lambda: parent.send(5.0), parent.status, parent.stop, lambda: parent.put(5.0),
                stream.read, parent.feed):
        try:
            ask()
            words.append("worked")
        except Exception as error:
            words.append(str(error))
    parent.close()
    with Client("bench", address) as own:
        words.append(own.status().state)
        own.take_over()
        own.send(3.5)
    if way == "twice":
        inner = os.fork()
        if not inner:
            with Client("bench", address) as own:
                own.status()
            sys.exit(0)
        words.append(os.waitstatus_to_exitcode(os.waitpid(inner, 0)[1]))
    out.send(words)

here, there = mp.Pipe()
if way == "multiprocessing":
    child = mp.get_context("fork").Process(target=work, args=(there,))
    child.start()
    print(here.recv()); child.join(20.0); print(child.exitcode)
else:
    child = os.fork()
    if not child:
        work(there)
        sys.exit(7)  # by the interpreter's own end, where objects are freed
    print(here.recv()); print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
if not closed:
    print(parent.status().name); parent.close()
"""


def run_program(program: str, *arguments: str) -> list[str]:
    """Run the program in its own process, which must succeed; return the lines that it prints."""
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.parametrize("closed", ["closed", "open"])
@pytest.mark.parametrize("way", ["multiprocessing", "fork", "twice", "locked"])
def test_in_a_forked_child_a_fresh_client_works_and_an_inherited_one_says_so(
    shared: Bench, way: str, closed: str
) -> None:
    shared.client()
    lines = run_program(PROGRAM, shared.address, closed, way)
    words, code, *parent = lines
    assert words.count(INHERITED) == 6
    assert code == ("0" if way == "multiprocessing" else "7")
    assert parent == (["bench"] if closed == "open" else [])


def ask(address: str) -> str:
    with Client("bench", address) as client:
        return client.status().name


def test_a_pool_of_forked_workers(shared: Bench) -> None:
    shared.client()
    context = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(3, mp_context=context) as pool:
        assert list(pool.map(ask, [shared.address] * 6)) == ["bench"] * 6


POSITIONER = """
import os, sys, dehyst
from dehyst.client import Client
make = lambda: Client("bench", sys.argv[1], label="scan")
stage = dehyst.Positioner(make)
stage.go(4.0).result(60)
child = os.fork()
if not child:
    for ask in (lambda: stage.go(5.0), stage.read, stage.stop):
        try:
            ask()
            print("worked")
        except Exception as error:
            print(error)
    stage.close()
    with dehyst.Positioner(make) as own:
        print(own.read().result(60).target)
    sys.stdout.flush()
    sys.exit(7)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
print(stage.go(3.0).result(60).target)
stage.close()
"""


def test_in_a_forked_child_a_fresh_positioner_works_and_an_inherited_one_says_so(
    shared: Bench,
) -> None:
    shared.client().close()
    lines = run_program(POSITIONER, shared.address)
    assert all(INHERITED in line and "make a new Positioner" in line for line in lines[:3])
    assert lines[3:] == ["4.0", "7", "3.0"]


def test_a_positioner_may_be_used_by_several_threads(shared: Bench) -> None:
    shared.client().close()
    with Positioner(lambda: Client("bench", shared.address, label="scan")) as stage:

        def work(number: int) -> float:
            with suppress(NotNow):  # a later thread may have sent it elsewhere
                assert stage.go(3.0 + 0.5 * number).result(60).target == 3.0 + 0.5 * number
            return stage.read(0.05).result(60).target

        with ThreadPoolExecutor(4) as pool:
            assert np.isfinite(list(pool.map(work, range(4)))).all()
        assert stage.go(4.0).result(60).target == 4.0
