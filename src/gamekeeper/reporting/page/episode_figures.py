"""Figures of every episode and agent of a run, summed by columns."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.contract.failure import MEASURED, Failure
from gamekeeper.episodes.arrow import TERM
from gamekeeper.episodes.canonical import from_json
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.outcome import TEAM, Outcome, failed, failures, outcome_of, plain_numbers
from gamekeeper.episodes.plain_json import legible
from gamekeeper.errors import ContractError, EvidenceError
from gamekeeper.reporting.page.packed_values import fields_of_text
from gamekeeper.reporting.page.page_data import Cell, PageBlock, PageTable, bounds, name, number
from gamekeeper.reporting.text_columns import APART
from gamekeeper.statistics.interval import FloatArray
from gamekeeper.statistics.paired import FEWEST, paired_effect

BoolArray = NDArray[np.bool_]

SPARK: Final = 24
"""Parts of an episode in its sparkline."""
ACTIONS: Final = 8
"""Bars of an episode's histogram of actions; the last one counts all higher numbers too."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of each episode, agent by agent.

    Attributes:
        headers: the rows of `episodes`.
        agents: in the order of `possible_agents`; only those with a row.
        present: [episodes, agents] True if the agent has a row in the episode.
        returns: [episodes, agents] sum of its rewards.
        lengths: [episodes, agents] number of its actions, without None steps of ended agents.
        terms: by reward term of the environment, [episodes, agents].
        terminated: [episodes, agents] True if it was terminated.
        truncated: [episodes, agents] True if it was truncated.
        cumulative: [episodes, SPARK] sum of all agents' rewards up to the end of each part of it.
        actions: [episodes, ACTIONS] number of all agents' actions 0, 1, 2, ...; zeros of actions
            that aren't whole numbers.
    """

    headers: tuple[Mapping[str, Any], ...]
    agents: tuple[str, ...]
    present: BoolArray
    returns: FloatArray
    lengths: FloatArray
    terms: Mapping[str, FloatArray]
    terminated: BoolArray
    truncated: BoolArray
    cumulative: FloatArray
    actions: FloatArray = field(default_factory=lambda: np.zeros((0, ACTIONS)))
    _places: Mapping[int, int] = field(default_factory=dict)

    @property
    def team(self) -> FloatArray:
        """[episodes] the sum of all agents' returns."""
        return np.asarray(np.where(self.present, self.returns, 0.0).sum(axis=1), np.float64)

    def place(self, episode: int) -> int:
        """The row of an episode."""
        return self._places[episode]


@legible
def figures_of(evidence: Evidence) -> Figures:
    """The figures of a whole run, from one reading of its rows."""
    headers = tuple(evidence.episode_table.to_pylist())
    sums = _Sums([header["episode"] for header in headers])
    turns = np.array([header.get("turns") or 0 for header in headers], np.int64)
    cumulative, actions = np.zeros((len(headers), SPARK)), np.zeros((len(headers), ACTIONS))
    unread = tuple(kind for kind in APART if kind != "action")
    for steps in evidence.tables.all_parts("agent_steps", without=unread) or ():
        if steps.num_rows:
            row = sums.add(steps)
            part = np.minimum(
                steps["turn"].to_numpy() * SPARK // np.maximum(turns[row], 1), SPARK - 1
            )
            np.add.at(cumulative, (row, part), pc.fill_null(steps["reward"], 0.0).to_numpy())
            _count(actions, row, steps)
    listed = map(str, evidence.manifest.get("agents") or ())
    agents = [name for name in listed if name in sums.names]
    agents += sorted(set(sums.names) - set(agents))
    return Figures(
        headers=headers,
        agents=tuple(agents),
        present=sums.of("rows", agents) > 0,
        returns=sums.of("reward", agents),
        lengths=sums.of("acted", agents),
        terms={name[len(TERM) :]: sums.of(name, agents) for name in sums.terms},
        terminated=sums.of("terminated", agents) > 0,
        truncated=sums.of("truncated", agents) > 0,
        cumulative=np.cumsum(cumulative, axis=1),
        actions=actions,
        _places={header["episode"]: place for place, header in enumerate(headers)},
    )


def _count(actions: FloatArray, row: Any, steps: pa.Table) -> None:
    """Adds the whole-number actions of rows to the histograms of their episodes."""
    for column in steps.schema.names:  # a column for each space of actions
        if column.split("@")[0] != "action" or not pa.types.is_integer(steps[column].type):
            continue
        chose = np.asarray(pc.is_valid(steps[column]).to_numpy(), np.bool_)
        values = pc.fill_null(steps[column], 0).to_numpy()
        bars = np.clip(values, 0, ACTIONS - 1).astype(np.int64)
        np.add.at(actions, (row[chose], bars[chose]), 1.0)


