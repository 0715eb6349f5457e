"""NumPy: a whole run as one .npz file, every agent's rows as plain arrays.

    arrays = np.load("run.npz")            # allow_pickle stays False
    arrays["picker_0/obs"], arrays["picker_0/action"], json.loads(str(arrays["metadata"]))
    rows, paid = decisions(arrays, "picker_0")    # what it was paid from each decision to its next

| array | what it is |
|---|---|
| `metadata` | JSON text: layout, environment, contract, spaces, seed, fingerprints, `agents` (name to prefix), `lost` |
| `AGENT/episode`, `AGENT/turn` | int32; the key of each of the agent's rows |
| `AGENT/order` | int16; its place among those who acted, -1: it did not act |
| `AGENT/live`, `AGENT/given` | bool; in the roster; the row holds what `last()` returns |
| `AGENT/obs`, `AGENT/obs.PATH` | one array for each leaf of its space, with `AGENT/obs.valid` |
| `AGENT/mask` | the mask of the info, with `AGENT/mask.valid`; only where it ever had one |
| `AGENT/cumulative_reward`, `AGENT/terminated`, `AGENT/truncated` | what `last()` returned |
| `AGENT/action`, `AGENT/action.PATH` | with `AGENT/action.valid` |
| `AGENT/reward`, `AGENT/reward.TERM` | float64; what this step paid it, with `AGENT/reward.valid`; of a term NaN where the run doesn't say |
| `AGENT/info`, `AGENT/raised`, `AGENT/nonconforming` | texts |
| `AGENT/digest` | uint8 [rows, 16]; only at level "digest", in place of the observations |
| `state/episode`, `state/turn` | the turns that have a `state()`: `state/value` or `state/value.PATH`, `state/value.valid`, `state/nonconforming` |
| `episodes/episode`, `seed`, `turns`, `end`, ... | one row for each episode, in this order |

A row without a value holds zeros and False in `.valid`. A text `X` stands as two arrays: `X.text`, UTF-8, and `X.end` [rows], where each
row's text ends in it; `texts(arrays, "X")` reads them, and an empty one is none.

| | |
|---|---|
| kept | every row, value, dtype and shape; orders, masks, reward terms, ends, seeds, options, policies, infos (JSON), states, fingerprints |
| changed | null is zeros with `.valid` (numbers: 0, -1 for an order); "/" in an agent's name is "%2F"; values of a Sequence, Graph or OneOf stand as canonical JSON |
| lost | frames; timings; reward terms that the run doesn't tell are NaN; observations at level "digest" (their digests are kept); masks of another length than the agent's first |
| refused | nothing; a value that isn't of its space stands in `nonconforming`, as it was |
"""  # noqa: E501  # a row of a table is one line

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gamekeeper.adapters.export_source import (
    UNKNOWN_TERMS,
    AgentRows,
    Export,
    LeafValues,
    Run,
    Say,
    chosen,
    evidence_of,
    rows_of,
    tell,
    to_stderr,
)
from gamekeeper.adapters.spool import Spool, spooled
from gamekeeper.episodes.encoder import EPISODES
from gamekeeper.episodes.episode import Spaces
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.spaces import Codec
from gamekeeper.runs.files.folder import output_path

LAYOUT: Final = 1
OWN: Final = ("metadata", "episodes", "state")  # prefixes that no agent may have
NUMBERS: Final = (
    "episode",
    "turn",
    "live",
    "cumulative_reward",
    "terminated",
    "truncated",
    "reward",
)
KEPT: Final = (
    "environment",
    "contract",
    "spaces",
    "state_space",
    "terms",
    "seed",
    "level",
    "status",
    "fingerprint",
    "info_fingerprint",
)
HEADERS: Final = ("end", "options", "policies", "endings", "error", "fingerprint")
BATCH: Final = 1_024  # episodes whose headers are written at a time
PLAIN: Final = " !#$&'()+,-.:;=@[]^_`{}~"  # stays as it is in the name of a member


