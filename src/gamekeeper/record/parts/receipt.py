"""Receipts: what says that a part is whole, and where it lies.

Every attempt at a part has a folder of its own, so that two of them never mix; the receipt, written
last, names the one that counts. Whoever merges reads receipts: nothing is there twice, and a folder
without one is rubbish.

Neither parts nor receipts are synced, as a part that a power cut tore is played again. A receipt
that is no JSON is torn, and counts as none; what a receipt names is compared with its seal when it
is merged.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from secrets import token_hex
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from gamekeeper.errors import BundleError
from gamekeeper.record.files.schema import EXTENSION, STREAMS, check_schema, plain_schema
from gamekeeper.record.files.seal import check_seal
from gamekeeper.record.parts.plan import FOLDER
from gamekeeper.run.executors.storage import Storage

READERS: Final = 16
"""Receipts that are asked for at a time."""
MOST_BYTES: Final = 1 << 24
"""Of a receipt."""


@dataclass(frozen=True, slots=True)
class Receipt:
    """A part that is whole.

    Attributes:
        key: the part's.
        folder: of the attempt that counts, in storage.
        first: its first episode.
        episodes: how many there are; fewer than planned where one failed.
        turns: crossings of all of them.
        error: fields of the error that an episode ended with; None where none did.
        schemas: by stream, its columns, so that a merged table is known before it is written.
    """

    key: str
    folder: str
    first: int
    episodes: int
    turns: int
    error: Mapping[str, str] | None
    schemas: Mapping[str, str]

    @property
    def has_failed(self) -> bool:
        """Whether an episode of it failed, so that one process would have ended here."""
        return self.error is not None

    def schema(self, stream: str) -> pa.Schema | None:
        """The columns of a stream; None where it wasn't recorded.

        Raises:
            BundleError: they are columns that no bundle holds.
        """
        text = self.schemas.get(stream)
        if text is None:
            return None
        try:
            data = base64.b64decode(text)
            if EXTENSION in data:  # reading its name would run a package's code
                raise ValueError("a column of an extension type")
            found = pa.ipc.read_schema(pa.py_buffer(data))
        except (ValueError, TypeError, OSError, pa.ArrowException) as error:
            raise _unreadable(self.key, str(error)[:200]) from error
        check_schema(found, stream, where=self.key)
        return found

    def put(self, storage: Storage) -> None:
        """The part counts from now on.

        Raises:
            BundleError: the storage refuses.
        """
        text = json.dumps(asdict(self), sort_keys=True)
        storage.put(_name(self.key), text.encode(), durable=False)

    def said(self) -> dict[str, Any]:
        """What a task hands back of it: nothing that grows with the part."""
        return {"episodes": self.episodes, "turns": self.turns, "failed": self.has_failed}


def receipt_of(storage: Storage, key: str) -> Receipt | None:
    """The receipt of a part; None where it isn't whole yet, or a power cut tore the receipt.

    Raises:
        BundleError: it isn't what a receipt is.
    """
    name = _name(key)
    if not storage.exists(name):
        return None
    try:
        fields = json.loads(storage.get(name, most_bytes=MOST_BYTES))
    except (ValueError, RecursionError):
        return None
    try:
        found = Receipt(**fields)
        _check(found)
    except (ValueError, TypeError) as error:
        raise _unreadable(f"{storage}/{name}", str(error)[:200]) from error
    if found.key != key or not found.folder.startswith(f"{FOLDER}/{key}."):
        raise _unreadable(f"{storage}/{name}", f"{found.key}, {found.folder}"[:200])
    return found


def receipts_of(storage: Storage, keys: Iterable[str]) -> Iterator[Receipt | None]:
    """The receipts of these parts, in their order; several are asked for at a time.

    An object store takes tens of milliseconds for each, however small.

    Raises:
        BundleError: one can't be read.
    """
    with ThreadPoolExecutor(READERS) as pool:
        yield from pool.map(partial(receipt_of, storage), keys)


def whole_keys(storage: Storage) -> set[str]:
    """The keys of all parts that have a receipt.

    Raises:
        BundleError: the storage refuses.
    """
    names = storage.names(FOLDER)
    return {name.removesuffix(".json") for name in names if name.endswith(".json")}


def forget(storage: Storage, key: str) -> None:
    """The part doesn't count any more; what lies in its folder is rubbish.

    Raises:
        BundleError: the storage refuses.
    """
    storage.delete(_name(key))


def is_torn(bundle: Path) -> bool:
    """Whether a part isn't, byte by byte, what was sealed."""
    try:
        return bool(check_seal(bundle))
    except BundleError:  # not even its manifest is
        return True


def attempt_folder(key: str) -> str:
    """A name in storage that no other attempt has."""
    return f"{FOLDER}/{key}.{token_hex(6)}"


def schemas_of(bundle: Path) -> dict[str, str]:
    """The columns of a sealed bundle's streams, as a receipt holds them."""
    found = {}
    for stream in STREAMS:
        path = bundle / f"{stream}.parquet"
        if path.is_file():
            schema = plain_schema(pq.read_schema(path))
            found[stream] = base64.b64encode(schema.serialize().to_pybytes()).decode()
    return found


def _check(found: Receipt) -> None:
    """Does nothing where every field is of its type."""
    texts = (found.key, found.folder)
    numbers = (found.first, found.episodes, found.turns)
    objects = (found.schemas, found.error or {})
    if not (
        all(isinstance(text, str) for text in texts)
        and all(type(number) is int and number >= 0 for number in numbers)
        and all(isinstance(each, dict) for each in objects)
    ):
        raise TypeError("a field of another type")


def _name(key: str) -> str:
    return f"{FOLDER}/{key}.json"


def _unreadable(where: str, seen: str) -> BundleError:
    return BundleError(
        "a receipt can't be read",
        where=where,
        seen=seen,
        mend="take it away: its part is played again",
    )
