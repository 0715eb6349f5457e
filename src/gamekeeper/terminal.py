"""Text for standard error, made safe: quotes of foreign code can't control the terminal."""

from __future__ import annotations

import os
import sys
from contextlib import suppress


def visible(text: str) -> str:
    """Writes out control characters, so that a terminal doesn't obey an agent's name.

    Ends of lines and tabs stay; halves of surrogate pairs, which streams refuse, are written out.
    """
    return "\n".join(map(_visible_line, text.split("\n")))


def say(text: str) -> None:
    """Writes text to standard error, also where an environment closed or replaced the stream."""
    lines = f"{visible(text).rstrip()}\n"
    try:
        sys.stderr.write(lines)
        sys.stderr.flush()
    except KeyboardInterrupt:
        raise
    except BaseException:  # the stream is foreign code, too
        with suppress(OSError):
            os.write(2, lines.encode())


def _visible_line(line: str) -> str:
    if line.isprintable():
        return line
    return "".join(
        sign if sign.isprintable() or sign == "\t" else f"\\u{ord(sign):04x}" for sign in line
    )
