"""The options that are set on the sockets of this process, among files that are not sockets."""

import os
import socket

from dehyst.daemon.bus.unread import end_unread_connections


def test_listeners_hand_the_limit_on_and_no_descriptor_is_left_open() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, open(os.devnull, "rb"):
        before = len(os.listdir("/proc/self/fd"))
        for _ in range(5):
            end_unread_connections(1234)
        assert len(os.listdir("/proc/self/fd")) == before
        with socket.create_connection(server.getsockname()) as client:
            accepted, _ = server.accept()
            with accepted:
                name = (socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)
                assert accepted.getsockopt(*name) == 1234
                assert client.getsockopt(*name) == 0
