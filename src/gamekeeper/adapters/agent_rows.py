"""What one agent was given, did and was paid in one episode, as arrays."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
import pyarrow as pa
from gymnasium import spaces

from gamekeeper.core.arrow import TERM, cells_of
from gamekeeper.core.block import Text
from gamekeeper.core.leaf_columns import value_columns
from gamekeeper.core.legible import legible
from gamekeeper.core.space import Codec, Leaf
from gamekeeper.core.trace import Spaces, Trace

TEXTS: Final = (
    pa.types.is_string, pa.types.is_large_string, pa.types.is_binary, pa.types.is_large_binary,
    pa.types.is_fixed_size_binary, pa.types.is_null,
)  # fmt: skip
NOBODY: Final = Spaces(None, None)


@dataclass(frozen=True, slots=True)
class Values:
    """The leaves of one space, row by row.

    Attributes:
        leaves: by path, an array [rows, ...] or a list of texts; zeros and "" where there is none.
        described: the leaf of each path.
        valid: [rows] whether the row holds a value of the space.
    """

    leaves: Mapping[str, Any]
    described: Mapping[str, Leaf]
    valid: Any

    def taken(self, rows: Any) -> Mapping[str, Any]:
        """The leaves of some rows only."""
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
    spaces: Spaces = NOBODY
    _cache: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def __len__(self) -> int:
        return int(self.table.num_rows)

    @legible
    def numbers(self, name: str) -> tuple[Any, Any]:
        """A column of numbers or flags, zeros where it is null, and which rows aren't null."""
        if name not in self._cache:
            column = self.table[name].combine_chunks()
            valid = np.asarray(column.is_valid(), bool)
            is_flag = pa.types.is_boolean(column.type)
            filled = column.fill_null(False if is_flag else 0) if column.null_count else column
            self._cache[name] = np.asarray(filled), valid
        found: tuple[Any, Any] = self._cache[name]
        return found

    @legible
    def texts(self, name: str) -> list[Any]:
        """A column of texts or bytes; None where it is null."""
        if name not in self._cache:
            column = self.table[name]
            if not any(is_of(column.type) for is_of in TEXTS):
                raise TypeError(f"{name} holds {column.type} in place of texts")
            self._cache[name] = column.to_pylist()
        found: list[Any] = self._cache[name]
        return found

    @property
    @legible
    def digests(self) -> Any:
        """[rows, 16] the digest of each, where digests stand in place of the observations."""
        return np.array([np.frombuffer(row, np.uint8) for row in self.texts("digest")])

    @property
    def turns(self) -> Any:
        """[rows] the turn of each."""
        return self.numbers("turn")[0]

    @property
    def terms(self) -> list[str]:
        """The names of the reward terms."""
        return [name[len(TERM) :] for name in self.table.schema.names if name.startswith(TERM)]

    @cached_property
    def observations(self) -> Values:
        """What it observed."""
        return self.values_of("obs", self.spaces.observation)

    @cached_property
    def actions(self) -> Values:
        """What it did."""
        return self.values_of("action", self.spaces.action)

    @cached_property
    def ended(self) -> Any:
        """[rows] whether the row's flags say terminated or truncated."""
        return self.numbers("terminated")[0] | self.numbers("truncated")[0]

    @cached_property
    def decided(self) -> Any:
        """[rows] whether it chose an action here that the environment took."""
        chose = self.numbers("order")[1] & ~self.ended
        return chose & np.array([kind is None for kind in self.texts("raised")], bool)

    @legible
    def masks(self) -> list[Any]:
        """The mask of each row's info as an array; None where there is none."""
        found: list[Any] = []
        for mask, info in zip(self.texts("mask"), self.texts("info"), strict=True):
            if mask is None:
                found.append(None)
                continue
            dtype, _, shape = str(json.loads(info)["action_mask"]).partition(" ")
            sides = [int(side) for side in shape.split("x") if side]
            found.append(np.frombuffer(mask, dtype).reshape(sides))
        return found

    @legible
    def odd(self, row: int) -> dict[str, Any]:
        """The fields of a row that weren't as declared: type, and value where it had none."""
        text = self.texts("odd")[row]
        return {} if text is None else json.loads(text)

    @legible
    def values_of(self, kind: str, codec: Codec | None) -> Values:
        """The values of one kind of columns (`obs`, `action`, `state`), leaf by leaf."""
        valid = np.full(len(self), codec is not None)
        columns = [] if codec is None else value_columns(self.table.schema, kind)
        leaves: dict[str, Any] = {}
        for leaf in () if codec is None else codec.leaves:
            column = next((each for each in columns if each.leaf == leaf), None)
            if column is None:  # nobody's rows hold it: level "digest", or no row at all
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
        return Values(leaves, described, valid)


def agents_of(trace: Trace, only: Collection[str] | None = None) -> Iterator[AgentRows]:
    """The rows of each agent of an episode, in the order in which the agents first come."""
    return rows_of(trace.steps, trace.spaces, only, episode=trace.episode)


def rows_of(
    steps: pa.Table,
    spaces: Mapping[str, Spaces],
    only: Collection[str] | None = None,
    *,
    episode: int = -1,
) -> Iterator[AgentRows]:
    """The rows of each agent, in the order in which the agents first come.

    Args:
        steps: rows of `steps`, of one episode or of several.
        spaces: the codecs of each agent.
        only: these agents; None: all.
        episode: the number of the episode; -1 for rows of several.
    """
    whole, rows_by_agent = _by_agent(steps)
    for name, rows in rows_by_agent:
        if only is None or name in only:
            yield AgentRows(name, episode, _taken(whole, rows), spaces.get(name, NOBODY))


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
    parts = iter([leaves[leaf.path] for leaf in codec.leaves])
    return _nested(space, parts)


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
