"""The command line: one module for each command, found by walking this package.

A module without an underscore is a command: its `command` function takes a `Screen` and the
options that its signature declares, and returns a `CommandResult`; its docstring is the help text,
and says under `Args` how each option is typed (see `_options`).
"""

import signal
import sys
from collections.abc import Sequence
from contextlib import suppress


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command line and returns its exit code.

    0: passed, verified, done. 1: failed, diverged. 2: can't tell, or wrong use.
    130: interrupted.

    Args:
        arguments: those after the program's name; None: this process's.
    """
    try:
        from gamekeeper.import_guard import guarded
        from gamekeeper.rollouts.pandas_later import pandas_can_wait

        pandas_can_wait()
        with guarded():  # commands to which the user names code lift it
            from gamekeeper.cli._app import run_line

            return run_line(arguments)
    except KeyboardInterrupt:  # while the command line was being made, or was just over
        sys.stderr.write("interrupted\n")
        return 130
    finally:
        if arguments is None:
            _end_at_once()


def _end_at_once() -> None:
    """Lets Ctrl-C end the process at once, without a traceback: from here on it only ends."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        with suppress(ValueError):  # a thread isn't interrupted
            signal.signal(signal.SIGINT, signal.SIG_DFL)
