"""What workers do: play a part, merge parts into one table, keep evidence. Tasks for executors."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from secrets import token_hex
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import agent_name
from gamekeeper.core.seeds import episode_seed
from gamekeeper.errors import GamekeeperError
from gamekeeper.evaluate.look import given, opened_with
from gamekeeper.evaluate.rows import Fingerprint, Success, rows_of, schema_with, table_of, widened
from gamekeeper.record.recording import MOST_TURNS, cast_of
from gamekeeper.record.tasks import error_fields
from gamekeeper.run.episode import Play
from gamekeeper.run.executors.storage import Storage
from gamekeeper.run.tally import tally

PLAY: Final = "gamekeeper.evaluate.play:play_task"
MERGE: Final = "gamekeeper.evaluate.play:merge_task"
READY: Final = "gamekeeper.evaluate.play:ready_task"
PARTS: Final = "parts"
ROWS: Final = "rows.parquet"
EPISODES: Final = "episodes.parquet"
GROUP_ROWS: Final = 1 << 16
"""Rows of a row group of the merged table."""


def receipt_name(key: str) -> str:
    """Where the receipt of a part lies."""
    return f"{PARTS}/{key}.json"


def ready_task(report: Any) -> None:
    """Does nothing: whose process has come this far has imported what it plays with."""


def play_task(report: Any, *, place: str, key: str, **what: Any) -> dict[str, Any]:
    """Plays a part into storage: its rows, then the receipt that names them.

    Args:
        place: of the storage.
        key: of the part; attempts at it don't mix.
        **what: as `play_part` takes it.
    Returns:
        The receipt; or the fields of the `error` that was in the way.
    """
    try:
        table, receipt = play_part(report, **what)
    except GamekeeperError as error:
        return {"error": error_fields(error)}
    storage, attempt = Storage.at(place), f"{PARTS}/{key}.{token_hex(4)}"
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd")
    storage.put(f"{attempt}/{ROWS}", sink.getvalue())
    receipt = {"key": key, "rows": f"{attempt}/{ROWS}", **receipt}
    storage.put(receipt_name(key), json.dumps(receipt, sort_keys=True).encode())
    return receipt


def play_part(
    report: Any,
    *,
    opening: Mapping[str, Any],
    choices: Mapping[str, Any],
    sides: Mapping[str, Sequence[Any]],
    label: Mapping[str, Any],
    seed: int,
    first: int,
    last: int,
    options: Mapping[str, Any] | str | None,
    most_turns: int | None,
    success: Mapping[str, str],
    infos: Sequence[str],
) -> tuple[pa.Table, dict[str, Any]]:
    """Plays episodes `first` to `last - 1` in an environment of their own.

    Args:
        report: called at every turn, and with what was done after every episode.
        opening: what opens the environment.
        choices: who plays.
        sides: policy and run by agent, role or `*`, for the rows.
        label: names of environment and pairing, for the rows.
        seed: of the run.
        options: of the resets.
        success: conditions by scope.
        infos: fields of the last infos that are kept.
    Returns:
        Rows, and what a receipt says of them.
    Raises:
        GamekeeperError: it can't be played.
    """
    opened, declared = opened_with(opening)
    env: Any = opened.env
    try:
        contract = declared or Contract()
        cast = _Counting(cast_of(dict(choices), env, contract))
        judge = Success(contract, success)
        roster = [agent_name(agent) for agent in getattr(env, "possible_agents", ())]
        rows: list[dict[str, Any]] = []
        turns = 0
        for episode in range(first, last):
            play = Play(
                seed=episode_seed(seed, episode), stream=episode, options=given(options),
                most_turns=MOST_TURNS if most_turns is None else most_turns,
            )  # fmt: skip
            outcome = tally(play, env, cast=cast, cast_seed=seed, contract=contract, on_step=report)
            turns += outcome.turns
            rows += rows_of(
                outcome, label={**label, "episode": episode}, success=judge, contract=contract,
                sides={whom: (side[0], side[1]) for whom, side in sides.items()},
                lengths=cast.counts, roster=roster, infos=infos,
            )  # fmt: skip
            report(episode=episode + 1 - first, turns=turns)
    finally:
        if opened.make is not None:  # an object is whoever's it is to close
            env.close()
    table = table_of(rows)
    broken = sorted({str(row["error"]) for row in rows if row["error"] is not None})
    acted = sum(row["length"] for row in rows)
    return table, {
        "columns": table.schema.names, "episodes": last - first, "turns": turns,
        "agent_steps": acted, "errors": broken,
    }  # fmt: skip


class _Counting:
    """A cast that counts the decisions of each agent."""

    def __init__(self, cast: Any) -> None:
        self._cast, self.counts = cast, dict[str, int]()

    def begin(self, run_seed: int, episode: int) -> None:
        self.counts = {}
        self._cast.begin(run_seed, episode)

    def act(self, agent: Any, observation: Any, info: Any) -> Any:
        name = agent_name(agent)
        self.counts[name] = self.counts.get(name, 0) + 1
        return self._cast.act(agent, observation, info)


def merge_task(report: Any, *, place: str, keys: Sequence[str]) -> dict[str, Any]:
    """Writes the rows of parts, in this order, into one table; reads receipts, so nothing twice.

    Args:
        place: of the storage.
        keys: of the parts, all of which have a receipt.
    Returns:
        `fingerprint`, `rows`, `turns`, `agent_steps` and the `errors` that episodes ended with.
    """
    storage = Storage.at(place)
    receipts = []
    for key in keys:
        receipts.append(json.loads(storage.get(receipt_name(key))))
        report()
    schema = schema_with({name for each in receipts for name in each["columns"]} - _BASE)
    fingerprint, sink, count = Fingerprint(schema), io.BytesIO(), 0
    with pq.ParquetWriter(sink, schema, compression="zstd") as writer:
        waiting: list[pa.Table] = []
        for receipt in receipts:
            part = pq.read_table(pa.BufferReader(storage.get(receipt["rows"])))
            waiting.append(widened(part, schema))
            fingerprint.add(waiting[-1])
            count += part.num_rows
            report()
            if sum(each.num_rows for each in waiting) >= GROUP_ROWS:
                writer.write_table(pa.concat_tables(waiting).combine_chunks())
                waiting = []
        if waiting:
            writer.write_table(pa.concat_tables(waiting).combine_chunks())
    storage.put(EPISODES, sink.getvalue())
    return {
        "fingerprint": fingerprint.hexdigest(), "rows": count,
        "turns": sum(each["turns"] for each in receipts),
        "agent_steps": sum(each["agent_steps"] for each in receipts),
        "errors": sorted({text for each in receipts for text in each["errors"]}),
    }  # fmt: skip


_BASE: Final = frozenset(schema_with(()).names)
