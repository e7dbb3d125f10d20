"""What is reported of a stop and of an end is what the output does, also if a device or the loop's
process was away meanwhile. Real processes and ptys; the amplifier's own report is the evidence."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.rigs.processes import dehyst, until
from tests.rigs.service import HIGH_UM, SAFE_V, Service

from dehyst.daemon.loop.step_kernel import STOP_GRACE_NS
from dehyst.daemon.rings.records import State
from dehyst.drivers.emulated.control import ask


@pytest.fixture
def holding(tmp_path: Path, model: Path) -> Iterator[Service]:
    """`dehyst run` that leaves the output where it is after a fault."""
    service = Service(tmp_path, model, **{'on_fault = "ramp"': 'on_fault = "hold"'})
    try:
        yield service
    finally:
        service.close()


def high(service: Service) -> float:
    """Drive the stage up as a client does; return the output then."""

    def there() -> float:
        client.send(HIGH_UM)
        volts = service.output()
        return volts if volts > 60.0 else 0.0

    with service.client() as client:
        client.wait_until_started()
        return float(until(there, 60.0, "the output is high"))


def stop(service: Service) -> str:
    """Run `dehyst send --stop`; return what it prints."""
    address = f"tcp/127.0.0.1:{service.port}"
    process = dehyst("send", "--stop", "--connect", address)
    _, said = process.communicate(timeout=60.0)
    assert process.returncode == 0, said
    return said


def test_a_stop_during_a_fault_ramps_the_output_when_the_amplifier_is_back(
    holding: Service,
) -> None:
    holding.start()
    high_v = high(holding)
    ask(holding.bench.ports["control"], {"fault": "unplug"})
    until(lambda: holding.rings.state() is State.FAULT, 20.0, "the fault is noticed")
    said = stop(holding)
    assert "once it is back, holds the output for 0.5 s, then ramps to 5 V" in said
    assert holding.rings.state() is State.FAULT
    assert holding.output() >= high_v - 1.0
    ask(holding.bench.ports["control"], {"clear": True})
    until(lambda: holding.output() == pytest.approx(SAFE_V, abs=0.02), 60.0, "it is safe")
    until(lambda: holding.rings.state() is State.READY, 20.0, "the ramp is over")


def test_a_stop_that_moves_nothing_says_so(holding: Service) -> None:
    """After a fault with on_fault = "hold" the output is high in the state ready."""
    holding.start()
    high(holding)
    ask(holding.bench.ports["control"], {"fault": "unplug", "for_s": 0.5})
    until(lambda: holding.rings.state() is State.FAULT, 20.0, "the fault is noticed")
    until(lambda: holding.rings.state() is State.READY, 60.0, "the amplifier is back")
    volts = holding.output()
    said = stop(holding)
    assert "nothing moves, so the output stays at" in said
    assert "--release ramps it to 5 V" in said
    assert holding.output() == pytest.approx(volts, abs=0.02)


def test_a_core_that_was_suspended_as_the_daemon_ended_ramps_after_it(service: Service) -> None:
    service.start()
    assert service.high() > 60.0
    core = service.core_pid()
    os.kill(core, signal.SIGSTOP)
    assert service.supervisor is not None
    service.supervisor.send_signal(signal.SIGTERM)
    time.sleep(1.0 + STOP_GRACE_NS * 1e-9)  # longer than the ramp and the margin
    os.kill(core, signal.SIGCONT)
    assert service.supervisor.wait(60.0) == 0, service.words()
    assert service.output() == pytest.approx(SAFE_V, abs=0.02), service.words()
    assert "ending: the output ramps to 5 V at 200 V/s" in service.words()
    assert "the loop ends with the output at 5 V" in service.words()


def test_a_core_that_died_is_reported_with_what_follows(holding: Service) -> None:
    holding.start()
    assert holding.high() > 60.0
    os.kill(holding.core_pid(), signal.SIGKILL)
    said = 'core ended with code -9: the output stays where it is (safe.on_fault = "hold")'
    until(lambda: said in holding.words(), 20.0, said)
