"""Names that the two base classes need for themselves, kept safe from an author's own.

An author writes methods without an underscore and keeps what the task needs under any name. A
method called `_show` or an attribute called `_masks` would take the place of the base's in silence,
so a clash is an error: of a method as the class is made, of an attribute as an episode begins.
"""

from __future__ import annotations

import re
from typing import Final

from gamekeeper.errors import ContractError

ROOM: Final = "gamekeeper.game"
_PRIVATE: Final = re.compile(r"_(?!_)(?![A-Za-z0-9]\w*__)\w+")  # and not mangled, which can't clash
_PETTINGZOO: Final = frozenset({"_cumulative_rewards"})  # PettingZoo's own name, known to authors


def reserved_names(kind: type) -> tuple[str, ...]:
    """What stands under a private name in the classes of this room that `kind` is built on."""
    ours = (base for base in kind.__mro__ if _is_ours(base))
    names = {name for base in ours for name in vars(base) if _PRIVATE.fullmatch(name)}
    return tuple(sorted(names - _PETTINGZOO))


def refuse_methods(kind: type, *, root: type) -> None:
    """A class that is about to be finished writes none of the base's names, nor do its mixins.

    Args:
        kind: the class; those under it that are built on `root` were looked at before.
        root: the base of all that authors write.
    Raises:
        ContractError: it does.
    """
    if _is_ours(kind):
        return
    reserved = reserved_names(kind)
    for base in kind.__mro__:
        if _is_ours(base) or (base is not kind and issubclass(base, root)):
            continue
        for name in reserved:
            if name in vars(base):
                raise _clash(base, name, "a method or attribute of the class")


def refuse_attributes(env: object, names: tuple[str, ...]) -> None:
    """An instance holds none of the base's names.

    Raises:
        ContractError: it does.
    """
    kind = type(env)
    for name in names:
        found = getattr(env, name)
        if getattr(found, "__func__", found) is not getattr(kind, name):
            raise _clash(kind, name, f"self.{name} = {found!r:.80}")


def _is_ours(kind: type) -> bool:
    return kind.__module__.startswith(f"{ROOM}.")


def _clash(kind: type, name: str, seen: str) -> ContractError:
    return ContractError(
        f"{kind.__qualname__} has a {name} of its own, and the base class needs that name",
        where=f"{kind.__module__}.{kind.__qualname__}",
        expected="another name",
        seen=seen,
        mend=f"rename it: {name[1:]}, or __{name[1:]}, which can't clash",
    )
