"""The sections of a contract as frozen data; None is always *not declared*, so not judged."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from numbers import Integral, Real
from typing import Final, Generic, TypeAlias, TypeVar

from gamekeeper.contract.failure import Failure
from gamekeeper.contract.pattern import exact, is_exact, matches

V = TypeVar("V", covariant=True)


class Table(Mapping[str, V], Generic[V]):
    """An ordered mapping from names that can be hashed, copied and pickled, never changed.

    Two tables are equal where they hold the same rows, in whatever order, as in TOML.

    Args:
        rows: a mapping, or pairs of name and value.
    """

    __slots__ = ("_rows",)

    def __init__(self, rows: Mapping[str, V] | Iterable[tuple[str, V]] = ()) -> None:
        self._rows: dict[str, V] = dict(rows)

    def __getitem__(self, name: str) -> V:
        return self._rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __hash__(self) -> int:
        return hash(frozenset(self._rows.items()))

    def __repr__(self) -> str:
        return f"Table({self._rows!r})"

    def __reduce__(self) -> tuple[type[Table[V]], tuple[dict[str, V]]]:
        return type(self), (self._rows,)


Plain: TypeAlias = "bool | int | float | str | tuple[Plain, ...] | Mapping[str, Plain]"
"""A value that TOML and JSON both hold exactly."""

APIS: Final = ("aec", "parallel")
ORDERS: Final = ("none", "fixed", "rotating", "state", "random")
OBSERVE: Final = ("after tick", "after turn")
CONFLICTS: Final = ("joint rule", "priority", "random", "ordered")
KINDS: Final = ("individual", "shared", "zero-sum")
ENDING_KINDS: Final = ("termination", "truncation")
AFTER_END: Final = ("forbidden", "allowed")
KNOB_OF: Final = ("argument", "option", "wrapper", "policy")
ILLEGAL: Final = ("error", "penalty", "end")
NONE: Final = "none"
"""As a noop or a mask: declared that there is none, which is more than not declared."""
ONE_OR_MANY: Final = ("agents", "earner", "payee")
"""Fields that hold one name or a list of names."""
RESERVED: Final = ("all", "earner", "team")
"""Words that stand for agents beside the roles, so no role is called so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """Order in which roles act, and what they observe of it.

    Args:
        stages: roles that act together, stage after stage; `(("picker",), ("carrier",))`: all
            pickers, then all carriers.
        order: within a stage: `none` (simultaneous), `fixed`, `rotating`, `state`, `random`.
        observe: observations show what was `after tick` or `after turn`.
        conflicts: what settles two actions that exclude each other: a `joint rule` (free of
            order), `priority`, `random`, `ordered` (who acts first).
        horizon: ticks after which the episode is truncated, above 0.
    """

    stages: tuple[tuple[str, ...], ...] | None = None
    order: str | None = None
    observe: str | None = None
    conflicts: str | None = None
    horizon: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Role:
    """Agents that are told the same and may do the same.

    Args:
        agents: patterns of their names; None: the role's name, or it with a number after it
            (`picker`, `picker_0`).
        symmetric: they are interchangeable.
        may_join: one may appear after reset.
        may_leave: one may leave without having ended.
        noop: the action that does nothing; `none`: there is no such action.
        mask: where legal actions are told, `infos.KEY` or `observation.KEY`; `none`: nowhere,
            every action is always legal.
        messages: fields of action or observation that carry messages.
        illegal: a masked action raises an `error`, costs a `penalty`, or is the `end`.
    """

    agents: tuple[str, ...] | None = None
    symmetric: bool | None = None
    may_join: bool | None = None
    may_leave: bool | None = None
    noop: Plain | None = None
    mask: str | None = None
    messages: tuple[str, ...] | None = None
    illegal: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RewardTerm:
    """A part of the reward; the terms' sum is what an agent is paid.

    Args:
        kind: `individual`, `shared` (all payees get the same), `zero-sum` (payees' sum is 0).
        earner: whose doing brings it: roles, or `all`.
        payee: who is paid: roles, `all`, or `earner` (the agent that earned it).
    """

    kind: str | None = None
    earner: tuple[str, ...] | None = None
    payee: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Ending:
    """A reason to end.

    Args:
        kind: `termination` (a rule of the task) or `truncation` (a limit from outside).
        owner: whom it ends: the one `agent` it befalls (whatever roles there are), `all`, or all
            agents of a role.
    """

    kind: str | None = None
    owner: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Seeds:
    """Promises about seeds.

    Args:
        deterministic: the same seed and actions give the same rollout.
    """

    deterministic: bool | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class InfoField:
    """A field of the agents' infos.

    Args:
        dtype: a numpy name as `int64`, or `str`, `json`.
        shape: lengths of its axes; `()` is a single value.
        volatile: it differs between equal runs (a time), so the info fingerprint leaves it out.
    """

    dtype: str | None = None
    shape: tuple[int, ...] | None = None
    volatile: bool | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Knob:
    """A setting that makes the task harder.

    Args:
        label: what failing under it is called, as `perception`.
        ideal: its value where it disturbs nothing.
        of: what it is a setting of: an `argument` of the environment (also where nothing is said),
            an `option` of its reset, an attribute of a `wrapper`, or one of a `policy`.
        worst: a value with which it disturbs as much as can be expected, for perturbations.
        contains: other knobs that turning this one to its ideal makes up for, as the true state
            does for noise and drift.
    """

    label: str
    ideal: Plain | None = None
    of: str | None = None
    worst: Plain | None = None
    contains: tuple[str, ...] | None = None


