"""Unit, reach and model are those of the core that runs, in every order of restarts.

Real core, real gateway, real client. The model in nm is the one in um with a thousand times the
displacement: if the two are confused, a set-point of 5 is off by that factor.
"""

import signal
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from tests.rigs.gateway_bench import answering, follows, free_port, wait_until, wait_until_heard
from tests.rigs.processes import dehyst, end, simulated_config
from tests.rigs.stage_model import kept_model

from dehyst.daemon import clock
from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.files.models import load_model, save_model


class Pair:
    """A core and a gateway, each started and ended by hand."""

    def __init__(self, folder: Path) -> None:
        self.model = folder / "model.toml"
        self.port = free_port()
        self.config = simulated_config(folder, 200.0, self.model)
        self.text = f'bus = {{listen = ["tcp/127.0.0.1:{self.port}"]}}\n' + self.config.read_text()
        self.running: dict[str, subprocess.Popen[str]] = {}
        self.use("um")

    def use(self, unit: str) -> None:
        """Write the model and the sensor's scale in this unit to the files."""
        model = kept_model()
        if unit == "nm":
            h = model.hysteresis
            model = replace(model, displacement_unit="nm", hysteresis=replace(h, c=1000.0 * h.c))
        save_model(model, self.model)
        scale = {"um": 1.0, "nm": 1000.0}[unit]
        self.config.write_text(self.text.replace("[sensor]", f"[sensor]\nscale = {scale}"))

    def start(self, name: str) -> None:
        self.running[name] = dehyst(name, "--config", str(self.config))

    def kill(self, name: str, number: int = signal.SIGKILL) -> None:
        process = self.running.pop(name)
        process.send_signal(number)
        process.communicate(timeout=30)

    def client(self) -> Client:
        return answering(self.port)

    def close(self) -> None:
        for process in self.running.values():
            end(process)


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[Pair]:
    pair = Pair(tmp_path)
    try:
        yield pair
    finally:
        pair.close()


def check(client: Client, unit: str) -> None:
    """Check that everything is reported in this unit and that commands in the other one are
    refused."""
    wait_until("the loop is past its start", lambda: follows(client), 120.0)
    client._unit = ""  # query it again
    status = client.status()
    stroke = {"um": 1.0, "nm": 1000.0}[unit]
    assert status.unit == unit
    assert 10 * stroke < status.reach_max < 100 * stroke
    assert client.model().displacement_unit == unit
    stream = client.stream()
    assert stream.read(60.0).size  # the loop may load its kernels first
    assert stream.unit == unit
    stream.close()
    client.send(5.0 * stroke)
    client._unit = {"um": "nm", "nm": "um"}[unit]  # a client that still has the previous run's unit
    with pytest.raises(Refusal, match=f"takes '{unit}'"):
        client.send(5.0)
    client._unit = ""


@pytest.mark.parametrize("first", ["core", "gateway", "gateway stays"])
def test_another_unit_after_a_stop(pair: Pair, first: str) -> None:
    pair.start("core")
    pair.start("gateway")
    with pair.client() as client:
        check(client, "um")
        pair.kill("core", signal.SIGTERM)
        pair.use("nm")
        if first == "gateway stays":
            pair.start("core")
            wait_until("the new run", lambda: client.status().unit == "nm", 120.0)
            check(client, "nm")
            return
    pair.kill("gateway")
    over_ns = clock.wall_ns()
    pair.start(first)
    if first == "gateway":
        with pair.client() as client:  # until the core starts, the status is that of the old run
            assert not client.status().core_alive
            wait_until("the old rings", lambda: client.status().unit == "um", 30.0)
            assert all(event.wall_ns > over_ns for event in client.events())
            with pytest.raises(Refusal, match="does not run"):
                client.send(5.0)
            pair.start("core")
            wait_until("the new run", lambda: client.status().unit == "nm", 120.0)
            check(client, "nm")
    else:
        pair.start("gateway")
        with pair.client() as client:
            wait_until("the new run", lambda: client.status().unit == "nm", 120.0)
            check(client, "nm")
            events = client.events()
            assert any("the loop runs" in event.text for event in events)
            assert all(event.wall_ns > over_ns for event in events)


def test_another_unit_after_a_refused_reload_and_a_death(pair: Pair) -> None:
    pair.start("core")
    pair.start("gateway")
    with pair.client() as client:
        check(client, "um")
        feed = client.feed()
        wait_until_heard(feed)
        pair.use("nm")
        pair.running["core"].send_signal(signal.SIGHUP)

        def refused() -> bool:
            return any("reload refused" in event.text for event in feed.events)

        wait_until("the refusal", refused, 30.0)
        check(client, "um")
        pair.kill("core")
        pair.start("core")
        wait_until("the new run", lambda: client.status().unit == "nm", 120.0)
        check(client, "nm")


def test_a_reload_is_reported_with_its_model(pair: Pair) -> None:
    pair.start("core")
    pair.start("gateway")
    with pair.client() as client:
        check(client, "um")
        model = load_model(pair.model)
        bigger = replace(model.hysteresis, c=1.5 * model.hysteresis.c)
        before = client.status().reach_max
        save_model(replace(model, hysteresis=bigger), pair.model)
        pair.running["core"].send_signal(signal.SIGHUP)
        wait_until("the reach", lambda: client.status().reach_max > 1.4 * before, 30.0)
        assert client.model().hysteresis.c == pytest.approx(bigger.c)
