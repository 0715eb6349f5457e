"""A reproducer in a process of its own; loads nothing, as a stranger's process wouldn't either."""

import os
import sys
from collections.abc import Callable
from typing import Any, Final

FILE: Final = "<reproducer>"
NUMPY_TESTING: Final = f"numpy{os.sep}testing"
LIBRARIES: Final = tuple(
    f"{os.sep}{name}{os.sep}" for name in ("numpy", "gymnasium", f"pettingzoo{os.sep}utils")
)
"""Parts of the paths of code that raises for another."""


def is_of_library(file: str) -> bool:
    """Tells whether a file is of a library that raises for the environment's own code."""
    return any(part in file for part in LIBRARIES)


def raised_at(error: BaseException) -> str:
    """File and line that raised it; empty for the program itself, or NumPy's assertion in it.

    Where a library raised it, those of the code that called it, unless that is the program.
    """
    places, at = [], error.__traceback__
    while at is not None:
        places.append((at.tb_frame.f_code.co_filename, at.tb_lineno))
        at = at.tb_next
    if places and NUMPY_TESTING in places[-1][0]:
        while places and (
            NUMPY_TESTING in places[-1][0] or places[-1][0].endswith("contextlib.py")
        ):
            places.pop()
    if not places or places[-1][0] == FILE:
        return ""
    start = max((place for place, each in enumerate(places) if each[0] == FILE), default=-1)
    own = [each for each in places[start + 1 :] if not is_of_library(each[0])]
    file, line = own[-1] if own else places[-1]
    return f"{file}:{line}"


def run_program(report: Callable[..., None], *, program: str) -> dict[str, Any]:
    """Runs a program in this process, which was started for it.

    Returns:
        `raised`: name of the exception's class, None where the program came to its end; `text`: its
        message; `at`: file and line that raised it, empty where that is the program's own; `told`:
        the exception of the environment's that it shows, caught or not, empty where there is none.
    """
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):  # what it prints, five times over, is of no use to anybody
        os.dup2(nowhere, stream)
    sys.argv, sys.orig_argv = ["-c"], [sys.executable, "-c", program]  # it may start itself again
    sys.path.insert(0, "")  # as `python -c` has it
    names = sys.modules["__main__"].__dict__
    try:
        exec(compile(program, FILE, "exec"), names)  # the audit has run this environment already
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever it raises is the answer
        place = raised_at(error)
        name, text = type(error).__name__, str(error)[:500]
        shown = error.args[0] if error.args and not place else None  # of `assert error is None`
        told = f"{type(shown).__name__}: {text}" if isinstance(shown, BaseException) else ""
        told = f"{name}: {text}".removesuffix(": ") if place else told
        return {"raised": name, "text": text, "at": place, "told": told}
    return {"raised": None, "text": "", "at": "", "told": ""}
