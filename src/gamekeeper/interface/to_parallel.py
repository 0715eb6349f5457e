"""From one agent after the other to all at once: AEC environments behind the Parallel API."""

from collections.abc import Iterable, Mapping
from operator import add
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Space
from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.errors import ContractError
from gamekeeper.interface.aec_accounts import books_of, pays_others
from gamekeeper.interface.author_calls import AgentId, before_reset, reset_arguments
from gamekeeper.interface.bookkeeping import Books
from gamekeeper.interface.env_inside import EnvInside
from gamekeeper.interface.legality import judge, learn_ranges, mismatch, refused


class TickActions:
    """Test of a dictionary of actions: can an AEC environment play it in one tick."""

    def __init__(self, env: AECEnv[Any, Any, Any], books: Any) -> None:
        """Takes the environment, and where its books are kept."""
        self._env, self._books = env, books
        self._keeps_books = isinstance(books, Books)
        self._trusts = getattr(books, "_trusts_ranges", True)
        self._spaces: dict[Any, Space[Any]] = {}
        self._ranges: dict[Any, range] = {}

    def learn(self, agents: Iterable[Any]) -> None:
        """Reads the action spaces of agents that come into the roster."""
        space_of = self._env.action_space
        learn_ranges(agents, space_of, self._spaces, self._ranges, trusted=self._trusts)

    def check(self, actions: Any, agents: list[Any]) -> None:
        """Each of these agents has an action, in its space, and nobody else has one.

        Raises:
            ActionError: it isn't so.
        """
        if not isinstance(actions, Mapping) or len(actions) != len(agents):
            raise mismatch(actions, agents)
        ranges = self._ranges
        for agent in agents:
            try:
                action = actions[agent]
            except KeyError:
                raise mismatch(actions, agents) from None
            if type(action) is not int or action not in ranges[agent]:
                self._check_one(agent, action)

    def check_turn(self, actions: Any, agents: list[Any], actor: AgentId) -> None:
        """The agent in turn has an action in its space, and nobody has one who isn't live.

        Raises:
            ActionError: it isn't so.
        """
        if not isinstance(actions, Mapping) or not set(actions) <= set(agents):
            raise mismatch(actions, agents)
        if actor not in actions:
            raise mismatch(actions, [actor])
        self._check_one(actor, actions[actor])

    def _check_one(self, agent: AgentId, action: Any) -> None:
        """One of our own environments judges by itself, its masks and penalties included."""
        if self._keeps_books:
            if not getattr(self._books, "_pardons", False):
                self._books._judge(agent, action)
            return
        space = self._spaces[agent]
        if not judge(space, action)[0]:
            raise refused(agent, action, space)


FEW: Final = 4  # agents: up to here adding every reward takes less than finding those that count
Totals = dict[Any, Any]


class TickRewards:
    """Adds up rewards, and reward terms where the environment keeps them, turn by turn.

    From the first turn that pays more agents than the actor, the sums of a tick stand in a list, in
    the order in which the environment lists its rewards: adding a list to a list takes a third of
    what it takes to find those who were paid and to change a dictionary agent by agent.
    """

    def __init__(self, books: Any) -> None:
        """Takes where an AEC environment keeps its books."""
        self._books = books
        self._keeps_books = isinstance(books, Books)
        self._agents: list[Any] = []
        self.has_terms = isinstance(getattr(books, "terms", None), dict)
        self.start()

    def start(self) -> None:
        """Begins a tick."""
        self._totals: Totals | None = None
        self._sums: list[Any] | None = None  # of `_agents`; what `_totals` says is older then
        self.terms: dict[Any, dict[str, float]] = {}

    def add(self, actor: AgentId) -> None:
        """Adds what the last turn paid."""
        books, totals = self._books, self._totals
        paid = rewards = books.rewards
        if self.has_terms and books.terms:
            self._add_terms(books.terms)
        if self._keeps_books:
            paid = books.touched.paid
            if not paid:
                return
        if totals is None:
            self._totals = dict(rewards)
        elif paid is rewards and len(rewards) > FEW:
            self._add_many(totals, actor, rewards)
        else:
            _add_each(totals, rewards, paid)

    def total(self) -> Totals | None:
        """Rewards of each agent since `start`; None where there were none."""
        if self._sums is not None and self._totals is not None:
            self._totals.update(zip(self._agents, self._sums, strict=True))
        return self._totals

    def _add_many(self, totals: Totals, actor: AgentId, rewards: Mapping[Any, Any]) -> None:
        if self._sums is None:
            own = rewards.get(actor)
            if not pays_others(rewards, own):
                _add_each(totals, rewards, () if own is None else (actor,))
                return
            self._agents, self._sums = list(totals), list(totals.values())
        if list(rewards) == self._agents:
            self._sums = list(map(add, self._sums, rewards.values()))
        else:  # an agent came or left
            self.total()
            self._sums = None
            _add_each(totals, rewards, rewards)

    def _add_terms(self, paid: Mapping[Any, Mapping[str, float]]) -> None:
        for agent, amounts in paid.items():
            sums = self.terms.setdefault(agent, {})
            for term, amount in amounts.items():
                sums[term] = sums.get(term, 0.0) + amount


