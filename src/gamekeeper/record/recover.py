"""Seals a run that was killed, with the longest prefix of whole turns."""

from __future__ import annotations

import os
from os import PathLike
from pathlib import Path
from typing import Any

import pyarrow as pa

from gamekeeper.core.evidence import Evidence, fingerprints
from gamekeeper.core.press import EPISODES
from gamekeeper.errors import BundleError
from gamekeeper.record.bundle import load
from gamekeeper.record.claim import lock_folder
from gamekeeper.record.folder import system_error
from gamekeeper.record.seal import commit
from gamekeeper.record.table_writer import write_table
from gamekeeper.record.verify import digest_again


def recover(
    path: str | PathLike[str], *, status: str = "recovered", error: str | None = None
) -> Evidence:
    """Seals an open bundle whose recorder is gone; its last episode is kept as *torn*.

    Args:
        status: "recovered", "sealed" or "failed".
        error: why the last episode could not go on; it then counts as failed.
    Raises:
        BundleError: there is no bundle, or it is still being recorded.
    """
    evidence = load(path)
    if evidence.manifest.get("status") != "open":
        return evidence
    found = digest_again(evidence)
    rows = evidence.episodes.to_pylist()
    for row in rows:
        row["fingerprint"], row["info_fingerprint"] = found.episodes[row["episode"]]
        if row["end"] is None:
            row |= {"end": "torn", "turns": _turns(evidence, row["episode"])}
    if error is not None and rows:
        rows[-1] |= {"end": "failed", "error": rows[-1]["error"] or error}
    episodes = pa.Table.from_pylist(rows, schema=EPISODES)
    manifest: dict[str, Any] = {
        **evidence.manifest,
        **fingerprints(evidence.manifest, episodes),
        "status": status,
    }
    if error is not None:
        manifest["error"] = error
    tables = {
        "episodes": episodes,
        "steps": evidence.steps,
        "states": evidence.states,
        "timings": evidence.timings,
    }
    _seal(Path(path), manifest, {name: t for name, t in tables.items() if t is not None})
    return load(path)


def _seal(folder: Path, manifest: dict[str, Any], tables: dict[str, pa.Table]) -> None:
    lock = lock_folder(folder)
    try:
        files = {
            name: write_table(folder, name, table.schema, table.to_batches())
            for name, table in tables.items()
        }
        commit(folder, manifest, files)
    except OSError as error:
        if isinstance(error, BundleError):
            raise
        raise system_error("sealing", folder, error) from error
    finally:
        if lock >= 0:
            os.close(lock)


def _turns(evidence: Evidence, episode: int) -> int:
    """The whole turns of an episode: one row of timings for each."""
    if evidence.timings is None:
        raise BundleError("the bundle has no timings, so its whole turns can't be told", where=str(evidence.path))
    return evidence.timings["episode"].to_pylist().count(episode)
