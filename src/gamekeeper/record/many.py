"""Recording many copies at once: one bundle, its episodes in their order whatever the timing."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

import pyarrow as pa

from gamekeeper.core.contract import Contract
from gamekeeper.core.evidence import manifest_of
from gamekeeper.core.merge import merged_episodes
from gamekeeper.core.press import EPISODES
from gamekeeper.record.files.store import Store


def record_many(
    venv: Any, path: str | PathLike[str], *, level: str, contract: Contract | None
) -> None:
    """Records a vector environment into a bundle from its next reset on; closing it seals that.

    The fingerprint is the one that the same episodes have, played one by one. Rows reach the disk
    in the order of episodes, so those after an episode that is still being played wait in memory.

    Args:
        venv: a vector environment that wasn't reset yet.
        path: a folder that doesn't exist yet, or is empty.
        level: `full` or `digest`.
        contract: names reward terms and volatile infos; None: the environment's own.
    Raises:
        BundleError: the folder can't be written, or something is in it.
        OrderError: it was reset already.
    """
    declared = venv.seen.contract if contract is None else contract
    facts: dict[str, Any] = {
        "environment": venv.seen.identity, "contract": declared, "level": level, "run_seed": None,
        "layout": venv.seen.layout,
    }  # fmt: skip
    store = Store.create(Path(path).absolute(), manifest_of(**facts))
    episodes: list[pa.RecordBatch] = []

    def write(stream: str, batch: pa.RecordBatch) -> None:
        store.append(stream, batch)
        if stream == "episodes":
            episodes.append(batch)

    def seal() -> None:
        merged = merged_episodes(episodes) if episodes else EPISODES.empty_table()
        failed = "failed" in merged["end"].to_pylist()
        status = {"status": "failed" if failed else "sealed"}
        store.seal({**manifest_of(episodes=merged, **facts), **status})

    try:
        venv.record(
            write, level=level, terms=() if declared is None else tuple(declared.rewards),
            volatile=() if declared is None else tuple(declared.volatile_infos()), on_close=seal,
        )  # fmt: skip
    except BaseException:
        store.abandon()
        raise
