"""Calls by which rules keep their accounts: add_reward, terminate, truncate, join.

The same four verbs serve environments of both APIs. They keep the public dictionaries right and
note who was touched, so that nobody has to look at every agent to find out what a step did.
"""

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from gamekeeper.errors import ContractError, OrderError

AgentId = Hashable
TERMINATED: Final = "terminated"
TRUNCATED: Final = "truncated"
HORIZON: Final = "horizon"  # the reason of those whom a time limit ends


@dataclass(frozen=True, slots=True)
class Touched:
    """Agents that the last step touched: all that a reader must look at, and no others.

    The containers belong to the books and are emptied as the next step begins: read them then.

    Args:
        paid: agents with a reward, as the keys of a dictionary, in the order of their first one.
        ended: agents that were terminated or truncated, in order.
        joined: agents that came into the roster, in order.
        left: agents that went out of it.
    """

    paid: dict[Any, None] = field(default_factory=dict)
    ended: list[Any] = field(default_factory=list)
    joined: list[Any] = field(default_factory=list)
    left: list[Any] = field(default_factory=list)


class AuthorCalls:
    """The verbs of an author's rules, over dictionaries that the class below keeps.

    What may be called when: inside `act` or `tick`, and inside `illegal`.
    """

    __slots__ = ()

    agents: list[Any]
    possible_agents: list[Any]
    rewards: dict[Any, float]
    terminations: dict[Any, bool]
    truncations: dict[Any, bool]
    terms: dict[Any, dict[str, float]]
    endings: dict[Any, str]
    touched: Touched

    def add_reward(self, agent: AgentId, amount: float, term: str | None = None) -> None:
        """Adds an amount to what this step pays an agent.

        Args:
            agent: anybody in the roster; one who ends in this step gets its last reward.
            amount: finite, in reward units.
            term: the reward term that it belongs to; kept apart in `terms`.
        Raises:
            ContractError: the agent isn't in the roster, or the amount isn't finite.
        """
        amount = float(amount)
        if amount - amount != 0.0:  # neither NaN nor an infinity minus itself is 0
            raise _unpayable(agent, amount)
        try:
            self.rewards[agent] += amount
        except KeyError:
            raise self._absent(agent, "paid") from None
        self.touched.paid[agent] = None
        if term is not None:
            paid = self.terms.get(agent)
            if paid is None:
                self.terms[agent] = {term: amount}
            else:
                paid[term] = paid.get(term, 0.0) + amount

    def terminate(self, agent: AgentId, reason: str = TERMINATED) -> None:
        """Ends an agent by the rules of the task. To say it twice changes nothing.

        Args:
            agent: anybody in the roster.
            reason: the name of the ending; the first one given for an agent stands in `endings`.
        Raises:
            ContractError: the agent isn't in the roster.
        """
        self._end(self.terminations, agent, reason)

    def truncate(self, agent: AgentId, reason: str = TRUNCATED) -> None:
        """Ends an agent for a reason outside the task: a time limit, an empty battery, leaving.

        PettingZoo knows no way out of the roster but an ending, so who leaves is truncated.

        Args:
            agent: anybody in the roster.
            reason: the name of the ending; the first one given for an agent stands in `endings`.
        Raises:
            ContractError: the agent isn't in the roster.
        """
        self._end(self.truncations, agent, reason)

    def join(self, agent: AgentId) -> None:
        """Brings an agent into the roster; from now on it can be paid, and its turns come.

        Raises:
            ContractError: it is in the roster already, ended before in this episode (an identity is
                used once, or a learner would bootstrap across its end), or isn't a possible agent.
        """
        if agent in self.rewards:
            raise ContractError(
                f"agent {agent!r} joined twice",
                where="join",
                expected="an agent that isn't in the roster",
                actual="one that is",
                fix="ask `agent in self.agents` first",
            )
        if agent in self.endings:
            raise ContractError(
                f"agent {agent!r} joined after it had ended",
                where="join",
                expected="an agent that hasn't ended in this episode",
                actual=f"one that ended: {self.endings[agent]}",
                fix="let it come back under another of the possible agents' names",
            )
        if agent not in self._possible():
            raise ContractError(
                f"agent {agent!r} joined, but isn't in possible_agents",
                where="join",
                expected="one of possible_agents",
                actual=repr(agent),
                fix="list every agent that may ever appear in possible_agents",
            )
        self._enter(agent)
        self.touched.joined.append(agent)

    def _end(self, flags: dict[Any, bool], agent: AgentId, reason: str) -> None:
        """Sets an agent's flag, and notes its end the first time."""
        try:
            if flags[agent]:
                return
        except KeyError:
            raise self._absent(agent, "ended") from None
        flags[agent] = True
        if agent not in self.endings:
            self.endings[agent] = reason
            self.touched.ended.append(agent)

    def _enter(self, agent: AgentId) -> None:
        """Opens the books of a new agent, and finds its place in the roster."""
        raise NotImplementedError

    def _possible(self) -> frozenset[Any]:
        """Agents that may appear in some episode."""
        raise NotImplementedError

    def _view(self, agent: Any) -> Any:
        """The observation that is handed out: the author's, without its guard and with the mask."""
        raise NotImplementedError

    def _range_of(self, agent: AgentId) -> range:
        """The whole numbers that need no further look as actions of an agent."""
        raise NotImplementedError

    def _learn_spaces(self, agents: Iterable[Any]) -> None:
        """Reads the action spaces of agents that come into the roster."""
        raise NotImplementedError

    def _absent(self, agent: AgentId, deed: str) -> ContractError:
        """Error about an agent that isn't in the roster."""
        if agent in self.endings:
            actual, fix = (
                f"it ended before: {self.endings[agent]}",
                "ask `agent in self.agents` first",
            )
        elif agent in self.possible_agents:
            actual, fix = "it hasn't joined", "call self.join(agent) first"
        else:
            actual, fix = "nobody of that name", "use a name of possible_agents"
        return ContractError(
            f"agent {agent!r} was {deed} and isn't in the roster",
            where="the rules",
            expected="one of self.agents",
            actual=actual,
            fix=fix,
        )


