"""Ledger of a flight recorder: figures of episodes, those that stay, sums of those that don't."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from math import inf
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.contract import Contract
from gamekeeper.contract.failure import Failure
from gamekeeper.episodes.arrow import TERM
from gamekeeper.episodes.buffer import GIVEN, TURN, BufferedTurns
from gamekeeper.episodes.encoder import by_episode
from gamekeeper.episodes.layout import Layout
from gamekeeper.episodes.outcome import Outcome, check_measured, failed, failures, plain_numbers
from gamekeeper.errors import ContractError
from gamekeeper.runs.ring.keep_rule import KeepRule

KEYS: Final = ("episode", "agent")
ENDED: Final = ("episode", "turns", "end", "error", "endings")
MEASURED: Final = ("return", "length", "is_over", "ending")
"""Figures that every run has; others stand in infos, or are reward terms."""


@dataclass(slots=True)
class RingEpisode:
    """Figures of one episode."""

    number: int
    size_bytes: float = 0.0
    returns: dict[str, float] = field(default_factory=dict)
    terms: dict[str, dict[str, float]] = field(default_factory=dict)
    flags: dict[str, str] = field(default_factory=dict)
    infos: dict[str, dict[str, float]] = field(default_factory=dict)
    seen: dict[str, int] = field(default_factory=dict)
    endings: Mapping[str, str] = field(default_factory=dict)
    turns: int = 0
    end: str = ""
    error: str | None = None
    is_failed: bool = False

    @property
    def team_return(self) -> float:
        """The sum of all agents' returns."""
        return sum(self.returns.values())

    def ending(self, agent: str) -> str:
        """The reason why the agent ended, else `terminated`, `truncated` or `cut`."""
        return str(self.endings.get(agent) or self.flags.get(agent, "cut"))

    def outcome(self) -> Outcome:
        """Outcome, by which conditions are judged."""
        return Outcome(
            turns=self.turns,
            returns=self.returns,
            terms=self.terms,
            endings={agent: self.ending(agent) for agent in self.returns},
            infos=self.infos,
            seen=self.seen,
            flags={agent: self.flags.get(agent, "cut") for agent in self.returns},
            is_over=self.end == "ended",
            error=self.error,
        )


@dataclass(slots=True)
class Sums:
    """Count, sum, sum of squares, least and greatest of numbers that aren't kept one by one."""

    count: int = 0
    total: float = 0.0
    squares: float = 0.0
    least: float = inf
    greatest: float = -inf

    def add(self, value: float) -> None:
        """Counts a number."""
        self.count += 1
        self.total += value
        self.squares += value * value
        self.least, self.greatest = min(self.least, value), max(self.greatest, value)

    def to_json(self) -> dict[str, Any]:
        """The sums as they stand in a manifest; a figure that JSON can't hold is null."""
        named = {
            "sum": self.total,
            "sum_of_squares": self.squares,
            "min": self.least,
            "max": self.greatest,
        }
        finite = {key: each if abs(each) < inf else None for key, each in named.items()}
        return {"count": self.count, **finite}


@dataclass(slots=True)
class DroppedSums:
    """Sums over the episodes that were dropped."""

    lengths: Sums = field(default_factory=Sums)
    ends: dict[str, int] = field(default_factory=dict)
    failed: int = 0
    returns: dict[str, Sums] = field(default_factory=dict)
    endings: dict[str, dict[str, int]] = field(default_factory=dict)

    def add(self, episode: RingEpisode) -> None:
        """Counts an episode."""
        self.lengths.add(episode.turns)
        self.ends[episode.end] = self.ends.get(episode.end, 0) + 1
        self.failed += episode.is_failed
        for agent, value in episode.returns.items():
            self.returns.setdefault(agent, Sums()).add(value)
            mine, ending = self.endings.setdefault(agent, {}), episode.ending(agent)
            mine[ending] = mine.get(ending, 0) + 1

    def to_json(self) -> dict[str, Any]:
        """The sums as they stand in a manifest."""
        return {
            "episodes": self.lengths.count,
            "failed": self.failed,
            "lengths": self.lengths.to_json(),
            "ends": dict(self.ends),
            "agents": {
                agent: {"returns": sums.to_json(), "endings": dict(self.endings[agent])}
                for agent, sums in self.returns.items()
            },
        }


