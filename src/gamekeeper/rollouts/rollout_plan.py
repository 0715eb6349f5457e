"""The plan of a rollout: its settings, for `gk.rollout`, the command line and workers alike."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.errors import EvidenceError

if TYPE_CHECKING:
    from gamekeeper.contract import Contract
    from gamekeeper.interface.joint_policy import Choices

PARTS: Final = 64
"""Parts of a run, as long as none has more than `MOST_EPISODES`."""
MOST_EPISODES: Final = 256
"""Episodes of a part: the cost of a death, and the most by which workers can end apart."""
MOST_TURNS: Final = 100_000
"""Turns of an episode, by default; some environments never end under some policies."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RolloutPlan:
    """Settings of a rollout.

    Attributes:
        policies: one for all, or by agent, role or under `*`.
        first: number of the first one, where they are a part of a run.
        level: `full`, `digest` or `actions`.
        check: replay the first finished episode of a run of level `actions` in a worker.
        frames: also render() once a turn.
        most_turns: longer episodes are cut; None: `MOST_TURNS`.
        contract: a contract, or the path of its file; None: the environment's own.
    """

    spec: object
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    policies: Choices = "random"
    episodes: int = 20
    first: int = 0
    seed: int = 0
    options: Mapping[str, Any] | None = None
    level: str = "full"
    check: bool = True
    frames: bool = False
    most_turns: int | None = None
    contract: Contract | str | PathLike[str] | None = None

    def __post_init__(self) -> None:
        """Refuses a plan without an episode."""
        if self.episodes < 1 or self.first < 0:
            raise EvidenceError(
                "nothing is to be played",
                where="episodes, first",
                expected="at least 1 episode, from 0 on",
                actual=f"{self.episodes}, {self.first}",
                fix="ask for one episode or more, from number 0 on",
            )

    def portable(self) -> RolloutPlan:
        """The same plan, all of it names that another process can open.

        Raises:
            EvidenceError: an object of this process stands in it.
        """
        whole: dict[str, Any] = (
            dict(self.policies) if isinstance(self.policies, Mapping) else {"*": self.policies}
        )
        for where, given in (
            ("spec", self.spec),
            *((f"policies[{name!r}]", policy) for name, policy in whole.items()),
        ):
            if not isinstance(given, str):
                expected = "a name that another process can open: module:callable"
                raise object_of_this_process(where, given, expected)
        if not (self.contract is None or isinstance(self.contract, str | PathLike)):
            raise object_of_this_process("contract", self.contract, "the path of its file")
        contract = None if self.contract is None else fspath(self.contract)
        return replace(self, policies=whole, contract=contract)

    def to_json(self) -> dict[str, Any]:
        """Plain data; arguments keep their very types.

        Raises:
            EvidenceError: an argument is an object that no text can build again.
        """
        from gamekeeper.episodes.canonical import is_exact, to_json

        plan = self.portable()
        given = to_json([dict(self.env_kwargs), self.options])
        if not is_exact(given):
            raise EvidenceError(
                "an argument is an object that no text can build again",
                where="env_kwargs, options",
                actual=given[:200],
                fix="use plain arguments, or record in one process, without workers",
            )
        named = {each.name: getattr(plan, each.name) for each in fields(plan)}
        return {**named, "env_kwargs": None, "options": None, "given": given}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> RolloutPlan:
        """The plan that `to_json` gave."""
        from gamekeeper.episodes.canonical import from_json

        given: Any = from_json(data["given"])
        named = {key: value for key, value in data.items() if key != "given"}
        return cls(**{**named, "env_kwargs": given[0], "options": given[1]})

    def ranges(self) -> Iterator[range]:
        """The episodes of each part, in their order; they depend on the plan alone."""
        size = min(max(-(-self.episodes // PARTS), 1), MOST_EPISODES)
        for first in range(0, self.episodes, size):
            yield range(first, min(first + size, self.episodes))

    def part(self, episodes: range) -> RolloutPlan:
        """The plan of some of its episodes."""
        return replace(self, first=episodes.start, episodes=len(episodes))


NAMES: Final = "names, which another process can open"


def object_of_this_process(where: str, actual: object, expected: str) -> EvidenceError:
    """Error about an object that has no name under which a worker could find it."""
    return EvidenceError(
        "an object of this process can't go to workers",
        where=where,
        expected=expected,
        actual=repr(actual)[:200],
        fix="name it, or play in this process: leave workers out",
    )
