"""Reading the books of an AEC environment: where they are kept, whom they pay."""

from collections.abc import Mapping
from itertools import compress, repeat
from operator import ne
from typing import Any, Final

from pettingzoo.utils import wrappers

from gamekeeper.interface.author_calls import AgentId
from gamekeeper.interface.packing import MISSING, REALS, flag_of, nonconforming, reward_of
from gamekeeper.interface.slim_aec import SlimAEC

# wrappers of PettingZoo, and the one in their place, keep no books of their own: those are read
# where they are kept, since an attribute costs 0.65 us for each wrapper that it falls through
TRANSPARENT: Final = (
    wrappers.BaseWrapper,
    wrappers.OrderEnforcingWrapper,
    wrappers.AssertOutOfBoundsWrapper,
    wrappers.ClipOutOfBoundsWrapper,
    wrappers.TerminateIllegalWrapper,
    wrappers.CaptureStdoutWrapper,
    SlimAEC,
)


def books_of(env: Any) -> Any:
    """The environment whose bookkeeping counts: the first that isn't a transparent wrapper."""
    while type(env) in TRANSPARENT:
        env = env.env
    return env


def entry_of(book: Any, agent: AgentId) -> Any:
    """Value that a dictionary holds for an agent; MISSING where it has no entry."""
    try:
        return book[agent] if book.__class__ is dict else book.get(agent, MISSING)
    except (AttributeError, KeyError, TypeError):
        return MISSING


def reward_in(rewards: Mapping[AgentId, Any], agent: AgentId, entry: Any) -> tuple[Any, Any]:
    """Reward of an agent in `rewards`, and its nonconforming part where `entry` is no number."""
    reward = rewards.get(agent)
    if reward.__class__ is float or reward_of(reward) is not None:
        return reward, entry
    if reward is None and agent not in rewards:
        return None, entry
    return None, (*(entry or ()), nonconforming("reward", reward))


def pays_others(rewards: Mapping[AgentId, Any], reward: Any) -> bool:
    """Tells whether `rewards` may pay anybody but the agent whose own reward is `reward`.

    Counting one of the zeros that are in it finds the others by identity, at 1 ns each, where `any`
    asks every number for its truth.
    """
    values = list(rewards.values())
    zero = values[0] if values and values[0].__class__ in REALS and not values[0] else 0
    try:
        return len(values) - values.count(zero) != (1 if reward else 0)
    except ValueError:  # a reward that is an array has no truth
        return True


def paid_others(rewards: Mapping[AgentId, Any], agent: AgentId) -> list[AgentId]:
    """Those that `rewards` pays, but for `agent`; what is no number counts as pay, to be seen."""
    return [
        other
        for other, reward in rewards.items()
        if other != agent and (reward.__class__ not in REALS or reward)
    ]


class Flags:
    """One kind of flag of all agents, as it stood at the start of the last turn."""

    __slots__ = ("_known", "_name", "_values")

    def __init__(self, name: str) -> None:
        self._name = name
        self.clear()

    def clear(self) -> None:
        """Forgets all flags: each agent's is False."""
        self._known: dict[AgentId, Any] = {}
        self._values: list[Any] = []

    def differ_from(self, flags: Mapping[AgentId, Any]) -> bool:
        """Tells whether any flag has changed, by comparing values in the order of the books."""
        try:
            return list(flags.values()) != self._values
        except ValueError:  # a flag that is an array has no truth
            return True

    def take(self, flags: Mapping[AgentId, Any]) -> list[AgentId]:
        """Takes the flags as known and returns whose have changed."""
        before = map(self._known.get, flags, repeat(False))
        try:
            changed = list(compress(flags, map(ne, flags.values(), before)))
        except ValueError:
            known = self._known
            changed = [agent for agent in flags if flags[agent] is not known.get(agent, False)]
        self._known, self._values = dict(flags), list(flags.values())
        return changed

    def put(self, agent: AgentId, flag: Any) -> None:
        """Takes one flag as known; `differ_from` then says that they differ."""
        self._known[agent], self._values = flag, []

    def drop(self, agent: AgentId) -> bool:
        """Takes out an agent that has left, likewise; returns True if its flag was set."""
        self._values = []
        return _is_set(self._known.pop(agent, False))

    def has(self, agent: AgentId) -> bool:
        """Tells whether the agent's flag is set."""
        return _is_set(self._known.get(agent, False))

    def of(self, agent: AgentId, entries: list[str]) -> Any:
        """The agent's flag for its row; one that is no bool goes to `entries`."""
        return flag_of(self._known.get(agent, False), self._name, entries)


def _is_set(flag: Any) -> bool:
    try:
        return bool(flag)
    except ValueError:  # an array of flags says nothing
        return False