class _Groups:
    """Rows of a batch by episode and agent.

    NumPy takes a tenth of the processor time that Arrow's grouping does, which starts threads.
    """

    def __init__(self, batch: pa.RecordBatch) -> None:
        agents = batch["agent"].dictionary_encode()
        self._names = agents.dictionary.to_pylist()
        episodes, place = np.unique(batch["episode"].to_numpy(), return_inverse=True)
        self._episodes = episodes.tolist()
        self._keys = place * len(self._names) + agents.indices.to_numpy()
        self._present = np.unique(self._keys).tolist()

    def sums(
        self, column: pa.Array, *, only_valid: bool = False
    ) -> Iterator[tuple[tuple[int, str], float]]:
        """Sums of a column, null counting as 0.

        Args:
            only_valid: leave out groups in which every row is null.
        """
        values = column.fill_null(0.0).to_numpy(zero_copy_only=False)
        size = len(self._episodes) * len(self._names)
        found = np.bincount(self._keys, values, size)
        counts = None
        if only_valid:
            is_valid = column.is_valid().to_numpy(zero_copy_only=False)
            counts = np.bincount(self._keys, is_valid, size)
        for key in self._present:
            if counts is None or counts[key]:
                episode, agent = divmod(key, len(self._names))
                yield (self._episodes[episode], self._names[agent]), float(found[key])


