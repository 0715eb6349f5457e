"""Rows of one agent as arrays: observations, actions and rewards; and what all exporters share.

They share the choice of agents, the result, and the sentences on stderr about losses.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike, fspath
from typing import Any, Final, TypeAlias, cast

import numpy as np
import pyarrow as pa
from gymnasium import spaces

from gamekeeper.episodes.arrow import TERM, cells_of
from gamekeeper.episodes.block import Text
from gamekeeper.episodes.episode import Episode, Spaces, digests_of
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.layout import value_columns
from gamekeeper.episodes.plain_json import fields_json, legible
from gamekeeper.episodes.spaces import Codec, Leaf
from gamekeeper.errors import EvidenceError
from gamekeeper.runs.load_run import load

Run: TypeAlias = "Evidence | str | PathLike[str]"
Say: TypeAlias = Callable[[str], None]
UNKNOWN_TERMS: Final = "by which terms {} rewards were paid (NaN): the run doesn't say"
HEADERS: Final = 256  # episodes whose headers are plain data at a time


@dataclass(frozen=True, slots=True)
class Export:
    """Result of an export.

    Attributes:
        to: the form: `numpy`, `minari`, `rerun`, `run`.
        path: the file or folder that was written.
        agents: agents in it.
        episodes: number of episodes.
        rows: number of rows or steps that were written, of all agents.
        parts: ids of the data sets in the path, where these are several.
        lost: losses, a sentence each.
    """

    to: str
    path: str
    agents: tuple[str, ...]
    episodes: int
    rows: int
    parts: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper export --json` prints, but for the run's name."""
        return fields_json(self)

    def __str__(self) -> str:
        whole = f"{self.rows} rows of {self.episodes} episodes"
        return "\n".join([f"{self.path}: {whole}", *(f"  {part}" for part in self.parts)])


def to_stderr(text: str) -> None:
    """Writes a sentence to stderr."""
    sys.stderr.write(f"gamekeeper: {text}\n")


def evidence_of(run: Run) -> Evidence:
    """Returns evidence as it is, or out of the folder of a run.

    Raises:
        RunError: there is no run, or it is damaged.
        EvidenceError: it has no episode.
    """
    evidence = run if isinstance(run, Evidence) else load(fspath(run))
    if not evidence.episode_table.num_rows:
        where = "memory" if evidence.path is None else str(evidence.path)
        raise EvidenceError("there is no episode to export", where=where, fix="record one first")
    return evidence


def chosen(evidence: Evidence, agents: Collection[str] | None) -> list[str]:
    """Returns the agents of a run that are asked for, in the order in which they came.

    Raises:
        EvidenceError: the run has no agent of that name.
    """
    known = [str(name) for name in evidence.manifest.get("agents") or ()]
    missing = [name for name in agents or () if name not in known]
    if missing:
        raise EvidenceError(
            f"the run has no agent called {missing[0]!r}",
            where="agents",
            expected=", ".join(known)[:300],
            actual=repr(missing[0]),
            fix="name agents of the run, or leave the option out: all are exported",
        )
    return [name for name in known if not agents or name in agents]


def episodes_of(evidence: Evidence) -> Iterator[Episode]:
    """Yields the episodes in their order; headers become plain data a few at a time."""
    for batch in evidence.episode_table.to_batches(max_chunksize=HEADERS):
        for header in batch.to_pylist():
            yield evidence.episode_of(header)


def tell(lost: Sequence[str], say: Say) -> tuple[str, ...]:
    """Says each loss once, and returns them."""
    for each in lost:
        say(f"lost: {each}")
    return tuple(lost)


TEXTS: Final = (
    pa.types.is_string,
    pa.types.is_large_string,
    pa.types.is_binary,
    pa.types.is_large_binary,
    pa.types.is_fixed_size_binary,
    pa.types.is_null,
)
UNKNOWN: Final = Spaces(None, None)


