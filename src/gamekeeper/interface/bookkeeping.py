"""Bookkeeping of an AEC environment, in one place: rewards, endings, roster, order of turns.

`Books` makes PettingZoo's promises and plays no game: `TurnEnv` puts an author's rules on top, a
converter a Parallel environment. A turn costs the same for 2 agents as for 2,048, because

- a step zeroes and adds up only the rewards of agents that `add_reward` named. The sum is added
  once, after the rules, and not inside `add_reward`: (c + a) + b and c + (a + b) differ in their
  last digits, and PettingZoo means the second;
- the next agent is looked up, and agents that wait for their last turn stand in a list of their
  own;
- what is read at every turn lies in slots. An instance dictionary that was looked at once (pickle,
  deepcopy, a snapshot) makes each access twice as dear; slots don't notice.

What no other module needs has two underscores: subclasses are strangers' code, and a clash would be
silent. Names with one are reserved (`game.reserved`): a TurnEnv that takes one is refused.
"""

from bisect import bisect_left
from collections.abc import Iterable, Iterator
from typing import Any

from gymnasium.spaces import Space
from pettingzoo import AECEnv

from gamekeeper.errors import ActionError
from gamekeeper.interface.author_calls import (
    HORIZON,
    AgentId,
    AuthorCalls,
    Touched,
    after_end,
    before_reset,
    check_first_state,
    check_roster,
    loop_without_step,
)
from gamekeeper.interface.legality import judge, learn_ranges, refused


class Circle:
    """Cyclic order of agents: the next one in O(1), joining in O(1), leaving in O(log n).

    `after` and `before` hold each agent's neighbours, `place` a number for each that grows along
    the roster, from its first to its last.
    """

    __slots__ = ("_places", "after", "before", "place")

    def __init__(self, agents: list[Any]) -> None:
        """A circle of distinct agents in the order of the list."""
        self.place = {agent: place for place, agent in enumerate(agents)}
        self._places = list(range(len(agents)))  # of all in the circle, ascending
        self.after = dict(zip(agents, agents[1:] + agents[:1], strict=True))
        self.before = dict(zip(agents, agents[-1:] + agents[:-1], strict=True))

    def append(self, agent: AgentId, last: AgentId) -> None:
        """Puts an agent between the last of the roster and the first."""
        self.place[agent] = self._places[-1] + 1
        self._places.append(self.place[agent])
        first = self.after[last]
        self.after[last] = self.before[first] = agent
        self.after[agent], self.before[agent] = first, last

    def remove(self, agent: AgentId) -> int:
        """Takes an agent out of the circle and says which position of the roster it had."""
        after, before = self.after.pop(agent), self.before.pop(agent)
        if after != agent:
            self.after[before], self.before[after] = after, before
        position = bisect_left(self._places, self.place.pop(agent))
        del self._places[position]
        return position


