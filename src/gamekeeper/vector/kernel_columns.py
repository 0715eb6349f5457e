"""The rows of a kernel's buffer as columns, which the encoder takes; infos as canonical JSON.

Texts are what `gamekeeper.episodes.canonical.to_json` writes of each info alone, without a look at
single rows.
"""

from collections.abc import Callable, Collection
from operator import attrgetter
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.episodes.block import Block, Cells, Coded, Columns, Raw, States
from gamekeeper.episodes.buffer import EpisodeEnd, EpisodeStart
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.layout import Column, Layout, SpaceColumns
from gamekeeper.kernels.kernel import MASK, Kernel
from gamekeeper.kernels.rule_parts import HORIZON, UNNAMED
from gamekeeper.vector.kernel_buffer import TERMINATED, TRUNCATED, Arrays, KernelBuffer
from gamekeeper.vector.kernel_rows import done_values, given_values, rows_of

NAMES: Final = {
    HORIZON: "horizon",
    UNNAMED + TERMINATED: "terminated",
    UNNAMED + TRUNCATED: "truncated",
}
LISTED: Final = 64  # elements: longer arrays are base64
SCALAR_WORDS: Final = ('{"$":"nan"}', '{"$":"inf"}', '{"$":"-inf"}')
LISTED_WORDS: Final = ('"nan"', '"inf"', '"-inf"')