class RingLedger:
    """Figures of the episodes that are in the run, and of those that were.

    Args:
        rule: says which episodes stay.
        conditions: say when an episode failed; without any, where the environment raised.
        contract: names roles and terms.
        must_measure: the first episode that ends has every figure that a condition names.
    """

    def __init__(
        self,
        rule: KeepRule,
        conditions: Mapping[str, Failure],
        contract: Contract,
        *,
        must_measure: bool,
    ) -> None:
        self.rule, self._conditions, self._contract = rule, conditions, contract
        self._open: dict[int, RingEpisode] = {}
        self._ended: dict[int, RingEpisode] = {}
        self._dropped = DroppedSums()
        self._marks: dict[str, RingEpisode] = {}
        self._is_checked = not must_measure
        self._unjudged = 0
        names = {name for each in conditions.values() for name in each.names}
        self._asks_infos = any(name.rpartition(".")[2] not in MEASURED for name in names)

    # -- what is written

    def add(self, stream: str, batch: pa.RecordBatch) -> None:
        """Counts a batch that is being written.

        Raises:
            ContractError: the first episode that ended doesn't measure what a condition names.
        """
        share = batch.nbytes / batch.num_rows
        for number, rows in by_episode(batch["episode"].to_numpy()):
            self._episode(number).size_bytes += share * (rows.stop - rows.start)
        if stream == "agent_steps":
            self._add_rows(batch)
        elif stream == "episodes":
            for row in batch.select(ENDED).filter(pc.is_valid(batch["end"])).to_pylist():
                self._end(row)

    def add_infos(self, buffered: BufferedTurns, layout: Layout) -> None:
        """Takes the numbers of infos that a small run doesn't keep, where a condition asks."""
        if not self._asks_infos:
            return
        texts: list[Any] = buffered.given[6::GIVEN]
        if texts.count(None) == len(texts):
            return
        turns: list[Any] = buffered.turns
        ends = list(accumulate(max(count, 0) for count in turns[2::TURN]))
        agents: list[Any] = buffered.given[::GIVEN]
        place = 0
        for row, text in enumerate(texts):
            if text is None:
                continue
            while ends[place] <= row:
                place += 1
            episode, turn = turns[place * TURN : place * TURN + 2]
            agent = layout.order[agents[row]].name
            self._add_info(self._episode(episode), agent, turn, text)

    def _episode(self, number: int) -> RingEpisode:
        """The episode, which begins now if it isn't there."""
        found = self._open.get(number) or self._ended.get(number)
        if found is None:
            found = self._open[number] = RingEpisode(number)
        return found

    def _add_rows(self, batch: pa.RecordBatch) -> None:
        columns = [name for name in batch.schema.names if name.startswith(TERM)]
        groups = _Groups(batch)
        for (number, agent), paid in groups.sums(batch["reward"]):
            episode = self._episode(number)
            episode.returns[agent] = episode.returns.get(agent, 0.0) + paid
        for name in columns:
            for (number, agent), paid in groups.sums(batch[name], only_valid=True):
                mine = self._episode(number).terms.setdefault(agent, {})
                mine[name[len(TERM) :]] = mine.get(name[len(TERM) :], 0.0) + paid
        for flag in ("truncated", "terminated"):  # an agent with both flags has terminated
            is_set = pc.fill_null(batch[flag], False)
            for row in batch.select(KEYS).filter(is_set).to_pylist():
                self._episode(row["episode"]).flags[row["agent"]] = flag
        if self._asks_infos:
            known = batch.select([*KEYS, "turn", "info"]).filter(pc.is_valid(batch["info"]))
            for row in known.to_pylist():
                self._add_info(
                    self._episode(row["episode"]), row["agent"], row["turn"], row["info"]
                )

    @staticmethod
    def _add_info(episode: RingEpisode, agent: str, turn: int, text: str) -> None:
        numbers = plain_numbers(json.loads(text))
        if numbers:
            episode.infos[agent], episode.seen[agent] = numbers, turn

    def _end(self, row: Mapping[str, Any]) -> None:
        """Judges an episode that is over."""
        episode = self._open.pop(row["episode"], None) or RingEpisode(row["episode"])
        self._ended[episode.number] = episode
        episode.turns, episode.end, episode.error = row["turns"], row["end"], row["error"]
        episode.endings = json.loads(row["endings"] or "{}")
        outcome = episode.outcome()
        if not self._is_checked and outcome.is_over:
            self._is_checked = True
            check_measured(outcome, self._conditions, self._contract)
        episode.is_failed = episode.error is not None
        if outcome.is_over and self._conditions:
            try:
                verdicts = failed(outcome, self._conditions, self._contract)
            except ContractError:  # a figure that this episode doesn't have
                self._unjudged += 1
            else:
                episode.is_failed = any(verdicts.values())
        episode.infos, episode.seen, episode.terms = {}, {}, {}
        self._mark(episode)

    def _mark(self, episode: RingEpisode) -> None:
        marks = self._marks
        if "longest" not in marks or episode.turns > marks["longest"].turns:
            marks["longest"] = episode
        if episode.end != "ended":  # a part of an episode is no best one
            return
        if "best" not in marks or episode.team_return > marks["best"].team_return:
            marks["best"] = episode
        if "worst" not in marks or episode.team_return < marks["worst"].team_return:
            marks["worst"] = episode

    # -- what stays

    def drop(self) -> list[int]:
        """Numbers of the episodes that don't stay, sorted; from now on they are sums alone."""
        marked = [episode.number for episode in self._marks.values()]
        stay = self.rule.retained(self._ended.values(), marked)
        dropped = sorted(self._ended.keys() - stay)
        for number in dropped:
            self._dropped.add(self._ended.pop(number))
        return dropped

    def resize(self, size_bytes: float) -> None:
        """Takes note of the bytes that the episodes which are over have come to."""
        total = sum(episode.size_bytes for episode in self._ended.values())
        scale = min(size_bytes / total, 1.0) if total else 1.0
        for episode in self._ended.values():
            episode.size_bytes *= scale

    def to_json(self) -> dict[str, Any]:
        """The entry `keep` of a manifest."""
        ended = self._ended.values()
        count, open_ = len(ended), len(self._open)
        return {
            "rule": self.rule.text,
            "most_bytes": self.rule.most_bytes,
            "conditions": {scope: each.text for scope, each in self._conditions.items()},
            "seen": self._dropped.lengths.count + count + open_,
            "retained": count + open_,
            "not_judged": self._unjudged,
            "failed": [episode.number for episode in ended if episode.is_failed],
            "marked": {name: episode.number for name, episode in self._marks.items()},
            "dropped": self._dropped.to_json(),
        }


def ring_ledger(rule: KeepRule, contract: Contract | None, condition: str | None) -> RingLedger:
    """Ledger of a run that is about to be recorded.

    Args:
        condition: holds for the team where an episode failed, in place of what the contract says.
    Raises:
        ContractError: failed episodes are asked for, and nothing says when an episode failed; or
            the condition can't be read.
    """
    declared = contract or Contract()
    conditions: Mapping[str, Failure] = {}
    if condition is not None or rule.has_failed or declared.failure:
        conditions = failures(declared, condition)
    must_measure = rule.has_failed or condition is not None
    return RingLedger(rule, conditions, declared, must_measure=must_measure)


def with_recovered(keep: Any, episodes: int) -> Any:
    """The entry `keep` of a run that was killed, its counts by the episodes that are there.

    What it says of failed and marked ones stands as of the last time that rows were dropped.
    """
    dropped = keep.get("dropped") if isinstance(keep, dict) else None
    count = dropped.get("episodes") if isinstance(dropped, dict) else None
    if type(count) is not int:
        return keep
    return {**keep, "retained": episodes, "seen": count + episodes}
