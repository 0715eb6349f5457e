"""Another time of day, for those who take it for randomness."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

LATER_S: Final = (1009, 86_413)
"""How much later it may be within `later`: two times, of few possible outcomes two may agree."""
NS: Final = 1_000_000_000


@contextmanager
def later(seconds: int) -> Iterator[None]:
    """Within it `time.time()` and `time.time_ns()` are ahead; who holds the functions isn't led on.

    Clocks that only measure how long something took go on as they are.
    """
    now, now_ns = time.time, time.time_ns
    time.time = lambda: now() + seconds
    time.time_ns = lambda: now_ns() + seconds * NS
    try:
        yield
    finally:
        time.time, time.time_ns = now, now_ns
