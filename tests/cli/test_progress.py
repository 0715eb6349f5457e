"""Progress on narrow terminals: the times stay, other parts are shortened."""

import io
import re

import pytest
from rich.console import Console

from gamekeeper.cli._audit import probing
from gamekeeper.cli._screen import live_progress

TIME = r"(\d+:\d\d:\d\d|-:--:--)"
COUNTS = {"episode": 1_234, "episodes": 10_000, "turns": 123_456}


def terminal(width: int) -> Console:
    """A terminal that nobody looks at."""
    return Console(file=io.StringIO(), width=width, force_terminal=True, color_system=None)


def shown(console: Console) -> str:
    """All that a terminal was sent."""
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


@pytest.mark.parametrize("width", [60, 80, 120])
@pytest.mark.parametrize(
    ("title", "fields"),
    [
        ("recording", COUNTS),
        ("replaying in B", COUNTS),
        ("recording", {"merged": 12_000, "parts": 100_000}),
        ("recording", {"turns": 1_234_567_890}),
    ],
)
def test_times_stay_on_a_narrow_terminal(width: int, title: str, fields: dict[str, int]) -> None:
    """Elapsed and remaining time are whole at 60 columns, and no line is cut."""
    console = terminal(width)
    with live_progress(title, console) as take:
        take(fields)
    last = shown(console).split(title)[-1]
    left = "" if fields.keys() == {"turns"} else TIME  # nothing says how many there will be
    assert re.search(f"{TIME} left: {left}", last)
    assert "…" not in last


def test_counts_lose_their_steps_before_their_episodes() -> None:
    """The least that is said is how many of how many."""
    lines = {}
    for width in (60, 120):
        console = terminal(width)
        with live_progress("recording", console) as take:
            take(COUNTS)
        lines[width] = shown(console)
    assert "1,234 of 10,000 episodes, 123,456 steps" in lines[120]
    assert "1,234 of 10,000" in lines[60]
    assert "123,456 steps" not in lines[60]


@pytest.mark.parametrize("width", [60, 80, 120])
def test_time_of_an_audit_stays_on_a_narrow_terminal(width: int) -> None:
    """A long name of a probe goes first."""
    console = terminal(width)
    shares = {"first": 1.0, "a_probe_with_a_long_name": 1.0}
    with probing(shares, is_shown=True, console=console) as take:
        take("a_probe_with_a_long_name", 1, 2)
    last = shown(console).split("auditing")[-1]
    assert re.search(rf"\(2 of 2\) {TIME}", last)
    assert "…" not in last
