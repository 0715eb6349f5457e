"""Seals a run that was killed, with the longest prefix of whole turns."""

from __future__ import annotations

from os import PathLike
from typing import Any

import pyarrow as pa

from gamekeeper.core.evidence import Evidence, fingerprints
from gamekeeper.core.press import EPISODES
from gamekeeper.errors import BundleError
from gamekeeper.record.bundle import load
from gamekeeper.record.recovered import seal_recovered
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
    evidence = load(path, salvage=True)
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
    seal_recovered(path, manifest, episodes=episodes)
    return load(path)


def _turns(evidence: Evidence, episode: int) -> int:
    """The whole turns of an episode: one row of timings for each."""
    if evidence.timings is None:
        raise BundleError("the bundle has no timings, so its whole turns can't be told", where=str(evidence.path))
    return evidence.timings["episode"].to_pylist().count(episode)
