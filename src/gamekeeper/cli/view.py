"""`gamekeeper view RUN`: every episode of a run in the browser, also while it is recorded."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from gamekeeper.cli._screen import Answer, Screen

if TYPE_CHECKING:
    from gamekeeper.adapters.view.view import View

ORDER: Final = 96

RunsArgument = Annotated[
    list[Path],
    typer.Argument(
        metavar="RUN", show_default=False, help="Folders of recorded evidence; two to compare."
    ),
]
PortOption = Annotated[
    int, typer.Option("--port", metavar="N", min=0, max=65_535, help="0: a free one.")
]
BrowserOption = Annotated[
    bool,
    typer.Option("--browser/--no-browser", help="Open it; only on a terminal with a display."),
]


def command(
    screen: Screen,
    runs: RunsArgument,
    port: PortOption = 0,
    browser: BrowserOption = True,
) -> Answer:
    """Shows every episode of a run in the browser, and the run as it grows.

    Served on this machine alone, to whoever has the address with its token, until Ctrl-C. A run
    that is still being recorded is read again as it grows. For a file to send to somebody, see
    `gamekeeper report`.
    """
    from gamekeeper.adapters.view.view import View

    view = View(runs, port=port)
    try:
        _announce(screen, view, runs, browser=browser)
        view.serve()
    except KeyboardInterrupt:
        screen.note("closed")  # Ctrl-C is how this ends, so that it is no failure
    finally:
        view.close()
    if screen.is_json:
        raise SystemExit(0)  # its document was said at the start, when it was of use
    return Answer()


def _announce(screen: Screen, view: View, runs: list[Path], *, browser: bool) -> None:
    document: dict[str, Any] = {"url": view.url, "port": view.port, "runs": [str(r) for r in runs]}
    screen.document(document)
    screen.show(f"View  {view.url}")
    screen.note("Ctrl-C ends it")
    if "SSH_CONNECTION" in os.environ:
        screen.note(f"from your own machine: ssh -N -L {view.port}:127.0.0.1:{view.port} THIS-HOST")
    elif browser and not screen.is_json and is_at_terminal(screen) and _has_display():
        open_browser(view.url)


def is_at_terminal(screen: Screen) -> bool:
    """Whether somebody reads what is shown, rather than a program."""
    return screen.out.isatty()


def open_browser(url: str) -> None:
    """Opens an address in the browser, which may take its time."""
    import webbrowser

    threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()


def _has_display() -> bool:
    """Without one, what opens is a browser in this very terminal."""
    if os.name == "nt" or sys.platform == "darwin":
        return True
    return any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))
