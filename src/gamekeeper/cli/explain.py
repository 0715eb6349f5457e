"""`gamekeeper explain GK402`: the promise of a check, its reason, and the fix for a failure."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._options import CheckId
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.errors import GamekeeperError
from gamekeeper.import_guard import unguarded

if TYPE_CHECKING:
    from gamekeeper.checks.check import Check

ORDER: Final = 16
MOST_IN_FULL: Final = 3
"""Checks that one beginning of an id explains in full; more of them are listed."""


@unguarded()  # nothing of a run is looked at
def command(screen: Screen, ids: list[CheckId]) -> CommandResult:
    """Explains checks: the promise, why it matters, a bad and a good example, the fix.

    Exit code 0: done. 2: there is no such check.

    Example: gamekeeper explain GK402

    Args:
        ids (ID): Id of a check, such as GK402, or the beginning of several, such as GK4.
    """
    from gamekeeper.checks.check import checks
    from gamekeeper.reporting.check_text import check_text, checks_text

    known = checks()
    asked: list[Check] = []
    texts = []
    for word in ids:
        found = _found(word, known)
        asked += found
        cards = [card_of(each) for each in found]
        if len(found) > MOST_IN_FULL:
            texts.append(checks_text(cards, width=screen.width))
        else:
            texts += [check_text(card, width=screen.width) for card in cards]
    screen.show("\n\n".join(texts))
    unique = {each.id: card_of(each) for each in asked}
    return CommandResult({"checks": list(unique.values())})


def card_of(check: Check) -> dict[str, Any]:
    """A check as plain data, for texts and JSON."""
    names = ("id", "name", "claim", "about", "severity", "confidence", "fix", "api")
    return {**{name: getattr(check, name) for name in names}, "needs": list(check.needs)}


def _found(word: str, known: dict[str, Check]) -> list[Check]:
    """Finds the checks whose ids begin with a word, or of that name.

    Raises:
        GamekeeperError: there are none.
    """
    start = word.strip().upper()
    named = [each for each in known.values() if each.name == word.strip().lower()]
    found = named or [each for id, each in known.items() if start and id.startswith(start)]
    if found:
        return found
    near = get_close_matches(start, known, n=3, cutoff=0.5)
    raise GamekeeperError(
        f"no check is called {word!r}",
        where="explain",
        expected="an id like GK402, or how some ids begin, like GK4",
        actual=f"the nearest are {', '.join(near)}" if near else "",
        fix="`gamekeeper list checks` shows them all",
    )
