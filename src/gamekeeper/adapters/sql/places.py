"""Which bundles and evaluations a query is about: folders, patterns, folders of folders, parts."""

from __future__ import annotations

import glob
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import BundleError
from gamekeeper.record.files.fields import check_fields
from gamekeeper.record.files.folder import inside, read_bounded, reading
from gamekeeper.record.files.manifest import MANIFEST, load_manifest, seal_of

STREAMS: Final = ("episodes", "steps", "states", "timings")
"""As `record.files.schema` has them; importing that loads pyarrow, a query over Parquet doesn't."""
EVALUATION: Final = "evaluation.json"
EPISODES: Final = "episodes.parquet"
PARTS: Final = "parts"
RECEIPT_BYTES: Final = 1 << 24
MAGIC: Final = frozenset("*?[")


@dataclass(frozen=True, slots=True)
class Place:
    """A bundle.

    Attributes:
        run: its folder as it was named, with slashes: what the column `run` holds.
        folder: the same.
        manifest: what the manifest says.
        files: of a sealed one, the Parquet file of each stream; empty while it is open.
    """

    run: str
    folder: Path
    manifest: Mapping[str, Any]
    files: Mapping[str, str]

    @property
    def is_open(self) -> bool:
        """It is still being recorded, or its recorder was killed."""
        return bool(self.manifest["status"] == "open")


@dataclass(frozen=True, slots=True)
class Places:
    """What a query is about: bundles, and the folders of evaluations."""

    bundles: tuple[Place, ...]
    evaluations: tuple[Path, ...]


def places_of(names: Iterable[str | PathLike[str]], *, check: bool = False) -> Places:
    """The bundles and evaluations that `names` stand for, each once, in their order.

    A name is the folder of a bundle or an evaluation, a folder right in which such folders lie
    (also the parts of a run that is recorded by many workers), or a pattern (`runs/*`, `runs/**`).

    Args:
        names: as a user types them.
        check: compare every file of a sealed bundle with its seal first.
    Raises:
        BundleError: a name stands for nothing, or a bundle is damaged.
    """
    bundles: dict[str, Place] = {}
    evaluations: dict[Path, None] = {}
    for name in names:
        folders = list(_folders(os.fspath(name)))
        if not folders:
            raise _nothing(os.fspath(name))
        for folder in folders:
            if (folder / MANIFEST).is_file():
                bundles.setdefault(os.path.normpath(folder), _place(folder, check=check))
            if (folder / EVALUATION).is_file():
                evaluations[Path(os.path.normpath(folder))] = None
    return Places(tuple(bundles.values()), tuple(evaluations))


def _place(folder: Path, *, check: bool) -> Place:
    path = Path(os.path.normpath(folder))
    with reading(path):
        manifest = load_manifest(path)
        seal = seal_of(manifest, path / MANIFEST)
        check_fields(manifest, path / MANIFEST)
    if seal is not None and check:
        from gamekeeper.record.files.reading import check_sealed

        check_sealed(path, manifest, seal)
    files: dict[str, str] = {}
    sealed = {} if seal is None else seal.files
    for stream in STREAMS:
        if f"{stream}.parquet" in sealed:
            file = inside(path, f"{stream}.parquet")  # no link leads out of the folder
            if not file.is_file():
                raise BundleError(
                    f"{file.name} is missing", where=str(file),
                    mend="restore the file from a copy; `gamekeeper verify` lists all damage",
                )  # fmt: skip
            files[stream] = file.as_posix()
    return Place(path.as_posix(), path, manifest, files)


def _folders(name: str) -> Iterator[Path]:
    """The folders of bundles and evaluations that a name stands for."""
    path = Path(name)
    if path.is_dir():
        yield from _within(path)
    elif MAGIC & set(name):
        for found in sorted(glob.glob(name, recursive=True)):  # noqa: PTH207  # Path.glob refuses absolute patterns
            if _is_one(Path(found)):
                yield Path(found)


def _within(folder: Path) -> Iterator[Path]:
    """The folder itself where it holds something, else those right in it that do."""
    if _is_one(folder):
        yield folder
        return
    with reading(folder):
        inner = sorted(folder.iterdir())
    if folder.name != PARTS:
        yield from filter(_is_one, inner)
    yield from _parts(folder if folder.name == PARTS else folder / PARTS)


def _parts(folder: Path) -> Iterator[Path]:
    """The parts that have a receipt: an attempt without one was never finished."""
    if not folder.is_dir():
        return
    for receipt in sorted(folder.glob("*.json")):
        with reading(receipt):
            said = json.loads(read_bounded(receipt, RECEIPT_BYTES))
        named = said.get("folder") if isinstance(said, dict) else None
        attempt = str(named).rpartition("/")[2]
        if attempt.startswith(f"{receipt.stem}.") and _is_one(folder / attempt):
            yield folder / attempt


def _is_one(path: Path) -> bool:
    return (path / MANIFEST).is_file() or (path / EVALUATION).is_file()


def _nothing(name: str) -> BundleError:
    path = Path(name)
    seen = "no such folder"
    if path.is_dir():
        seen = f"a folder with neither {MANIFEST} nor folders of evidence in it"
    elif path.exists():
        seen = "a file"
    elif MAGIC & set(name):
        seen = "a pattern that no folder of evidence fits"
    return BundleError(
        "there is no evidence here", where=name,
        expected=f"a folder with {MANIFEST} or {EVALUATION}, a folder of such, or a pattern",
        seen=seen, mend="check the path, or record a run with `gamekeeper record`",
    )  # fmt: skip
