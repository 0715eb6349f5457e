"""Serves recorded runs to a browser on this machine, also while they are being recorded."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Final

from gamekeeper.adapters.view.admission import Admission
from gamekeeper.adapters.view.routes import Routes
from gamekeeper.adapters.view.shelf import Shelf
from gamekeeper.adapters.view.visits import Visits
from gamekeeper.errors import GamekeeperError

TOKEN_BYTES: Final = 32
POLL_S: Final = 0.25
"""Between two looks at connections whose time is over, in seconds."""


class View:
    """Runs on show under `url`, from construction until `close`.

    As a context manager it answers in a thread of its own; `serve` answers in the caller's.
    """

    def __init__(self, runs: Sequence[str | PathLike[str]], *, port: int = 0) -> None:
        """Reads the runs and takes the port.

        Args:
            runs: their folders; the first is `a` on the page, and so on.
            port: on 127.0.0.1; 0: a free one.
        Raises:
            BundleError: one of them is no bundle, or is damaged.
            GamekeeperError: the port is taken.
        """
        shelf = Shelf([Path(run) for run in runs])
        try:
            self._visits = Visits(port)
        except OSError as error:
            raise GamekeeperError(
                f"port {port} can't be had: {error.strerror or error}",
                where="--port",
                mend="name another one, or none: a free one is taken then",
            ) from error
        self.port: int = self._visits.server_port
        admission = Admission(self.port, secrets.token_urlsafe(TOKEN_BYTES))
        self.url: str = admission.url
        self._visits.respond = Routes(admission, shelf)
        self._thread: threading.Thread | None = None

    def serve(self) -> None:
        """Answers until another thread closes it, or Ctrl-C."""
        self._visits.serve_forever(poll_interval=POLL_S)

    def close(self) -> None:
        """Answers no more; the port is free."""
        if self._thread is not None:
            self._visits.shutdown()
            self._thread.join()
            self._thread = None
        self._visits.server_close()

    def __enter__(self) -> View:
        self._thread = threading.Thread(target=self.serve, name="gamekeeper-view", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
