"""Digests of rows, episodes and runs: any reader of the record can compute the same ones.

A row's canonical bytes are: the digest of its layout (the fields that are present, each with its
tag, little-endian dtype and shape, as canonical JSON), then the fields' C bytes in that order.
Texts and agents' names stand in it by their blake2b-128, an observation of `LARGE_BYTES` or more by
its blake3. NaN is one NaN, -0.0 is kept.

Source: RFC 7693 (BLAKE2); O'Connor et al. 2020 (BLAKE3).
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import blake2b
from typing import Any, Final, TypeAlias

import numpy as np
from blake3 import blake3
from numpy.typing import NDArray

from gamekeeper.episodes.block import Block, Bytes2, Cells, Coded, Raw, States, Text
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.layout import LARGE_BYTES

SIZE: Final = 16  # bytes of a row's digest
_BITS: Final = 30  # of a pattern of present fields, before it is renumbered
_FEW: Final = 1 << 16  # patterns that are counted rather than sorted

Hasher: TypeAlias = Callable[[Bytes2, int], Bytes2]
"""The blake2b of that size of every row of bytes, [rows, size]; a faster one may be passed in."""


@dataclass(frozen=True, slots=True)
class DigestField:
    """One field of a row's canonical bytes: `values` [rows, bytes], where `valid` [rows]."""

    tag: str
    dtype: str
    shape: tuple[int, ...]
    values: Bytes2
    valid: NDArray[np.bool_] | None = None


def row_digests(block: Block, *, hasher: Hasher | None = None) -> Bytes2:
    """The digest of every row of `block`, [rows, 16]."""
    return digest_fields(list(_fields(block)), len(block), hasher=hasher)


def digest_fields(fields: list[DigestField], count: int, *, hasher: Hasher | None = None) -> Bytes2:
    """The digest of each of `count` rows, [rows, 16]; absent fields leave no bytes."""
    hasher = hasher or _each
    sometimes = [f.valid for f in fields if f.valid is not None and not f.valid.all()]
    if not sometimes or not count:
        return hasher(_table(fields, slice(None), count), SIZE)
    out = np.empty((count, SIZE), np.uint8)
    # rows with the same fields are hashed together; a row's pattern has a bit for each such field
    code = np.zeros(count, np.int64)
    for place, valid in enumerate(sometimes):
        code = code << 1 | valid
        if place % _BITS == _BITS - 1:  # so that any number fits
            code = np.unique(code, return_inverse=True)[1].reshape(-1)
    is_small = int(code.max()) < _FEW
    patterns = np.flatnonzero(np.bincount(code)) if is_small else np.unique(code)
    for number in patterns.tolist():
        rows = np.flatnonzero(code == number)
        present = [f for f in fields if f.valid is None or f.valid[rows[0]]]
        out[rows] = hasher(_table(present, rows, len(rows)), SIZE)
    return out


def _table(fields: list[DigestField], rows: Any, count: int) -> Bytes2:
    """The canonical bytes of rows that have the same fields, [rows, bytes]."""
    head = _head(tuple((f.tag, f.dtype, f.shape) for f in fields))
    parts = [head[None], *(f.values[rows] for f in fields if f.values.shape[1])]
    # a field at a time as whole elements: joining them byte by byte takes five times as long
    kinds = [(str(place), f"V{part.shape[1]}") for place, part in enumerate(parts)]
    table = np.empty(count, kinds)
    for (name, kind), part in zip(kinds, parts, strict=True):
        table[name] = np.ascontiguousarray(part).view(kind)[:, 0]
    return table.view(np.uint8).reshape(count, table.itemsize)


def _each(table: Bytes2, size: int) -> Bytes2:
    """The digests of rows of bytes, one after the other."""
    (count, width), raw, fresh = table.shape, table.tobytes(), blake2b(digest_size=size).copy
    digests = []
    for at in range(0, width * count, width):
        row = fresh()  # a copy costs a fifth less than one made anew: no options to look at
        row.update(raw[at : at + width])
        digests.append(row.digest())
    return np.frombuffer(b"".join(digests), np.uint8).reshape(count, size)


