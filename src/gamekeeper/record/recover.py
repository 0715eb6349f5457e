"""Seals a run that was killed, with the longest prefix of whole turns."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import Any

import pyarrow as pa

from gamekeeper.core.evidence import Evidence, fingerprints
from gamekeeper.core.extent import crossings
from gamekeeper.core.press import EPISODES
from gamekeeper.record.bundle import load
from gamekeeper.record.files.recovered import seal_recovered
from gamekeeper.record.verify import digest_again


def recover(
    path: str | PathLike[str],
    *,
    status: str = "recovered",
    error: str | None = None,
    is_theirs: bool = True,
) -> Evidence:
    """Seals an open bundle whose recorder is gone; its last episode is kept as *torn*.

    Args:
        status: "recovered", "sealed" or "failed".
        error: why the last episode could not go on; it then counts as failed.
        is_theirs: the error is the environment's, which a replay has to come to again; one of the
            disk leaves the episode *torn*.
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
            row |= {"end": "torn", "turns": _turns(evidence, row)}
    if error is not None and rows:
        end = "failed" if is_theirs else rows[-1]["end"]
        rows[-1] |= {"end": end, "error": rows[-1]["error"] or error}
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


def _turns(evidence: Evidence, header: Mapping[str, Any]) -> int:
    """The whole turns of an episode: a row of timings for each, where any were written yet."""
    timings = evidence.timings
    if timings is None:
        return crossings(evidence.trace_of(header))
    return int(timings["episode"].to_pylist().count(header["episode"]))
