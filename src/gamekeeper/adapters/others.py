"""Nobody is played by chance without being told: whoever doesn't learn has a policy by name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from gamekeeper.errors import SpecError
from gamekeeper.game.casting.cast import Choices
from gamekeeper.game.policy import EVERYONE


def require_policies(
    agents: Iterable[Any], others: Choices, role_of: Callable[[Any], str | None]
) -> None:
    """Sees that each of these agents has a policy: its own, its role's, or everybody's.

    Raises:
        SpecError: somebody has none.
    """
    if others is None:
        without = list(agents)
    elif not isinstance(others, Mapping) or EVERYONE in others:
        without = []
    else:
        without = [a for a in agents if str(a) not in others and role_of(a) not in others]
    if without:
        names = ", ".join(map(str, without))
        given = ", ".join(map(str, others)) if isinstance(others, Mapping) else "nobody"
        raise SpecError(
            "who doesn't learn has no policy",
            where="others",
            expected=f"policies for {names}",
            seen=f"policies for {given}",
            mend="others='random', or others={'role': 'module:callable'}",
        )
