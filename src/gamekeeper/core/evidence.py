"""Evidence: the traces of a run, its facts and its contract, under one fingerprint."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePath
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.core.canon import from_json
from gamekeeper.core.contract import Contract
from gamekeeper.core.digest import run_fingerprint
from gamekeeper.core.layout import Layout, spaces_json
from gamekeeper.core.space import Codec, UnknownSpace, space_from_json, space_to_json
from gamekeeper.core.summary import Summary, summarise
from gamekeeper.core.trace import Spaces, Trace

IDENTITY: Final = ("api", "kwargs", "name")  # what of an environment's identity the fingerprint covers


@dataclass(frozen=True)
class Evidence:
    """A recorded run. Tables are pyarrow's; the bundle's page says what their columns are.

    Attributes:
        manifest: environment, contract, spaces, seeds, status, fingerprints.
        episodes: one row for each episode.
        steps: one row for each agent's decision.
        states: `state()` by turn, or None.
        timings: wall time by turn, or None.
        facts: what probes saw that is no turn.
        path: the folder of the bundle; None for evidence in memory.
    """

    manifest: Mapping[str, Any]
    episodes: pa.Table
    steps: pa.Table
    states: pa.Table | None = None
    timings: pa.Table | None = None
    facts: tuple[Any, ...] = ()
    path: PurePath | None = None

    @property
    def fingerprint(self) -> str:
        """Covers environment, arguments, spaces, seeds, options, rows and states; 64 hexadecimal digits."""
        return str(self.manifest.get("fingerprint") or "")

    @cached_property
    def contract(self) -> Contract:
        """The contract that the run was recorded under; an empty one where none was."""
        return Contract.from_json(self.manifest.get("contract") or {})

    @cached_property
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
        state_codec = _codec(self.manifest.get("state_space"))
        for header in self.episodes.to_pylist():
            number = header["episode"]
            yield Trace(
                episode=number,
                header=header,
                steps=episode_rows(self.steps, number),
                states=None if self.states is None else episode_rows(self.states, number),
                spaces=self.spaces,
                state_codec=state_codec,
            )

    def trace(self, episode: int) -> Trace:
        """The trace of one episode.

        Raises:
            KeyError: there is no such episode.
        """
        for trace in self.traces:
            if trace.episode == episode:
                return trace
        raise KeyError(episode)

    @cached_property
    def summary(self) -> Summary:
        """Returns, lengths, endings, shares and idle parts, by agent."""
        return summarise(self)

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper record --json` prints."""
        run = None if self.path is None else str(self.path)
        return {"run": run, **self.summary.to_json(), "fingerprint": self.fingerprint}

    def __str__(self) -> str:
        where = "in memory" if self.path is None else str(self.path)
        return f"{self.episodes.num_rows} episodes of {self.manifest.get('environment', {}).get('name')} ({where})\n{self.summary}"

    def _repr_html_(self) -> str:
        return self.summary.to_html()


def episode_rows(table: pa.Table, episode: int) -> pa.Table:
    """The rows of one episode of a table that is sorted by episode."""
    numbers = table["episode"].to_numpy()
    first, last = np.searchsorted(numbers, [episode, episode + 1])
    return table.slice(int(first), int(last - first))


def manifest_of(
    *,
    environment: Mapping[str, Any],
    layout: Layout,
    contract: Contract | None,
    level: str,
    run_seed: int | None,
    episodes: pa.Table | None = None,
) -> dict[str, Any]:
    """The manifest of a run: all that isn't a row. With `episodes` given, it has the run's fingerprints."""
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
    if described is None:
        return None
    space = space_from_json(dict(described))
    return None if isinstance(space, UnknownSpace) else Codec(space)


def parsed(text: str | None) -> Any:
    """A canonical JSON text from a column, or None."""
    return None if text is None else from_json(text)
