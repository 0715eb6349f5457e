"""`gamekeeper view RUN`: every episode of a run in the browser, also while it is recorded."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from gamekeeper.cli._options import Accepted, Count
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.errors import GamekeeperError

if TYPE_CHECKING:
    from gamekeeper.diagnosis.play_on import PlayOnOptions
    from gamekeeper.viewing.viewer import Viewer

ORDER: Final = 98
STACK_BYTES: Final = 1 << 20
BUDGET: Final = 1_000_000
SILENCE_S: Final = 60.0
"""As `play_on` has them; importing that loads numpy, help doesn't."""


def command(
    screen: Screen,
    runs: list[Path],
    port: Annotated[int, Accepted(0, 65535)] = 0,
    browser: bool = True,
    interactive: bool = False,
    try_: list[str] | None = None,
    policy: list[str] | None = None,
    budget: Count = BUDGET,
    timeout: float = SILENCE_S,
    allow_import: bool = False,
) -> CommandResult:
    """Shows every episode of a run in the browser, also while it is being recorded.

    Serves the page on this machine only, under an address with a secret token, until Ctrl-C.
    `gamekeeper report` writes a file that can be sent to others. With --interactive the page can
    play on from any turn: one future on the recorded draws, or many on fresh ones.

    Example: gamekeeper view runs/warehouse-1

    Args:
        runs (RUN): Folders of recorded runs; two to compare.
        port (--port N): Port of the page; 0: a free one.
        browser (--browser/--no-browser): Open the browser, if this is a terminal with a display.
        interactive (--interactive): Let the page play on from a turn, with one agent's action or
            policy changed: runs the environment and the policies that the run names, as replay
            does.
        try_ (--try POLICY): With --interactive, a policy that the page offers beside the run's, the
            environment's and the built-in ones. Repeatable (default: none).
        budget (--budget STEPS): With --interactive, the number of env steps after which no future
            begins.
    """
    options = _play_on(interactive, try_, policy, budget, timeout, allow_import)
    # Arrow's own allocator reserves a gigabyte of addresses, and a thread's stack eight megabytes.
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    threading.stack_size(STACK_BYTES)
    from gamekeeper.viewing.viewer import Viewer

    view = Viewer(runs, port=port, interactive=options)
    try:
        _announce(screen, view, runs, browser=browser)
        view.serve()
    except KeyboardInterrupt:
        screen.note("closed")  # Ctrl-C is how this ends, so that it is no failure
    finally:
        view.close()
    if screen.is_json:
        raise SystemExit(0)  # its document was said at the start, when it was of use
    return CommandResult()


def _play_on(
    interactive: bool,
    try_: list[str] | None,
    policy: list[str] | None,
    budget: int,
    timeout: float,
    allow_import: bool,
) -> PlayOnOptions | None:
    """Consent and limits of playing on; None: the page only shows.

    Raises:
        GamekeeperError: an option that only playing on has was given without it.
    """
    if not interactive:
        if try_ or policy or allow_import:
            raise GamekeeperError(
                "without --interactive no code of a run is run",
                where="--try, --policy, --allow-import",
                fix="add --interactive",
            )
        return None
    from gamekeeper.diagnosis.play_on import PlayOnOptions
    from gamekeeper.interface.policy import parse_choices

    return PlayOnOptions(
        allow_import=allow_import,
        tried=tuple(try_ or ()),
        policies=parse_choices(policy or ()),
        budget=budget,
        silence_s=timeout,
    )


def _announce(screen: Screen, view: Viewer, runs: list[Path], *, browser: bool) -> None:
    document: dict[str, Any] = {"url": view.url, "port": view.port, "runs": [str(r) for r in runs]}
    screen.document(document)
    screen.show(f"View  {view.url}")
    screen.note("Ctrl-C ends it")
    if "SSH_CONNECTION" in os.environ:
        screen.note(f"from your own machine: ssh -N -L {view.port}:127.0.0.1:{view.port} THIS-HOST")
    elif browser and not screen.is_json and is_at_terminal(screen) and has_display():
        open_browser(view.url)


def is_at_terminal(screen: Screen) -> bool:
    """Tells if the output goes to a terminal, not to a program."""
    return screen.out.isatty()


def open_browser(url: str) -> None:
    """Opens an address in the browser, which may take its time."""
    import webbrowser

    threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()


def has_display() -> bool:
    """Tells if there is a display; without one, a browser would open in this very terminal."""
    if os.name == "nt" or sys.platform == "darwin":
        return True
    return any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))