def _unpayable(agent: AgentId, amount: float) -> ContractError:
    """Error that says why an amount can't be added as a reward."""
    return ContractError(
        f"agent {agent!r} was paid {amount}",
        where="add_reward",
        expected="a finite number",
        actual=str(amount),
        fix="look for a division by 0 or an overflow in the rule",
    )


def check_roster(agents: list[Any], possible: frozenset[Any]) -> None:
    """An episode begins with at least one agent, each of them once and each a possible one.

    Raises:
        ContractError: it doesn't.
    """
    strangers = [agent for agent in agents if agent not in possible]
    if agents and not strangers and len(set(agents)) == len(agents):
        return
    raise ContractError(
        "an episode can't begin with this roster",
        where="starting_agents",
        expected="one or more of possible_agents, each once",
        actual=f"{strangers[0]!r}, who isn't one" if strangers else repr(agents),
        fix="yield agents of possible_agents from starting_agents, each once",
    )


def check_first_state(touched: Touched) -> None:
    """Raises where the first state rewards or ends an agent: after a reset rewards are 0.

    Raises:
        ContractError: somebody was.
    """
    if touched.paid or touched.ended:
        deed, agents = ("paid", list(touched.paid)) if touched.paid else ("ended", touched.ended)
        raise ContractError(
            f"agent {agents[0]!r} was {deed} before anybody acted",
            where="start",
            expected="no rewards and no endings in the first state",
            actual=f"{deed}: {agents!r}"[:300],
            fix="leave it out of starting_agents(), or wait for the first turn",
        )


def reset_arguments(seed: int | None, options: Mapping[str, Any] | None) -> dict[str, Any]:
    """Keyword arguments of a `reset`, without those that are None: some environments take none."""
    arguments = {"seed": seed, "options": options}
    return {name: value for name, value in arguments.items() if value is not None}


def before_reset(call: str) -> OrderError:
    """Something was called before the first reset."""
    return OrderError(f"{call}() came before reset()", where=call, fix="call reset() first")


def loop_without_step(kind: type[OrderError] = OrderError) -> OrderError:
    """Error of a loop over `agent_iter` that went round without a step."""
    return kind(
        "a loop over agent_iter() went round without a step",
        where="agent_iter",
        expected="step() or reset() once in each round",
        actual="neither",
        fix="call step(action) once in each round; None for an agent that has ended",
    )


def after_end(call: str) -> OrderError:
    """Something was called after the last agent had left."""
    return OrderError(
        f"{call}() came after the last agent had left",
        where=call,
        expected="reset()",
        fix="go on only while env.agents isn't empty",
    )
