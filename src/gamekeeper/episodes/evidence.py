"""Evidence: the episodes of a run, its facts and its contract, under one fingerprint."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import PurePath
from shlex import quote
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.contract import Contract
from gamekeeper.episodes.chunks import EpisodeChunks, RowReader
from gamekeeper.episodes.digest import run_fingerprint, run_header
from gamekeeper.episodes.encoder import EPISODES
from gamekeeper.episodes.episode import Episode, Spaces
from gamekeeper.episodes.known_extent import WHOLE, Extent, extent, is_open
from gamekeeper.episodes.layout import Layout, spaces_json
from gamekeeper.episodes.plain_json import legible
from gamekeeper.episodes.spaces import Codec, space_from_json, space_to_json
from gamekeeper.episodes.summary import Summary, summarise
from gamekeeper.episodes.tables import Tables, episode_rows
from gamekeeper.episodes.views import Views
from gamekeeper.errors import DependencyError, EvidenceError

NO_STEPS: Final = pa.schema(  # of a run that ended before its first row: what every run has
    [
        ("episode", pa.int32()),
        ("turn", pa.int32()),
        ("agent", pa.string()),
        ("order", pa.int16()),
        ("action_mask", pa.binary()),
        ("cumulative_reward", pa.float64()),
        ("terminated", pa.bool_()),
        ("truncated", pa.bool_()),
        ("info", pa.string()),
        ("reward", pa.float64()),
        ("live", pa.bool_()),
        ("raised", pa.string()),
        ("nonconforming", pa.string()),
    ]
)
HEADERS: Final = 1_024
"""Rows of `episodes` that are made into headers at a time."""
MOST_EPISODES: Final = 2**31 - 1  # the numbers that the column `episode` holds
IDENTITY: Final = ("api", "kwargs", "name")
"""Fields of an environment's identity that the fingerprint covers."""


NOT_WHOLE: Final = {
    "open": "Not whole: it is still being recorded, or its recorder was killed.",
    "recovered": "Not whole: its recorder was killed; what came after the last whole turn is lost.",
    "failed": "Not whole: its recording ended with an error.",
}
"""By status of a run."""


