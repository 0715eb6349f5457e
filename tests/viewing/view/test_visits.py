"""Connections have bounds: on their size, their time and their number."""

import socket
from contextlib import ExitStack
from pathlib import Path

import pytest

from gamekeeper.errors import GamekeeperError
from gamekeeper.viewing import connections
from gamekeeper.viewing.viewer import Viewer
from tests.viewing.view.visiting import PATIENCE_S, Visitor, reply_of


def test_long_heads_are_refused(visitor: Visitor) -> None:
    """In one header, in many, or in the address."""
    assert visitor.get("/index.json", X_Long="x" * (1 << 16)).status == 431
    many = {f"X-{number}": "x" for number in range(110)}
    assert visitor.get("/index.json", **many).status == 431
    assert visitor.get("/" + "x" * (1 << 16)).status == 414
    assert visitor.get("/index.json").status == 200


@pytest.mark.parametrize(
    "data",
    [
        b"\r\n\r\n",
        b"GET\r\n\r\n",
        b"GET / x\r\n\r\n",
        b"\0\xff\xfe\r\n\r\n",
        b"GET /\r\n\r\n",
        b"<script> x HTTP/1.0\r\n\r\n",
        b"",
    ],
)
def test_what_is_no_request_is_refused_or_left(visitor: Visitor, data: bytes) -> None:
    """Without a fault, and without an echo that a browser might take for a page."""
    with socket.create_connection(("127.0.0.1", visitor.port), PATIENCE_S) as connection:
        connection.sendall(data)
        connection.shutdown(socket.SHUT_WR)
        reply = reply_of(connection)
    assert reply.status in (0, 400, 403, 421)
    assert reply.headers.get("content-type") in (None, "application/json")
    assert visitor.get("/index.json").status == 200


def test_silent_visitors_are_let_go(line: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many there are, they keep nobody out."""
    monkeypatch.setattr(connections.Connection, "timeout", 0.3)
    with Viewer([line]) as view, ExitStack() as idle:
        held = [
            idle.enter_context(socket.create_connection(("127.0.0.1", view.port), PATIENCE_S))
            for _ in range(40)
        ]
        assert Visitor(view).get("/index.json").status == 200
        assert all(connection.recv(1) == b"" for connection in held)


def test_server_listens_on_one_address_alone(visitor: Visitor) -> None:
    """Not on all of this machine's, of which 127.0.0.2 would be one."""
    with pytest.raises(OSError, match=r"."):
        socket.create_connection(("127.0.0.2", visitor.port), PATIENCE_S)


def test_port_that_is_taken_is_said(line: Path, visitor: Visitor) -> None:
    """With what to do."""
    with pytest.raises(GamekeeperError, match=r"(?s)port \d+ can't be used.*give another"):
        Viewer([line], port=visitor.port)


def test_closed_view_leaves_its_port(line: Path) -> None:
    """It can be had again at once."""
    with Viewer([line]) as view:
        port = view.port
    with Viewer([line], port=port) as again:
        assert again.port == port