@lru_cache(maxsize=256)
def _head(layout: tuple[tuple[str, str, tuple[int, ...]], ...]) -> NDArray[np.uint8]:
    """The digest of a layout, [16]: tag, dtype and shape of each field."""
    text = to_json([[tag, dtype, list(shape)] for tag, dtype, shape in layout])
    return np.frombuffer(blake2b(text.encode(), digest_size=SIZE).digest(), np.uint8)


def _fields(block: Block) -> Iterator[DigestField]:
    count = len(block)
    yield DigestField("turn", "<i4", (), block.turn.view(np.uint8).reshape(count, 4))
    yield DigestField("agent", "text", (), names_digests(block.agent))
    yield DigestField("order", "<i2", (), block.order.values, block.order.valid)
    for column, cells in sorted(block.values.values(), key=lambda each: each[0].tag):
        leaf = column.leaf
        yield cells_digest_field(column.tag, leaf.dtype, leaf.shape, cells)
    yield from _masks(block.mask)
    for name, dtype, raw in (
        ("cumulative_reward", "<f8", block.cumulative_reward),
        ("terminated", "|b1", block.terminated),
        ("truncated", "|b1", block.truncated),
        ("reward", "<f8", block.reward),
        *((f"reward.{term}", "<f8", raw) for term, raw in sorted(block.terms.items())),
    ):
        yield DigestField(name, dtype, (), one_nan(raw.values, dtype), raw.valid)
    yield DigestField("live", "|b1", (), block.live.view(np.uint8).reshape(count, 1))
    for name, texts in (("raised", block.raised), ("nonconforming", block.nonconforming)):
        if texts is not None:
            yield cells_digest_field(name, "", (), Text(texts))


def cells_digest_field(tag: str, dtype: str, shape: tuple[int, ...], cells: Cells) -> DigestField:
    """One value column as a field of the rows' canonical bytes."""
    if isinstance(cells, Text):
        return DigestField(tag, "text", (), *_texts(cells.values))
    values = cells.values
    if values.shape[1] >= LARGE_BYTES:
        return DigestField(tag, f"blake3 {dtype}", shape, _large(cells), cells.valid)
    return DigestField(tag, dtype, shape, one_nan(values, dtype), cells.valid)


def _large(cells: Raw) -> Bytes2:
    digests = [
        blake3(row).digest() if ok else bytes(32)
        for row, ok in zip(cells.values, cells.valid, strict=True)
    ]
    return np.frombuffer(b"".join(digests), np.uint8).reshape(len(digests), 32)


def one_nan(values: Bytes2, dtype: str) -> Bytes2:
    """`values` with every NaN as the one that numpy makes; the same array where there is none."""
    if not dtype.startswith("<f") or not values.size:
        return values
    floats = np.ascontiguousarray(values).view(dtype)
    missing = np.isnan(floats)
    if not missing.any():
        return values
    floats = floats.copy()
    floats[missing] = np.nan
    return floats.view(np.uint8).reshape(values.shape)


def names_digests(names: list[str] | Coded) -> Bytes2:
    """The digest of each name, [names, 16]."""
    if isinstance(names, Coded):
        return _digests_of(names.names)[names.codes]
    known = {
        name: blake2b(name.encode(errors="surrogatepass"), digest_size=SIZE).digest()
        for name in set(names)
    }
    return np.frombuffer(b"".join([known[name] for name in names]), np.uint8).reshape(-1, SIZE)


@lru_cache(maxsize=16)
def _digests_of(names: tuple[str, ...]) -> Bytes2:
    """The digests of all names of a run, which each flush needs: of 512 they cost 0.5 ms."""
    return names_digests(list(names))


