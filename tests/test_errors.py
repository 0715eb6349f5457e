"""The tree of errors is as it is drawn."""

import inspect
import re

from gamekeeper import errors
from gamekeeper.errors import GamekeeperError

LINE = re.compile(r"(?P<indent>[│ ]*)[├└]── (?P<name>\w+) \((?P<builtin>\w+)\)\s+\S")


def drawn() -> dict[str, tuple[str, str]]:
    """By name what stands in the drawing: the error above it and the builtin in brackets."""
    above, found = {0: "GamekeeperError"}, {}
    for line in (errors.__doc__ or "").splitlines():
        if match := LINE.match(line):
            depth = len(match["indent"]) // 4
            found[match["name"]] = above[depth], match["builtin"]
            above[depth + 1] = match["name"]
    return found


def test_tree_of_errors_is_drawn_as_it_is() -> None:
    """Every error stands under its parent, with the builtin that it also is, and no other does."""
    kinds = [
        kind
        for kind in vars(errors).values()
        if inspect.isclass(kind)
        and issubclass(kind, GamekeeperError)
        and kind is not GamekeeperError
    ]
    assert {kind.__name__: tuple(base.__name__ for base in kind.__bases__) for kind in kinds} == (
        drawn()
    )


def test_error_says_what_where_and_how_to_fix_it() -> None:
    """Each part on its line, and those that are missing leave none."""
    full = GamekeeperError("it broke", where="here", expected="0", actual="1", fix="pay 0")
    assert str(full).splitlines() == [
        "it broke",
        "  where: here   expected: 0   actual: 1",
        "  fix: pay 0",
    ]
    assert str(GamekeeperError("it broke")) == "it broke"
