"""Who learns, and who plays the others."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gamekeeper.adapters.others import require_policies
from gamekeeper.core.contract import Contract
from gamekeeper.errors import SpecError
from gamekeeper.game.casting.cast import Cast, Choices
from gamekeeper.game.open import open_env
from gamekeeper.record.recording import cast_of
from gamekeeper.vector.form import Group


@dataclass(frozen=True, slots=True)
class Learners:
    """The agents that learn, A of them, all with the same spaces.

    Attributes:
        group: whose spaces they have.
        agents: their names.
        places: where they stand in the arrays of their group; a slice where they stand together.
        learner_of: [column], which of them an agent is; -1: it doesn't learn.
        rest: who doesn't learn: group, place in it, name.
    """

    group: Group
    agents: tuple[Any, ...]
    places: slice | NDArray[np.intp]
    learner_of: NDArray[np.intp]
    rest: tuple[tuple[Group, int, Any], ...]

    def __len__(self) -> int:
        return len(self.agents)

    def in_turn(self, turn: NDArray[np.integer[Any]]) -> tuple[Any, NDArray[np.intp]]:
        """In which copies it is a learner's turn, as an index, and in which slot.

        Args:
            turn: [copy], the column of the agent in turn.
        """
        learner = self.learner_of[turn]
        firsts = np.arange(len(turn)) * len(self)
        if self.are_all:
            return slice(None), firsts + learner
        copies = np.flatnonzero(learner >= 0)
        return copies, firsts[copies] + learner[copies]

    @property
    def are_all(self) -> bool:
        """Whether there is nobody else."""
        return not self.rest


def find_learners(
    groups: Sequence[Group], role: str | None, role_of: Callable[[Any], str]
) -> Learners:
    """The agents of a role, or the one that is called so; None: all.

    Raises:
        SpecError: there are none, or they differ in their spaces.
    """
    everybody = [(g, place, agent) for g in groups for place, agent in enumerate(g.agents)]
    chosen = [one for one in everybody if role in (None, role_of(one[2]), str(one[2]))]
    if not chosen:
        known = dict.fromkeys(role_of(agent) for _, _, agent in everybody)
        raise SpecError(
            f"nobody has the role {role!r}", where="role", expected=", ".join(known),
            seen=repr(role),
        )  # fmt: skip
    group = chosen[0][0]
    if any(other is not group for other, _, _ in chosen):
        raise SpecError(
            "one policy can't be shared by agents that differ in their spaces",
            where="role",
            expected="agents with one observation space and one action space",
            seen=", ".join(each.name for each in groups),
            mend="name the role that learns, and give the others policies",
        )
    places = np.array([place for _, place, _ in chosen])
    learner_of = np.full(len(everybody), -1)
    learner_of[group.first + places] = np.arange(len(places))
    first, last = int(places[0]), int(places[-1])
    stand_together = last - first + 1 == len(places)
    return Learners(
        group,
        tuple(agent for _, _, agent in chosen),
        slice(first, last + 1) if stand_together else places,
        learner_of,
        tuple(one for one in everybody if learner_of[one[0].first + one[1]] < 0),
    )


def casts_of_others(
    spec: object,
    env_kwargs: Mapping[str, Any],
    others: Choices,
    learners: Learners,
    role_of: Callable[[Any], str],
    *,
    contract: Contract,
    num_envs: int,
) -> list[Cast]:
    """A cast for each copy; none where everybody learns.

    Raises:
        SpecError: somebody has no policy, or everybody learns and there are some.
    """
    if learners.are_all:
        if others:
            raise SpecError(
                "there are policies for others, and everybody learns",
                where="others", mend="name the role that learns",
            )  # fmt: skip
        return []
    require_policies([agent for _, _, agent in learners.rest], others, role_of)
    env = open_env(spec, **env_kwargs).env
    try:
        return [cast_of(others, env, contract) for _ in range(num_envs)]
    finally:
        env.close()
