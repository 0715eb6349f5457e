"""Packs runs into one file that somebody else can check: a claim.

    claim.json      what is claimed: runs, their digests and figures, source, packages, all files
    runs/NAME/      each run, byte by byte
    evaluations/    each evaluation's document and raw episodes; its recorded runs are among runs
    source/         modules that the environment was imported from, and contracts beside them
    files/          whatever else was named: checkpoints, specifications, tables
    lock.txt        packages that are installed where it was packed

Packing runs no code of a run: sources are those that recording noted, or the file that a run names.

A claim is signed by an SSH key, with OpenSSH's `ssh-keygen -Y`: the signature lies beside it, in
CLAIM.sig, and covers every byte of it.
"""

import json
import platform
import shutil
import subprocess
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from hashlib import blake2b, file_digest
from importlib import metadata
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.contract import Contract
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.plain_json import fields_json
from gamekeeper.errors import ContractError, DependencyError, RunError
from gamekeeper.evaluation.claim_figures import policy_files, runs_of
from gamekeeper.evaluation.continuation import RESULT, document_in
from gamekeeper.evaluation.worker_tasks import EPISODES
from gamekeeper.import_guard import guarded
from gamekeeper.interface.object_source import FILE_MODULE
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
BLOCK_BYTES: Final = 1 << 20
"""Bytes of a file that are in memory at once."""

Content = bytes | Path
"""Content of an entry: bytes, or a file that is copied when the claim is written."""