class KernelColumns:
    """Makes columns of what a kernel's buffer holds.

    Args:
        layout: of the environment: columns by agent.
        terms: reward terms by name, as the contract has them.
        volatile: info fields that stay out of the info fingerprint.
    """

    def __init__(
        self,
        buffer: KernelBuffer,
        layout: Layout,
        *,
        terms: tuple[str, ...],
        volatile: Collection[str],
    ) -> None:
        self._buffer, self._kernel, self._layout = buffer, buffer.kernel, layout
        self._terms, self._volatile = terms, volatile
        self._columns = [layout.agents[agent] for agent in self._kernel.agents]

    def taken(self, *, options: str | None, is_last: bool) -> Columns:
        """All that the buffer holds, sorted by episode.

        Args:
            options: what every reset was given, as canonical JSON; None: nothing.
            is_last: the episodes in progress end as *cut*, and what is given now is taken too.
        """
        buffer, rows = self._buffer, rows_of(self._buffer, is_last=is_last)
        block, steady = self._block(rows) if len(rows) else (None, None)
        ends = self._ends(_joined(buffer.apart.ends), "ended")
        if is_last:
            e = np.flatnonzero(buffer.given["open"][buffer.filled])
            now = {name: buffer.given[name][buffer.filled, e] for name in ("episode", "clock")}
            cut = {"episode": now["episode"], "turns": now["clock"], **buffer.end_of(e)}
            ends += self._ends(cut, "cut")
        return Columns(
            starts=_starts(_joined(buffer.apart.starts), options),
            rows=block,
            states=self._states(is_last=is_last),
            ends=sorted(ends, key=attrgetter("episode")),
            steady_infos=steady,
        )

    # -- episodes

    def _ends(self, columns: Arrays, end: str) -> list[EpisodeEnd]:
        if not columns:
            return []
        texts = (
            _by_pattern(columns["endings"], self._endings),
            _by_pattern(columns["has_acted"], self._types),
        )
        rows = zip(columns["episode"].tolist(), columns["turns"].tolist(), *texts, strict=True)
        return [
            EpisodeEnd(episode, end, turns, None, endings, types)
            for episode, turns, endings, types in rows
        ]

    def _endings(self, codes: list[int]) -> str | None:
        """Reason of each agent's ending, as JSON; None where none ended."""
        kernel = self._kernel
        reasons = {
            agent: NAMES[code] if code in NAMES else kernel.endings[code - 1]
            for agent, code in zip(kernel.agents, codes, strict=True)
            if code
        }
        return to_json(reasons) if reasons else None

    def _types(self, has_acted: list[bool]) -> str:
        """Types of the whole numbers with which agents acted, as JSON."""
        kernel: Kernel = self._kernel
        named = {
            agent: "int"
            for agent, acted in zip(kernel.agents, has_acted, strict=True)
            if acted and isinstance(kernel.action_of(agent), spaces.Discrete)
        }
        return to_json(named)

    # -- columns

    def _states(self, *, is_last: bool) -> States | None:
        buffer, side = self._buffer, self._layout.state
        if "state" not in buffer.given or side is None:
            return None
        slots = buffer.filled + is_last
        moment = np.flatnonzero(buffer.given["open"][:slots])
        apart = {name: np.concatenate(parts) for name, parts in buffer.apart.states.items()}

        def whole(name: str, of: str) -> NDArray[Any]:
            array = buffer.given[of][:slots]
            dense = array.reshape(-1, *array.shape[2:])[moment]
            return np.concatenate([dense, apart[name]]) if apart else dense

        episode, turn = whole("episode", "episode"), whole("turn", "clock")
        order = np.lexsort((turn, episode))
        episode, turn = episode[order], np.ascontiguousarray(turn[order])
        if not len(episode):
            return None
        column = side.columns[0]
        values = _bytes(column, whole("state", "state")[order])
        cells: list[tuple[Column, Cells]] = [(column, Raw(values, np.ones(len(turn), bool)))]
        return States(episode, turn, cells, [None] * len(turn))

    def _block(self, rows: NDArray[Any]) -> tuple[Block, pa.Array | None]:
        masks, texts = self._masks(rows)
        infos = given_values(self._buffer, "infos", rows) if self._kernel.info else None
        given = np.ascontiguousarray(rows["given"])
        plain = None
        if self._volatile:
            plain = info_texts(infos, texts, given, without=self._volatile)
        block = Block(
            episode=np.ascontiguousarray(rows["episode"]),
            turn=np.ascontiguousarray(rows["turn"]),
            agent=Coded(np.ascontiguousarray(rows["agent"]), self._names()),
            order=_raw(rows, "order", "has_order"),
            values=self._values(rows),
            mask=masks,
            cumulative_reward=_raw(rows, "cumulative_reward", "given"),
            terminated=_raw(rows, "terminated", "flagged"),
            truncated=_raw(rows, "truncated", "flagged"),
            info=info_texts(infos, texts, given),
            reward=_raw(rows, "reward", "is_paid"),
            terms=self._paid(rows),
            live=np.ascontiguousarray(rows["live"]),
            raised=None,
            nonconforming=None,
        )
        return block, plain

    def _names(self) -> tuple[str, ...]:
        return tuple(columns.name for columns in self._columns)

    def _paid(self, rows: NDArray[Any]) -> dict[str, Raw]:
        found = {}
        valid = np.ascontiguousarray(rows["has_terms"])
        for name in self._terms:
            amounts = np.zeros(len(rows))
            if name in self._kernel.terms:
                amounts += rows["terms"][:, self._kernel.terms.index(name)]  # -0.0 becomes 0.0
            found[name] = Raw(amounts.view(np.uint8).reshape(len(rows), 8), valid)
        return found

    def _values(self, rows: NDArray[Any]) -> dict[str, tuple[Column, Cells]]:
        """Observations and actions by column; a row is null where a column isn't its agent's."""
        values: dict[str, tuple[Column, Cells]] = {}
        for kind, flag in (("obs", "given"), ("action", "acted")):
            for g, group in enumerate(self._kernel.groups):
                columns = self._columns[group.first]
                side = columns.observation if kind == "obs" else columns.action
                assert side is not None  # kernels declare their spaces
                mine = self._of_group(rows, g)
                own = rows if mine is None else rows[mine]
                for column, array in self._leaves(kind, g, side, own):
                    raw = _bytes(column, array)
                    _merge(values, column, raw, np.ascontiguousarray(own[flag]), mine, len(rows))
        return values

    def _leaves(self, kind: str, g: int, side: SpaceColumns, rows: NDArray[Any]) -> Any:
        """Columns of a group, and their values in its rows."""
        buffer = self._buffer
        if kind == "action":
            yield side.columns[0], done_values(buffer, f"action.{g}", rows)
            return
        space = side.codec.space
        if not isinstance(space, spaces.Dict):
            yield side.columns[0], given_values(buffer, f"obs.{g}", rows)
            return
        for key, column in zip(sorted(space.spaces), side.columns, strict=True):
            is_mask = key == MASK and self._kernel.mask is not None
            name = f"mask.{g}" if is_mask else f"obs.{g}.{key}"
            found = given_values(buffer, name, rows)
            yield column, found.astype(space.spaces[key].dtype)

    def _of_group(self, rows: NDArray[Any], g: int) -> NDArray[np.intp] | None:
        """Rows that are of a group; None: all."""
        if len(self._kernel.groups) == 1:
            return None
        group = self._kernel.groups[g]
        agent = rows["agent"]
        return np.flatnonzero((agent >= group.first) & (agent < group.first + group.count))

    def _masks(self, rows: NDArray[Any]) -> tuple[dict[int, Raw], pa.Array | None]:
        """The masks of Discrete actions by their length, and what infos tell of all masks."""
        masks: dict[int, Raw] = {}
        if self._kernel.mask is None:
            return masks, None
        texts, places = [], list[Any]()
        for g, group in enumerate(self._kernel.groups):
            mine = self._of_group(rows, g)
            own = rows if mine is None else rows[mine]
            flags = given_values(self._buffer, f"mask.{g}", own)
            nvec = getattr(group.action_space, "nvec", None)
            parts = None if nvec is None else tuple(int(n) for n in nvec)
            texts.append(mask_texts(flags, parts))
            places.append(mine)
            if parts is None:
                known = masks.get(flags.shape[1])
                raw = _spread(flags.view(np.uint8), own["given"], mine, len(rows))
                masks[flags.shape[1]] = (
                    raw
                    if known is None
                    else Raw(
                        np.where(raw.valid[:, None], raw.values, known.values),
                        known.valid | raw.valid,
                    )
                )
        if places[0] is None:
            return masks, texts[0]
        back = np.argsort(np.concatenate(places), kind="stable")
        return masks, pa.concat_arrays(texts).take(pa.array(back))


