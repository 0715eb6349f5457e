"""Evidence: the traces of a run, its facts and its contract, under one fingerprint."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import PurePath
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.core.contract import Contract
from gamekeeper.core.digest import run_fingerprint
from gamekeeper.core.layout import Layout, spaces_json
from gamekeeper.core.legible import legible
from gamekeeper.core.press import EPISODES
from gamekeeper.core.space import Codec, UnknownSpace, space_from_json, space_to_json
from gamekeeper.core.summary import Summary, summarise
from gamekeeper.core.tables import Tables, episode_rows
from gamekeeper.core.trace import Spaces, Trace

NO_STEPS: Final = pa.schema(  # of a run that ended before its first row: what every run has
    [
        ("episode", pa.int32()),
        ("turn", pa.int32()),
        ("agent", pa.string()),
        ("order", pa.int16()),
        ("mask", pa.binary()),
        ("received", pa.float64()),
        ("terminated", pa.bool_()),
        ("truncated", pa.bool_()),
        ("info", pa.string()),
        ("reward", pa.float64()),
        ("live", pa.bool_()),
        ("raised", pa.string()),
        ("odd", pa.string()),
    ]
)
HEADERS: Final = 1_024
"""Rows of `episodes` that are made into headers at a time."""
MOST_EPISODES: Final = 2**31 - 1  # the numbers that the column `episode` holds
IDENTITY: Final = (
    "api",
    "kwargs",
    "name",
)  # what of an environment's identity the fingerprint covers


@dataclass(frozen=True, repr=False)
class Evidence:
    """A recorded run. Tables are pyarrow's; the bundle's page says what their columns are.

    Attributes:
        manifest: environment, contract, spaces, seeds, status, fingerprints.
        tables: the streams; a trace reads only its own rows.
        facts: what probes saw that is no turn.
        path: the folder of the bundle; None for evidence in memory.
    """

    manifest: Mapping[str, Any]
    tables: Tables
    facts: tuple[Any, ...] = ()
    path: PurePath | None = None

    @cached_property
    def episodes(self) -> pa.Table:
        """One row for each episode."""
        table = self.tables.table("episodes")
        return EPISODES.empty_table() if table is None else table

    @cached_property
    def steps(self) -> pa.Table:
        """One row for each agent's decision, all of them in memory."""
        table = self.tables.table("steps")
        return table if table is not None and table.num_rows else NO_STEPS.empty_table()

    @property
    def states(self) -> pa.Table | None:
        """`state()` by turn, or None."""
        return self.tables.table("states")

    @property
    def timings(self) -> pa.Table | None:
        """The wall time of each crossing, or None."""
        return self.tables.table("timings")

    @property
    def fingerprint(self) -> str:
        """Covers environment, arguments, spaces, seeds, options, rows, states; 64 hex digits."""
        return str(self.manifest.get("fingerprint") or "")

    @cached_property
    @legible
    def contract(self) -> Contract:
        """The contract that the run was recorded under; an empty one where none was."""
        return Contract.from_json(self.manifest.get("contract") or {})

    @cached_property
    @legible
    def spaces(self) -> Mapping[str, Spaces]:
        """The codecs of each agent's spaces, rebuilt from their JSON."""
        named = self.manifest.get("spaces") or {}
        return {
            agent: Spaces(_codec(pair.get("observation")), _codec(pair.get("action")))
            for agent, pair in named.items()
        }

    @property
    def traces(self) -> Iterator[Trace]:
        """The episodes as traces, in their order."""
        for batch in self.episodes.to_batches(max_chunksize=HEADERS):
            for header in batch.to_pylist():
                yield self.trace_of(header)

    def trace(self, episode: int) -> Trace:
        """The trace of one episode.

        Raises:
            KeyError: there is no such episode.
        """
        rows = episode_rows(self.episodes, episode) if 0 <= episode < MOST_EPISODES else None
        if rows is None or not rows.num_rows:
            raise KeyError(episode)
        return self.trace_of(rows.slice(0, 1).to_pylist()[0])

    @legible
    def trace_of(self, header: Mapping[str, Any]) -> Trace:
        """The trace of the episode that has this row in `episodes`."""
        number = header["episode"]
        steps = self.tables.episode("steps", number)
        return Trace(
            episode=number,
            header=header,
            # of a run that was killed before its first turn only the key columns are there
            steps=steps if steps is not None and steps.num_rows else NO_STEPS.empty_table(),
            states=self.tables.episode("states", number),
            spaces=self.spaces,
            state_codec=_codec(self.manifest.get("state_space")),
        )

    @cached_property
    @legible
    def summary(self) -> Summary:
        """Returns, lengths, endings, shares and idle parts, by agent."""
        return summarise(self)

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper record --json` prints."""
        run = None if self.path is None else str(self.path)
        return {"run": run, **self.summary.to_json(), "fingerprint": self.fingerprint}

    def __str__(self) -> str:
        where = "in memory" if self.path is None else str(self.path)
        name = self.manifest.get("environment", {}).get("name")
        return f"{self.episodes.num_rows} episodes of {name} ({where})\n{self.summary}"

    def __repr__(self) -> str:
        where = "in memory" if self.path is None else f"in {str(self.path)!r}"
        name = self.manifest.get("environment", {}).get("name")
        return f"<Evidence of {name}, {self.episodes.num_rows} episodes, {where}>"

    def _repr_html_(self) -> str:
        return self.summary.to_html()


def manifest_of(
    *,
    environment: Mapping[str, Any],
    layout: Layout,
    contract: Contract | None,
    level: str,
    run_seed: int | None,
    episodes: pa.Table | None = None,
) -> dict[str, Any]:
    """The manifest of a run: all that isn't a row; with `episodes`, the run's fingerprints too."""
    spaces = spaces_json(layout)
    manifest: dict[str, Any] = {
        "level": level,
        "environment": dict(environment),
        "contract": None if contract is None else contract.to_json(),
        "agents": [seat.name for seat in layout.order],
        "spaces": spaces,
        "state_space": None if layout.state is None else space_to_json(layout.state.codec.space),
        "terms": list(layout.terms),
        "seed": run_seed,
        "fingerprint": None,
        "info_fingerprint": None,
    }
    if episodes is not None:
        manifest |= fingerprints(manifest, episodes)
    return manifest


def fingerprints(manifest: Mapping[str, Any], episodes: pa.Table) -> dict[str, str]:
    """The two fingerprints of a run, from its manifest and those of its episodes."""
    environment = {key: manifest["environment"].get(key) for key in IDENTITY}
    spaces = manifest["spaces"]
    done = episodes.filter(pc.is_valid(episodes["fingerprint"]))
    return {
        name: run_fingerprint(environment, spaces, done[name].to_pylist())
        for name in ("fingerprint", "info_fingerprint")
    }


def _codec(described: Mapping[str, Any] | None) -> Codec | None:
    return None if described is None else _codec_of(json.dumps(described))


@lru_cache(maxsize=64)
def _codec_of(text: str) -> Codec | None:
    """One codec for equal spaces: agents share theirs, and so do the many plays of an audit."""
    space = space_from_json(json.loads(text))
    return None if isinstance(space, UnknownSpace) else Codec(space)
