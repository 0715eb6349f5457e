"""Raw episodes as rows: one an agent and episode, and the columns that they have."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from hashlib import blake2b
from typing import Any, Final

import pyarrow as pa

from gamekeeper.core.contract import Contract
from gamekeeper.core.contract.failure import Failure
from gamekeeper.core.layout import role as role_in_name
from gamekeeper.core.outcome import EACH, TEAM, Outcome, failed, figures, members_of

REWARD: Final = "reward."
INFO: Final = "info."
SUCCESS: Final = "success."
BASE: Final = pa.schema(
    [
        ("environment", pa.string()), ("pairing", pa.string()), ("policy", pa.string()),
        ("run", pa.int32()), ("episode", pa.int64()), ("seed", pa.int64()), ("agent", pa.string()),
        ("role", pa.string()), ("return", pa.float64()), ("length", pa.int64()),
        ("ending", pa.string()), ("terminated", pa.bool_()), ("truncated", pa.bool_()),
        ("success", pa.bool_()), ("success.team", pa.bool_()), ("success.role", pa.bool_()),
        ("success.agent", pa.bool_()), ("turns", pa.int64()), ("error", pa.string()),
    ]
)  # fmt: skip
"""Columns that all rows have; those of reward terms and of infos follow, by name."""
FAILED: Final = "failed"
"""The ending of an agent whose episode an exception broke off."""


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
        """Whether it succeeded: by scope, and for agents with a condition by name.

        Raises:
            ContractError: a condition names a figure that the episode doesn't have.
        """
        if not self._wanted:
            told = failed(outcome, self._contract.failure, self._contract)
            return {scope: not each for scope, each in told.items()}
        answers: dict[str, bool] = {}
        for scope, condition in self._wanted.items():
            whom = list(outcome.returns) if scope == EACH else [scope]
            for each in whom:
                members = members_of(each, outcome.returns, self._contract)
                holds = outcome.error is None and condition.holds(
                    figures(outcome, members, self._contract)
                )
                answers[each] = holds
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
        outcome: what it came to.
        label: environment, pairing and number of the episode.
        sides: by agent, role or `*`: policy and run.
        lengths: decisions by agent.
        success: says whether it succeeded.
        contract: has the roles and the reward terms.
        roster: who stands in the rows of an episode that an exception broke off in its reset.
        infos: fields of the last infos that are kept.
    """
    told = success.of(outcome)
    is_whole = outcome.error is None
    rows = []
    for agent in outcome.returns or dict.fromkeys(roster, 0.0) or {"": 0.0}:
        role = contract.role_of(agent) or role_in_name(agent)
        side = sides.get(agent) or sides.get(role) or sides["*"]
        own = told.get(agent) if EACH in success.scopes or agent in success.scopes else None
        answers = [own, told.get(role), told.get(TEAM)]
        flag = outcome.flags.get(agent, "cut")
        row = {
            **label, "policy": side[0], "run": side[1], "seed": outcome.seed, "agent": agent,
            "role": role, "return": outcome.returns.get(agent) if is_whole else None,
            "length": lengths.get(agent, 0),
            "ending": outcome.endings.get(agent, "cut") if is_whole else FAILED,
            "terminated": is_whole and flag == "terminated",
            "truncated": is_whole and flag == "truncated",
            "success": next((each for each in answers if each is not None), None),
            "success.team": answers[2], "success.role": answers[1], "success.agent": answers[0],
            "turns": outcome.turns, "error": outcome.error,
        }  # fmt: skip
        if outcome.terms:
            declared = dict.fromkeys(contract.rewards, 0.0)
            paid = {**declared, **outcome.terms.get(agent, {})}
            row |= {f"{REWARD}{term}": value for term, value in paid.items()}
        seen = outcome.infos.get(agent, {})
        row |= {f"{INFO}{name}": float(seen[name]) for name in infos if name in seen}
        rows.append(row)
    return rows


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
