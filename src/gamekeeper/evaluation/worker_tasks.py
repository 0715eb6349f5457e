"""Tasks of workers: play a part, merge parts into one table, keep evidence."""

import io
import json
import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from math import isclose
from pathlib import Path
from secrets import token_hex
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import is_exact, to_json
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.layout import agent_name
from gamekeeper.errors import GamekeeperError
from gamekeeper.evaluation.episode_rows import (
    Fingerprint,
    Success,
    rows_of,
    schema_with,
    table_of,
    widened,
)
from gamekeeper.evaluation.inspection import given, opened_with
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.rollouts.episode_loop import EpisodePlan
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.rollout_plan import MOST_TURNS
from gamekeeper.rollouts.tally import tally
from gamekeeper.runs.recording import joint_policy_of, rollout

PLAY: Final = "gamekeeper.evaluation.worker_tasks:play_task"
MERGE: Final = "gamekeeper.evaluation.worker_tasks:merge_task"
READY: Final = "gamekeeper.evaluation.worker_tasks:ready_task"
PARTS: Final = "parts"
ROWS: Final = "rows.parquet"
EPISODES: Final = "episodes.parquet"
GROUP_ROWS: Final = 1 << 16
"""Rows of a row group of the merged table."""


def receipt_name(key: str) -> str:
    """Name of the receipt of a part."""
    return f"{PARTS}/{key}.json"


def ready_task(report: Any) -> None:
    """Does nothing: a process that runs it has imported all that playing takes."""


@dataclass(frozen=True, slots=True)
class Lineup:
    """Policies that play together in an environment, as tasks take them: plain JSON.

    Attributes:
        choices: policies, by agent or role.
        most_turns: longer episodes are cut; None: `MOST_TURNS`.
    """

    opening: Mapping[str, Any]
    choices: Mapping[str, Any]
    options: Mapping[str, Any] | str | None
    seed: int
    most_turns: int | None


def play_task(
    report: Any, *, place: str, key: str, lineup: Mapping[str, Any], **part: Any
) -> dict[str, Any]:
    """Plays a part into storage: its rows, then the receipt that names them.

    Args:
        key: of the part; attempts at it don't mix.
        lineup: the fields of a `Lineup`.
        **part: as `play_part` takes it.
    Returns:
        The receipt; or the fields of the `error` that was in the way.
    """
    try:
        table, receipt = play_part(report, Lineup(**lineup), **part)
    except GamekeeperError as error:
        return {"error": error.to_json()}
    storage, attempt = Storage.at(place), f"{PARTS}/{key}.{token_hex(4)}"
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd")
    storage.put(f"{attempt}/{ROWS}", sink.getvalue())
    receipt = {"key": key, "rows": f"{attempt}/{ROWS}", **receipt}
    storage.put(receipt_name(key), json.dumps(receipt, sort_keys=True).encode())
    return receipt


def play_part(
    report: Any,
    lineup: Lineup,
    *,
    sides: Mapping[str, Sequence[Any]],
    label: Mapping[str, Any],
    first: int,
    last: int,
    success: Mapping[str, str],
    infos: Sequence[str],
) -> tuple[pa.Table, dict[str, Any]]:
    """Plays episodes `first` to `last - 1` in an environment of their own.

    Args:
        report: called at every turn, and with what was done after every episode.
        sides: policy and run by agent, role or `*`, for the rows.
        label: names of environment and pairing, for the rows.
        success: conditions by scope.
        infos: fields of the last infos that are kept.
    Returns:
        Rows, and what a receipt says of them.
    Raises:
        GamekeeperError: it can't be played.
    """
    opened, declared = opened_with(lineup.opening)
    seed, most_turns = lineup.seed, lineup.most_turns
    env: Any = opened.env
    try:
        contract = declared or Contract()
        joint_policy = _Counting(joint_policy_of(dict(lineup.choices), env, contract), opened.api)
        judge = Success(contract, success)
        roster = [agent_name(agent) for agent in getattr(env, "possible_agents", ())]
        rows: list[dict[str, Any]] = []
        turns = 0
        for episode in range(first, last):
            play = EpisodePlan(
                seed=episode_seed(seed, episode),
                stream=episode,
                options=given(lineup.options),
                most_turns=MOST_TURNS if most_turns is None else most_turns,
            )
            outcome = tally(
                play,
                env,
                joint_policy=joint_policy,
                policy_seed=seed,
                contract=contract,
                on_step=report,
            )
            turns += outcome.turns
            rows += rows_of(
                outcome,
                label={**label, "episode": episode, "reset": joint_policy.reset},
                success=judge,
                contract=contract,
                sides={place: (side[0], side[1]) for place, side in sides.items()},
                lengths=joint_policy.counts,
                roster=roster,
                infos=infos,
            )
            report(episode=episode + 1 - first, turns=turns)
    finally:
        if opened.make is not None:  # an object is whoever's it is to close
            env.close()
    table = table_of(rows)
    broken = sorted({str(row["error"]) for row in rows if row["error"] is not None})
    return table, {
        "columns": table.schema.names,
        "episodes": last - first,
        "turns": turns,
        "agent_steps": sum(row["length"] for row in rows),
        "errors": broken,
    }


