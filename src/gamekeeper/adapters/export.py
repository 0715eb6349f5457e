"""What every exporter shares: whom it exports, what it came to, and saying aloud what is lost."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final, TypeAlias

from gamekeeper.core.evidence import Evidence
from gamekeeper.core.trace import Trace
from gamekeeper.errors import BundleError, DependencyError, EvidenceError
from gamekeeper.record.bundle import load

Run: TypeAlias = "Evidence | str | PathLike[str]"
Say: TypeAlias = Callable[[str], None]
HEADERS: Final = 256  # episodes whose headers are plain data at a time


@dataclass(frozen=True, slots=True)
class Export:
    """What an export came to.

    Attributes:
        to: the form: `numpy`, `minari`, `rerun`, `bundle`.
        path: the file or folder that was written.
        agents: who is in it.
        episodes: how many.
        rows: how many rows or steps were written, of all agents.
        parts: what the path holds, where that is more than one thing: ids of data sets.
        lost: what isn't in it, a sentence each.
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
        return {
            "to": self.to, "path": self.path, "agents": list(self.agents),
            "episodes": self.episodes, "rows": self.rows, "parts": list(self.parts),
            "lost": list(self.lost),
        }  # fmt: skip

    def __str__(self) -> str:
        whole = f"{self.rows} rows of {self.episodes} episodes"
        return "\n".join([f"{self.path}: {whole}", *(f"  {part}" for part in self.parts)])


def to_stderr(text: str) -> None:
    """Says a sentence on stderr."""
    sys.stderr.write(f"gamekeeper: {text}\n")


def evidence_of(run: Run) -> Evidence:
    """Evidence as it is, or out of the folder of a run.

    Raises:
        BundleError: there is no bundle, or it is damaged.
        EvidenceError: it has no episode.
    """
    evidence = run if isinstance(run, Evidence) else load(fspath(run))
    if not evidence.episodes.num_rows:
        raise EvidenceError(
            "there is no episode to export", where=_name(evidence), mend="record one first"
        )
    return evidence


def chosen(evidence: Evidence, agents: Collection[str] | None) -> list[str]:
    """The agents of a run that are asked for, in the order in which it seated them.

    Raises:
        EvidenceError: nobody is called so.
    """
    seated = [str(name) for name in evidence.manifest.get("agents") or ()]
    missing = [name for name in agents or () if name not in seated]
    if missing:
        raise EvidenceError(
            f"nobody is called {missing[0]!r}", where="agents", expected=", ".join(seated)[:300],
            seen=repr(missing[0]),
        )  # fmt: skip
    return [name for name in seated if not agents or name in agents]


def traces_of(evidence: Evidence) -> Iterator[Trace]:
    """The episodes in their order; their headers too are plain data only a few at a time."""
    for batch in evidence.episodes.to_batches(max_chunksize=HEADERS):
        for header in batch.to_pylist():
            yield evidence.trace_of(header)


def free_path(out: str | PathLike[str] | None, *, suffix: str = "") -> Path:
    """The path of a file that isn't there yet, its folder made.

    Raises:
        EvidenceError: none was named.
        BundleError: something lies there, or the folder can't be made.
    """
    if out is None:
        raise EvidenceError("no file is named", where="--out", mend=f"--out demo{suffix}")
    path = Path(fspath(out))
    if suffix and path.name and path.suffix != suffix:  # `.` has no name, and lies there
        path = path.with_name(path.name + suffix)
    if path.exists() or path.is_symlink():
        raise BundleError(
            "something lies where the export should go", where=str(path),
            expected="a path that doesn't exist yet", mend="choose another, or move it away first",
        )  # fmt: skip
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BundleError(
            f"making the folder failed: {error.strerror}", where=str(path.parent),
            mend="choose a folder that you may write to",
        ) from error  # fmt: skip
    return path


def needs(package: str, extra: str, error: ImportError) -> DependencyError:
    """What is said where the package of an exporter isn't installed."""
    return DependencyError(
        f"{package} isn't installed", where=f"--to {extra}", seen=str(error),
        mend=f"pip install 'gamekeeper[{extra}]'",
    )  # fmt: skip


def tell(lost: Sequence[str], say: Say) -> tuple[str, ...]:
    """Says each loss once, and gives them back."""
    for each in lost:
        say(f"lost: {each}")
    return tuple(lost)


def _name(evidence: Evidence) -> str:
    return "memory" if evidence.path is None else str(evidence.path)
