"""A joint policy: which policy plays which agent, and with which random stream."""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from types import FunctionType, ModuleType
from typing import Any, Final, TypeAlias

from gymnasium.spaces import Space
from numpy.random import Generator

from gamekeeper.episodes.layout import agent_name
from gamekeeper.errors import PolicyError
from gamekeeper.interface.construction import nearest
from gamekeeper.interface.generators import is_same_state, state_of
from gamekeeper.interface.policy import (
    EVERYONE,
    AgentSlot,
    Choice,
    Chosen,
    Player,
    SlotPolicy,
    Start,
    guarded,
    is_schemed,
    raised,
    reset_policy,
    resolve,
    shared_with,
)
from gamekeeper.randomness.seeds import policy_rng

Choices: TypeAlias = "Choice | Mapping[str, Choice] | None"
"""One policy for everybody, or policies by agent, by role, or under `*` for all others."""

DEFAULT: Final = "random"
"""Policy of an agent that no choice covers."""


def assign(
    policies: Choices,
    *,
    possible_agents: Iterable[Any],
    action_space: Callable[[Any], Space[Any]],
    roles: Callable[[Any], str | None] | None = None,
    role_names: Collection[str] = (),
    noop: Callable[[Any], Any] | None = None,
    mask_at: Callable[[Any], str | None] | None = None,
) -> JointPolicy:
    """A joint policy for an environment, settled from a user's choices.

    An agent's own choice goes before its role's, that before `*`; nobody's choice is `random`.

    Args:
        policies: what the user chose.
        possible_agents: as the environment names them; none where it can't say before it runs.
        action_space: an agent's action space; asked once, when the agent is first seen.
        roles: an agent's role, None where it has none.
        role_names: further roles that nobody of `possible_agents` has, such as those of late
            joiners.
        noop: an agent's declared noop, None where none is declared.
        mask_at: where an agent's mask stands by its contract, None where the contract doesn't say.
    Raises:
        PolicyError: a policy can't be found, a choice is for nobody in the game, or `noop` is to
            play an agent without a declared noop.
    """
    chosen = _resolved(policies)
    role_of = roles or (lambda agent: None)
    noop_of = noop or (lambda agent: None)
    agents = list(possible_agents)
    if agents:
        known = {agent_name(agent) for agent in agents} | {
            role for a in agents if (role := role_of(a))
        }
        _check_known(chosen, known | set(role_names))
    joint_policy = JointPolicy(
        chosen,
        apart=_apart(policies, chosen),
        action_space=action_space,
        roles=role_of,
        noop=noop_of,
        mask_at=mask_at or (lambda agent: None),
    )
    for agent in agents:
        check = getattr(joint_policy.chosen_for(agent).policy, "check", None)
        if callable(check):
            check(agent, role_of(agent), noop_of(agent))
    return joint_policy


def _resolved(policies: Choices) -> dict[str, Chosen]:
    if not isinstance(policies, Mapping):
        policies = {EVERYONE: DEFAULT if policies is None else policies}
    named = {agent_name(place): choice for place, choice in policies.items()}
    chosen = {
        place: resolve(choice) for place, choice in named.items() if shared_with(choice) is None
    }
    if EVERYONE not in named:
        chosen[EVERYONE] = resolve(DEFAULT)
    own = dict(chosen)
    for place, choice in named.items():
        other = shared_with(choice)
        if other is not None and other not in own:
            raise PolicyError(
                f"no policy is chosen for {other!r}, so {place!r} can't share it",
                where="policies",
                expected=", ".join(sorted(own)),
                actual=f"{place}={choice}",
                fix=f"choose a policy for {other!r} first",
            )
        if other is not None:
            chosen[place] = own[other]
    return chosen


def _apart(policies: Choices, chosen: Mapping[str, Chosen]) -> frozenset[str]:
    """The places whose agents have an object each: named by a text, and not shared by `same:`.

    Each has a copy: what its module holds stays as it was, so that each joint policy begins alike.

    A function is one for all, and so is what can't be copied, a Python object that was handed in,
    and a trainer's model without a `reset`.
    """
    whole = policies if isinstance(policies, Mapping) else {EVERYONE: policies}
    named = {agent_name(place): choice for place, choice in whole.items()}
    owners = {shared_with(choice) for choice in named.values()}
    return frozenset(
        place
        for place, choice in named.items()
        if isinstance(choice, str)
        and place not in owners
        and shared_with(choice) is None
        and _is_copied(choice, chosen[place])
    )


