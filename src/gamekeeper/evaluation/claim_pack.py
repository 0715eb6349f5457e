"""Packs runs into one file that somebody else can check: a claim.

    claim.json      what is claimed: runs, their digests and figures, source, packages, all files
    runs/NAME/      each run, byte by byte
    evaluations/    each evaluation's document and raw episodes; its recorded runs are among runs
    source/         modules that the environment was imported from, and contracts beside them
    files/          whatever else was named: checkpoints, specifications, tables
    lock.txt        packages that are installed where it was packed

Packing runs no code of a run: sources are those that recording noted, or the file that a run names.
"""

from __future__ import annotations

import json
import platform
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from hashlib import blake2b
from importlib import metadata
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import RunError
from gamekeeper.evaluation.claim_figures import policy_files, runs_of
from gamekeeper.evaluation.continuation import RESULT, document_in
from gamekeeper.evaluation.worker_tasks import EPISODES
from gamekeeper.import_guard import guarded
from gamekeeper.interface.found_again import FILE_MODULE
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.runs import own_runs
from gamekeeper.runs.load_run import load
from gamekeeper.runs.run_check import verify

FORMAT: Final = 1
CLAIM: Final = "claim.json"
RUNS, SOURCE, FILES, LOCK = "runs", "source", "files", "lock.txt"
EVALUATIONS: Final = "evaluations"
MOMENT: Final = (1980, 1, 1, 0, 0, 0)
"""Time of every entry, so that equal contents make equal files."""
FIGURES: Final = ("return_mean", "length_mean", "share", "idle")