class _Sums:
    """Sums by agent and episode, of rows in their order: floats in another order differ."""

    def __init__(self, episodes: list[int]) -> None:
        self.names: dict[str, int] = {}
        self.terms: dict[str, None] = {}
        self._sums: dict[str, FloatArray] = {}
        self._order = np.argsort(np.asarray(episodes, np.int64), kind="stable")
        self._numbers = np.asarray(episodes, np.int64)[self._order]

    def of(self, what: str, agents: list[str]) -> FloatArray:
        """[episodes, agents] one of the sums."""
        places = [self.names[agent] for agent in agents]
        sums = self._sums.get(what, np.zeros((len(self._numbers), 0)))
        return np.ascontiguousarray(sums[:, places])

    def add(self, steps: pa.Table) -> Any:
        """Adds the next rows, at least one, and returns the place of each row's episode."""
        # Episodes may stand in any order: rows find theirs among the sorted numbers.
        row = np.searchsorted(self._numbers, steps["episode"].to_numpy())
        if len(self._order):
            row = self._order[np.minimum(row, len(self._order) - 1)]
        agents = steps["agent"].combine_chunks().dictionary_encode()
        columns = [
            self.names.setdefault(name, len(self.names)) for name in agents.dictionary.to_pylist()
        ]
        cells = row, np.array(columns)[np.asarray(agents.indices)]
        self.terms |= dict.fromkeys(
            name
            for name in steps.schema.names
            if name.startswith(TERM) and steps[name].null_count < steps.num_rows
        )
        flags = {
            name: np.asarray(pc.fill_null(steps[name], False).to_numpy(), np.bool_)
            for name in ("terminated", "truncated")
        }
        chose, raised = (
            np.asarray(pc.is_valid(steps[name]).to_numpy(), np.bool_)
            for name in ("order", "raised")
        )
        acted = chose & ~raised & ~(flags["terminated"] | flags["truncated"])
        for column, weights in {"rows": np.ones(len(row)), "acted": acted, **flags}.items():
            self._into(column, cells, weights)
        for column in ("reward", *self.terms):
            self._into(column, cells, pc.fill_null(steps[column], 0.0).to_numpy())
        return row

    def _into(self, what: str, cells: tuple[Any, Any], weights: Any) -> None:
        sums = self._sums.get(what, np.zeros((len(self._numbers), 0)))
        more = len(self.names) - sums.shape[1]
        if more:  # agents that had no row before
            sums = np.pad(sums, ((0, 0), (0, more)))
        # `+=` would add only one of several rows for a cell; `add.at` adds each, in order.
        np.add.at(sums, cells, np.asarray(weights, np.float64))
        self._sums[what] = sums


UNFINISHED: Final = (None, "torn")
"""Ends of episodes that were still running when their recording stopped."""


def failing(
    evidence: Evidence, figures: Figures, condition: str | None = None
) -> tuple[list[bool | None], str]:
    """True for each episode that failed by the contract's conditions, and these in words.

    None for an episode for which it isn't known, as one whose recorder was killed; an episode
    that ended with an exception failed.

    Args:
        condition: of the team, in place of what the contract declares.
    """
    contract = evidence.contract
    errors = [True if header.get("error") else None for header in figures.headers]
    try:
        conditions = failures(contract, condition)
    except ContractError:
        return errors, "the contract declares no [failure]; episodes with an error failed"
    text = "; ".join(scope_text(*each) for each in conditions.items())
    names = {name.rpartition(".")[2] for each in conditions.values() for name in each.names}
    terms = {*figures.terms, *contract.rewards} if figures.terms else set()
    needs_infos = not names <= {*MEASURED, *terms}
    infos = _last_infos(evidence, figures) if needs_infos else {}
    found: list[bool | None] = []
    for place, header in enumerate(figures.headers):
        if header.get("end") in UNFINISHED and not header.get("error"):
            found.append(None)
            continue
        try:
            outcome = _outcome(figures, place, infos.get(header["episode"], {}))
            found.append(any(failed(outcome, conditions, contract).values()))
        except (ContractError, EvidenceError) as error:
            found.append(True if header.get("error") else None)
            why = f"{error.what}; expected: {error.expected}" if error.expected else error.what
            text = f"{text} ({why})" if why not in text else text
    return found, text


def scope_text(scope: str, condition: Failure) -> str:
    """A condition of failure, after its scope where that isn't the team."""
    return condition.text if scope == TEAM else f"{scope}: {condition.text}"


def failed_text(failed: Sequence[bool | None]) -> str:
    """Number of failed episodes, and of those for which it isn't known."""
    judged = [each for each in failed if each is not None]
    unknown = len(failed) - len(judged)
    if not judged:
        return "not known of any episode"
    text = f"{sum(judged)} of {len(failed)} episodes failed"
    return f"{text}; of {unknown} it isn't known" if unknown else text


