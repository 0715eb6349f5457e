"""Evidence of line-ups, so that a reader can replay what the figures were made from."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from gamekeeper.core.evidence import Evidence
from gamekeeper.errors import GamekeeperError
from gamekeeper.evaluate.look import given
from gamekeeper.evaluate.play import receipt_name
from gamekeeper.record.recording import rollout
from gamekeeper.record.tasks import error_fields
from gamekeeper.run.executors.storage import Storage

KEEP: Final = "gamekeeper.evaluate.keep:keep_task"
BUNDLES: Final = "bundles"
NEAR: Final = 1e-9
"""Returns that differ by no more, relatively, are the same sum in another order."""


def keep_task(
    report: Any,
    *,
    place: str,
    key: str,
    parts: Sequence[str],
    level: str,
    opening: Mapping[str, Any],
    choices: Mapping[str, Any],
    options: Mapping[str, Any] | str | None,
    seed: int,
    most_turns: int | None,
    episodes: int,
) -> dict[str, Any]:
    """Records a line-up's episodes as a bundle in storage; compares them with the raw episodes.

    Args:
        place: of the storage.
        key: of the line-up.
        parts: keys of its raw episodes.
        level: of the recording.
        opening: what opens the environment.
        choices: who plays.
        options: of the resets.
        seed: of the run.
        episodes: how many.
    Returns:
        The bundle's `folder` and `fingerprint`, and in how many episodes a return differs from
        what was played before (`differs`); or the fields of the `error` that was in the way.
    """
    storage, name = Storage.at(place), f"{BUNDLES}/{key}"
    receipt = receipt_name(f"{key}.{level}.{episodes}")
    if storage.exists(receipt):
        found: dict[str, Any] = json.loads(storage.get(receipt))
        return found
    contract = opening["contract"]
    if isinstance(contract, Mapping):
        from gamekeeper.core.contract import Contract

        contract = Contract.from_json(contract)
    try:
        with tempfile.TemporaryDirectory(prefix="gamekeeper-") as draft:
            evidence = rollout(
                opening["spec"], policies=dict(choices), episodes=episodes, seed=seed,
                out=Path(draft) / "bundle", level=level, contract=contract,
                options=given(options), most_turns=most_turns,
                env_kwargs=given(opening["kwargs"]), after_turn=report,
            )  # fmt: skip
            differs = _differs(evidence, storage, parts)
            storage.delete(name)
            storage.put_folder(name, Path(draft) / "bundle")
            told = {"folder": name, "fingerprint": evidence.fingerprint, "differs": differs}
    except GamekeeperError as error:
        return {"error": error_fields(error)}
    storage.put(receipt, json.dumps(told, sort_keys=True).encode())
    return told


def _differs(evidence: Evidence, storage: Storage, parts: Sequence[str]) -> int:
    """In how many episodes an agent's return differs between the evidence and the raw episodes."""
    recorded = _returns(evidence.steps.select(["episode", "agent", "reward"]), "reward")
    rows = []
    for key in parts:
        receipt = json.loads(storage.get(receipt_name(key)))
        part = pq.read_table(pa.BufferReader(storage.get(receipt["rows"])))
        rows.append(part.select(["episode", "agent", "return"]))
    played = _returns(pa.concat_tables(rows), "return")
    return len(
        {
            episode
            for (episode, agent), value in played.items()
            if not _is_near(value, recorded.get((episode, agent), 0.0))
        }
    )


def _returns(table: pa.Table, column: str) -> dict[tuple[int, str], float]:
    table = table.filter(pc.is_valid(table[column]))
    found = (
        table.group_by(["episode", "agent"], use_threads=False)
        .aggregate([(column, "sum")])
        .to_pydict()
    )
    keys = zip(found["episode"], found["agent"], strict=True)
    return dict(zip(keys, found[f"{column}_sum"], strict=True))


def _is_near(one: float, two: float) -> bool:
    return one == two or abs(one - two) <= NEAR * max(abs(one), abs(two), 1.0)
