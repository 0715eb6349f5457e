"""Connections have bounds: on their size, their time and their number."""

from __future__ import annotations

import socket
import socketserver
import threading
from pathlib import Path

import pytest

from gamekeeper.adapters.view import visits
from gamekeeper.adapters.view.view import View
from gamekeeper.errors import GamekeeperError
from tests.adapters.view.visiting import PATIENCE_S, Visitor, reply_of


def test_long_heads_are_refused(visitor: Visitor) -> None:
    """In one header, in many, or in the address."""
    assert visitor.get("/index.json", X_Long="x" * visits.HEAD_BYTES).status == 431
    many = {f"X-{number}": "x" * 300 for number in range(90)}
    assert visitor.get("/index.json", **many).status == 431
    assert visitor.get("/" + "x" * visits.HEAD_BYTES).status == 431
    assert visitor.get("/index.json").status == 200


@pytest.mark.parametrize(
    "data",
    [b"\r\n\r\n", b"GET\r\n\r\n", b"GET / x\r\n\r\n", b"\0\xff\xfe\r\n\r\n", b"GET /\r\n\r\n",
     b"<script> x HTTP/1.0\r\n\r\n", b""],
)  # fmt: skip
def test_what_is_no_request_is_refused_or_left(visitor: Visitor, data: bytes) -> None:
    """Without a fault, and without an echo that a browser might take for a page."""
    with socket.create_connection(("127.0.0.1", visitor.port), PATIENCE_S) as connection:
        connection.sendall(data)
        connection.shutdown(socket.SHUT_WR)
        reply = reply_of(connection)
    assert reply.status in (0, 400, 403, 421)
    assert reply.headers.get("content-type") in (None, "application/json")
    assert visitor.get("/index.json").status == 200


def test_slow_visitors_are_cut(line: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever sends a byte now and then holds a connection no longer than one who sends none."""
    monkeypatch.setattr(visits, "READ_S", 0.3)
    with View([line]) as view, socket.create_connection(("127.0.0.1", view.port)) as connection:
        connection.settimeout(0.1)
        sent = 0
        while sent < 1_000:
            try:
                connection.sendall(b"G")
                sent += 1
                if not connection.recv(1):
                    break
            except TimeoutError:
                continue
            except OSError:
                break
        assert 0 < sent < 1_000


def test_many_connections_leave_room_once_they_are_gone(line: Path) -> None:
    """More than have a place are turned away; after them the server answers as before."""
    with View([line]) as view:
        held = [
            socket.create_connection(("127.0.0.1", view.port), PATIENCE_S)
            for _ in range(visits.VISITS)
        ]
        with socket.create_connection(("127.0.0.1", view.port), PATIENCE_S) as one_more:
            assert one_more.recv(1) == b""
        for connection in held:
            connection.shutdown(socket.SHUT_WR)
            assert reply_of(connection).status == 0
            connection.close()
        assert Visitor(view).get("/index.json").status == 200


def test_server_listens_on_one_address_alone(visitor: Visitor) -> None:
    """Not on all of this machine's, of which 127.0.0.2 would be one."""
    with pytest.raises(OSError, match=r"."):
        socket.create_connection(("127.0.0.2", visitor.port), PATIENCE_S)


def test_port_that_is_taken_is_said(line: Path, visitor: Visitor) -> None:
    """With what to do."""
    with pytest.raises(GamekeeperError, match=r"(?s)port \d+ can't be had.*name another"):
        View([line], port=visitor.port)


def test_closed_view_leaves_its_port(line: Path) -> None:
    """It can be had again at once."""
    with View([line]) as view:
        port = view.port
    with View([line], port=port) as again:
        assert again.port == port


def test_interrupt_ends_it_while_a_thread_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the visit was over before the thread that started it was interrupted."""

    def started_and_interrupted(self: visits.Visits, request: socket.socket, who: object) -> None:
        self.process_request_thread(request, who)
        raise KeyboardInterrupt

    monkeypatch.setattr(socketserver.ThreadingMixIn, "process_request", started_and_interrupted)
    server = visits.Visits(0)
    given_up = threading.Timer(PATIENCE_S, server.shutdown)
    given_up.start()
    with socket.create_connection(("127.0.0.1", server.server_port)) as visit:
        visit.sendall(b"GET / HTTP/1.1\r\n\r\n")
        with pytest.raises(KeyboardInterrupt):
            server.serve_forever()
    given_up.cancel()
    server.server_close()