def _outcome(
    figures: Figures, place: int, infos: Mapping[str, tuple[int, Mapping[str, float]]]
) -> Outcome:
    header = figures.headers[place]
    there = np.flatnonzero(figures.present[place]).tolist()
    names = [figures.agents[k] for k in there]
    flags = {name: _ending_word(figures, place, k) for name, k in zip(names, there, strict=True)}
    reasons = fields_of_text(header.get("endings"))
    return Outcome(
        seed=header.get("seed"),
        turns=header.get("turns") or 0,
        returns={figures.agents[k]: float(figures.returns[place, k]) for k in there},
        terms={
            figures.agents[k]: {name: float(sums[place, k]) for name, sums in figures.terms.items()}
            for k in there
        }
        if figures.terms
        else {},
        endings={name: str(reasons.get(name) or word) for name, word in flags.items()},
        infos={name: numbers for name, (_, numbers) in infos.items()},
        seen={name: turn for name, (turn, _) in infos.items()},
        flags=flags,
        is_over=header.get("end") == "ended",
        error=header.get("error"),
    )


def _ending_word(figures: Figures, place: int, agent: int) -> str:
    """The flag of an agent's ending: `terminated`, `truncated`, or `cut` without one."""
    if figures.terminated[place, agent]:
        return "terminated"
    return "truncated" if figures.truncated[place, agent] else "cut"


def _last_infos(
    evidence: Evidence, figures: Figures
) -> dict[int, dict[str, tuple[int, Mapping[str, float]]]]:
    """By episode and agent, the turn and the numbers of the last info that had any."""
    found: dict[int, dict[str, tuple[int, Mapping[str, float]]]] = {}
    again: set[int] = set()
    for row in _last_rows(evidence, figures):
        numbers = plain_numbers(from_json(row["info"]))
        if numbers:
            found.setdefault(row["episode"], {})[row["agent"]] = (row["turn"], numbers)
        else:  # an earlier info may have some
            again.add(row["episode"])
    for episode in again:
        outcome = outcome_of(evidence.episode(episode))
        found[episode] = {
            agent: (outcome.seen[agent], numbers) for agent, numbers in outcome.infos.items()
        }
    return found


def _last_rows(evidence: Evidence, figures: Figures) -> Iterator[dict[str, Any]]:
    """The last row with an info of each agent in each episode, read part by part."""
    names, still_open = ["episode", "turn", "agent", "info"], None
    parts = evidence.tables.all_parts("agent_steps", without=(*APART[:1], *APART[2:], "reward"))
    for part in parts or ():
        if not part.num_rows:
            continue
        rows = part.select(names).filter(pc.is_valid(part["info"]))
        last = _last(rows if still_open is None else pa.concat_tables([still_open, rows]), figures)
        # The last episode of a part may continue in the next one, so its rows wait for that.
        is_open = pc.equal(last["episode"], part["episode"][-1])
        yield from last.filter(pc.invert(is_open)).to_pylist()
        still_open = last.filter(is_open)
    yield from () if still_open is None else still_open.to_pylist()


def _last(rows: pa.Table, figures: Figures) -> pa.Table:
    """The last row of each agent in each episode, found as the first one from behind."""
    names = pc.index_in(rows["agent"], pa.array(figures.agents, pa.string())).to_numpy()
    key = rows["episode"].to_numpy().astype(np.int64) * max(len(figures.agents), 1) + names
    _, last = np.unique(key[::-1], return_index=True)
    return rows.take(pa.array(len(key) - 1 - last))


def compared_block(
    one: Figures, two: Figures, *, names: tuple[str, str], rng: Generator
) -> PageBlock:
    """Compares two runs agent by agent, on the same seeds where there are any."""
    seeds = {header["seed"]: place for place, header in enumerate(one.headers)}
    pairs = [
        (seeds[header["seed"]], place)
        for place, header in enumerate(two.headers)
        if header["seed"] is not None and header["seed"] in seeds
    ]
    rows = []
    for agent in [each for each in one.agents if each in two.agents]:
        a, b = one.agents.index(agent), two.agents.index(agent)
        both = [(i, k) for i, k in pairs if one.present[i, a] and two.present[k, b]]
        base = np.array([one.returns[i, a] for i, _ in both], np.float64)
        other = np.array([two.returns[k, b] for _, k in both], np.float64)
        rows.append(
            (
                name(agent),
                number(_mean(one.returns[one.present[:, a], a])),
                number(_mean(two.returns[two.present[:, b], b])),
                number(len(both)),
                *_difference(base, other, rng),
            )
        )
    columns = ("agent", *names, "same seeds", "difference", "95 % interval")
    note = f"Differences between episodes with the same seed; an interval needs {FEWEST} of them."
    table = PageTable("Returns, and differences on the same seeds", columns, tuple(rows), note)
    both_runs = set(one.agents) & set(two.agents)
    missing = [each for each in (*one.agents, *two.agents) if each not in both_runs]
    notes = (f"Only in one of the runs: {', '.join(missing)}.",) if missing else ()
    return PageBlock(title=f"{names[1]} compared with {names[0]}", tables=(table,), notes=notes)


def _mean(values: FloatArray) -> float | None:
    return float(values.mean()) if len(values) else None


def _difference(base: FloatArray, other: FloatArray, rng: Generator) -> tuple[Cell, Cell]:
    try:
        effect = paired_effect(base, other, rng=rng)
    except EvidenceError:  # too few pairs, or figures that aren't finite
        return number(_mean(other - base)), bounds(None, None)
    return number(effect.value), bounds(effect.low, effect.high)
