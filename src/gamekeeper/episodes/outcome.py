"""Outcome of one episode, agent by agent, and the conditions under which it counts as failed."""

from collections import ChainMap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Final, Literal, Self, TypeAlias, get_args

from gamekeeper.contract import Contract
from gamekeeper.contract.failure import Failure, Value
from gamekeeper.episodes.arrow import TERM
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.layout import role as role_in_name
from gamekeeper.episodes.plain_json import fields_json
from gamekeeper.errors import ContractError

TEAM: Final = "team"
EACH: Final = "agent"
"""In a contract's `[failure]`: a condition for each agent by itself."""
SAMPLED: Final = 20
"""Episodes whose figures an error looks at, to propose a condition."""
SUCCESS: Final = ("success", "is_success")
"""Names under which infos commonly say that an episode succeeded."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of an episode; every mapping is by agent.

    Attributes:
        seed: of its reset.
        turns: ticks, or turns of an AEC environment.
        returns: the sum of an agent's rewards.
        terms: the same by reward term that was paid; empty where the environment has no terms.
        endings: the reason why an agent ended, else `terminated`, `truncated`, or `cut`.
        infos: numbers and truth values in the last info of an agent that has any.
        seen: the turn of that info.
        flags: `terminated`, `truncated` or `cut`, whatever the reason is called.
        is_over: the episode ended by itself.
        error: the exception that broke it off.
    """

    seed: int | None = None
    turns: int = 0
    returns: Mapping[str, float] = field(default_factory=dict)
    terms: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    endings: Mapping[str, str] = field(default_factory=dict)
    infos: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    seen: Mapping[str, int] = field(default_factory=dict)
    flags: Mapping[str, str] = field(default_factory=dict)
    is_over: bool = True
    error: str | None = None

    @property
    def team_return(self) -> float:
        """The sum of all agents' returns."""
        return float(sum(self.returns.values()))

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return fields_json(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """The outcome that `to_json` wrote."""
        return cls(**data)


def plain_numbers(info: object) -> dict[str, float]:
    """The numbers and truth values among the fields of an info."""
    if not isinstance(info, Mapping):
        return {}
    found: dict[str, float] = {}
    for key, value in info.items():
        if getattr(value, "shape", None) == () and hasattr(value, "item"):
            value = value.item()
        if isinstance(value, bool | int | float):
            found[str(key)] = value
    return found


def outcome_of(episode: Episode) -> Outcome:
    """Outcome of a recorded episode."""
    returns: dict[str, float] = {}
    terms: dict[str, dict[str, float]] = {}
    endings: dict[str, str] = {}
    infos: dict[str, dict[str, float]] = {}
    seen: dict[str, int] = {}
    acted = 0
    for turn in episode.turns:
        acted += bool(turn.order)
        for agent in turn.agents:
            returns[agent] = returns.get(agent, 0.0) + turn.rewards.get(agent, 0.0)
            for name, value in turn.terms.get(agent, {}).items():
                paid = terms.setdefault(agent, {})
                paid[name] = paid.get(name, 0.0) + value
            if agent in turn.ended:
                endings[agent] = "terminated" if turn.terminated.get(agent) else "truncated"
        for agent, info in turn.infos.items():
            if numbers := plain_numbers(info):
                infos[agent], seen[agent] = numbers, turn.index
    if not acted and any(name.startswith(TERM) for name in episode.steps.schema.names):
        terms = {agent: {} for agent in returns}  # before a step no agent can have been paid
    named = episode.endings
    return Outcome(
        seed=episode.seed,
        turns=acted,
        returns=returns,
        terms=terms,
        infos=infos,
        seen=seen,
        endings={agent: str(named.get(agent) or endings.get(agent, "cut")) for agent in returns},
        flags={agent: endings.get(agent, "cut") for agent in returns},
        is_over=episode.header.get("end") == "ended",
        error=episode.header.get("error"),
    )


def failures(
    contract: Contract, condition: str | None = None, episodes: Iterable[Episode] = ()
) -> Mapping[str, Failure]:
    """The conditions that say what failed, by scope: `team`, a role, or `agent` for each.

    Args:
        condition: holds for the team, in place of what the contract declares.
        episodes: of the run; where nothing is declared, the error proposes a condition on these.
    Raises:
        ContractError: there is neither a condition nor a declaration.
    """
    if condition is not None:
        return {TEAM: Failure(condition)}
    if not contract.failure:
        outcomes = [outcome_of(each) for each in islice(episodes, SAMPLED)]
        raise ContractError(
            "nothing says when an episode failed",
            where="failure",
            expected="[failure] in the contract",
            actual="none",
            fix=f"give a condition: --failed '{_example(outcomes, contract)}' (in Python, "
            "failed=...)",
        )
    return contract.failure


def _example(outcomes: Sequence[Outcome], contract: Contract) -> str:
    """A condition on figures that the episodes have, which holds for some of them if they differ.

    Success is named only where the last infos of every episode have it.
    """
    rows = [dict(_of(each, [*each.returns], contract)) for each in outcomes]
    for name in SUCCESS:
        if rows and all(row.get(name) in (0, 1) for row in rows):
            return f"not {name}"
    for name in ("return", "length"):
        values = sorted({float(row[name]) for row in rows})
        if len(values) > 1:
            return f"{name} < {values[len(values) // 2]:.4g}"
    return "return < 0.5"


def failed(
    outcome: Outcome, conditions: Mapping[str, Failure], contract: Contract
) -> dict[str, bool]:
    """Tells if an episode failed: for the `team`, for roles, and for agents with a condition.

    An episode that an exception broke off failed for everybody. Where a condition stands for each
    agent, or for a role, its agents' own names stand in the answer too.

    Raises:
        ContractError: a condition names a figure that the episode doesn't have.
    """
    return {
        name: outcome.error is not None or condition.holds(values)
        for name, condition, values in _judged(outcome, conditions, contract)
    }


def check_measured(outcome: Outcome, conditions: Mapping[str, Failure], contract: Contract) -> None:
    """Checks that an episode measures everything that conditions ask for.

    Raises:
        ContractError: a condition names a figure that the episode doesn't have.
    """
    for _, condition, values in _judged(outcome, conditions, contract):
        condition.check(values)


def _judged(
    outcome: Outcome, conditions: Mapping[str, Failure], contract: Contract
) -> Iterator[tuple[str, Failure, Mapping[str, Value]]]:
    """Yields a name, the condition that is judged for it, and the figures to judge by."""
    asks_named = any("." in name for condition in conditions.values() for name in condition.names)
    named = _named(outcome, contract) if asks_named else {}
    for scope, condition in conditions.items():
        groups = {scope: members_of(scope, outcome.returns, contract)}
        if scope == EACH:
            groups = {agent: [agent] for agent in outcome.returns}
        for name, members in groups.items():
            yield name, condition, ChainMap(dict(_of(outcome, members, contract)), named)


def members_of(scope: str, agents: Iterable[str], contract: Contract) -> list[str]:
    """The agents in a scope: the whole `team`, a role's, or one by its name."""
    return [
        agent
        for agent in agents
        if scope in (TEAM, agent) or scope == (contract.role_of(agent) or role_in_name(agent))
    ]


def figures(outcome: Outcome, members: list[str], contract: Contract) -> dict[str, Value]:
    """The figures of an episode that a condition may name, for a group of agents.

    `return`, `length` (turns), `is_over`, `terminated`, `truncated` (all of them ended so),
    `ending` (their common reason; `mixed` where reasons differ, `cut` where an agent has none), a
    reward term (its sum over them), a field of the infos (where the agents that had it last agree,
    else it is left out). An agent's or role's own stand under its name: `carrier_0.return`,
    `picker.grasp`, `carrier_0.undelivered`. A declared term that was never paid is 0 where the
    episode has any term, or broke off; without terms at all it is left out.
    """
    return {**_named(outcome, contract), **dict(_of(outcome, members, contract))}


def _named(outcome: Outcome, contract: Contract) -> dict[str, Value]:
    """The figures of every role and every agent, under its name."""
    groups: dict[str, dict[str, None]] = {agent: {agent: None} for agent in outcome.returns}
    for agent in outcome.returns:
        groups.setdefault(contract.role_of(agent) or role_in_name(agent), {})[agent] = None
    return {
        f"{name}.{key}": value
        for name in sorted(groups)
        for key, value in _of(outcome, list(groups[name]), contract)
    }


def _of(outcome: Outcome, members: list[str], contract: Contract) -> Iterator[tuple[str, Value]]:
    latest: dict[str, tuple[int, set[float]]] = {}
    for agent in members:
        at = outcome.seen.get(agent, -1)
        for key, value in outcome.infos.get(agent, {}).items():
            when, values = latest.get(key, (-1, set()))
            latest[key] = (at, {value}) if at > when else (when, values)
            if at == when:
                values.add(value)
    yield from ((key, values.pop()) for key, (_, values) in latest.items() if len(values) == 1)
    declared = [name for name in contract.rewards if outcome.terms or outcome.error]
    named = {name for agent in members for name in outcome.terms.get(agent, {})}
    for term in sorted({*declared, *named}):
        yield term, sum(outcome.terms.get(agent, {}).get(term, 0.0) for agent in members)
    yield "return", sum(outcome.returns.get(agent, 0.0) for agent in members)
    yield "length", float(outcome.turns)
    yield "is_over", outcome.is_over
    endings = {outcome.endings.get(agent, "cut") for agent in members}
    yield "ending", endings.pop() if len(endings) == 1 else "mixed"


Label: TypeAlias = Literal[
    "perception", "state estimation", "planning", "control", "timing", "data coverage", "evaluation"
]

LABELS: Final[tuple[Label, ...]] = get_args(Label)
"""From what an agent senses to how it is judged: the order in which they are always listed."""