@dataclass(frozen=True, slots=True)
class Packed:
    """A claim that was written: its file, the digest of what it claims, and what is in it."""

    claim: str
    digest: str
    runs: tuple[str, ...]
    source: tuple[str, ...]
    files: int
    size_bytes: int
    signature: str | None = None

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper pack --json` prints."""
        return fields_json(self)


def pack(
    runs: Iterable[str | PathLike[str]],
    out: str | PathLike[str],
    *,
    files: Iterable[str | PathLike[str]] = (),
    sign: str | PathLike[str] | None = None,
) -> Packed:
    """Writes a claim over runs and evaluations: evidence, source, packages, figures.

    Args:
        runs: folders of finalized, undamaged runs, and of evaluations that recorded theirs.
        out: the file to write; it must not exist.
        files: more files and folders: checkpoints, an evaluation and its specification.
        sign: an SSH key, by which OpenSSH signs the claim into OUT.sig.
    Raises:
        RunError: a run is open or damaged, an evaluation recorded none, there is none, the file
            exists, two sources that differ have one name, or the key can't sign.
        DependencyError: there is a key, and no ssh-keygen.
    """
    named = [Path(each) for each in runs]
    evaluations = [each for each in named if (each / RESULT).is_file()]
    found = {}
    for each in evaluations:
        document = document_in(Storage.at(each))
        found[each] = document, runs_of(document, str(each))
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
            contents[f"{EVALUATIONS}/{name}/{part}"] = folder / part
        more += policy_files(document)
    contents |= _files(map(Path, more))
    packages = installed_packages()
    contents[LOCK] = "".join(f"{name}=={v}\n" for name, v in packages.items()).encode()
    claim = {"runs": claimed, "evaluations": judged, "packages": packages}
    packed = _written(target, claim, contents)
    return packed if sign is None else replace(packed, signature=str(signed(target, Path(sign))))


def _runs(folders: list[Path]) -> tuple[list[dict[str, Any]], dict[str, Content]]:
    """Claims over runs, and their files and sources.

    Raises:
        RunError: sources of two runs differ and have one name.
    """
    claimed = []
    contents: dict[str, Content] = {}
    for folder, name in zip(folders, _names(folders), strict=True):
        claimed.append(_claim_of(folder, name))
        contents |= {
            f"{RUNS}/{name}/{file.relative_to(folder).as_posix()}": file for file in _below(folder)
        }
        for place, data in _source_of(load(folder)).items():
            if contents.setdefault(f"{SOURCE}/{place}", data) != data:
                raise RunError(
                    "sources of two runs have one name",
                    where=str(folder),
                    expected=f"one {place} for all runs of a claim",
                    actual=f"another {place} than a run before it",
                    fix="pack them as two claims, or rename the file and record again",
                )
    return claimed, contents


def _files(named: Iterable[Path]) -> dict[str, Content]:
    """Files that were named, and those in folders that were, by their place in the claim.

    The place is the name; where two have one name, as many folders above it as tell them apart.
    """
    paths = list(dict.fromkeys(each.resolve() for each in named))
    tails = dict.fromkeys(paths, 1)
    while True:
        places = {path: Path(*path.parts[1:][-tails[path] :]) for path in paths}
        times = Counter(places.values())
        if all(count == 1 for count in times.values()):
            break
        tails = {path: tails[path] + (times[places[path]] > 1) for path in paths}
    return {
        f"{FILES}/{(place / file.relative_to(path)).as_posix()}": file
        for path, place in places.items()
        for file in (_below(path) if path.is_dir() else [path])
    }


def _written(target: Path, claim: Mapping[str, Any], contents: Mapping[str, Content]) -> Packed:
    """Writes the file."""
    whole = {
        "format": FORMAT,
        "python": platform.python_version(),
        **claim,
        "files": {name: digest_of(content) for name, content in sorted(contents.items())},
    }
    text = json.dumps(whole, indent=1, sort_keys=True).encode()
    _write(target, {CLAIM: text, **dict(sorted(contents.items()))})
    return Packed(
        str(target),
        digest_of(text),
        tuple(each["name"] for each in claim["runs"]),
        tuple(name for name in sorted(contents) if name.startswith(f"{SOURCE}/")),
        len(contents),
        target.stat().st_size,
    )


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


def hash_of_claim() -> blake2b:
    """The hash of a claim's files: blake2b of 16 bytes."""
    return blake2b(digest_size=16)


def digest_of(content: Content) -> str:
    """Hash of bytes or of a file, in hexadecimal digits."""
    if isinstance(content, Path):
        with content.open("rb") as file:
            return file_digest(file, hash_of_claim).hexdigest()
    found = hash_of_claim()
    found.update(content)
    return found.hexdigest()


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
        for beside in filter(_is_contract, file.parent.glob("*.toml")):
            files.setdefault((Path(place).parent / beside.name).as_posix(), beside)
    return {place: file.read_bytes() for place, file in files.items()}


def _is_contract(file: Path) -> bool:
    """Tells contracts from other TOML files, which may hold what isn't meant for others."""
    try:
        Contract.load(file)
    except ContractError:
        return False
    return True


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


def _write(target: Path, contents: Mapping[str, Content]) -> None:
    with zipfile.ZipFile(target, "x", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            info = zipfile.ZipInfo(name, MOMENT)
            info.compress_type = zipfile.ZIP_DEFLATED
            if isinstance(content, bytes):
                archive.writestr(info, content)
                continue
            with content.open("rb") as file, archive.open(info, "w", force_zip64=True) as entry:
                shutil.copyfileobj(file, entry, BLOCK_BYTES)


NAMESPACE: Final = "gamekeeper-claim"
SUFFIX: Final = ".sig"
MOST_OUTPUT: Final = 300


def signed(claim: Path, key: Path) -> Path:
    """Writes the signature of a claim beside it; asks for the key's passphrase where it has one.

    Args:
        key: a private SSH key, or a public one whose private key an agent holds.
    Raises:
        RunError: the key can't sign.
        DependencyError: there is no ssh-keygen.
    """
    target = Path(f"{claim}{SUFFIX}")
    target.unlink(missing_ok=True)  # ssh-keygen would ask whether to overwrite it
    done = _keygen("sign", "-f", str(key), str(claim))
    if done.returncode or not target.is_file():
        raise RunError(
            "the claim is packed, and can't be signed by this key",
            where=str(key),
            expected="an SSH key that you can use",
            actual=_output_of(done),
            fix="name the private key, such as ~/.ssh/id_ed25519",
        )
    return target


def signer_of(claim: Path, signers: Path) -> str:
    """The name by which a file of allowed signers knows the key that signed a claim.

    Args:
        claim: the file; its signature lies beside it.
        signers: lines of a name and a public key, as `man ssh-keygen` says (ALLOWED SIGNERS).
    Raises:
        RunError: there is no signature, it is of other bytes, or by none of these signers.
        DependencyError: there is no ssh-keygen.
    """
    signature = Path(f"{claim}{SUFFIX}")
    if not signature.is_file():
        raise RunError(
            "the claim has no signature",
            where=str(signature),
            expected="the file that gamekeeper pack --sign wrote beside the claim",
            actual="no such file",
            fix="ask for it, or leave out --signers",
        )
    of = ("-s", str(signature), "-f", str(signers))
    found = _keygen("find-principals", *of)
    name = found.stdout.decode(errors="replace").partition("\n")[0].strip()
    checked = _keygen("verify", *of, "-I", name, given=claim) if name else found
    if checked.returncode or not name:
        raise RunError(
            "the signature isn't one of an allowed signer over this claim",
            where=str(signature),
            expected=f"a signer of {signers}",
            actual=_output_of(checked),
            fix="ask whoever packed it for the claim and its signature again",
        )
    return name


def _keygen(
    action: str, *words: str, given: Path | None = None
) -> subprocess.CompletedProcess[bytes]:
    program = shutil.which("ssh-keygen")
    if program is None:
        raise DependencyError("ssh-keygen isn't installed", fix="install OpenSSH's client")
    scope = () if action == "find-principals" else ("-n", NAMESPACE)
    line = [program, "-Y", action, *scope, *words]
    if given is None:
        return subprocess.run(line, capture_output=True, check=False)
    with given.open("rb") as file:
        return subprocess.run(line, capture_output=True, check=False, stdin=file)


def _output_of(done: subprocess.CompletedProcess[bytes]) -> str:
    return (done.stderr or done.stdout).decode(errors="replace").strip()[:MOST_OUTPUT]