@dataclass(frozen=True, slots=True)
class Packed:
    """A claim that was written: its file, the digest of what it claims, and what is in it."""

    path: str
    digest: str
    runs: tuple[str, ...]
    source: tuple[str, ...]
    files: int
    size_bytes: int

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper pack --json` prints."""
        return {
            "claim": self.path,
            "digest": self.digest,
            "runs": list(self.runs),
            "source": list(self.source),
            "files": self.files,
            "size_bytes": self.size_bytes,
        }


def pack(
    runs: Iterable[str | PathLike[str]],
    out: str | PathLike[str],
    *,
    files: Iterable[str | PathLike[str]] = (),
) -> Packed:
    """Writes a claim over runs and evaluations: evidence, source, packages, figures.

    Args:
        runs: folders of finalized, undamaged runs, and of evaluations that recorded theirs.
        out: the file to write; it must not exist.
        files: more files and folders: checkpoints, an evaluation and its specification.
    Raises:
        RunError: a run is open or damaged, an evaluation recorded none, there is none, or the
            file exists.
    """
    named = [Path(each) for each in runs]
    evaluations = [each for each in named if (each / RESULT).is_file()]
    found = {each: _evaluation(each) for each in evaluations}
    played = [each / run for each in evaluations for run in found[each][1].values()]
    folders = [each for each in named if each not in found] + played
    target = Path(out)
    if not folders or target.exists():
        raise RunError(
            "no claim can be packed",
            where=str(target),
            expected="at least one run, and a new file",
            actual="the file exists already" if folders else "no run",
            fix="name a file that isn't there" if folders else "name the folder of a run",
        )
    claimed, contents = _runs(folders)
    names = {folder: each["name"] for folder, each in zip(folders, claimed, strict=True)}
    judged, more = [], [*files]
    for folder, name in zip(evaluations, _names(evaluations), strict=True):
        document, its_runs = found[folder]
        rows = [[*key, names[folder / run]] for key, run in its_runs.items()]
        judged.append({"name": name, "runs": rows})
        for part in (RESULT, EPISODES):
            contents[f"{EVALUATIONS}/{name}/{part}"] = (folder / part).read_bytes()
        more += policy_files(document)
    contents |= _files(map(Path, more))
    packages = installed_packages()
    contents[LOCK] = "".join(f"{name}=={v}\n" for name, v in packages.items()).encode()
    claim = {"runs": claimed, "evaluations": judged, "packages": packages}
    return _written(target, claim, contents)


def _runs(folders: list[Path]) -> tuple[list[dict[str, Any]], dict[str, bytes]]:
    """Claims over runs, and their files and sources."""
    claimed = []
    contents: dict[str, bytes] = {}
    for folder, name in zip(folders, _names(folders), strict=True):
        claimed.append(_claim_of(folder, name))
        contents |= {
            f"{RUNS}/{name}/{file.relative_to(folder).as_posix()}": file.read_bytes()
            for file in _below(folder)
        }
        contents |= {f"{SOURCE}/{key}": data for key, data in _source_of(load(folder)).items()}
    return claimed, contents


def _files(named: Iterable[Path]) -> dict[str, bytes]:
    """Files that were named, and those in folders that were, by their place in the claim."""
    return {
        f"{FILES}/{file.relative_to(each.parent).as_posix()}": file.read_bytes()
        for each in named
        for file in (_below(each) if each.is_dir() else [each])
    }


def _written(target: Path, claim: Mapping[str, Any], contents: Mapping[str, bytes]) -> Packed:
    """Writes the file."""
    whole = {
        "format": FORMAT,
        "python": platform.python_version(),
        **claim,
        "files": {name: digest_of_bytes(data) for name, data in sorted(contents.items())},
    }
    text = json.dumps(whole, indent=1, sort_keys=True).encode()
    _write(target, {CLAIM: text, **dict(sorted(contents.items()))})
    return Packed(
        str(target),
        digest_of_bytes(text),
        tuple(each["name"] for each in claim["runs"]),
        tuple(name for name in sorted(contents) if name.startswith(f"{SOURCE}/")),
        len(contents),
        target.stat().st_size,
    )


def _evaluation(folder: Path) -> tuple[dict[str, Any], dict[tuple[str, str], str]]:
    """Document of an evaluation, and its runs' folders by environment and pairing.

    Raises:
        RunError: it recorded no runs.
        EvidenceError: the document there is another.
    """
    document = document_in(Storage.at(folder))
    return document, runs_of(document, str(folder))


def figures_of(evidence: Evidence) -> dict[str, Any]:
    """Figures of a run by name: fingerprint, episodes, and each agent's part."""
    summary = evidence.summary
    found: dict[str, Any] = {
        "fingerprint": evidence.fingerprint,
        "episodes": summary.episodes,
        "turns": summary.turns,
    }
    for agent, part in summary.agents.items():
        values = part.to_json()
        found |= {f"{agent}.{key}": values[key] for key in FIGURES if values.get(key) is not None}
    return found


def digest_of_bytes(data: bytes) -> str:
    """blake2b of 16 bytes, in hexadecimal digits."""
    return blake2b(data, digest_size=16).hexdigest()


def installed_packages() -> dict[str, str]:
    """Installed distributions and their versions, in the order of their names."""
    found = {
        each.metadata["Name"].lower(): each.version
        for each in metadata.distributions()
        if each.metadata["Name"]
    }
    return dict(sorted(found.items()))


def source_module(identity: Mapping[str, Any]) -> str:
    """Name in the claim's source of the module that a run's environment stands in."""
    module = str(identity.get("entry_point")).partition(":")[0]
    return module if identity.get("kind") == "file" else f"{module.replace('.', '/')}.py"


def _claim_of(folder: Path, name: str) -> dict[str, Any]:
    """Claim over a run: its digests, environment and figures.

    Raises:
        RunError: it is open or damaged.
    """
    with guarded(folder):
        found, evidence = verify(folder), load(folder)
    if not found.ok or evidence.root is None:
        raise RunError(
            "a run can't be claimed as it is",
            where=str(folder),
            expected="a finalized run whose files have their checksums",
            actual=str(found).splitlines()[0],
            fix="finalize it, or restore it: gamekeeper recover, gamekeeper verify",
        )
    return {
        "name": name,
        "root": evidence.root,
        "environment": evidence.manifest.get("environment"),
        "figures": figures_of(evidence),
    }


def _source_of(evidence: Evidence) -> dict[str, bytes]:
    """Modules that the environment was imported from, by their place under `source`.

    Raises:
        RunError: one isn't as it was when the run was recorded.
    """
    identity = evidence.manifest.get("environment") or {}
    modules = own_runs.recall(evidence.root) or {}
    changed = own_runs.changed(modules)
    if changed:
        raise RunError(
            "the source of a run has changed since it was recorded",
            where=changed[0],
            expected="the file that the run was recorded with",
            actual="another",
            fix="record the run again, or pack from the commit that it was recorded with",
        )
    found = {_place(name, Path(path)): Path(path) for name, (path, _) in modules.items()}
    path = identity.get("path")
    if identity.get("kind") == "file" and isinstance(path, str) and Path(path).is_file():
        found[Path(path).name] = Path(path)
    files = {place: file for place, file in found.items() if file.is_file()}
    for place, file in list(files.items()):
        for beside in file.parent.glob("*.toml"):
            files.setdefault((Path(place).parent / beside.name).as_posix(), beside)
    return {place: file.read_bytes() for place, file in files.items()}


def _place(name: str, path: Path) -> str:
    """Place of a module in the source: `pkg.sub` in pkg/sub.py, a loaded file by its own name."""
    if name.startswith(FILE_MODULE):
        return path.name
    parts = name.replace(".", "/")
    return f"{parts}/__init__.py" if path.name == "__init__.py" else f"{parts}.py"


def _names(folders: list[Path]) -> Iterator[str]:
    """A name for each run: its folder's, numbered where two are called alike."""
    seen: set[str] = set()
    for folder in folders:
        name, number = folder.resolve().name, 2
        while name in seen:
            name, number = f"{folder.resolve().name}-{number}", number + 1
        seen.add(name)
        yield name


def _below(folder: Path) -> list[Path]:
    return sorted(each for each in folder.rglob("*") if each.is_file() and not each.is_symlink())


def _write(target: Path, contents: Mapping[str, bytes]) -> None:
    with zipfile.ZipFile(target, "x", zipfile.ZIP_DEFLATED) as archive:
        for name, data in contents.items():
            archive.writestr(zipfile.ZipInfo(name, MOMENT), data, zipfile.ZIP_DEFLATED)