def export(
    run: Run,
    out: str | PathLike[str] | None,
    *,
    agents: Collection[str] | None = None,
    compress: bool = True,
    say: Say = to_stderr,
) -> Export:
    """Writes a run as one .npz file that `numpy.load` reads without pickle.

    Memory stays flat however many episodes there are, and however long they are: rows are taken a
    part of the run at a time, not an episode at a time, as an agent in an episode often has few.
    Equal evidence gives equal bytes.

    Args:
        run: evidence, or the folder of a run.
        out: the file; `.npz` is put behind it where it lacks that.
        agents: only these; None: all.
        compress: deflate the arrays.
        say: takes a sentence for each loss.
    Raises:
        RunError: there is no run, `out` is a folder or part of a run, or the disk refuses.
        EvidenceError: the run has no such agent, or no episode.
    """
    evidence = evidence_of(run)
    names = chosen(evidence, agents)
    path = output_path(out, suffix=".npz")
    with spooled(path, compress=compress) as spool:
        writer = _ArrayWriter(spool, {name: prefix_of(name) for name in names})
        for headers in evidence.episode_table.to_batches(max_chunksize=BATCH):
            writer.add_headers(headers)
        for steps in evidence.tables.all_parts("agent_steps") or ():
            writer.add_steps(steps, evidence.spaces)
        for states in evidence.tables.all_parts("states") or ():
            writer.add_states(states, evidence.state_codec)
        lost = tell(_lost(evidence, writer), say)
        metadata = {name: evidence.manifest.get(name) for name in KEPT}
        metadata |= {"layout": LAYOUT, "agents": writer.prefixes, "lost": list(lost)}
        spool.add_text("metadata", json.dumps(metadata, sort_keys=True))
    return Export(
        to="numpy",
        path=str(path),
        agents=tuple(names),
        episodes=evidence.episode_table.num_rows,
        rows=writer.rows,
        lost=lost,
    )


def texts(arrays: Mapping[str, Any], name: str) -> list[str | None]:
    """Returns the texts of an array of texts; None for a row that has none.

    Args:
        arrays: what `numpy.load` gave.
        name: as "picker_0/info".
    Raises:
        KeyError: there is no such array.
    """
    data, ends = bytes(arrays[f"{name}.text"].tobytes()), arrays[f"{name}.end"].tolist()
    starts = [0, *ends[:-1]]
    return [data[a:b].decode() if a < b else None for a, b in zip(starts, ends, strict=True)]


