"""HTTP server on loopback: one request per connection; silent connections are closed."""

import socketserver
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final

from gamekeeper.viewing.admission import Response, refusal

LOOPBACK: Final = "127.0.0.1"
SILENCE_S: Final = 10.0
"""Time until a silent connection is closed, in seconds."""

BODY_BYTES: Final = 1 << 16

Respond = Callable[[str, str, Any, bytes], Response]
"""Method, target, headers and body to an answer."""


class Connections(ThreadingHTTPServer):
    """Listens on loopback and answers by `respond`, with one thread per connection.

    `serve_forever` serves until another thread calls `shutdown`, or Ctrl-C.
    """

    daemon_threads = True
    block_on_close = False

    def __init__(self, port: int) -> None:
        """Listens from now on; answers once `respond` is set and `serve_forever` runs.

        Args:
            port: 0: a free one.
        Raises:
            OSError: the port is taken, or may not be used.
        """
        self.respond: Respond = _not_ready
        super().__init__((LOOPBACK, port), Connection)

    def server_bind(self) -> None:
        """Binds without asking for this machine's name, which may take seconds."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = self.server_address[:2]  # type: ignore[assignment]  # of IPv4 both are known

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Logs nothing: failures are answered, and a client that left isn't a fault."""


class Connection(BaseHTTPRequestHandler):
    """One connection: one request, one answer; the standard library bounds the request's size."""

    server: Connections
    timeout = SILENCE_S
    server_version = "gamekeeper"
    sys_version = ""
    # For a request that can't be read.
    command = requestline = ""
    request_version = "HTTP/1.0"

    def parse_request(self) -> bool:
        """Tells if the request can be read; HTTP/0.9, which has no headers, is refused."""
        if not super().parse_request():
            return False
        if self.request_version == "HTTP/0.9":
            self.send_error(400, "a request without headers")
            return False
        return True

    def __getattr__(self, name: str) -> Any:
        # All methods have one answer, so that PUT and unknown ones are refused alike.
        if name.startswith("do_"):
            return self._answer
        raise AttributeError(name)

    def _answer(self) -> None:
        length = self.headers.get("Content-Length", "0")
        if not (length.isascii() and length.isdigit() and int(length) <= BODY_BYTES):
            self._send(refusal(413, "the body of a request is too long", actual=length[:20]))
            return
        body = self.rfile.read(int(length))
        self._send(self.server.respond(self.command, self.path, self.headers, body))

    def _send(self, answer: Response) -> None:
        self.close_connection = True
        self.send_response(answer.status)
        for name, value in answer.header_lines().items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(answer.body)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Refuses a request that the standard library can't read, with this server's headers."""
        del explain
        self.request_version = "HTTP/1.0"  # otherwise only the body would be sent
        self._send(refusal(code, (message or "a request that can't be read")[:200]))

    def log_message(self, format: str, *args: Any) -> None:
        """Logs nothing: requests hold a token."""


def _not_ready(method: str, target: str, headers: Any, body: bytes) -> Response:
    return refusal(503, "the server isn't ready yet")
