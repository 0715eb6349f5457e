"""`TickEnv`: a Parallel environment of which the author writes the rules alone."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Space
from pettingzoo import ParallelEnv

from gamekeeper.errors import ActionError
from gamekeeper.interface.author_calls import (
    HORIZON,
    AgentId,
    Touched,
    after_end,
    before_reset,
    check_first_state,
    check_roster,
)
from gamekeeper.interface.authoring import Authored
from gamekeeper.interface.legality import learn_ranges, mismatch

Given = dict[Any, Any]


class TickEnv(Authored, ParallelEnv[Any, Any, Any]):
    """All agents act at once, and one rule resolves it: PettingZoo's Parallel interface.

    Written like a `TurnEnv`, with `tick(actions)` in place of `act`, and without `first_agent` and
    `next_agent`. `actions` always has the live agents in the order of `possible_agents`, whatever
    order they were handed in: a rule whose outcome hangs on the caller's dictionary can't be
    written. For the same reason the roster is in that order, and who joins has its own place in it.

    Every dictionary that `step` returns is new and holds the same agents: those who were live as
    the tick began, with the last observation and reward of those who ended in it, and those who
    joined. Who ended is out of `agents` when `step` returns and may not be given an action again.
    """

    __slots__ = (
        "__limit",
        "__places",
        "__ranges",
        "__spaces",
        "agents",
        "endings",
        "infos",
        "rewards",
        "terminations",
        "terms",
        "touched",
        "truncations",
        "turns",
    )

    infos: dict[Any, dict[str, Any]]
    turns: int
    __places: dict[Any, int]
    __spaces: dict[Any, Space[Any]]
    __ranges: dict[Any, range]

    # -- what an author writes

    def tick(self, actions: dict[Any, Any]) -> None:
        """Plays one tick by the rules of the task.

        Args:
            actions: by live agent, in the order of possible_agents; the rule may keep it.
        """
        raise NotImplementedError(f"{type(self).__name__} has no tick(actions)")

    # -- PettingZoo's side

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Given, dict[Any, dict[str, Any]]]:
        """Begins an episode (of a new seed, or the next one of the last): observations, infos.

        Raises:
            DrawError: the seed is no whole number in [0, 2**64).
            ContractError: the rules break a promise of the books.
        """
        rng = self._take_seed(seed)
        self.__places = {agent: place for place, agent in enumerate(self.possible_agents)}
        roster = list(self.starting_agents())
        check_roster(roster, self._possible())
        self.agents = sorted(roster, key=self.__places.__getitem__)
        self.endings, self.touched, self.turns = {}, Touched(), 0
        self.__limit = self._limit()
        self.__open_tick()
        self.start(rng, dict(options or {}))
        self._check_names(is_begun=True)
        check_first_state(self.touched)
        self.touched.joined.clear()
        self._learn_spaces(self.agents)
        return self.__show(), self.infos

    def step(
        self, actions: Mapping[Any, Any]
    ) -> tuple[
        Given, dict[Any, float], dict[Any, bool], dict[Any, bool], dict[Any, dict[str, Any]]
    ]:
        """Plays one tick: observations, rewards, terminations, truncations, infos.

        Actions that are refused leave everything as it was.

        Raises:
            OrderError: there was no reset, or everybody has ended.
            ActionError: an agent has no action, one that isn't live has one, or one isn't legal.
        """
        try:
            agents = self.agents
        except AttributeError:
            raise before_reset("step") from None
        if not agents:
            raise after_end("step")
        ordered, refused = self.__in_order(actions)
        self.__open_tick()
        for agent, action in refused.items():
            ordered[agent] = self.illegal(agent, action)
            if ordered[agent] is None:
                del ordered[agent]
        self.turns += 1
        self.tick(ordered)
        if self.turns == self.__limit:
            for agent in self.agents:
                if agent not in self.endings:
                    self.truncate(agent, HORIZON)
        observations = self.__show()
        ended = self.touched.ended
        if ended:
            self.agents = [agent for agent in self.agents if agent not in self.endings]
            self.touched.left.extend(ended)
        return observations, self.rewards, self.terminations, self.truncations, self.infos

    # -- within a tick

    def __open_tick(self) -> None:
        """New dictionaries, of nothing paid and nobody ended."""
        agents, touched = self.agents, self.touched
        self.rewards = dict.fromkeys(agents, 0.0)
        self.terminations = dict.fromkeys(agents, False)
        self.truncations = dict.fromkeys(agents, False)
        self.terms = {}
        touched.paid.clear()
        touched.ended.clear()
        touched.joined.clear()
        touched.left.clear()

    def __in_order(self, actions: Mapping[Any, Any]) -> tuple[Given, Given]:
        """All actions in the order of the roster, and those that a rule must punish."""
        is_mapping = type(actions) is dict or isinstance(actions, Mapping)
        if not is_mapping or len(actions) != len(self.agents):
            raise self.__mismatch(actions)
        ordered: Given = {}
        refused: Given = {}
        ranges = self.__ranges
        for agent in self.agents:
            try:
                action = actions[agent]
            except KeyError:
                raise self.__mismatch(actions) from None
            if type(action) is not int:
                if isinstance(action, np.integer) and int(action) in ranges[agent]:
                    ordered[agent] = int(action)  # what NumPy samples, so most actions there are
                    continue
            elif action in ranges[agent]:
                ordered[agent] = action
                continue
            plays, action = self._judge(agent, action)
            if not plays:
                refused[agent] = action
            ordered[agent] = action
        return ordered, refused

    def __show(self) -> Given:
        """Everybody's observation and new info; a picture for who watches."""
        agents, view = self.agents, self._view
        if self._masks:
            self._forget_masks()
        observations = {agent: view(agent) for agent in agents}
        if self._masks or self._informs:
            self.infos = {agent: self._info_of(agent) for agent in agents}
        else:
            self.infos = {agent: {} for agent in agents}
        if self.render_mode == "human":
            self.render()
        return observations

    def __mismatch(self, actions: Any) -> ActionError:
        """Error that names agents without an action, and actions without a live agent."""

        def fault_of(agent: Any) -> str:
            if agent in self.endings:
                return "an action of who has ended:"
            is_known = agent in self.__places
            return "an action of who hasn't joined:" if is_known else "an action of nobody's:"

        return mismatch(actions, self.agents, fault_of)

    # -- the roster

    def _enter(self, agent: AgentId) -> None:
        """Opens the books of an agent that joins, at its place among the possible agents."""
        self._learn_spaces((agent,))
        self.agents = sorted([*self.agents, agent], key=self.__places.__getitem__)
        self.rewards[agent] = 0.0
        self.terminations[agent] = self.truncations[agent] = False

    def _possible(self) -> frozenset[Any]:
        return frozenset(self.__places)

    def _range_of(self, agent: AgentId) -> range:
        return self.__ranges[agent]

    def _learn_spaces(self, agents: Iterable[Any]) -> None:
        try:
            spaces, ranges = self.__spaces, self.__ranges
        except AttributeError:
            spaces, ranges = self.__spaces, self.__ranges = {}, {}
        learn_ranges(agents, self.action_space, spaces, ranges, trusted=self._trusts_ranges)