@dataclass(frozen=True, slots=True)
class LeafValues:
    """The leaves of one space, row by row.

    Attributes:
        leaves: by path, an array [rows, ...] or a list of texts; zeros and "" where there is none.
        described: the leaf of each path.
        valid: [rows] True where the row holds a value of the space.
    """

    leaves: Mapping[str, Any]
    described: Mapping[str, Leaf]
    valid: Any

    def taken(self, rows: Any) -> Mapping[str, Any]:
        """Returns the leaves of some rows only."""
        return {
            path: [leaf[row] for row in rows.tolist()] if isinstance(leaf, list) else leaf[rows]
            for path, leaf in self.leaves.items()
        }


@dataclass(frozen=True)
class AgentRows:
    """The rows of one agent in one episode, or in several, in their order.

    Attributes:
        agent: its name, as evidence spells it.
        episode: the number of the episode in its run; -1 for rows of several.
        table: its rows of the `steps` table.
        spaces: the codecs of its spaces.
    """

    agent: str
    episode: int
    table: pa.Table
    spaces: Spaces = UNKNOWN
    _cache: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def __len__(self) -> int:
        return int(self.table.num_rows)

    @legible
    def numbers(self, name: str) -> tuple[Any, Any]:
        """Returns a column of numbers or flags, zeros for null, and True where it isn't null."""
        if name not in self._cache:
            column = self.table[name].combine_chunks()
            valid = np.asarray(column.is_valid(), bool)
            is_flag = pa.types.is_boolean(column.type)
            filled = column.fill_null(False if is_flag else 0) if column.null_count else column
            self._cache[name] = np.asarray(filled), valid
        return cast("tuple[Any, Any]", self._cache[name])

    @legible
    def texts(self, name: str) -> list[Any]:
        """Returns a column of texts or bytes; None where it is null."""
        if name not in self._cache:
            column = self.table[name]
            if not any(is_of(column.type) for is_of in TEXTS):
                raise TypeError(f"{name} holds {column.type} in place of texts")
            self._cache[name] = column.to_pylist()
        return cast("list[Any]", self._cache[name])

    @property
    @legible
    def digests(self) -> Any:
        """[rows, 16] the digest of each, where digests stand in place of the observations."""
        return digests_of(self.table)

    @property
    def turns(self) -> Any:
        """[rows] the turn of each."""
        return self.numbers("turn")[0]

    @property
    def terms(self) -> list[str]:
        """The names of the reward terms."""
        return [name[len(TERM) :] for name in self.table.schema.names if name.startswith(TERM)]

    def paid_by(self, term: str) -> Any:
        """[rows] its rewards of a term; NaN where the run doesn't tell the terms of a reward."""
        return np.where(self.has_unknown_terms, np.nan, self.numbers(f"{TERM}{term}")[0])

    @cached_property
    def has_unknown_terms(self) -> Any:
        """[rows] True where it had a reward, and the run doesn't tell its terms."""
        if not self.terms:
            return np.zeros(len(self), bool)
        return self.numbers("reward")[1] & ~self.numbers(f"{TERM}{self.terms[0]}")[1]

    @cached_property
    def observations(self) -> LeafValues:
        """Its observations."""
        return self.values_of("obs", self.spaces.observation)

    @cached_property
    def actions(self) -> LeafValues:
        """Its actions."""
        return self.values_of("action", self.spaces.action)

    @cached_property
    def ended(self) -> Any:
        """[rows] True where the row's flags say terminated or truncated."""
        return self.numbers("terminated")[0] | self.numbers("truncated")[0]

    @cached_property
    def decided(self) -> Any:
        """[rows] True where it chose an action that the environment took."""
        chose = self.numbers("order")[1] & ~self.ended
        return chose & np.array([kind is None for kind in self.texts("raised")], bool)

    @legible
    def masks(self) -> list[Any]:
        """Returns the mask of each row's info as an array; None where it has none."""
        found: list[Any] = []
        for mask, info in zip(self.texts("action_mask"), self.texts("info"), strict=True):
            if mask is None:
                found.append(None)
                continue
            dtype, _, shape = str(json.loads(info)["action_mask"]).partition(" ")
            sides = [int(side) for side in shape.split("x") if side]
            found.append(np.frombuffer(mask, dtype).reshape(sides))
        return found

    @legible
    def nonconforming(self, row: int) -> dict[str, Any]:
        """Returns the fields of a row that weren't as declared, with type and value."""
        text = self.texts("nonconforming")[row]
        return {} if text is None else json.loads(text)

    @legible
    def values_of(self, kind: str, codec: Codec | None) -> LeafValues:
        """Returns the values of one kind of columns (`obs`, `action`, `state`), leaf by leaf."""
        valid = np.full(len(self), codec is not None)
        columns = [] if codec is None else value_columns(self.table.schema, kind)
        leaves: dict[str, Any] = {}
        for leaf in () if codec is None else codec.leaves:
            column = next((each for each in columns if each.leaf == leaf), None)
            if column is None:  # no row holds it: level "digest", or no row at all
                valid[:] = False
                continue
            cells = cells_of(column, self.table[column.name])
            if isinstance(cells, Text):
                valid &= np.array([text is not None for text in cells.values], bool)
                leaves[leaf.path] = [text or "" for text in cells.values]
                continue
            valid &= cells.valid
            leaves[leaf.path] = _array(leaf, cells.values)
        described = {} if codec is None else {leaf.path: leaf for leaf in codec.leaves}
        return LeafValues(leaves, described, valid)