def _texts(texts: list[str | None]) -> tuple[Bytes2, NDArray[np.bool_]]:
    count = len(texts)
    if texts.count(None) == count:
        return np.zeros((count, SIZE), np.uint8), np.zeros(count, np.bool_)
    valid = np.fromiter((text is not None for text in texts), np.bool_, count)
    return names_digests([text or "" for text in texts]), valid


def _masks(masks: list[bytes | None] | dict[int, Raw]) -> Iterator[DigestField]:
    """A field for each length of mask, so that the layout tells it."""
    if isinstance(masks, dict):
        for length, raw in sorted(masks.items()):
            yield DigestField("action_mask", "|u1", (length,), raw.values, raw.valid)
        return
    count = len(masks)
    if masks.count(None) == count:
        return
    lengths = np.fromiter((-1 if mask is None else len(mask) for mask in masks), np.int64, count)
    for length in sorted(set(lengths.tolist()) - {-1}):
        valid = lengths == length
        blank = bytes(length)
        parts = [mask if mask is not None and len(mask) == length else blank for mask in masks]
        values = np.frombuffer(b"".join(parts), np.uint8).reshape(count, length)
        yield DigestField("action_mask", "|u1", (length,), values, valid)


def state_digests(states: States, *, hasher: Hasher | None = None) -> Any:
    """The digest of the state at every turn, [turns, 16]."""
    count = len(states.turn)
    fields = [DigestField("turn", "<i4", (), states.turn.view(np.uint8).reshape(count, 4))]
    fields += [
        cells_digest_field(column.tag, column.leaf.dtype, column.leaf.shape, cells)
        for column, cells in states.cells
    ]
    fields.append(cells_digest_field("nonconforming", "", (), Text(states.nonconforming)))
    return digest_fields(fields, count, hasher=hasher)


@dataclass(slots=True)
class EpisodeDigest:
    """The running digest of one episode: its header, its rows, its states, and apart its infos."""

    header: str
    _rows: Any = field(default_factory=lambda: blake2b(digest_size=32))
    _states: Any = field(default_factory=lambda: blake2b(digest_size=32))
    _infos: Any = field(default_factory=lambda: blake2b(digest_size=32))

    def add_rows(self, digests: Bytes2) -> None:
        """Takes the digests of rows that follow those taken before, [rows, 16]."""
        self._rows.update(np.ascontiguousarray(digests))

    def add_states(self, digests: Bytes2) -> None:
        """Takes the digests of states that follow those taken before, [turns, 16]."""
        self._states.update(np.ascontiguousarray(digests))

    def add_infos(self, lines: memoryview) -> None:
        """Takes infos, a line for each: turn, agent, canonical JSON without volatile fields."""
        self._infos.update(lines)

    @property
    def fingerprint(self) -> str:
        """Covers header, rows and states; 64 hexadecimal digits."""
        parts = self.header.encode(), self._rows.digest(), self._states.digest()
        return blake2b(b"\0".join(parts), digest_size=32).hexdigest()

    @property
    def info_fingerprint(self) -> str:
        """Covers the infos; 64 hexadecimal digits."""
        return str(self._infos.hexdigest())


def episode_header(*, seed: int | None, options: str | None) -> str:
    """Arguments of an episode's reset as canonical JSON; `options` is canonical JSON already."""
    return to_json({"options": options, "seed": seed})


def run_header(environment: Mapping[str, object], spaces: Mapping[str, object]) -> bytes:
    """Canonical JSON of what all episodes of a run share."""
    return to_json({"environment": environment, "spaces": spaces}).encode()


def run_fingerprint(header: bytes, episodes: Iterable[str]) -> str:
    """The digest of a run: its header, its episodes in order; 64 hexadecimal digits."""
    whole = blake2b(header, digest_size=32)
    for fingerprint in episodes:
        whole.update(bytes.fromhex(fingerprint))
    return whole.hexdigest()