class Books(AuthorCalls, AECEnv[Any, Any, Any]):
    """An AEC environment whose books are kept and whose rules are missing.

    A subclass calls `_open` and `_begin` when an episode begins and writes `act`; it may write
    `next_agent`, `_judge`, `_play`, `_view` and `_show`. Public attributes are PettingZoo's own, as
    ordinary dictionaries and lists, and `terms`, `endings`, `touched`, `turns`. They are written
    through the verbs only: what is put into `rewards` or `terminations` by hand isn't noticed.
    """

    __slots__ = (
        "__acted",
        "__after",
        "__chooses",
        "__circle",
        "__due",
        "__ended",
        "__limit",
        "__paid",
        "__possible",
        "__ranges",
        "__shows",
        "__spaces",
        "__stepped",
        "__stirred",
        "__then",
        "__tick",
        "__waiting",
        "_cumulative_rewards",
        "agent_selection",
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
    __spaces: dict[Any, Space[Any]]
    __ranges: dict[Any, range]
    __waiting: list[Any]  # who has ended and is still in the roster, the next to leave at the end
    __acted: set[Any]  # who had a turn in this tick; kept under a limit only, like the next
    agent_selection: Any
    __due: set[Any]  # who was live as this tick began and had no turn in it yet
    __then: Any  # whose turn it is once those who wait have left

    _trusts_ranges = True  # False where a number in its range may still be refused (masks)

    # -- what a subclass writes

    def act(self, agent: Any, action: Any) -> None:
        """Plays one turn by the rules of the task."""
        raise NotImplementedError(f"{type(self).__name__} has no act(agent, action)")

    def next_agent(self, agent: Any) -> Any:
        """Agent that acts after `agent`, asked as its turn ends; by default the roster's next."""
        return self.__after[agent]

    def first_to_leave(self) -> Any:
        """Agent that has its last turn first where several end; None: the first in the roster."""
        return None

    def _judge(self, agent: Any, action: Any) -> tuple[bool, Any]:
        """Tells whether an action may be played, and its form, where the range doesn't tell.

        Raises:
            ActionError: it may not, and no rule says what then.
        """
        space = self.action_space(agent)
        if not judge(space, action)[0]:
            raise refused(agent, action, space)
        return True, action

    def _play(self, agent: Any, action: Any) -> None:
        """Runs in place of `act` where `_judge` refused the action."""
        raise NotImplementedError

    def _view(self, agent: Any) -> Any:
        """The observation that `last` hands out."""
        return self.observe(agent)

    def _show(self, agents: Iterable[Any]) -> None:
        """Gets ready what these agents are shown next, where `_open` was told so.

        Called with everybody as an episode begins, and with the agent in turn as each turn does.
        """

    # -- episodes

    def _open(
        self, agents: Iterable[AgentId], *, horizon: int | None = None, shows: bool = False
    ) -> None:
        """Opens the books of a new episode.

        Args:
            agents: the roster to begin with, in order.
            horizon: ticks after which everybody is truncated. A tick is over once all who were live
                as it began have had a turn or ended, or the turn comes to an agent that already had
                one in it. In a fixed order: once round; who joins begins with the next tick.
            shows: whether `_show` is called.
        Raises:
            ContractError: there are no agents, or one stands there twice or isn't a possible agent.
        """
        roster = list(agents)
        self.__possible = frozenset(self.possible_agents)
        check_roster(roster, self.__possible)
        self.__circle = Circle(roster)
        self.__after = self.__circle.after
        self.rewards = dict.fromkeys(roster, 0.0)
        self._cumulative_rewards = dict.fromkeys(roster, 0.0)
        self.terminations = dict.fromkeys(roster, False)
        self.truncations = dict.fromkeys(roster, False)
        self.infos = {agent: {} for agent in roster}
        self.terms, self.endings, self.touched = {}, {}, Touched()
        self.__paid, self.__ended = self.touched.paid, self.touched.ended
        self.__waiting, self.__then, self.__stirred = [], None, False
        self.__limit, self.__tick, self.__acted, self.__due = horizon, 0, set(), set(roster)
        self.__shows = shows
        self.__chooses = type(self).next_agent is not Books.next_agent
        self.turns = 0
        self.agents, self.agent_selection = roster, roster[0]
        self.__stepped = True

    def _begin(self, first: AgentId) -> None:
        """Hands the first turn over, once the first state is there.

        Raises:
            ContractError: somebody was paid or ended already, or the first isn't in the roster.
        """
        check_first_state(self.touched)
        if first not in self.rewards:
            raise self._absent(first, "given the first turn")
        self.__settle_down()
        self._learn_spaces(self.agents)
        self.agent_selection = first
        if self.__shows:
            self._show(self.agents)

    def _range_of(self, agent: AgentId) -> range:
        return self.__ranges[agent]

    def _learn_spaces(self, agents: Iterable[AgentId]) -> None:
        try:
            spaces, ranges = self.__spaces, self.__ranges
        except AttributeError:
            spaces, ranges = self.__spaces, self.__ranges = {}, {}
        learn_ranges(agents, self.action_space, spaces, ranges, trusted=self._trusts_ranges)

    # -- PettingZoo's side

    def step(self, action: Any) -> None:
        """Plays one turn of the agent in turn, or its last one, in which only None can be done.

        An action that is refused leaves everything as it was.

        Raises:
            OrderError: there was no reset, or everybody has left.
            ActionError: the action isn't one that the agent may take now.
        """
        try:
            agent = self.agent_selection
        except AttributeError:
            raise before_reset("step") from None
        # Until those that ended have left, every step is one's last turn.
        if self.__waiting:
            self.__bury(agent, action)
            return
        plays = True
        if type(action) is not int or action not in self.__ranges[agent]:
            plays, action = self._judge(agent, action)
        paid = self.__paid
        if paid:
            rewards = self.rewards
            for name in paid:
                rewards[name] = 0.0
            paid.clear()
            self.terms.clear()
        if self.__stirred:
            self.__settle_down()
        # Cleared before the rules and not after: what this very step pays its actor has to stand in
        # the sum that it is given at its next turn.
        self._cumulative_rewards[agent] = 0.0
        self.turns += 1
        if plays:
            self.act(agent, action)
        else:
            self._play(agent, action)
        if paid:
            rewards, cumulative = self.rewards, self._cumulative_rewards
            for name in paid:
                cumulative[name] += rewards[name]
        then = self.__chosen(agent) if self.__chooses else self.__after[agent]
        if self.__ended or self.__limit is not None:
            then = self.__pass_on(agent, then)
        self.agent_selection = then
        self.__stepped = True
        if self.__shows:
            self._show((then,))

    def last(self, observe: bool = True) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Observation, reward since its last turn, flags and info of the agent in turn.

        Raises:
            OrderError: there was no reset, or everybody has left.
        """
        try:
            agent = self.agent_selection
        except AttributeError:
            raise before_reset("last") from None
        if not self.agents:
            raise after_end("last")
        return (
            self._view(agent) if observe else None,
            self._cumulative_rewards[agent],
            self.terminations[agent],
            self.truncations[agent],
            self.infos[agent],
        )

    def agent_iter(self, max_iter: int = 2**63) -> Iterator[Any]:
        """The agents in the order of their turns, for a loop that steps once each time round.

        Raises:
            OrderError: there was no reset; or the loop went round without a step.
        """
        if not hasattr(self, "agents"):
            raise before_reset("agent_iter")
        self.__stepped = True
        return self.__turns_to_come(max_iter)

    def __turns_to_come(self, left: int) -> Iterator[Any]:
        while left > 0 and self.agents:
            if not self.__stepped:
                raise loop_without_step()
            self.__stepped = False
            left -= 1
            yield self.agent_selection

    # -- between turns

    def __chosen(self, agent: AgentId) -> Any:
        """Next agent by the author's rule, which isn't asked where no agent is left."""
        if len(self.__ended) == len(self.agents):
            return agent
        then = self.next_agent(agent)
        if then not in self.rewards:
            raise self._absent(then, "given a turn by next_agent")
        return then

    def __pass_on(self, agent: AgentId, then: AgentId) -> Any:
        """Next agent: first those with a last turn due, in roster order, then the next live one."""
        endings, ended = self.endings, self.__ended
        if len(ended) < len(self.agents):  # a live one is left, or this would go round for ever
            while then in endings:
                then = self.__after[then]
        if self.__limit is not None:
            acted, due = self.__acted, self.__due
            acted.add(agent)
            due.discard(agent)
            due.difference_update(ended)
            if then in acted or not due:
                self.__end_tick()
        if not ended:
            return then
        self.__then = then
        self.__waiting = sorted(ended, key=self.__circle.place.__getitem__, reverse=True)
        self.__stirred = True
        first = self.first_to_leave()
        if first in self.__waiting:
            self.__waiting.remove(first)
            self.__waiting.append(first)
        return self.__waiting[-1]

    def __end_tick(self) -> None:
        """Counts a tick; at the limit everybody left is truncated."""
        self.__tick += 1
        if self.__tick == self.__limit:
            for name in self.agents:
                if name not in self.endings:
                    self.truncate(name, HORIZON)
        self.__acted.clear()
        self.__due = set(self.agents).difference(self.__ended)

    def __bury(self, agent: AgentId, action: Any) -> None:
        """The last turn of one that has ended: it leaves the roster, and nobody is paid."""
        if not self.agents:
            raise after_end("step")
        if action is not None:
            raise ActionError(
                f"agent {agent!r} acted after it had ended",
                where="step",
                expected="None",
                actual=repr(action)[:300],
                fix="step(None) where last() says terminated or truncated",
            )
        for name in self.__paid:
            self.rewards[name] = 0.0
        self.__paid.clear()
        self.terms.clear()
        self.__settle_down()
        del self.rewards[agent], self._cumulative_rewards[agent], self.infos[agent]
        del self.terminations[agent], self.truncations[agent]
        # By its position: list.remove would compare all agents before it.
        del self.agents[self.__circle.remove(agent)]
        self.touched.left.append(agent)
        self.__stirred = True
        waiting = self.__waiting
        waiting.pop()
        if waiting:
            self.agent_selection = waiting[-1]
        elif self.agents:
            self.agent_selection = self.__then
        else:
            waiting.append(agent)  # the next step comes here again, and raises: nobody is left
        self.__stepped = True
        if self.__shows and self.agents:
            self._show((self.agent_selection,))

    def __settle_down(self) -> None:
        """Forgets whom the last step moved."""
        touched = self.touched
        touched.ended.clear()
        touched.joined.clear()
        touched.left.clear()
        self.__stirred = False

    def _enter(self, agent: AgentId) -> None:
        """Opens the books of an agent that joins, at the end of the roster."""
        self._learn_spaces((agent,))
        self.__circle.append(agent, self.agents[-1])
        self.agents.append(agent)
        self.rewards[agent] = self._cumulative_rewards[agent] = 0.0
        self.terminations[agent] = self.truncations[agent] = False
        self.infos[agent] = {}
        self.__stirred = True

    def _arrange(self, roster: Iterable[AgentId]) -> None:
        """Gives the roster another order, within a step; who isn't named leaves at once.

        For rules that keep a roster of their own, as those of a converted environment do.
        """
        self.agents[:] = roster
        for agent in self.rewards.keys() - set(self.agents):
            del self.rewards[agent], self._cumulative_rewards[agent], self.infos[agent]
            del self.terminations[agent], self.truncations[agent]
            self.__paid.pop(agent, None)
            self.touched.left.append(agent)
            self.__stirred = True
        self.__circle = Circle(self.agents)
        self.__after = self.__circle.after

    def _possible(self) -> frozenset[Any]:
        return self.__possible
