"""Raw episodes as rows: one an agent and episode, and the columns that they have."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b
from itertools import pairwise
from math import isfinite
from typing import Any, Final, Self

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.contract.failure import Failure
from gamekeeper.episodes.layout import role as role_in_name
from gamekeeper.episodes.outcome import EACH, TEAM, Outcome, failed, figures, members_of
from gamekeeper.statistics.interval import FloatArray

REWARD: Final = "reward."
INFO: Final = "info."
BASE: Final = pa.schema(
    [
        ("environment", pa.string()),
        ("pairing", pa.string()),
        ("policy", pa.string()),
        ("run", pa.int32()),
        ("episode", pa.int64()),
        ("seed", pa.int64()),
        ("reset", pa.string()),
        ("agent", pa.string()),
        ("role", pa.string()),
        ("return", pa.float64()),
        ("length", pa.int64()),
        ("ending", pa.string()),
        ("terminated", pa.bool_()),
        ("truncated", pa.bool_()),
        ("success", pa.bool_()),
        ("success.team", pa.bool_()),
        ("success.role", pa.bool_()),
        ("success.agent", pa.bool_()),
        ("turns", pa.int64()),
        ("error", pa.string()),
    ]
)
"""Columns that all rows have; those of reward terms and of infos follow, by name."""
_FLAGS: Final = ("terminated", "truncated")
FAILED: Final = "failed"
"""The ending of an agent whose episode an exception broke off."""


NOT_FINITE: Final = "NotFinite"
"""Kind of error of an episode with a reward that is NaN or infinite; it breaks off at no turn."""


class Success:
    """Conditions under which an episode succeeded, by scope."""

    def __init__(self, contract: Contract, wanted: Mapping[str, str]) -> None:
        """Takes the conditions of success, else the contract's of failure.

        Raises:
            ContractError: a condition can't be read.
        """
        self._contract = contract
        self._wanted = {scope: Failure(text) for scope, text in wanted.items()}
        self.scopes = tuple(self._wanted or contract.failure)

    def of(self, outcome: Outcome) -> dict[str, bool]:
        """Success of an episode: by scope, and for agents with a condition by name.

        Raises:
            ContractError: a condition names a figure that the episode doesn't have.
        """
        if not self._wanted:
            failures = failed(outcome, self._contract.failure, self._contract)
            return {scope: not each for scope, each in failures.items()}
        answers: dict[str, bool] = {}
        for scope, condition in self._wanted.items():
            for each in list(outcome.returns) if scope == EACH else [scope]:
                members = members_of(each, outcome.returns, self._contract)
                values = figures(outcome, members, self._contract)
                answers[each] = outcome.error is None and condition.holds(values)
        return answers


def rows_of(
    outcome: Outcome,
    *,
    label: Mapping[str, Any],
    sides: Mapping[str, tuple[str, int]],
    lengths: Mapping[str, int],
    success: Success,
    contract: Contract,
    roster: Iterable[str],
    infos: Iterable[str] = (),
) -> list[dict[str, Any]]:
    """The rows of an episode.

    Args:
        label: environment, pairing and number of the episode.
        sides: by agent, role or `*`: policy and run.
        lengths: decisions by agent.
        contract: has the roles and the reward terms.
        roster: agents in the rows of an episode that an exception broke off in its reset.
        infos: fields of the last infos that are kept.
    """
    outcome = finite_of(outcome)
    successes = success.of(outcome)
    is_whole = outcome.error is None
    rows = []
    for agent in outcome.returns or dict.fromkeys(roster, 0.0) or {"": 0.0}:
        role = contract.role_of(agent) or role_in_name(agent)
        side = sides.get(agent) or sides.get(role) or sides["*"]
        own = successes.get(agent) if EACH in success.scopes or agent in success.scopes else None
        answers = [own, successes.get(role), successes.get(TEAM)]
        flag = outcome.flags.get(agent, "cut")
        row = {
            **label,
            "policy": side[0],
            "run": side[1],
            "seed": outcome.seed,
            "agent": agent,
            "role": role,
            "return": outcome.returns.get(agent) if is_whole else None,
            "length": lengths.get(agent, 0),
            "ending": outcome.endings.get(agent, "cut") if is_whole else FAILED,
            "terminated": is_whole and flag == "terminated",
            "truncated": is_whole and flag == "truncated",
            "success": next((each for each in answers if each is not None), None),
            "success.team": answers[2],
            "success.role": answers[1],
            "success.agent": answers[0],
            "turns": outcome.turns,
            "error": outcome.error,
        }
        if outcome.terms:
            declared = dict.fromkeys(contract.rewards, 0.0)
            paid = {**declared, **outcome.terms.get(agent, {})}
            row |= {f"{REWARD}{term}": value for term, value in paid.items()}
        seen = outcome.infos.get(agent, {})
        row |= {f"{INFO}{name}": float(seen[name]) for name in infos if name in seen}
        rows.append(row)
    return rows


def finite_of(outcome: Outcome) -> Outcome:
    """The outcome; as one that broke off where a reward wasn't finite.

    A sum with such a reward in it is no return, and to leave the agent out would change the team's.
    """
    if outcome.error is not None:
        return outcome
    paid = [(agent, "return", value) for agent, value in outcome.returns.items()]
    paid += [(a, term, x) for a, terms in outcome.terms.items() for term, x in terms.items()]
    for agent, what, value in paid:
        if not isfinite(value):
            text = f"{NOT_FINITE}: rewards of {agent!r} add up to {value} ({what})"
            return replace(outcome, error=text)
    return outcome


def table_of(rows: list[dict[str, Any]]) -> pa.Table:
    """The rows as a table; columns beyond the base ones are floats."""
    more = sorted({key for row in rows for key in row} - set(BASE.names))
    return pa.Table.from_pylist(rows, schema=schema_with(more))


def schema_with(more: Iterable[str]) -> pa.Schema:
    """The base columns and these."""
    return pa.schema([*BASE, *(pa.field(name, pa.float64()) for name in sorted(set(more)))])


def widened(table: pa.Table, schema: pa.Schema) -> pa.Table:
    """The table with all columns of a schema, null where it had none."""
    columns = [
        table[field.name]
        if field.name in table.schema.names
        else pa.nulls(table.num_rows, field.type)
        for field in schema
    ]
    return pa.table(columns, schema=schema)


class Fingerprint:
    """A digest of rows, whatever parts they come in."""

    def __init__(self, schema: pa.Schema) -> None:
        self._columns = {name: blake2b(digest_size=16) for name in schema.names}

    def add(self, table: pa.Table) -> None:
        """Takes the next rows."""
        for name, digest in self._columns.items():
            values = table[name].to_pylist()
            digest.update("\n".join(map(repr, values)).encode("utf-8", "surrogatepass") + b"\n")

    def hexdigest(self) -> str:
        """The digest of all rows taken."""
        whole = blake2b(digest_size=16)
        for name, digest in self._columns.items():
            whole.update(name.encode() + b"\0" + digest.digest())
        return whole.hexdigest()


RETURN, LENGTH, SUCCESS = "return", "length", "success"
ROLE: Final = "role"


@dataclass(frozen=True, slots=True)
class Sheet:
    """The episodes of one line-up, each agent's figures in columns.

    Attributes:
        agents: in the order in which they first appear.
        episodes: [episodes] their numbers, ascending.
        places: [rows] where each stands: episode and agent.
        failed_return: of each agent in episodes that broke off; None: they have none.
    """

    agents: tuple[str, ...]
    roles: tuple[str, ...]
    episodes: NDArray[np.int64]
    table: pa.Table
    places: tuple[NDArray[np.intp], NDArray[np.intp]]
    failed_return: float | None = None

    @classmethod
    def of(cls, table: pa.Table) -> Self:
        """The sheet of a line-up's rows."""
        agents = table["agent"].combine_chunks().dictionary_encode()
        names = tuple(agents.dictionary.to_pylist())
        which = agents.indices.to_numpy(zero_copy_only=False).astype(np.intp)
        episodes, at = np.unique(table["episode"].to_numpy(), return_inverse=True)
        roles = dict(zip(which.tolist(), table["role"].to_pylist(), strict=True))
        by_agent = tuple(str(roles[place]) for place in range(len(names)))
        return cls(names, by_agent, episodes, table, (at.astype(np.intp), which))

    def column(self, name: str) -> FloatArray:
        """[episodes, agents] a column's values; NaN where an agent wasn't there or has none."""
        found = np.full((len(self.episodes), len(self.agents)), np.nan)
        if name in self.table.schema.names:
            values = pc.cast(self.table[name], pa.float64()).to_numpy()
            found[self.places] = values
        if name == RETURN and self.failed_return is not None:
            found[self._is_broken()] = self.failed_return
        return found

    def members(self, scope: str, who: str) -> list[int]:
        """The columns of the agents in a scope."""
        if scope == TEAM:
            return list(range(len(self.agents)))
        names = self.roles if scope == ROLE else self.agents
        return [place for place, name in enumerate(names) if name == who]

    def values(self, metric: str, scope: str = TEAM, who: str = TEAM) -> FloatArray:
        """[episodes] a metric; NaN where an episode has none.

        The team's return and reward terms are sums over all agents; a role's figures are means
        over its agents in each episode; success is its own condition's.
        """
        members = self.members(scope, who)
        if metric == SUCCESS:
            return _first(self.column(f"success.{scope}")[:, members])
        if metric == LENGTH and scope == TEAM:
            return _first(self.column("turns"))
        figures = self.column(metric)[:, members]
        is_sum = scope == TEAM and (metric == RETURN or metric.startswith(REWARD))
        return _sums(figures) if is_sum else _means(figures)

    def metrics(self, terms: Sequence[str] | None, infos: Sequence[str]) -> list[str]:
        """The metrics that there are: return, length, reward terms, fields of the infos."""
        names = self.table.schema.names
        there = [name for name in names if name.startswith((REWARD, INFO))]
        wanted = [
            name
            for name in there
            if (name.startswith(REWARD) and (terms is None or name[len(REWARD) :] in terms))
            or (name.startswith(INFO) and name[len(INFO) :] in infos)
        ]
        return [
            RETURN,
            LENGTH,
            *(name for name in wanted if self.table[name].null_count < len(self.table)),
        ]

    @property
    def broken(self) -> NDArray[np.bool_]:
        """[episodes] whether it broke off."""
        return np.asarray(self._is_broken().any(axis=1))

    @property
    def ended(self) -> NDArray[np.bool_]:
        """[episodes] whether it is whole and no agent of it was cut."""
        cut = np.zeros(len(self.episodes), np.bool_)
        flags = [self.table[name].to_numpy(zero_copy_only=False) for name in _FLAGS]
        cut[self.places[0][~(flags[0] | flags[1]).astype(np.bool_)]] = True
        return np.asarray(~cut & ~self.broken)

    @property
    def resets(self) -> list[str | None]:
        """[episodes] digests of the first observations; None where there is none."""
        found: list[str | None] = [None] * len(self.episodes)
        if "reset" in self.table.schema.names:
            texts = self.table["reset"].to_pylist()
            for place, text in zip(self.places[0].tolist(), texts, strict=True):
                found[place] = text
        return found

    def _is_broken(self) -> NDArray[np.bool_]:
        found = np.zeros((len(self.episodes), len(self.agents)), np.bool_)
        found[self.places] = pc.is_valid(self.table["error"]).to_numpy()
        return found

    def endings(self, scope: str = TEAM, who: str = TEAM) -> dict[str, Any]:
        """Endings of the episodes: terminated, truncated, cut, broken off; and reasons by name.

        The team is counted by episode (`mixed` where its agents ended differently), others by
        agent and episode.
        """
        members = set(self.members(scope, who))
        reasons: dict[str, int] = {}
        kinds = {"terminated": 0, "truncated": 0, "cut": 0}
        for flag, reason in self._ends(members, is_team=scope == TEAM):
            kinds[flag] = kinds.get(flag, 0) + 1
            reasons[reason] = reasons.get(reason, 0) + 1
        return {**kinds, "reasons": dict(sorted(reasons.items()))}

    def _ends(self, members: set[int], *, is_team: bool) -> Iterator[tuple[str, str]]:
        terminated, truncated = (
            self.table[name].to_pylist() for name in ("terminated", "truncated")
        )
        reasons, broken = self.table["ending"].to_pylist(), self.table["error"].to_pylist()
        episodes, agents = (places.tolist() for places in self.places)
        by_episode: dict[int, set[tuple[str, str]]] = {}
        for row, agent in enumerate(agents):
            if agent not in members:
                continue
            flag = "terminated" if terminated[row] else "truncated" if truncated[row] else "cut"
            end = ("failed" if broken[row] is not None else flag, str(reasons[row]))
            if is_team:
                by_episode.setdefault(episodes[row], set()).add(end)
            else:
                yield end
        for ends in by_episode.values():
            flags, names = {flag for flag, _ in ends}, {name for _, name in ends}
            yield _one(flags), _one(names)