@dataclass(frozen=True, repr=False)
class Evidence:
    """A recorded run. Tables are pyarrow's; the run's page says what their columns are.

    Attributes:
        manifest: environment, contract, spaces, seeds, status, fingerprints.
        tables: the streams; an episode reads only its own rows.
        facts: observations of probes that aren't turns.
        path: the folder of the run; None for evidence in memory.
        root: root digest of the run, as it was when this was read; None in memory, or while open.
        small: the folder of the run that this is the expansion of, where that is another one.
    """

    manifest: Mapping[str, Any]
    tables: Tables
    facts: tuple[Any, ...] = ()
    path: PurePath | None = None
    root: str | None = None
    small: PurePath | None = None

    @property
    def name(self) -> str:
        """The folder of the run that was asked for, as text; "memory" where there is none."""
        return str(self.small or self.path or "memory")

    @cached_property
    def episode_table(self) -> pa.Table:
        """One row for each episode."""
        return self.tables.table("episodes") or EPISODES.empty_table()

    @cached_property
    def agent_steps(self) -> pa.Table:
        """One row for each agent's decision, all of them in memory."""
        table = self.tables.table("agent_steps")
        return table if table is not None and table.num_rows else NO_STEPS.empty_table()

    @property
    def states(self) -> pa.Table | None:
        """`state()` by turn, or None."""
        return self.tables.table("states")

    @property
    def timings(self) -> pa.Table | None:
        """The wall time of each step, or None."""
        return self.tables.table("timings")

    def to_pandas(self, table: str = "agent_steps") -> Any:
        """A table as a pandas DataFrame: `agent_steps`, `episodes`, `states` or `timings`.

        Raises:
            EvidenceError: the run has no such table.
            DependencyError: pandas isn't installed.
        """
        found = {"episodes": self.episode_table, "agent_steps": self.agent_steps}.get(table)
        if found is None and table in ("states", "timings"):
            found = self.tables.table(table)
        if found is None:
            raise EvidenceError(
                "the run has no such table",
                where=table,
                expected="agent_steps or episodes; states and timings where they were recorded",
                actual=repr(table),
                fix="name a table that the run has",
            )
        try:
            return found.to_pandas()
        except ImportError as error:
            raise DependencyError(
                "a pandas DataFrame is asked for, and pandas isn't installed",
                fix="pip install pandas, or use the pyarrow tables",
            ) from error

    @property
    def fingerprint(self) -> str:
        """Level and 64 digits; covers environment, arguments, spaces, resets, rows and states."""
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
        return spaces_of(self.manifest.get("spaces") or {})

    @cached_property
    @legible
    def state_codec(self) -> Codec | None:
        """The codec of `state()`, where it was recorded."""
        return _codec(self.manifest.get("state_space"))

    @property
    def episodes(self) -> Sequence[Episode]:
        """Views of the episodes, in their order, each read when it is asked for."""
        table = self.episode_table
        return Views(
            table.num_rows,
            lambda place: self.episode_of(table.slice(place, 1).to_pylist()[0]),
            lambda: map(self.episode_of, self.headers),
        )

    @property
    def headers(self) -> Iterator[Mapping[str, Any]]:
        """The rows of `episodes`, in their order."""
        for batch in self.episode_table.to_batches(max_chunksize=HEADERS):
            yield from batch.to_pylist()

    def episode(self, number: int) -> Episode:
        """View of one episode by its number.

        Raises:
            EvidenceError: there is no such episode.
        """
        return self.episode_of(self.header(number))

    def header(self, episode: int) -> Mapping[str, Any]:
        """The row of one episode in `episodes`.

        Raises:
            EvidenceError: there is no such episode.
        """
        rows = episode_rows(self.episode_table, episode) if 0 <= episode < MOST_EPISODES else None
        if rows is None or not rows.num_rows:
            raise EvidenceError(
                f"the run has no episode {episode}",
                where=self.name,
                expected=f"one of its {self.episode_table.num_rows} episodes",
                actual=str(episode),
                fix="`gamekeeper show RUN` tells the number of episodes",
            )
        return dict(rows.slice(0, 1).to_pylist()[0])

    @legible
    def episode_of(self, header: Mapping[str, Any]) -> Episode:
        """The episode that has this row in `episodes`."""
        number = header["episode"]
        steps = self.tables.episode("agent_steps", number)
        return Episode(
            episode=number,
            header=header,
            # of a run that was killed before its first turn only the key columns are there
            steps=steps if steps is not None and steps.num_rows else NO_STEPS.empty_table(),
            states=self.tables.episode("states", number),
            spaces=self.spaces,
            state_codec=self.state_codec,
        )

    @legible
    def chunks(self, header: Mapping[str, Any]) -> EpisodeChunks:
        """The episode that has this row in `episodes`, to be read some turns at a time."""
        number = header["episode"]
        if header.get("turns") is None:
            header = {**header, "turns": self.reach(number)[0]}
        steps = self.tables.parts("agent_steps", number)
        states = self.tables.parts("states", number)
        return EpisodeChunks(
            episode=number,
            header=header,
            spaces=self.spaces,
            state_codec=self.state_codec,
            steps=RowReader(steps or ()),
            states=None if states is None else RowReader(states),
            empty=NO_STEPS,
        )

    @legible
    def extent(self, header: Mapping[str, Any]) -> Extent:
        """Known extent of the episode that has this row in `episodes`."""
        if not is_open(header):
            return WHOLE
        number, state = header["episode"], None
        acted, last = self.reach(number)
        for part in self.tables.parts("states", number, columns=("turn",)) or ():
            state = part["turn"][-1].as_py() if part.num_rows else -1 if state is None else state
        turns = header.get("turns")
        return extent(header, turns=acted if turns is None else turns, last=last, state=state)

    def turns_of(self, header: Mapping[str, Any]) -> int:
        """Env steps of an episode; of one that has no end yet, as far as its rows tell."""
        turns = header["turns"]
        return self.reach(header["episode"])[0] if turns is None else int(turns)

    def reach(self, episode: int) -> tuple[int, int]:
        """Turns up to the last in which an agent acted, and the last turn that has a row."""
        acted, last = 0, -1
        for part in self.tables.parts("agent_steps", episode, columns=("turn", "order")) or ():
            turns = part["turn"].filter(pc.is_valid(part["order"]))
            acted = max(acted, int(pc.max(turns).as_py()) + 1) if len(turns) else acted
            last = max(last, int(pc.max(part["turn"]).as_py())) if part.num_rows else last
        return acted, last

    @cached_property
    @legible
    def summary(self) -> Summary:
        """Returns, lengths, endings, shares and idle parts, by agent."""
        turns = map(self.turns_of, self.episode_table.select(["episode", "turns"]).to_pylist())
        agents = self.manifest.get("agents", [])
        return summarise(self.tables, self.episode_table, self.contract, agents, turns=sum(turns))

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper rollout --json` prints."""
        return {
            "run": None if self.path is None else str(self.path),
            **self.summary.to_json(),
            "fingerprint": self.fingerprint,
            "root": self.root,
        }

    @property
    def not_whole(self) -> str:
        """Sentence that says why the run is incomplete; empty where it is complete."""
        stopped = self.manifest.get("stopped")
        why = f"Not whole: {stopped}." if isinstance(stopped, str) else ""
        return NOT_WHOLE.get(str(self.manifest.get("status")), why)

    @property
    def retained_text(self) -> str:
        """Sentence about the episodes that a flight recorder dropped; empty for another run."""
        keep = self.manifest.get("keep")
        if not isinstance(keep, dict):
            return ""
        return (
            f"It retains {keep.get('retained')} of the {keep.get('seen')} episodes that were "
            f"recorded ({keep.get('rule')}); manifest.json has the sums of the others under keep."
        )

    @property
    def kept_text(self) -> str:
        """Level `actions` and the lines that show the rest; empty for another level."""
        if self.manifest.get("level") != "actions":
            return ""
        checked = self.manifest.get("checked") or {}
        outcome, why = checked.get("outcome", "not checked"), checked.get("why")
        result = f"replay of episode {checked.get('episode')} {outcome}"
        if outcome == "not checked":
            result = f"{outcome}: {why}"
        run = quote(str(self.path or "RUN"))
        return (
            f"actions ({result}); observations, infos and states are on the page of "
            f"gamekeeper report {run} --expand, and in the run of gamekeeper expand {run} OUT"
        )

    def __str__(self) -> str:
        where = "in memory" if self.path is None else str(self.path)
        name = self.manifest.get("environment", {}).get("name")
        alert = f"{self.not_whole}\n" if self.not_whole else ""
        alert += f"Level {self.kept_text}\n" if self.kept_text else ""
        alert += f"{self.retained_text}\n" if self.retained_text else ""
        count = self.episode_table.num_rows
        episodes = f"{count} episode{'s' * (count != 1)}"
        return f"{episodes} of {name} ({where})\n{alert}{self.summary}"

    def __repr__(self) -> str:
        where = "in memory" if self.path is None else f"in {str(self.path)!r}"
        name = self.manifest.get("environment", {}).get("name")
        return f"<Evidence of {name}, {self.episode_table.num_rows} episodes, {where}>"

    def _repr_html_(self) -> str:
        alert = f"<p>{self.not_whole}</p>" if self.not_whole else ""
        return f"{alert}{self.summary.to_html()}"


def manifest_of(
    *,
    environment: Mapping[str, Any],
    layout: Layout,
    contract: Contract | None,
    level: str,
    run_seed: int | None,
    episodes: pa.Table | None = None,
    extra: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The manifest of a run: all that isn't a row; with `episodes`, the run's fingerprints too.

    Args:
        extra: entries of a run that was made in another way than by recording.
    """
    manifest: dict[str, Any] = {
        "level": level,
        "environment": dict(environment),
        "contract": None if contract is None else contract.to_json(),
        "agents": [each.name for each in layout.order],
        "spaces": spaces_json(layout),
        "state_space": None if layout.state is None else space_to_json(layout.state.codec.space),
        "terms": list(layout.terms),
        "seed": run_seed,
        "fingerprint": None,
        "info_fingerprint": None,
        **(extra or {}),
    }
    if episodes is not None:
        manifest |= fingerprints(manifest, episodes)
    return manifest


def fingerprints(manifest: Mapping[str, Any], episodes: pa.Table) -> dict[str, str]:
    """The two fingerprints of a run, from its manifest and those of its episodes.

    Raises:
        EvidenceError: the manifest has no environment or no spaces.
    """
    for key in ("environment", "spaces"):
        if not isinstance(manifest.get(key), Mapping):
            raise EvidenceError(
                f"the manifest has no {key}",
                where=key,
                expected="a JSON object",
                actual=repr(manifest.get(key))[:80],
                fix="restore the run from a copy",
            )
    environment = {key: manifest["environment"].get(key) for key in IDENTITY}
    done = episodes.filter(pc.is_valid(episodes["fingerprint"]))
    level, header = manifest.get("level"), run_header(environment, manifest["spaces"])
    return {
        name: f"{level}:{run_fingerprint(header, done[name].to_pylist())}"
        for name in ("fingerprint", "info_fingerprint")
    }


def spaces_of(described: Mapping[str, Any]) -> Mapping[str, Spaces]:
    """The codecs of each agent's spaces, from their JSON."""
    return {
        agent: Spaces(_codec(pair.get("observation")), _codec(pair.get("action")))
        for agent, pair in described.items()
    }


def _codec(described: Mapping[str, Any] | None) -> Codec | None:
    return None if described is None else _codec_of(json.dumps(described))


@lru_cache(maxsize=64)
def _codec_of(text: str) -> Codec:
    """One codec for equal spaces: agents share theirs, and so do the many episodes of an audit."""
    return Codec(space_from_json(json.loads(text)))
