"""Texts of an exception that foreign code raised: making them runs its code again."""

import traceback
from types import TracebackType
from typing import Final

from gamekeeper.episodes.canonical.json_text import clean
from gamekeeper.episodes.canonical.opaque import class_name

MESSAGE_CHARS: Final = 2_000
TRACEBACK_CHARS: Final = 200_000


def message(error: BaseException) -> str:
    """The message of an exception, at most `MESSAGE_CHARS` long; never raises."""
    try:
        return cut(str.__str__(str(error)), MESSAGE_CHARS)
    except KeyboardInterrupt:
        raise
    except BaseException as second:
        return f"<no message: its __str__ raised {class_name(type(second))}>"


def said_by(error: BaseException) -> str:
    """The type and the message of an exception; never raises."""
    return f"{class_name(type(error))}: {message(error)}".removesuffix(": ")


def traceback_text(error: BaseException, *, limit: int | None = None) -> str:
    """The traceback as Python prints it, at most `TRACEBACK_CHARS` long; never raises.

    Args:
        limit: frames; the innermost ones where it is negative.
    """
    try:
        text = "".join(traceback.format_exception(error, limit=limit))
    except KeyboardInterrupt:
        raise
    except BaseException:  # attributes that raise when they are looked at
        text = "".join(traceback.format_tb(frames_of(error), limit)) + said_by(error) + "\n"
    return cut(text, TRACEBACK_CHARS)


def frames_of(error: BaseException) -> TracebackType | None:
    """The frames that an exception passed, whatever its class says."""
    return vars(BaseException)["__traceback__"].__get__(error)  # type: ignore[no-any-return]


def cut(text: str, most: int) -> str:
    """Text that UTF-8 carries, of about `most` characters: the middle of a longer one goes."""
    text = clean(text)
    if len(text) <= most:
        return text
    half = most // 2
    return f"{text[:half]}\n[... {len(text) - 2 * half:,} characters left out ...]\n{text[-half:]}"