def _is_copied(name: str, policy: Chosen) -> bool:
    is_model = is_schemed(name) and not callable(getattr(policy.policy, "reset", None))
    return not is_model and _copied(policy) is not None


def _copied(chosen: Chosen) -> Chosen | None:
    """A policy as a copy; None where none is made: of functions, and of what can't be copied."""
    if isinstance(chosen.policy, ModuleType | FunctionType | SlotPolicy):
        return None
    try:
        return replace(chosen, policy=copy.deepcopy(chosen.policy))
    except Exception:  # foreign code; what can't be copied is shared
        return None


def _check_known(chosen: Mapping[str, Chosen], known: Collection[str]) -> None:
    for place, choice in chosen.items():
        if place != EVERYONE and place not in known:
            raise PolicyError(
                f"a policy is chosen for {place!r}, which is no agent and no role here"
                f"{nearest(place, known)}",
                where="policies",
                expected=", ".join(sorted(known)),
                actual=f"{place}={choice.name}",
                fix="name an agent or a role of this environment, or choose one policy for all",
            )


class JointPolicy:
    """Players for every agent of a game, also for those that join late.

    Who sits where is settled when an agent is first seen, its random stream when it first acts in
    an episode; neither depends on the order in which agents come.
    """

    def __init__(
        self,
        chosen: Mapping[str, Chosen],
        *,
        action_space: Callable[[Any], Space[Any]],
        roles: Callable[[Any], str | None],
        noop: Callable[[Any], Any],
        mask_at: Callable[[Any], str | None],
        apart: frozenset[str] = frozenset(),
    ) -> None:
        self._chosen = dict(chosen)
        self._own: dict[str, Chosen] = {}  # by agent, of places whose agents have an object each
        self._apart = apart
        # One object in several places goes by the first of their names, and is reset once under it.
        names: dict[int, str] = {}
        self._objects = {
            place: place
            if isinstance(one.policy, ModuleType)  # a built-in: it remembers nothing
            or place in apart
            else names.setdefault(id(one.policy), place)
            for place, one in sorted(chosen.items())
        }
        self._resets = {
            place: one
            for place, one in sorted(chosen.items())
            if self._objects[place] == place
            and place not in apart
            and callable(getattr(one.policy, "reset", None))
        }
        self._action_space, self._roles = action_space, roles
        self._noop, self._mask_at = noop, mask_at
        self._starts: dict[Any, Start] = {}
        self._playing: dict[Any, Player] = {}
        self._rngs: dict[Any, Generator] = {}
        self._shared: dict[Any, Any] = {}
        self._run_seed = self._episode = 0
        self._is_begun = False

    def begin(self, run_seed: int, episode: int) -> None:
        """An episode begins: streams are new, and policies that have a `reset` get it called.

        Raises:
            PolicyError: a policy's `reset` raised.
        """
        self._run_seed, self._episode = run_seed, episode
        self._playing, self._rngs, self._is_begun = {}, {}, True
        for place, chosen in [*self._resets.items(), *sorted(self._own.items())]:
            self._reset(place, chosen)

    def _reset(self, name: str, chosen: Chosen) -> None:
        if not callable(getattr(chosen.policy, "reset", None)):
            return
        # A stream of its own: what the policy does with it must not repeat an agent's draws.
        stream = policy_rng(self._run_seed, self._episode, f"reset of {name}")
        try:
            reset_policy(chosen.policy, int(stream.integers(1 << 31)))
        except (Exception, SystemExit) as error:
            raise raised(chosen, name, error) from error

    def act(self, agent: Any, observation: Any, info: Any) -> Any:
        """The action of a live agent.

        Raises:
            PolicyError: its policy raised or returned None, or the mask doesn't fit its action
                space.
            ActionError: its policy chose outside a Discrete space.
        """
        player = self._playing.get(agent)
        if player is None:
            player = self._playing[agent] = self._enter(agent)
        return player(observation, info)

    def policies(self) -> list[Any]:
        """Returns the policies that are objects of their own, in the order of their places."""
        every = [*sorted(self._chosen.items()), *sorted(self._own.items())]
        found = {id(one.policy): one.policy for _, one in every}
        return [policy for policy in found.values() if not isinstance(policy, ModuleType)]

    def draw_anew(self, run_seed: int, without: Collection[Any] = ()) -> None:
        """Gives agents another stream from here on; policies keep what they remember.

        Args:
            without: agents that go on drawing as they did.
        """
        for agent in without:  # a stream that isn't there yet would begin from the new seed
            self._rngs.setdefault(agent, policy_rng(self._run_seed, self._episode, agent))
        self._run_seed = run_seed
        for agent, rng in self._rngs.items():
            if agent not in without:
                fresh = policy_rng(run_seed, self._episode, agent)
                rng.bit_generator.state = fresh.bit_generator.state
        for agent in list(self._playing):  # a built-in may have drawn ahead, and remembers nothing
            is_meant = agent not in without
            if is_meant and isinstance(self.chosen_for(agent).policy, ModuleType):
                del self._playing[agent]

    @property
    def has_drawn(self) -> bool:
        """An agent's stream was drawn from in this episode."""
        return any(
            not is_same_state(
                state_of(rng), state_of(policy_rng(self._run_seed, self._episode, agent))
            )
            for agent, rng in self._rngs.items()
        )

    def __deepcopy__(self, memo: dict[int, Any]) -> JointPolicy:
        """A copy that goes on by itself: all streams and policies are its own.

        What functions keep in their modules is shared, as Python copies no function.
        """
        chosen = {
            place: one
            if isinstance(one.policy, ModuleType)
            else replace(one, policy=copy.deepcopy(one.policy, memo))
            for place, one in self._chosen.items()
        }
        copied = JointPolicy(
            chosen,
            action_space=self._action_space,
            roles=self._roles,
            noop=self._noop,
            mask_at=self._mask_at,
            apart=self._apart,
        )
        copied._own = {
            agent: replace(one, policy=copy.deepcopy(one.policy, memo))
            for agent, one in self._own.items()
        }
        copied._run_seed, copied._episode = self._run_seed, self._episode
        copied._is_begun = self._is_begun
        copied._rngs = copy.deepcopy(self._rngs, memo)
        return copied

    def chosen_for(self, agent: Any) -> Chosen:
        """The policy that plays an agent; of agents with an object each its own copy."""
        place, name = self._place_of(agent), agent_name(agent)
        if place not in self._apart:
            return self._chosen[place]
        found = self._own.get(name)
        if found is None:
            one = self._chosen[place]
            found = self._own[name] = replace(one, policy=copy.deepcopy(one.policy))
            if self._is_begun:  # it joins late
                self._reset(name, found)
        return found

    def object_of(self, agent: Any) -> str:
        """Returns the name of the object that plays an agent; agents that share it have one."""
        place, name = self._place_of(agent), agent_name(agent)
        return name if place in self._apart else self._objects[place]

    def apart(self, agent: Any, rng: Generator) -> Player:
        """A player for an agent apart from the game, as at the beginning of an episode.

        A policy with a `reset` is reset by it; of one without, a copy plays, or the object itself
        where it can't be copied.

        Args:
            rng: stream of its draws; the seed of its reset is drawn from it.
        Raises:
            PolicyError: its `reset` raised.
        """
        chosen = self.chosen_for(agent)
        if callable(getattr(chosen.policy, "reset", None)):
            try:
                reset_policy(chosen.policy, int(rng.integers(1 << 31)))
            except (Exception, SystemExit) as error:
                raise raised(chosen, agent, error) from error
            return self._start_of(agent, chosen)(rng)
        return self._start_of(agent, _copied(chosen) or chosen)(rng)

    def asked(
        self, agent: Any, observation: Any, info: Any, times: int, *, anew: bool
    ) -> list[Any]:
        """Actions of a policy, which itself is asked for the first, and copies of it for the rest.

        A policy that keeps nothing in an object, or can't be copied, is asked for all of them
        itself if each is drawn anew, else once.

        Args:
            anew: each further one is asked of a copy as it was before, with the agent's stream;
                else all are asked of one copy in a row, with a copy of that stream.
        """
        # Copied before the policy itself is asked, so that each stands where it stood.
        chosen = self.chosen_for(agent)
        copies = [_copied(chosen) for _ in range(times - 1 if anew else 1)]
        rng = self._rngs.get(agent) or policy_rng(self._run_seed, self._episode, agent)
        rng = copy.deepcopy(rng)
        found = [self.act(agent, observation, info)]
        starts = [
            self._start_of(agent, each)(self._rngs[agent] if anew else rng)
            for each in copies
            if each
        ]
        if not starts and not anew:
            return found
        players = starts or [self._playing[agent]]
        return found + [players[at % len(players)](observation, info) for at in range(times - 1)]

    def renewer(self, agents: Iterable[Any]) -> Callable[[], None]:
        """Copies the objects that play agents as they are now; puts copies in place when called.

        Objects that aren't copied for agents of their own stay as they are.
        """
        copies: list[tuple[dict[str, Chosen], list[str], Chosen]] = []
        names = {agent_name(agent) for agent in agents}
        for agent in sorted(names):
            place, one = self._place_of(agent), self.chosen_for(agent)
            copied = _copied(one) if self.is_renewed(agent) else None
            if copied is not None and place in self._apart:
                copies.append((self._own, [agent], copied))
            elif copied is not None:
                places = [place for place, x in self._chosen.items() if x.policy is one.policy]
                copies.append((self._chosen, places, copied))

        def renew() -> None:
            for table, places, copied in copies:
                policy = copy.deepcopy(copied.policy)
                for place in places:
                    table[place] = replace(table[place], policy=policy)
                    if table is self._chosen and place in self._resets:
                        self._resets[place] = table[place]
            self._starts = {a: x for a, x in self._starts.items() if agent_name(a) not in names}

        return renew

    def is_renewed(self, agent: Any) -> bool:
        """Tells whether the object that plays an agent can be copied, and may keep something."""
        one = self.chosen_for(agent)
        return _is_copied(one.name, one)

    def described(self, agents: Iterable[Any]) -> dict[str, dict[str, Any]]:
        """Describes the policies by agent, as evidence keeps them.

        Returns:
            By agent the name of its `policy`, its `version`, what it was `chosen_for` (the agent,
            its role, or `*`), its `object`: agents of one object share it; and, but for a built-in,
            whether it is its `own`, as others of the same choice have theirs.
        """
        found: dict[str, dict[str, Any]] = {}
        for agent in agents:
            place = self._place_of(agent)
            one = self._chosen[place]
            found[agent_name(agent)] = {
                "policy": one.name,
                "version": one.version,
                "chosen_for": place,
                "object": self.object_of(agent),
            }
            if not isinstance(one.policy, ModuleType):
                found[agent_name(agent)]["own"] = place in self._apart
        return found

    def _place_of(self, agent: Any) -> str:
        """Returns what an agent's policy was chosen for: itself, its role, or everyone."""
        for place in (agent_name(agent), self._roles(agent)):
            if place is not None and place in self._chosen:
                return place
        return EVERYONE

    def _enter(self, agent: Any) -> Player:
        start = self._starts.get(agent)
        if start is None:
            start = self._starts[agent] = self._start_of(agent, self.chosen_for(agent))
        if agent not in self._rngs:
            self._rngs[agent] = policy_rng(self._run_seed, self._episode, agent)
        return start(self._rngs[agent])

    def _start_of(self, agent: Any, chosen: Chosen) -> Start:
        slot = AgentSlot(
            agent,
            self._action_space(agent),
            role=self._roles(agent),
            noop=self._noop(agent),
            mask=self._mask_at(agent),
            shared=self._shared,
        )
        if isinstance(chosen.policy, SlotPolicy):
            return chosen.policy.start_for(slot)
        return guarded(slot, chosen, chosen.policy)
