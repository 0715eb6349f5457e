"""NumPy: a whole run as one .npz file, every agent's rows as plain arrays.

    arrays = np.load("run.npz")            # allow_pickle stays False
    arrays["picker_0/obs"], arrays["picker_0/action"], json.loads(str(arrays["metadata"]))

| array | what it is |
|---|---|
| `metadata` | JSON text: layout, environment, contract, spaces, seed, fingerprints, `agents` (name to prefix), `lost` |
| `AGENT/episode`, `AGENT/turn` | int32; the key of each of the agent's rows |
| `AGENT/order` | int16; its place among those who acted, -1: it did not act |
| `AGENT/live`, `AGENT/given` | bool; in the roster; the row holds what `last()` returns |
| `AGENT/obs`, `AGENT/obs.PATH` | one array for each leaf of its space, with `AGENT/obs.valid` |
| `AGENT/mask` | the mask of the info, with `AGENT/mask.valid`; only where it ever had one |
| `AGENT/received`, `AGENT/terminated`, `AGENT/truncated` | what `last()` returned |
| `AGENT/action`, `AGENT/action.PATH` | with `AGENT/action.valid` |
| `AGENT/reward`, `AGENT/reward.TERM` | float64; what this crossing paid it |
| `AGENT/info`, `AGENT/raised`, `AGENT/odd` | texts |
| `AGENT/digest` | uint8 [rows, 16]; only at level "digest", in place of the observations |
| `state/episode`, `state/turn` | the turns that have a `state()`: `state/value` or `state/value.PATH`, `state/value.valid`, `state/odd` |
| `episodes/episode`, `seed`, `turns`, `end`, ... | one row for each episode, in this order |

A row without a value holds zeros and False in `.valid`. A text `X` stands as two arrays: `X.text`, UTF-8, and `X.end` [rows], where each
row's text ends in it; `texts(arrays, "X")` reads them, and an empty one is none.

| | |
|---|---|
| kept | every row, value, dtype and shape; orders, masks, reward terms, ends, seeds, options, policies, infos (JSON), states, fingerprints |
| changed | null is zeros with `.valid` (numbers: 0, -1 for an order); "/" in an agent's name is "%2F"; values of a Sequence, Graph or OneOf stand as canonical JSON |
| lost | frames; timings; observations at level "digest" (their digests are kept); masks of another length than the agent's first |
| refused | nothing; a value that isn't of its space stands in `odd`, as it was |
"""  # noqa: E501  # a row of a table is one line

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from os import PathLike
from typing import Any, Final
from urllib.parse import quote

import numpy as np
import pyarrow as pa

from gamekeeper.adapters.agent_rows import AgentRows, Values, rows_of
from gamekeeper.adapters.export import (
    Export,
    Run,
    Say,
    chosen,
    evidence_of,
    free_path,
    tell,
    to_stderr,
)
from gamekeeper.adapters.spool import Spool, spooled
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.press import EPISODES
from gamekeeper.core.space import Codec
from gamekeeper.core.trace import Spaces