def _raw(rows: NDArray[Any], name: str, flag: str) -> Raw:
    """A column of the rows as bytes; zeros where there is none, as lists of rows have them."""
    valid = np.ascontiguousarray(rows[flag])
    values = np.where(valid, rows[name], np.zeros(1, rows.dtype[name])).astype(rows.dtype[name])
    return Raw(values.view(np.uint8).reshape(len(rows), values.itemsize), valid)


def _bytes(column: Column, values: NDArray[Any]) -> NDArray[np.uint8]:
    """Values as the column keeps them, [rows, bytes]."""
    dtype = "<i8" if column.leaf.kind == "int" else column.leaf.dtype
    whole = np.ascontiguousarray(values, np.dtype(dtype))
    found: NDArray[np.uint8] = whole.view(np.uint8).reshape(len(whole), -1)
    return found


def _spread(values: Any, valid: Any, mine: NDArray[np.intp] | None, count: int) -> Raw:
    """A column of all rows from one of some."""
    if mine is None:
        return Raw(np.ascontiguousarray(values), np.ascontiguousarray(valid))
    whole, there = np.zeros((count, values.shape[1]), np.uint8), np.zeros(count, bool)
    whole[mine], there[mine] = values, valid
    return Raw(whole, there)


def _merge(
    values: dict[str, tuple[Column, Cells]],
    column: Column,
    raw: NDArray[np.uint8],
    valid: NDArray[np.bool_],
    mine: NDArray[np.intp] | None,
    count: int,
) -> None:
    """Puts a group's values into their column, which other groups may share."""
    known = values.get(column.name)
    if known is None or mine is None:
        values[column.name] = column, _spread(raw, valid, mine, count)
        return
    cells: Any = known[1]
    cells.values[mine], cells.valid[mine] = raw, valid


def _joined(parts: dict[str, list[NDArray[Any]]]) -> Arrays:
    return {name: np.concatenate(part) for name, part in parts.items()}


def _starts(columns: Arrays, options: str | None) -> list[EpisodeStart]:
    if not columns:
        return []
    pairs = sorted(zip(columns["episode"].tolist(), columns["seed"].tolist(), strict=True))
    return [EpisodeStart(episode, seed, episode, options, None) for episode, seed in pairs]


