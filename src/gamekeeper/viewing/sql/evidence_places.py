"""Runs and evaluations of a query: folders, patterns, folders of folders, parts."""

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import RunError
from gamekeeper.runs.files.folder import MANIFEST, inside, read_bounded, reading
from gamekeeper.runs.files.manifest import checksums_of, load_manifest
from gamekeeper.runs.files.schema import STREAMS
from gamekeeper.runs.untrusted.limits import check_fields

EVALUATION: Final = "evaluation.json"
EPISODES: Final = "episodes.parquet"
PARTS: Final = "parts"
RECEIPT_BYTES: Final = 1 << 24
MAGIC: Final = frozenset("*?[")


@dataclass(frozen=True, slots=True)
class RunPlace:
    """A run.

    Attributes:
        run: its folder as it was named, with slashes: the value of the column `run`.
        folder: the same as a path.
        manifest: content of its manifest.
        files: the Parquet file of each stream; empty while the run is open.
    """

    run: str
    folder: Path
    manifest: Mapping[str, Any]
    files: Mapping[str, str]

    @property
    def is_open(self) -> bool:
        """True if it is still being recorded, or its recorder was killed."""
        return bool(self.manifest["status"] == "open")


@dataclass(frozen=True, slots=True)
class EvidencePlaces:
    """Runs and folders of evaluations that a query reads."""

    run_folders: tuple[RunPlace, ...]
    evaluations: tuple[Path, ...]


def places_of(names: Iterable[str | PathLike[str]], *, check: bool = False) -> EvidencePlaces:
    """Finds the runs and evaluations that `names` stand for, each once, in their order.

    A name is the folder of a run or an evaluation, a folder right in which such folders lie
    (also the parts of a run that is recorded by many workers), or a pattern (`runs/*`, `runs/**`).

    Args:
        names: as a user types them.
        check: compare every file of a finalized run with its checksums first.
    Raises:
        RunError: nothing has such a name, or a run is damaged.
    """
    run_folders: dict[str, RunPlace] = {}
    evaluations: dict[Path, None] = {}
    for name in names:
        folders = list(_folders(os.fspath(name)))
        if not folders:
            raise _nothing(os.fspath(name))
        for folder in folders:
            if (folder / MANIFEST).is_file():
                run_folders.setdefault(os.path.normpath(folder), _place(folder, check=check))
            if (folder / EVALUATION).is_file():
                evaluations[Path(os.path.normpath(folder))] = None
    return EvidencePlaces(tuple(run_folders.values()), tuple(evaluations))


def _place(folder: Path, *, check: bool) -> RunPlace:
    path = Path(os.path.normpath(folder))
    with reading(path):
        manifest = load_manifest(path)
        checksums = checksums_of(manifest, path / MANIFEST)
        check_fields(manifest, path / MANIFEST)
    if checksums is not None and check:
        from gamekeeper.runs.files.run_files import check_finalized

        check_finalized(path, manifest, checksums)
    files: dict[str, str] = {}
    finalized = {} if checksums is None else checksums.files
    for stream in STREAMS:
        if f"{stream}.parquet" in finalized:
            file = inside(path, f"{stream}.parquet")  # no link leads out of the folder
            if not file.is_file():
                raise RunError(
                    f"{file.name} is missing",
                    where=str(file),
                    fix="restore the file from a copy; `gamekeeper verify` lists all damage",
                )
            files[stream] = file.as_posix()
    return RunPlace(path.as_posix(), path, manifest, files)


def _folders(name: str) -> Iterator[Path]:
    """The folders of runs and evaluations that a name stands for."""
    path = Path(name)
    if path.is_dir():
        yield from _within(path)
    elif MAGIC & set(name):
        anchor = Path(path.anchor)  # a pattern of Path.glob must be relative
        for found in sorted(anchor.glob(str(path.relative_to(anchor)))):
            is_hidden = any(part.startswith(".") for part in {*found.parts} - {*path.parts})
            if not is_hidden and _is_one(found):
                yield found


def _within(folder: Path) -> Iterator[Path]:
    """The folder itself if it is a run or an evaluation, else those directly in it."""
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
            fields = json.loads(read_bounded(receipt, RECEIPT_BYTES))
        named = fields.get("folder") if isinstance(fields, dict) else None
        attempt = str(named).rpartition("/")[2]
        if attempt.startswith(f"{receipt.stem}.") and _is_one(folder / attempt):
            yield folder / attempt


def _is_one(path: Path) -> bool:
    return (path / MANIFEST).is_file() or (path / EVALUATION).is_file()


def _nothing(name: str) -> RunError:
    path = Path(name)
    actual = "no such folder"
    if path.is_dir():
        actual = f"a folder without {MANIFEST} and without folders of runs in it"
    elif path.exists():
        actual = "a file"
    elif MAGIC & set(name):
        actual = "a pattern that matches no folder of a run"
    return RunError(
        "no run or evaluation was found",
        where=name,
        expected=f"a folder with {MANIFEST} or {EVALUATION}, a folder of such, or a pattern",
        actual=actual,
        fix="check the path; an environment is recorded first: gamekeeper rollout ENV --out RUN",
    )