LAYOUT: Final = 1
OWN: Final = ("metadata", "episodes", "state")  # prefixes that no agent may have
NUMBERS: Final = ("episode", "turn", "live", "received", "terminated", "truncated", "reward")
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
        BundleError: there is no bundle, something lies at `out`, or the disk refuses.
        EvidenceError: nobody is called so, or the run has no episode.
    """
    evidence = evidence_of(run)
    names = chosen(evidence, agents)
    path = free_path(out, suffix=".npz")
    with spooled(path, compress=compress) as spool:
        writer = _Writer(spool, {name: prefix_of(name) for name in names})
        for headers in evidence.episodes.to_batches(max_chunksize=BATCH):
            writer.add_headers(headers)
        for steps in evidence.tables.all_parts("steps") or ():
            writer.add_steps(steps, evidence.spaces)
        for states in evidence.tables.all_parts("states") or ():
            writer.add_states(states, evidence.state_codec)
        lost = tell(_lost(evidence, writer.strange_masks), say)
        text = json.dumps(_metadata(evidence, writer.prefixes, lost), sort_keys=True)
        spool.add_text("metadata", text)
    return Export(
        to="numpy", path=str(path), agents=tuple(names), episodes=evidence.episodes.num_rows,
        rows=writer.rows, lost=lost,
    )  # fmt: skip


def texts(arrays: Mapping[str, Any], name: str) -> list[str | None]:
    """The texts of an array of texts; None for a row that has none.

    Args:
        arrays: what `numpy.load` gave.
        name: as "picker_0/info".
    Raises:
        KeyError: there is no such array.
    """
    data, ends = bytes(arrays[f"{name}.text"].tobytes()), arrays[f"{name}.end"].tolist()
    starts = [0, *ends[:-1]]
    return [data[a:b].decode() if a < b else None for a, b in zip(starts, ends, strict=True)]


def prefix_of(agent: str) -> str:
    """How an agent is called in the names of arrays."""
    name = quote(agent, safe=PLAIN)
    if agent in OWN or not name.strip("."):
        name = f"%{ord(agent[0]):02X}{name[1:]}" if agent else "%"
    return name


class _Writer:
    """Puts episode after episode into the arrays."""

    def __init__(self, spool: Spool, prefixes: Mapping[str, str]) -> None:
        self.spool, self.prefixes = spool, dict(prefixes)
        self.rows = 0
        self.strange_masks = 0
        self._masks: dict[str, tuple[Any, int]] = {}  # dtype and shape, and rows so far

    def add_headers(self, headers: pa.RecordBatch) -> None:
        """What some episodes are."""
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
        """The next rows, of whatever episodes."""
        for rows in rows_of(steps, spaces, self.prefixes) if steps.num_rows else ():
            self._agent(self.prefixes[rows.agent], rows)

    def add_states(self, states: pa.Table, codec: Codec | None) -> None:
        """The next states."""
        if not states.num_rows:
            return
        rows = AgentRows("state", -1, states, Spaces(codec, None))
        self.spool.add("state/episode", rows.numbers("episode")[0])
        self.spool.add("state/turn", rows.turns)
        self._values("state/value", rows.values_of("state", codec))
        self._texts("state/odd", rows.texts("odd"))

    def _agent(self, prefix: str, rows: AgentRows) -> None:
        put = self.spool.add
        self.rows += len(rows)
        for name in NUMBERS:
            put(f"{prefix}/{name}", rows.numbers(name)[0])
        put(f"{prefix}/given", rows.numbers("terminated")[1])
        order, acted = rows.numbers("order")
        put(f"{prefix}/order", np.where(acted, order, np.int16(-1)))
        for term in rows.terms:
            put(f"{prefix}/reward.{term}", rows.numbers(f"reward.{term}")[0])
        self._values(f"{prefix}/obs", rows.observations)
        self._values(f"{prefix}/action", rows.actions)
        self._mask(f"{prefix}/mask", rows)
        for name in ("info", "raised", "odd"):
            self._texts(f"{prefix}/{name}", rows.texts(name))
        if "digest" in rows.table.schema.names:
            put(f"{prefix}/digest", rows.digests)

    def _values(self, name: str, values: Values) -> None:
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
        """Masks begin where the first one stands; rows before it are filled up then."""
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


def _metadata(evidence: Evidence, prefixes: Mapping[str, str], lost: tuple[str, ...]) -> Any:
    kept = (
        "environment", "contract", "spaces", "state_space", "terms", "seed", "level", "status",
        "fingerprint", "info_fingerprint",
    )  # fmt: skip
    return {
        "layout": LAYOUT, "agents": dict(prefixes), "lost": list(lost),
        **{name: evidence.manifest.get(name) for name in kept},
    }  # fmt: skip


def _lost(evidence: Evidence, strange_masks: int) -> list[str]:
    found = []
    if evidence.manifest.get("level") == "digest":
        found.append("observations: the run was recorded at level 'digest'")
    if evidence.path is not None and any((_folder(evidence) / "frames").glob("*")):
        found.append("frames (`--to rerun` has them)")
    if strange_masks:
        found.append(f"{strange_masks} masks of another form than their agent's first")
    return found


def _folder(evidence: Evidence) -> Any:
    from pathlib import Path

    return Path(str(evidence.path))
