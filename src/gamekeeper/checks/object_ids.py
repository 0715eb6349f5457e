"""Numbers in place of addresses: what `id()` gives to the modules of an environment's classes.

An address is no part of an episode: it differs from process to process, and with all that a process
did before. The source of the function stands in programs.
"""

import sys
from typing import Any


def ids_from(env: Any, start: int) -> list[dict[str, Any]]:
    """Gives an environment's own modules numbers from `start` on, as if memory had been fuller.

    Returns:
        The modules' contents; `id` in them is the number's.
    """
    known: dict[int, Any] = {}

    def number(each: Any) -> Any:
        known.setdefault(id(each), (16 * (start + len(known)), each))  # kept: no other has its id
        return known[id(each)][0]

    others = "builtins", "__main__", "abc", "typing", "gymnasium", "pettingzoo", "gamekeeper"
    names = {cls.__module__ for cls in type(env.unwrapped).__mro__}
    own = [vars(sys.modules[each]) for each in names if each.partition(".")[0] not in others]
    own = [each for each in own if getattr(each.get("id", id), "__name__", "") in ("id", "number")]
    for module in own:  # one that calls something else `id` is left alone
        module["id"] = number
    return own