def patterns(name: str, role: Role) -> tuple[str, ...]:
    """The patterns of the agents that the role called `name` holds."""
    return role.agents or (exact(name), f"{exact(name)}_[0-9]*")


def covers(name: str, role: Role, agent: str) -> bool:
    """The role called `name` holds the agent."""
    return any(matches(pattern, agent) for pattern in patterns(name, role))


def is_single(role: Role) -> bool:
    """The role is declared to hold one agent and no other."""
    return role.agents is not None and len(role.agents) == 1 and is_exact(role.agents[0])


def plain(part: object) -> object:
    """The part as dictionaries, lists and scalars, without what isn't declared."""
    if is_dataclass(part) and not isinstance(part, type | Failure):
        pairs = ((field, getattr(part, field.name)) for field in fields(part))
        return {
            field.name: _plain_field(field.name, value)
            for field, value in pairs
            if not _is_default(field, value)
        }
    if isinstance(part, Failure):
        return part.text
    if isinstance(part, Mapping):
        return {name: plain(value) for name, value in part.items()}
    return [plain(item) for item in part] if isinstance(part, tuple | list) else part


def _is_default(field: Field[object], value: object) -> bool:
    """The value is the one of a field that isn't declared."""
    if field.default_factory is not MISSING:
        return value == field.default_factory()
    return value is None or (field.default is not MISSING and value == field.default)


def _plain_field(name: str, value: object) -> object:
    """A single pattern or role stands without brackets, as people write it."""
    if name in ONE_OR_MANY and isinstance(value, tuple | list) and len(value) == 1:
        return value[0]
    return plain(value)


def frozen(value: object) -> Plain:
    """The value with tables and tuples in place of dictionaries and lists.

    Raises:
        TypeError: something in it is neither text, number, truth value, list nor table, or a
            number isn't finite or needs more than 64 bits.
    """
    if isinstance(value, bool):
        return value
    if isinstance(value, str):
        return str(value)
    if isinstance(value, Integral) and -(2**63) <= int(value) < 2**63:
        return int(value)
    if isinstance(value, Real) and not isinstance(value, Integral) and math.isfinite(value):
        return float(value)
    if isinstance(value, list | tuple):
        return tuple(frozen(item) for item in value)
    if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        return Table({key: frozen(item) for key, item in value.items()})
    raise TypeError(repr(value))
