"""The server: connections on loopback, each with bounds on its size, its time and their number."""

from __future__ import annotations

import socket
import socketserver
import threading
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final, Protocol

from gamekeeper.adapters.view.answers import Answer, refusal

LOOPBACK: Final = "127.0.0.1"
HEAD_BYTES: Final = 16 << 10
"""Of a request's line and headers together."""
READ_S: Final = 10.0
"""Until a request's head has arrived, in seconds."""
WRITE_S: Final = 60.0
"""Until an answer has been made and taken, in seconds."""
VISITS: Final = 32
"""At a time; a browser opens six."""
LAST_WORDS_S: Final = 1.0
"""For answers under way when the server is closed, in seconds."""

Respond = Callable[[str, str, Any], Answer]
"""Method, target and headers to an answer."""


class Visits(ThreadingHTTPServer):
    """Listens on loopback and has `respond` answer, one thread a connection.

    `serve_forever` serves until another thread calls `shutdown`, or Ctrl-C.
    """

    daemon_threads = True
    request_queue_size = VISITS

    def __init__(self, port: int) -> None:
        """Listens from now on; answers once `respond` is set and `serve_forever` runs.

        Args:
            port: 0: a free one.
        Raises:
            OSError: the port is taken, or may not be had.
        """
        self.respond: Respond = _not_ready
        self._places = threading.BoundedSemaphore(VISITS)
        self._inside: set[socket.socket] = set()
        self._until: dict[socket.socket, float] = {}
        super().__init__((LOOPBACK, port), Visit)

    def server_bind(self) -> None:
        """Binds without asking for this machine's name, which may take seconds."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = self.server_address[:2]  # type: ignore[assignment]  # of IPv4 both are known

    def process_request(self, request: Any, client_address: Any) -> None:
        """Gives a connection a thread, or says that there are too many."""
        if not self._places.acquire(blocking=False):
            self.shutdown_request(request)
            return
        self._inside.add(request)
        self.allow(request, READ_S)
        try:
            super().process_request(request, client_address)
        except BaseException:  # no thread can be started; or Ctrl-C, while one starts or is done
            self._leave(request)
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answers, in a thread of the connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._leave(request)

    def allow(self, request: socket.socket, seconds: float) -> None:
        """The connection has so long from now on; then it is cut, wherever it is."""
        self._until[request] = time.monotonic() + seconds

    def service_actions(self) -> None:
        """Cuts the connections whose time is over: a byte now and then keeps none open."""
        now = time.monotonic()
        for request, until in list(self._until.items()):
            if until < now:
                self._until.pop(request, None)
                _cut(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Says nothing: whatever can be said was answered, and a visitor who left is no fault."""

    def server_close(self) -> None:
        """Closes, after what is being answered had a moment to end."""
        super().server_close()
        end = time.monotonic() + LAST_WORDS_S
        for _ in range(VISITS):
            if not self._places.acquire(timeout=max(0.0, end - time.monotonic())):
                return

    def _leave(self, request: Any) -> None:
        self._until.pop(request, None)
        try:
            self._inside.remove(request)
        except KeyError:  # it left already: a place is given back once
            return
        self._places.release()


class Visit(BaseHTTPRequestHandler):
    """One connection: one request, one answer."""

    server: Visits
    timeout = READ_S
    server_version = "gamekeeper"
    sys_version = ""
    # of a request that can't be read
    command = requestline = ""
    request_version = "HTTP/1.0"

    def setup(self) -> None:
        """Bounds what is read."""
        super().setup()
        self.rfile = _Bounded(self.rfile, HEAD_BYTES)  # type: ignore[assignment]  # readline is all that is read

    def handle_one_request(self) -> None:
        """Answers the request, or says why it is none."""
        try:
            super().handle_one_request()
        except _TooLongError:
            self._send(refusal(431, f"a request of more than {HEAD_BYTES} bytes"))
        except OSError:
            self.close_connection = True  # the visitor left, or took too long

    def parse_request(self) -> bool:
        """Whether the request can be read; one of HTTP/0.9, which has no headers, can't."""
        if not super().parse_request():
            return False
        if self.request_version == "HTTP/0.9":
            self.send_error(400, "a request without headers")
            return False
        return True

    def __getattr__(self, name: str) -> Any:
        # Methods have one answer, so that a refusal says the same of PUT and of what nobody knows.
        if name.startswith("do_"):
            return self._answer
        raise AttributeError(name)

    def _answer(self) -> None:
        self.server.allow(self.connection, WRITE_S)
        self._send(self.server.respond(self.command, self.path, self.headers))

    def _send(self, answer: Answer) -> None:
        self.close_connection = True
        self.send_response(answer.status)
        for name, value in answer.header_lines().items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(answer.body)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Refuses what the standard library couldn't read, in our words and with our headers."""
        del explain
        self.request_version = "HTTP/1.0"  # otherwise nothing but the body would be sent
        self._send(refusal(code, (message or "a request that can't be read")[:200]))

    def log_message(self, format: str, *args: Any) -> None:
        """Logs nothing: requests hold a token."""


class _TooLongError(Exception):
    pass


class _Lines(Protocol):
    def readline(self, size: int = -1, /) -> bytes: ...

    def close(self) -> None: ...


class _Bounded:
    """A file that is read line by line, up to so many bytes in all."""

    __slots__ = ("_file", "_left")

    def __init__(self, file: _Lines, most: int) -> None:
        self._file, self._left = file, most

    def readline(self, size: int = -1) -> bytes:
        bound = self._left + 1 if size < 0 else min(size, self._left + 1)
        line = self._file.readline(bound)
        self._left -= len(line)
        if self._left < 0:
            raise _TooLongError
        return line

    def close(self) -> None:
        self._file.close()


def _cut(request: socket.socket) -> None:
    try:
        request.shutdown(socket.SHUT_RDWR)
    except OSError:
        return  # it is gone already


def _not_ready(method: str, target: str, headers: Any) -> Answer:
    return refusal(503, "the server isn't ready yet")