def agents_of(episode: Episode, only: Collection[str] | None = None) -> Iterator[AgentRows]:
    """Yields the rows of each agent of an episode, in the order in which the agents first come."""
    return rows_of(episode.steps, episode.spaces, only, episode=episode.episode)


def rows_of(
    steps: pa.Table,
    spaces: Mapping[str, Spaces],
    only: Collection[str] | None = None,
    *,
    episode: int = -1,
) -> Iterator[AgentRows]:
    """Yields the rows of each agent, in the order in which the agents first come.

    Args:
        steps: rows of `steps`, of one episode or of several.
        spaces: the codecs of each agent.
        only: these agents; None: all.
        episode: the number of the episode; -1 for rows of several.
    """
    whole, rows_by_agent = _by_agent(steps)
    for name, rows in rows_by_agent:
        if only is None or name in only:
            yield AgentRows(name, episode, _taken(whole, rows), spaces.get(name, UNKNOWN))


@legible
def _by_agent(chunked: pa.Table) -> tuple[pa.Table, list[tuple[str, Any]]]:
    """The rows in one chunk; the names of agents as they first come, with the rows of each."""
    steps = chunked.combine_chunks()
    names = steps["agent"].combine_chunks().dictionary_encode()
    codes = np.asarray(names.indices)
    order = np.argsort(codes, kind="stable")
    bounds = np.searchsorted(codes[order], np.arange(len(names.dictionary) + 1))
    found = enumerate(names.dictionary.to_pylist())
    return steps, [(name, order[bounds[k] : bounds[k + 1]]) for k, name in found]


@legible
def _taken(steps: pa.Table, rows: Any) -> pa.Table:
    return steps.take(pa.array(rows)).combine_chunks()


def nested(space: spaces.Space[Any], leaves: Mapping[str, Any], codec: Codec) -> Any:
    """Leaves by path in the form of their space: dictionaries and tuples of whole columns."""
    return _nested(space, iter([leaves[leaf.path] for leaf in codec.leaves]))


def _nested(space: spaces.Space[Any], parts: Iterator[Any]) -> Any:
    if isinstance(space, spaces.Dict):  # its leaves come in the order of its keys
        found = {key: _nested(space.spaces[key], parts) for key in sorted(space.spaces)}
        return {key: found[key] for key in space.spaces}
    if isinstance(space, spaces.Tuple):
        return tuple([_nested(part, parts) for part in space.spaces])
    return next(parts)


def _array(leaf: Leaf, values: Any) -> Any:
    """Raw elements [rows, bytes] as the numbers that they are."""
    rows = len(values)
    if leaf.kind == "int":
        return np.ascontiguousarray(values).view("<i8")[:, 0].astype(leaf.dtype)
    if not values.shape[1]:
        return np.zeros((rows, *leaf.shape), leaf.dtype)
    return np.ascontiguousarray(values).view(leaf.dtype).reshape(rows, *leaf.shape)
