"""Receipts: a part is whole once it has one, which names its folder.

Every attempt at a part has a folder of its own, so that two of them never mix; the receipt, written
last, names the one that counts. Merging goes by receipts: no part is there twice, and a folder
without one is rubbish.

Neither parts nor receipts are synced, as a part that a power cut tore is played again. A receipt
that is no JSON is torn, and counts as none; the part that a receipt names is compared with its
checksums when it is merged.
"""

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

from gamekeeper.errors import RunError
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.runs.files.checksums import compare_checksums
from gamekeeper.runs.files.schema import EXTENSION, STREAMS, check_schema, plain_schema
from gamekeeper.runs.parts.part_plan import FOLDER

READERS: Final = 16
"""Receipts that are asked for at a time."""
MOST_BYTES: Final = 1 << 24
"""Bytes of a receipt."""


@dataclass(frozen=True, slots=True)
class Receipt:
    """A part that is whole.

    Attributes:
        key: the part's.
        folder: of the attempt that counts, in storage.
        first: its first episode.
        episodes: their number; smaller than planned where one failed.
        turns: steps of all of them.
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
        """True if an episode of it failed, so that one process would have ended here."""
        return self.error is not None

    def schema(self, stream: str) -> pa.Schema | None:
        """The columns of a stream; None where it wasn't recorded.

        Raises:
            RunError: they are columns that no run holds.
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
        """Counts the part from now on.

        Raises:
            RunError: the storage refuses.
        """
        data = json.dumps(asdict(self), sort_keys=True).encode()
        storage.put(_name(self.key), data, durable=False)

    def summary(self) -> dict[str, Any]:
        """The answer of its task: small, however large the part is."""
        return {"episodes": self.episodes, "turns": self.turns, "failed": self.has_failed}


def receipt_of(storage: Storage, key: str) -> Receipt | None:
    """The receipt of a part; None where it isn't whole yet, or a power cut tore the receipt.

    Raises:
        RunError: it isn't what a receipt is.
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
    """Yields the receipts of these parts, in their order; several are asked for at a time.

    An object store takes tens of milliseconds for each, however small.

    Raises:
        RunError: one can't be read.
    """
    with ThreadPoolExecutor(READERS) as pool:
        yield from pool.map(partial(receipt_of, storage), keys)


def whole_keys(storage: Storage) -> set[str]:
    """The keys of all parts that have a receipt.

    Raises:
        RunError: the storage refuses.
    """
    names = storage.names(FOLDER)
    return {name.removesuffix(".json") for name in names if name.endswith(".json")}


def forget(storage: Storage, key: str) -> None:
    """Takes the receipt of a part away; its folder is rubbish from now on.

    Raises:
        RunError: the storage refuses.
    """
    storage.delete(_name(key))


def is_torn(run_files: Path) -> bool:
    """True if a part isn't, byte by byte, as it was finalized."""
    try:
        return bool(compare_checksums(run_files))
    except RunError:  # not even its manifest is
        return True


def attempt_folder(key: str) -> str:
    """A name in storage that no other attempt has."""
    return f"{FOLDER}/{key}.{token_hex(6)}"


def schemas_of(run_files: Path) -> dict[str, str]:
    """The columns of a finalized run's streams, as a receipt holds them."""
    found = {}
    for stream in STREAMS:
        path = run_files / f"{stream}.parquet"
        if path.is_file():
            data = plain_schema(pq.read_schema(path)).serialize().to_pybytes()
            found[stream] = base64.b64encode(data).decode()
    return found


def _check(found: Receipt) -> None:
    """Raises a TypeError if a field isn't of its type."""
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


def _unreadable(where: str, seen: str) -> RunError:
    return RunError(
        "a receipt can't be read",
        where=where,
        actual=seen,
        fix="take it away: its part is played again",
    )
