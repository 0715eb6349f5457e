"""The command line: one module for each command, found by walking this package.

A module without an underscore is a command: its `command` function takes a `Screen` and the
options that its signature declares, and returns an `Answer`; its docstring is the help text.
"""

from __future__ import annotations

from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command line and returns its exit code.

    0: kept, verified, done. 1: broken, diverged, failed. 2: can't tell, or wrong use.
    130: interrupted.

    Args:
        arguments: those after the program's name; None: this process's.
    """
    from gamekeeper.run.pandas_later import pandas_can_wait

    pandas_can_wait()
    from gamekeeper.cli._app import run_line

    return run_line(arguments)