class _Counting:
    """A joint policy that counts the decisions of each agent, and digests what the first are given.

    That is what a reset gives: of a Parallel environment to all agents, of an AEC environment to
    the first in turn, since what others are shown first hangs on its action.
    """

    def __init__(self, joint_policy: Any, api: str) -> None:
        self._joint_policy, self._is_parallel = joint_policy, api == "parallel"
        self.counts: dict[str, int] = {}
        self._first, self._is_open = blake2b(digest_size=8), True

    def begin(self, run_seed: int, episode: int) -> None:
        self.counts = {}
        self._first, self._is_open = blake2b(digest_size=8), True
        self._joint_policy.begin(run_seed, episode)

    def act(self, agent: Any, observation: Any, info: Any) -> Any:
        name = agent_name(agent)
        self._is_open = self._is_open and (
            name not in self.counts if self._is_parallel else not self.counts
        )
        if self._is_open:
            text = to_json(observation)  # what no text can build again says nothing of the seed
            known = text if is_exact(text) else ""
            self._first.update(f"{name}\0{known}\0".encode(errors="surrogatepass"))
        self.counts[name] = self.counts.get(name, 0) + 1
        return self._joint_policy.act(agent, observation, info)

    @property
    def reset(self) -> str | None:
        """Digest of the first observations; None where no agent acted."""
        return self._first.hexdigest() if self.counts else None


def merge_task(report: Any, *, place: str, keys: Sequence[str]) -> dict[str, Any]:
    """Writes the rows of parts, in this order, into one table; reads receipts, so nothing twice.

    Args:
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
        "fingerprint": fingerprint.hexdigest(),
        "rows": count,
        "turns": sum(each["turns"] for each in receipts),
        "agent_steps": sum(each["agent_steps"] for each in receipts),
        "errors": sorted({text for each in receipts for text in each["errors"]}),
    }


_BASE: Final = frozenset(schema_with(()).names)


KEEP: Final = "gamekeeper.evaluation.worker_tasks:keep_task"
RUNS: Final = "runs"
LONGEST: Final = 100
"""Characters of a folder's name."""
NEAR: Final = 1e-9
"""Returns that differ by no more, relatively, are the same sum in another order."""


def keep_task(
    report: Any,
    *,
    place: str,
    key: str,
    name: str,
    parts: Sequence[str],
    level: str,
    lineup: Mapping[str, Any],
    episodes: int,
) -> dict[str, Any]:
    """Records a line-up's episodes as a run in storage; compares them with the raw episodes.

    Args:
        key: of the line-up.
        parts: keys of its raw episodes.
        level: of the recording.
        lineup: the fields of a `Lineup`.
    Returns:
        The run's `folder` and `fingerprint`, and in how many episodes a return differs from
        what was played before (`differs`); or the fields of the `error` that was in the way.
    """
    storage, name = Storage.at(place), f"{RUNS}/{name}"
    receipt = receipt_name(f"{key}.{level}.{episodes}")
    if storage.exists(receipt):
        found: dict[str, Any] = json.loads(storage.get(receipt))
        return found
    plan = Lineup(**lineup)
    contract = plan.opening["contract"]
    if isinstance(contract, Mapping):
        contract = Contract.from_json(contract)
    try:
        with tempfile.TemporaryDirectory(prefix="gamekeeper-") as draft:
            evidence = rollout(
                plan.opening["spec"],
                policies=dict(plan.choices),
                episodes=episodes,
                seed=plan.seed,
                out=Path(draft) / "run_files",
                level=level,
                contract=contract,
                options=given(plan.options),
                most_turns=plan.most_turns,
                env_kwargs=given(plan.opening["kwargs"]),
                after_turn=report,
            )
            differs = _differs(evidence, storage, parts)
            storage.delete(name)
            storage.put_folder(name, Path(draft) / "run_files")
            recorded = {"folder": name, "fingerprint": evidence.fingerprint, "differs": differs}
    except GamekeeperError as error:
        return {"error": error.to_json()}
    storage.put(receipt, json.dumps(recorded, sort_keys=True).encode())
    return recorded


def folder_names(lineups: Iterable[tuple[str, str]]) -> list[str]:
    """A folder's name for each environment and pairing: `line-picker=mappo_0-carrier=random`."""
    found: list[str] = []
    for environment, pairing in lineups:
        plain = re.sub(r"[^\w.=-]+", "_", f"{environment}-{pairing.replace(' ', '-')}")
        name = short = plain.strip("._")[:LONGEST] or "lineup"
        number = 2
        while name.lower() in map(str.lower, found):  # some disks don't tell cases apart
            name, number = f"{short}-{number}", number + 1
        found.append(name)
    return found


def _differs(evidence: Evidence, storage: Storage, parts: Sequence[str]) -> int:
    """In how many episodes an agent's return differs between the evidence and the raw episodes."""
    recorded = _returns(evidence.agent_steps.select(["episode", "agent", "reward"]), "reward")
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
            if not isclose(value, recorded.get((episode, agent), 0.0), rel_tol=NEAR, abs_tol=NEAR)
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