def _add_each(totals: Totals, rewards: Mapping[Any, Any], agents: Iterable[Any]) -> None:
    for agent in agents:
        reward = rewards[agent]
        totals[agent] = totals[agent] + reward if agent in totals else reward


LastOutput = tuple[Any, Any, Any, Any]  # observation, terminated, truncated, info
Step = tuple[
    dict[Any, Any], dict[Any, Any], dict[Any, Any], dict[Any, Any], dict[Any, dict[str, Any]]
]


def _copied(info: Any) -> Any:
    return dict(info) if info.__class__ is dict else info


def _unreported(agent: AgentId, reward: object) -> ContractError:
    return ContractError(
        f"agent {agent!r} was paid when it could no longer be told",
        where="rewards",
        expected="0 in the turns after the one in which it ended or left",
        actual=repr(reward)[:300],
        fix="pay what is owed in the turn that ends it",
    )


class ToParallel(EnvInside, ParallelEnv[Any, Any, Any]):
    """An AEC environment as a Parallel environment: a round of turns is one tick.

    The law of `style="cycle"`. A tick has one turn of each agent that was live as it began, in the
    environment's own order, whichever that is in this round. An agent's reward is the sum of what
    all turns of the tick paid it. An agent that ended before its turn has no turn, and its action
    is not played. Who ended gets its last observation, flags and info as its None turn shows them,
    in the step in which it ended. The others are shown what is there as the next round begins.
    For an environment whose state, rewards and endings change with the last turn of a round only,
    this is what `last()` gives everybody. Where they change earlier, agents choose by what was
    there as the tick began, and that is why it takes `order="as declared"`.

    The law of `style="turn"`. A tick is one turn: the action of the agent in turn is played, those
    of the others aren't looked at and may be absent; everybody is shown what is there after it.

    | | |
    |---|---|
    | kept | agents, late joiners, spaces, seeds and options; all rewards, so every return; endings with the last observation and info of the dying; masks; `state()`, `state_space`, rendering, render mode; reward terms where the environment tells them |
    | changed | infos are copies, as they are then: the next turn writes into the originals |
    | checked | every live agent has an action, nobody else has; each is in its space (masks are left to the environment's rules), before the first one is played |
    | lost | what agents see between the turns of one tick. Refused is a round in which an agent would have two turns, or a joiner one, before all others had theirs, and a reward that is paid after an end was told |
    """  # noqa: E501  # rows of a table

    terms: dict[Any, dict[str, float]]

    def __init__(self, env: AECEnv[Any, Any, Any], *, style: str = "cycle") -> None:
        """Takes hold of an environment; nothing is called on it yet."""
        super().__init__()
        self.env = env
        self._books: Any = books_of(env)
        self._keeps_books = isinstance(self._books, Books)
        # our own base class tells infos one by one, so they are asked for all at once
        asked = ("_masks", "_informs")
        self._asks_infos = any(getattr(self._books, name, False) is True for name in asked)
        self._actions = TickActions(env, self._books)
        self._rewards = TickRewards(self._books)
        self._last_outputs: dict[Any, LastOutput] = {}  # of agents whose end this tick reports
        self._lingering: set[Any] = set()  # reported as ended, their None turns still to come
        self.style = style
        self.metadata = getattr(env, "metadata", {})
        self.render_mode = getattr(env, "render_mode", None)
        self._list_agents()
        if hasattr(env, "state_space"):
            self.state_space = env.state_space
        if self._rewards.has_terms:
            self.terms = {}

    @property
    def to_move(self) -> list[Any]:
        """Agents whose actions the next step plays."""
        if self.style == "turn":
            return [self._books.agent_selection] if self.agents else []
        return list(self.agents)

    # -- PettingZoo's side

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[Any, Any], dict[Any, dict[str, Any]]]:
        """Begins an episode, with the same seed and options: observations, infos."""
        self.env.reset(**reset_arguments(seed, options))
        self._list_agents()
        self._last_outputs, self._lingering = {}, set()
        self._bury_the_dying()
        self._last_outputs = {}
        agents = self.agents = self._live()
        self._actions.learn(agents)
        return self._observations(agents), self._infos(agents)

    def _list_agents(self) -> None:
        """Notes the possible agents, which some environments know only once they were reset."""
        if hasattr(self.env, "possible_agents"):
            self.possible_agents = self.env.possible_agents

    def step(self, actions: Mapping[Any, Any]) -> Step:
        """Plays one tick: observations, rewards, terminations, truncations, infos.

        Actions that are refused leave everything as it was. Once everybody has ended nothing is
        played any more: five empty dictionaries.

        Raises:
            OrderError: there was no reset.
            ActionError: an agent has no action, one that isn't live has one, or one isn't in its
                space.
            ContractError: a round of turns isn't a tick.
        """
        if not hasattr(self, "agents"):
            raise before_reset("step")
        if not self.agents:
            return {}, {}, {}, {}, {}
        self._check(actions)
        if self._last_outputs:
            self._last_outputs = {}
        self._rewards.start()
        if self._rewards.has_terms:
            self.terms = self._rewards.terms
        if self.style == "turn":
            self._turn(actions)
        else:
            self._round(actions)
        totals = self._rewards.total()
        books, agents = self._books, self.agents
        terms, truncs, rewards = books.terminations, books.truncations, books.rewards
        # Where nobody ended, joined or left, the books' own dictionaries are the tick's.
        if (
            self._last_outputs
            or books.agents != agents
            or any(terms.values())
            or any(truncs.values())
            or not len(agents) == len(terms) == len(truncs) == len(rewards)
        ):
            return self._outputs(totals)
        if totals is None:
            totals = dict(rewards)
        return self._observations(agents), totals, dict(terms), dict(truncs), self._infos(agents)

    def _turn(self, actions: Mapping[Any, Any]) -> None:
        """One turn of one agent."""
        agent = self._books.agent_selection
        self.env.step(actions[agent])
        self._rewards.add(agent)

    def _round(self, actions: Mapping[Any, Any]) -> None:
        """One turn of everybody."""
        books, step, add = self._books, self.env.step, self._rewards.add
        for place, agent in enumerate(self.agents):
            if (
                books.agent_selection != agent
                or books.terminations[agent]
                or books.truncations[agent]
            ):
                self._rest_of_round(actions, set(self.agents[place:]))
                return
            step(actions[agent])
            add(agent)

    def _rest_of_round(self, actions: Mapping[Any, Any], left: set[Any]) -> None:
        """The turns that are left, where the order isn't the roster's or somebody has ended."""
        books, step, add = self._books, self.env.step, self._rewards.add
        while left:
            agent = books.agent_selection
            if agent not in left:
                if self._stops(agent, left):
                    break
            elif books.terminations[agent] or books.truncations[agent]:
                left.remove(agent)
                self._bury(agent)
            else:
                left.remove(agent)
                step(actions[agent])
                add(agent)

    def _stops(self, agent: AgentId, left: set[Any]) -> bool:
        """Tells whether a round is over although some had no turn: they left without an ending.

        Raises:
            ContractError: they are there, and somebody else has a turn.
        """
        books = self._books
        if not books.agents:
            return True
        if books.terminations[agent] or books.truncations[agent]:
            self._bury(agent)
            return False
        left.intersection_update(books.agents)
        if left:
            raise _no_round(agent, left, self.agents)
        return True

    def _check(self, actions: Mapping[Any, Any]) -> None:
        """Looks at all actions before one of them is played."""
        if self.style == "turn":
            self._actions.check_turn(actions, self.agents, self._books.agent_selection)
        else:
            self._actions.check(actions, self.agents)

    # -- the end of a tick: None turns are played, outputs are collected

    def _outputs(self, totals: Totals | None) -> Step:
        """The five dictionaries of a tick whose turns have been played."""
        self._bury_the_dying()
        books, last = self._books, self._last_outputs
        agents = self.agents = self._live()
        self._actions.learn(agents)
        observations, infos = self._observations(agents), self._infos(agents)
        terms, truncs = books.terminations, books.truncations
        terminations = {agent: terms[agent] for agent in agents}
        truncations = {agent: truncs[agent] for agent in agents}
        for agent, (observation, terminated, truncated, info) in last.items():
            observations[agent], infos[agent] = observation, info
            terminations[agent], truncations[agent] = terminated, truncated
        if totals is None:
            rewards = {
                agent: 0.0 if agent in last else books.rewards.get(agent, 0.0)
                for agent in observations
            }
        else:
            for agent in totals.keys() - observations.keys():
                if np.any(totals[agent]):
                    raise _unreported(agent, totals[agent])
            rewards = {agent: totals.get(agent, 0.0) for agent in observations}
        return observations, rewards, terminations, truncations, infos

    def _live(self) -> list[Any]:
        """Agents that can act next; those that ended and wait for their None turn are noted now."""
        books = self._books
        terms, truncs = books.terminations, books.truncations
        agents = list(books.agents)
        if not any(terms.values()) and not any(truncs.values()):
            self._lingering.clear()
            return agents
        dying = [agent for agent in agents if terms[agent] or truncs[agent]]
        for agent in dying:
            if agent not in self._lingering:
                self._last_outputs[agent] = self._last_output(agent)
        self._lingering = set(dying)
        return [agent for agent in agents if agent not in self._lingering]

    def _bury_the_dying(self) -> None:
        """None turns of those who ended, as far as the environment asks for them now."""
        books = self._books
        while books.agents:
            agent = books.agent_selection
            if not (books.terminations[agent] or books.truncations[agent]):
                return
            self._bury(agent)

    def _bury(self, agent: AgentId) -> None:
        """Plays an agent's None turn; what it is given there is its last output."""
        books = self._books
        if agent not in self._lingering and agent not in self._last_outputs:
            self._last_outputs[agent] = self._last_output(agent)
        self.env.step(None)
        if agent in books.agents and books.agent_selection == agent:
            raise ContractError(
                f"agent {agent!r} ended and doesn't leave",
                where="step(None)",
                expected="an agent that is out of the roster after its None turn",
                actual="one that is in turn again",
                fix="call self._was_dead_step(action) where the agent in turn has ended",
            )

    def _last_output(self, agent: AgentId) -> LastOutput:
        """Last observation, flags and info of an agent that ended."""
        books = self._books
        return (
            self._observations((agent,))[agent],
            books.terminations[agent],
            books.truncations[agent],
            self._infos((agent,))[agent],
        )

    def _observations(self, agents: Iterable[Any]) -> dict[Any, Any]:
        view = self._books._view if self._keeps_books else self._books.observe
        return {agent: view(agent) for agent in agents}

    def _infos(self, agents: Iterable[Any]) -> dict[Any, dict[str, Any]]:
        """New infos, as they are now."""
        books = self._books
        if self._asks_infos:
            return {agent: books._info_of(agent) for agent in agents}
        infos = books.infos
        try:
            return {agent: infos[agent].copy() for agent in agents}
        except (AttributeError, KeyError):  # another type, handed out as it is; or none at all
            return {agent: _copied(infos.get(agent, {})) for agent in agents}


def _no_round(agent: AgentId, left: set[Any], agents: list[Any]) -> ContractError:
    again = agent in agents
    return ContractError(
        "a round of turns isn't a tick",
        where="agent_selection",
        expected=f"a turn of one of {sorted(map(repr, left))}"[:300],
        actual=f"another turn of {agent!r}"
        if again
        else f"a turn of {agent!r}, who has just joined",
        fix="convert it with style='turn'",
    )