def lost(sheets: Sequence[Sheet], values: Sequence[FloatArray]) -> int:
    """Number of seeds on which a sheet has no figure because its episode broke off."""
    each = [np.isnan(figures) & sheet.broken for sheet, figures in zip(sheets, values, strict=True)]
    return int(np.any(each, axis=0).sum())


def sheets_of(table: pa.Table) -> dict[tuple[str, str], Sheet]:
    """The sheets of a table of episodes, by environment and line-up; its rows stand in order."""
    if not table.num_rows:
        return {}
    names = [table[key].combine_chunks().dictionary_encode() for key in ("environment", "pairing")]
    one, two = (each.indices.to_numpy(zero_copy_only=False) for each in names)
    changes = np.flatnonzero((np.diff(one) != 0) | (np.diff(two) != 0)) + 1
    bounds = [0, *changes.tolist(), table.num_rows]
    found = {}
    for start, end in pairwise(bounds):
        part = table.slice(start, end - start)
        key = (str(part["environment"][0]), str(part["pairing"][0]))
        found[key] = Sheet.of(part)
    return found


def _one(words: set[str]) -> str:
    return next(iter(words)) if len(words) == 1 else "mixed"


def _first(figures: FloatArray) -> FloatArray:
    """[episodes] the value that all agents of an episode share."""
    if not figures.shape[1]:
        return np.full(len(figures), np.nan)
    place = np.argmax(~np.isnan(figures), axis=1)
    return np.asarray(figures[np.arange(len(figures)), place])


def _sums(figures: FloatArray) -> FloatArray:
    total = np.nansum(figures, axis=1)
    return np.where(np.isnan(figures).all(axis=1), np.nan, total)


def _means(figures: FloatArray) -> FloatArray:
    count = (~np.isnan(figures)).sum(axis=1)
    total = np.nansum(figures, axis=1)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))