def decisions(
    arrays: Mapping[str, Any], agent: str, reward: str = "reward"
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Returns the rows of an agent's decisions, and its reward from each to the next or the end.

    Where others act in between, most of a decision's reward stands in later rows. Rewards before
    the first decision of an episode belong to no decision.

    Args:
        arrays: what `numpy.load` gave.
        agent: as `metadata` spells its prefix.
        reward: `reward`, or a term as "reward.delivery".
    Raises:
        KeyError: there is no such agent or term.
    """
    ended = arrays[f"{agent}/terminated"] | arrays[f"{agent}/truncated"]
    rows = np.flatnonzero((arrays[f"{agent}/order"] >= 0) & ~ended)
    if not len(rows):
        return rows, np.zeros(0)
    begins = np.flatnonzero(np.diff(arrays[f"{agent}/episode"], prepend=-1))
    bounds = np.union1d(rows, begins)
    paid = np.add.reduceat(arrays[f"{agent}/{reward}"], bounds)
    return rows, paid[np.searchsorted(bounds, rows)]


def prefix_of(agent: str) -> str:
    """Returns the name of an agent in the names of arrays."""
    name = quote(agent, safe=PLAIN)
    if agent in OWN or not name.strip("."):
        name = f"%{ord(agent[0]):02X}{name[1:]}" if agent else "%"
    return name


class _ArrayWriter:
    def __init__(self, spool: Spool, prefixes: Mapping[str, str]) -> None:
        self.spool, self.prefixes = spool, dict(prefixes)
        self.rows = 0
        self.strange_masks = self.unknown_terms = 0
        self._masks: dict[str, tuple[Any, int]] = {}  # dtype and shape, and rows so far

    def add_headers(self, headers: pa.RecordBatch) -> None:
        """Adds the headers of some episodes."""
        put, columns = self.spool.add, {}
        for name in ("episode", "seed", "turns", *HEADERS):  # of a killed run the keys alone
            kind = EPISODES.field(name).type
            is_there = name in headers.schema.names
            columns[name] = headers[name].cast(kind) if is_there else pa.nulls(len(headers), kind)
        put("episodes/episode", np.asarray(columns["episode"]))
        put("episodes/seed", np.asarray(columns["seed"].fill_null(0)))
        put("episodes/seed.valid", np.asarray(columns["seed"].is_valid(), bool))
        put("episodes/turns", np.asarray(columns["turns"].fill_null(0)))
        for name in HEADERS:
            self._texts(f"episodes/{name}", columns[name].to_pylist())

    def add_steps(self, steps: pa.Table, spaces: Mapping[str, Spaces]) -> None:
        """Adds the next rows, of whatever episodes."""
        for rows in rows_of(steps, spaces, self.prefixes) if steps.num_rows else ():
            self._agent(self.prefixes[rows.agent], rows)

    def add_states(self, states: pa.Table, codec: Codec | None) -> None:
        """Adds the next states."""
        if not states.num_rows:
            return
        rows = AgentRows("state", -1, states, Spaces(codec, None))
        self.spool.add("state/episode", rows.numbers("episode")[0])
        self.spool.add("state/turn", rows.turns)
        self._values("state/value", rows.values_of("state", codec))
        self._texts("state/nonconforming", rows.texts("nonconforming"))

    def _agent(self, prefix: str, rows: AgentRows) -> None:
        put = self.spool.add
        self.rows += len(rows)
        for name in NUMBERS:
            put(f"{prefix}/{name}", rows.numbers(name)[0])
        put(f"{prefix}/given", rows.numbers("terminated")[1])
        put(f"{prefix}/reward.valid", rows.numbers("reward")[1])
        order, acted = rows.numbers("order")
        put(f"{prefix}/order", np.where(acted, order, np.int16(-1)))
        for term in rows.terms:
            put(f"{prefix}/reward.{term}", rows.paid_by(term))
        self.unknown_terms += int(rows.has_unknown_terms.sum())
        self._values(f"{prefix}/obs", rows.observations)
        self._values(f"{prefix}/action", rows.actions)
        self._mask(f"{prefix}/mask", rows)
        for name in ("info", "raised", "nonconforming"):
            self._texts(f"{prefix}/{name}", rows.texts(name))
        if "digest" in rows.table.schema.names:
            put(f"{prefix}/digest", rows.digests)

    def _values(self, name: str, values: LeafValues) -> None:
        if not values.described:
            return
        self.spool.add(f"{name}.valid", values.valid)
        for path, leaf in values.leaves.items():
            key = f"{name}.{path}" if path else name
            if isinstance(leaf, list):
                self._texts(key, leaf)
            else:
                self.spool.add(key, leaf)

    def _mask(self, name: str, rows: AgentRows) -> None:
        """Adds masks, from the first one on; rows before it are filled with zeros then."""
        masks = rows.masks()
        first = next((mask for mask in masks if mask is not None), None)
        known, before = self._masks.get(name, (None, 0))
        if known is None and first is not None:
            known = first.dtype, first.shape
            self.spool.add(name, np.zeros((before, *first.shape), first.dtype))
            self.spool.add(f"{name}.valid", np.zeros(before, bool))
        self._masks[name] = known, before + len(rows)
        if known is None:
            return
        fits = [mask is not None and (mask.dtype, mask.shape) == known for mask in masks]
        self.strange_masks += sum(m is not None for m in masks) - sum(fits)
        blank = np.zeros(known[1], known[0])
        whole = [mask if ok else blank for mask, ok in zip(masks, fits, strict=True)]
        self.spool.add(name, np.stack(whole))
        self.spool.add(f"{name}.valid", np.array(fits, bool))

    def _texts(self, name: str, rows: list[str | None]) -> None:
        parts = [(text or "").encode("utf-8", "surrogatepass") for text in rows]
        ends = np.cumsum([0, *map(len, parts)], dtype=np.int64)[1:]
        before = self.spool.length(f"{name}.text")
        self.spool.add(f"{name}.text", np.frombuffer(b"".join(parts), np.uint8))
        self.spool.add(f"{name}.end", ends + before)


def _lost(evidence: Evidence, writer: _ArrayWriter) -> list[str]:
    found = []
    if evidence.manifest.get("level") == "digest":
        found.append("observations: the run was recorded at level 'digest'")
    if evidence.path is not None and any((Path(evidence.path) / "frames").glob("*")):
        found.append("frames (`--to rerun` has them)")
    if writer.strange_masks:
        found.append(f"{writer.strange_masks} masks of another form than their agent's first")
    if writer.unknown_terms:
        found.append(UNKNOWN_TERMS.format(writer.unknown_terms))
    return found
