"""The command line: one module for each command, found by walking this package.

A module without an underscore is a command: its `command` function takes a `Screen` and the
options that its signature declares, and returns an `Answer`; its docstring is the help text.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from contextlib import suppress


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command line and returns its exit code.

    0: kept, verified, done. 1: broken, diverged, failed. 2: can't tell, or wrong use.
    130: interrupted.

    Args:
        arguments: those after the program's name; None: this process's.
    """
    try:
        from gamekeeper.run.pandas_later import pandas_can_wait

        pandas_can_wait()
        from gamekeeper.cli._app import run_line

        return run_line(arguments)
    except KeyboardInterrupt:  # while the command line was being made, or was just over
        sys.stderr.write("interrupted\n")
        return 130
    finally:
        if arguments is None:
            _end_at_once()


def _end_at_once() -> None:
    """From here on the process only ends; Ctrl-C ends it now, without a traceback of that."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        with suppress(ValueError):  # in a thread nobody is interrupted
            signal.signal(signal.SIGINT, signal.SIG_DFL)