def _by_pattern(rows: NDArray[Any], text_of: Callable[[list[Any]], str | None]) -> list[str | None]:
    """A text for each row; equal rows have one text."""
    patterns, codes = np.unique(rows, axis=0, return_inverse=True)
    texts = [text_of(pattern) for pattern in patterns.tolist()]
    return [texts[code] for code in codes.reshape(-1).tolist()]


def info_texts(
    records: NDArray[Any] | None,
    masks: pa.Array | None,
    given: NDArray[np.bool_],
    *,
    without: Collection[str] = (),
) -> pa.Array | None:
    """The infos of rows, null where none was given; None where there are no infos at all.

    Args:
        records: [rows] the fields of a kernel's infos; None: it has none.
        masks: [rows] the texts of action masks; None: it has none.
        given: [rows] whether the row has an info.
        without: names of fields that are left out.
    """
    columns: dict[str, Any] = {}
    if records is not None:
        columns = {name: records[name] for name in records.dtype.names or ()}
    if masks is not None:
        columns["action_mask"] = masks
    if not columns:
        return None
    pieces: list[Any] = []
    prefix = "{"
    for name in sorted(columns):
        if name not in without:
            column = columns[name]
            values = column if isinstance(column, pa.Array) else field_texts(column)
            pieces += [f"{prefix}{to_json(name)}:", values]
            prefix = ","
    if not pieces:
        return pc.if_else(pa.array(given), "{}", pa.scalar(None, pa.string()))
    text = pc.binary_join_element_wise(*pieces, "}", "")
    return text if given.all() else pc.if_else(pa.array(given), text, pa.scalar(None, pa.string()))


def field_texts(values: NDArray[Any]) -> pa.Array:
    """The texts of one field, [rows] or [rows, ...]."""
    if values.ndim == 1:
        return number_texts(values, SCALAR_WORDS)
    rows, shape = len(values), values.shape[1:]
    count = int(np.prod(shape))
    if count > LISTED or not count or values.dtype.kind not in "biuf":
        return pa.array([to_json(value) for value in values], pa.string())
    head, _, tail = to_json(np.zeros(shape, values.dtype)).rpartition("[")
    flat = number_texts(np.ascontiguousarray(values).reshape(-1), LISTED_WORDS)
    offsets = pa.array(np.arange(rows + 1, dtype=np.int32) * count)
    joined = pc.binary_join(pa.ListArray.from_arrays(offsets, flat), ",")
    return pc.binary_join_element_wise(f"{head}[", joined, tail[tail.index("]") :], "")


def number_texts(values: NDArray[Any], words: tuple[str, str, str]) -> pa.Array:
    """Numbers as JSON has them, [values]; `words` for NaN and the infinities."""
    if values.dtype.kind == "b":
        return pc.if_else(pa.array(values), "true", "false")
    if values.dtype.kind in "iu":
        return pc.cast(pa.array(np.ascontiguousarray(values)), pa.string())
    wide = values.astype(np.float64)
    texts = pa.array(repr(wide.tolist())[1:-1].split(", ") if len(wide) else [], pa.string())
    if np.isfinite(wide).all():
        return texts
    for word, mask in zip(words, (np.isnan(wide), wide == np.inf, wide == -np.inf), strict=True):
        texts = pc.if_else(pa.array(mask), word, texts)
    return texts


def mask_texts(flags: NDArray[np.int8], parts: tuple[int, ...] | None) -> pa.Array:
    """Action masks of infos as text, [rows].

    Args:
        flags: [rows, actions].
        parts: how many of each part of a MultiDiscrete; None: of a Discrete, whose mask has a
            column of its own.
    """
    if parts is None:
        text = to_json(f"|i1 {flags.shape[1]}")
        return pa.array([text], pa.string()).take(pa.array(np.zeros(len(flags), np.int32)))
    bits = np.ascontiguousarray(flags).view(f"V{flags.shape[1]}")[:, 0]
    distinct, codes = np.unique(bits, return_inverse=True)
    cuts = np.cumsum(parts)[:-1]
    rows = distinct.view(np.int8).reshape(len(distinct), flags.shape[1])
    texts = [to_json(tuple(np.split(row, cuts))) for row in rows]
    return pa.array(texts, pa.string()).take(pa.array(codes.reshape(-1)))
