"""A visitor who can send what no browser would."""

import json
import socket
from dataclasses import dataclass
from typing import Any

from gamekeeper.viewing.viewer import Viewer

PATIENCE_S = 30.0


@dataclass(frozen=True, slots=True)
class Reply:
    """What came back."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def document(self) -> Any:
        """Its JSON."""
        return json.loads(self.body)


class Visitor:
    """Visits one view, with its token unless told otherwise."""

    def __init__(self, view: Viewer) -> None:
        self.port = view.port
        self.token = view.url.partition("token=")[2]

    def get(self, target: str, *, method: str = "GET", **headers: str | None) -> Reply:
        """Asks as a page of ours does; a header that is None isn't sent."""
        usual: dict[str, str | None] = {
            "Host": f"127.0.0.1:{self.port}",
            "Cookie": f"gamekeeper-{self.port}={self.token}",
            "Sec-Fetch-Site": "same-origin",
        }
        usual |= {name.replace("_", "-"): value for name, value in headers.items()}
        lines = [f"{name}: {value}" for name, value in usual.items() if value is not None]
        return self.send("\r\n".join([f"{method} {target} HTTP/1.1", *lines, "", ""]).encode())

    def order(self, target: str, order: object, **headers: str | None) -> Reply:
        """Posts an order as a page of ours does; a header that is None isn't sent."""
        body = json.dumps(order).encode()
        usual: dict[str, str | None] = {
            "Host": f"127.0.0.1:{self.port}",
            "Cookie": f"gamekeeper-{self.port}={self.token}",
            "Sec-Fetch-Site": "same-origin",
            "Origin": f"http://127.0.0.1:{self.port}",
            "Content-Type": "application/json",
            "Content-Length": str(len(body)),
        }
        usual |= {name.replace("_", "-"): value for name, value in headers.items()}
        lines = [f"{name}: {value}" for name, value in usual.items() if value is not None]
        return self.send("\r\n".join([f"POST {target} HTTP/1.1", *lines, "", ""]).encode() + body)

    def send(self, data: bytes) -> Reply:
        """Sends these bytes and reads until the server closes."""
        with socket.create_connection(("127.0.0.1", self.port), PATIENCE_S) as connection:
            connection.sendall(data)
            return reply_of(connection)


def reply_of(connection: socket.socket) -> Reply:
    """What a connection holds until it is closed."""
    data = b""
    while part := connection.recv(1 << 16):
        data += part
    head, _, body = data.partition(b"\r\n\r\n")
    first, *lines = head.decode("latin-1").split("\r\n")
    headers = {name.lower(): value for name, _, value in (line.partition(": ") for line in lines)}
    return Reply(int(first.split()[1]) if first else 0, headers, body)
