"""`gamekeeper explain GK402`: what a check promises, why, and how to mend what breaks it."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING, Annotated, Final

import typer

from gamekeeper.cli._checks import card_of, needs_contract, specimens
from gamekeeper.cli._screen import Answer, Screen
from gamekeeper.errors import GamekeeperError

if TYPE_CHECKING:
    from gamekeeper.audit.check import Check

ORDER: Final = 16
MOST_IN_FULL: Final = 3
"""Checks that one beginning of an id explains in full; more of them are listed."""

IdsArgument = Annotated[
    list[str],
    typer.Argument(metavar="ID", show_default=False, help="GK402, or how some ids begin, as GK4."),
]


def command(screen: Screen, ids: IdsArgument) -> Answer:
    """Explains checks: the promise, why it matters, a bad and a good example, the mend.

    Exit code 0: done. 2: there is no such check.
    """
    from gamekeeper.audit.check import checks
    from gamekeeper.report.check_text import check_text, checks_text

    known = checks()
    tried = {id: each for id, each in specimens().items() if not needs_contract(each)}
    asked: list[Check] = []
    texts = []
    for word in ids:
        found = _found(word, known)
        asked += found
        cards = [card_of(each) for each in found]
        if len(found) > MOST_IN_FULL:
            texts.append(checks_text(cards, width=screen.width))
        else:
            texts += [
                check_text(card, specimen=tried.get(card["id"]), width=screen.width)
                for card in cards
            ]
    screen.show("\n\n".join(texts))
    unique = {each.id: card_of(each) for each in asked}
    return Answer({"checks": [{**card, "specimen": tried.get(id)} for id, card in unique.items()]})


def _found(word: str, known: dict[str, Check]) -> list[Check]:
    """The checks whose ids begin so, or of that name.

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
        seen=f"the nearest are {', '.join(near)}" if near else "",
        mend="`gamekeeper list checks` shows them all",
    )
