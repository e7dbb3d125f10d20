"""The pty plumbing, with a unit that repeats what it receives."""

import os
import threading
import time

import pytest

from dehyst.drivers.emulated.pty_device import PtyServer, serve
from dehyst.drivers.interface import DeviceGone, DeviceNotFound, DeviceTimeout, DriverConfigError
from dehyst.drivers.serial_port import SerialPort


class Parrot:
    """A unit that repeats everything at once."""

    def __init__(self) -> None:
        self.heard = b""
        self.losses = 0

    def feed(self, data: bytes) -> None:
        self.heard += data

    def take(self) -> bytes:
        said, self.heard = self.heard, b""
        return said

    def next_due_s(self) -> float | None:
        return None

    def link_lost(self) -> None:
        self.heard = b""
        self.losses += 1

    def set_serial_number(self, number: int) -> None:
        """Ignore the number: this unit has none."""


def read(port: SerialPort, count: int) -> bytes:
    got = b""
    while len(got) < count:
        more = port.read_until_deadline(port._clock() + 5.0)
        assert more, f"only {got!r}"
        got += more
    return got


def test_every_byte_value_comes_through_unchanged(tmp_path):
    everything = bytes(range(256))
    with PtyServer(Parrot(), tmp_path / "port") as server:
        port = SerialPort(server.port)
        port.write(everything)
        assert read(port, 256) == everything
        port.close()


def test_more_than_the_kernel_buffers_comes_through_in_order(tmp_path):
    data = os.urandom(200_000)
    with PtyServer(Parrot(), tmp_path / "port") as server:
        port = SerialPort(server.port, write_timeout_s=5.0)
        writer = threading.Thread(target=port.write, args=(data,))
        writer.start()
        assert read(port, len(data)) == data
        writer.join()
        port.close()


def test_a_client_may_come_and_go(tmp_path):
    with PtyServer(Parrot(), tmp_path / "port") as server:
        for _ in range(3):
            port = SerialPort(server.port)
            port.write(b"hello")
            assert read(port, 5) == b"hello"
            port.close()
            port.close()


def test_unplug_and_plug(tmp_path):
    unit = Parrot()
    with PtyServer(unit, tmp_path / "port") as server:
        port = SerialPort(server.port)
        server.unplug()
        server.unplug()
        assert not server.plugged
        assert unit.losses == 1
        with pytest.raises(DeviceGone):
            port.write(b"x")
        with pytest.raises(DeviceGone):
            port.read_until_deadline(port._clock() + 1.0)
        with pytest.raises(DeviceGone):
            port.read_available()
        port.close()
        with pytest.raises(DeviceNotFound):
            SerialPort(server.port)
        server.plug()
        port = SerialPort(server.port)
        port.write(b"back")
        assert read(port, 4) == b"back"
        port.close()
    assert not os.path.lexists(tmp_path / "port")


def test_a_stalled_port_times_out_the_write_and_recovers(tmp_path):
    with PtyServer(Parrot(), tmp_path / "port") as server:
        port = SerialPort(server.port, write_timeout_s=0.05)
        server.stall_writes(True)
        with pytest.raises(DeviceTimeout):
            port.write(b"lost")
        server.stall_writes(False)
        port.write(b"heard")
        assert read(port, 5) == b"heard"
        port.close()


def test_a_closed_port_reaches_no_file_that_was_opened_after_it(tmp_path):
    with PtyServer(Parrot(), tmp_path / "old") as old, PtyServer(Parrot(), tmp_path / "new") as new:
        closed = SerialPort(old.port)
        closed.close()
        opened = SerialPort(new.port)
        for call in (lambda: closed.write(b"xvoltage=75\r"), closed.read_available):
            with pytest.raises(DeviceGone):
                call()
        opened.write(b"mine")
        assert read(opened, 4) == b"mine"
        opened.close()


def test_a_process_that_was_held_up_does_not_blame_the_unit(tmp_path):
    lost_s = iter([0.0, 3600.0])  # the process is held up between the first look and the second
    with PtyServer(Parrot(), tmp_path / "port") as server:
        port = SerialPort(server.port, clock=lambda: time.monotonic() + next(lost_s, 0.0))
        port.write(b"heard")
        assert read(port, 5) == b"heard"
        assert next(lost_s, None) is None
        port.close()


def test_errors_in_a_called_job_reach_the_caller(tmp_path):
    with PtyServer(Parrot(), tmp_path / "port") as server:
        with pytest.raises(ZeroDivisionError):
            server.call(lambda: 1 // 0)
        assert server.call(threading.get_ident) != threading.get_ident()


def test_two_servers_in_one_thread_and_a_control(tmp_path):
    servers = [PtyServer(Parrot(), tmp_path / name) for name in ("a", "b")]
    stop, heard = threading.Event(), []
    out_of, into = os.pipe()

    def control(data: bytes) -> None:
        heard.append(data)
        if not data:
            stop.set()

    thread = threading.Thread(target=serve, args=(servers, stop, [(out_of, control)]))
    thread.start()
    for server in servers:
        assert server._served.wait(5.0)
        port = SerialPort(server.port)
        port.write(b"hello")
        assert read(port, 5) == b"hello"
        port.close()
    os.write(into, b"a line\n")
    os.close(into)
    thread.join(5.0)
    os.close(out_of)
    assert not thread.is_alive()
    assert b"".join(heard) == b"a line\n"
    for server in servers:
        server.stop()


def test_a_link_that_belongs_to_somebody_else_is_left_alone(tmp_path):
    first = PtyServer(Parrot(), tmp_path / "port").start()
    second = PtyServer(Parrot(), tmp_path / "port").start()
    first.stop()
    port = SerialPort(second.port)
    port.write(b"x")
    assert read(port, 1) == b"x"
    port.close()
    second.stop()


def test_a_baud_rate_that_cannot_be_is_a_setting_error(tmp_path):
    with (
        PtyServer(Parrot(), tmp_path / "port") as server,
        pytest.raises(DriverConfigError),
    ):
        SerialPort(server.port, baud=-1)
