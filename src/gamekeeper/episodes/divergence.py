"""The first place where two episodes differ, with both values."""

import json
import zlib
from collections.abc import Collection, Iterator
from dataclasses import KW_ONLY, dataclass, replace
from itertools import chain
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gamekeeper.episodes.actions_level import EVERY
from gamekeeper.episodes.arrow import cells_of
from gamekeeper.episodes.block import Raw
from gamekeeper.episodes.canonical import drop, to_json, without
from gamekeeper.episodes.chunks import EpisodeChunks
from gamekeeper.episodes.episode import Episode, Turn
from gamekeeper.episodes.known_extent import Extent, clipped, extent_of, is_open
from gamekeeper.episodes.layout import value_columns
from gamekeeper.episodes.plain_json import legible
from gamekeeper.episodes.row_tables import html_table

WHOLE_ELEMENTS = 16  # an array of no more is shown whole
SHOWN = 200  # characters of a value
SET_UP = {
    "environment.name": "the name of the environment",
    "environment.api": "the API of the environment",
    "environment.kwargs": "the arguments of the environment",
    "seed": "the seed of its reset",
    "options": "the options of its reset",
}  # fields in which runs differ before their first turn, in words
WORDS = {
    **SET_UP,
    "episode": "the number of episodes (only one side has this one)",
    "endings": "the reasons for which agents ended",
    "digest": "the digest of the row (its values aren't in the run, or are spelled otherwise)",
}


def difference(one: Any, two: Any, tolerance: float | None) -> float | None:
    """The largest difference of two values; None if it is beyond `tolerance`, or no number's.

    Bit for bit equal values differ by 0.0. Only numbers have a tolerance: flags, texts and what is
    missing are equal or not, and an infinity equals itself alone.

    Args:
        tolerance: absolute, or relative to the larger of two numbers; None: nothing may differ.
    """
    if to_json(one) == to_json(two):
        return 0.0
    if tolerance is None:
        return None
    if isinstance(one, dict) and isinstance(two, dict) and one.keys() == two.keys():
        return _largest([difference(one[key], two[key], tolerance) for key in one])
    if isinstance(one, list | tuple) and type(one) is type(two) and len(one) == len(two):
        return _largest([difference(x, y, tolerance) for x, y in zip(one, two, strict=True)])
    a, b = _floats(one), _floats(two)
    if a is None or b is None or a.shape != b.shape:
        return None
    with np.errstate(invalid="ignore", over="ignore"):
        gap = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(a - b))
        within = gap <= tolerance * np.maximum(1.0, np.maximum(np.abs(a), np.abs(b)))
        within &= np.isfinite(gap)
    return float(gap.max(initial=0.0)) if bool(within.all()) else None


def shown_pair(one: Any, two: Any) -> tuple[str, str]:
    """Two values in a line each; of large arrays the first element that differs, with its place."""
    if (
        isinstance(one, np.ndarray)
        and isinstance(two, np.ndarray)
        and one.shape == two.shape
        and one.size > WHOLE_ELEMENTS
    ):
        places = np.argwhere((one != two) & ((one == one) | (two == two)))  # NaN equals NaN
        if len(places):
            at = tuple(places[0].tolist())
            note = f" at {list(at)}, the first of {len(places)} of {one.size} elements that differ"
            return to_json(one[at].item()) + note, to_json(two[at].item())
    plain = _short(_as_lists(one)), _short(_as_lists(two))
    return plain if plain[0] != plain[1] else (_short(one), _short(two))  # types, or past the cut


def _as_lists(value: Any) -> Any:
    """The value with arrays and tuples as lists, whose type and shape a reader seldom needs."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        return value.tolist()
    if isinstance(value, dict):
        return {key: _as_lists(each) for key, each in value.items()}
    if type(value) in (list, tuple):
        return [_as_lists(each) for each in value]
    return value


def _floats(value: Any) -> NDArray[np.float64] | None:
    """`value` as float64 if it is a number or an array of numbers; bools are none."""
    if isinstance(value, bool | str | bytes | list | tuple) or value is None:
        return None
    try:
        array = np.asarray(value)
        return array.astype(np.float64) if array.dtype.kind in "iuf" else None
    except (TypeError, ValueError, OverflowError):
        return None


def _largest(sizes: list[float | None]) -> float | None:
    known = [size for size in sizes if size is not None]
    return None if len(known) < len(sizes) else max(known, default=0.0)


def _short(value: Any) -> str:
    text = to_json(value)
    return text if len(text) <= SHOWN else f"{text[: SHOWN - 3]}..."


@dataclass(frozen=True, slots=True)
class Divergence:
    """The first place where two episodes differ.

    Attributes:
        episode: its number in the run.
        turn: the turn; None where the headers differ.
        agent: of the row; None where a whole turn or the state differs.
        field: `obs`, `obs.<path>`, `action`, `reward`, `cumulative_reward`, `terminated`,
            `truncated`, `info`, `mask`, `order`, `live`, `raised`, `nonconforming`, `state`,
            `rows`, `digest`, or a field of the header.
        recorded: the value on the left.
        replayed: the value on the right.
        witness: the last turn before it that was compared whole, in a run of level `actions`,
            which keeps no observations of the turns after that; else None.
    """

    episode: int
    turn: int | None
    agent: str | None
    field: str
    recorded: Any
    replayed: Any
    _: KW_ONLY
    witness: int | None = None

    @property
    def field_text(self) -> str:
        """The field in words, where its name alone doesn't say what differs."""
        if self.field != "rows":
            return WORDS.get(self.field, self.field)
        one, two = self.recorded, self.replayed
        if one is None or two is None:
            return "the number of turns (only one side has this one)"
        if len(one) != len(two):
            return "the number of rows of this turn (a row for each agent in it)"
        if one != two:
            return "the agents of this turn"
        return "the spelling of values that are equal"

    @property
    def place_text(self) -> str:
        """Episode, turn and agent in words; empty for a difference of the whole runs."""
        if self.field.startswith("environment."):
            return ""
        turn = "" if self.turn is None else f", turn {self.turn}"
        agent = "" if self.agent is None else f", agent {self.agent}"
        return f"episode {self.episode}{turn}{agent}"

    def to_json(self) -> dict[str, Any]:
        """Plain data; arrays as canonical JSON has them."""
        return {
            "episode": self.episode,
            "turn": self.turn,
            "agent": self.agent,
            "field": self.field,
            "recorded": json.loads(to_json(self.recorded)),
            "replayed": json.loads(to_json(self.replayed)),
            "witness": self.witness,
        }

    @property
    def are_digests(self) -> bool:
        """True where the values are digests, which tell a reader nothing."""
        values = self.recorded, self.replayed
        return self.field in ("digest", "state") and all(isinstance(x, bytes) for x in values)

    @property
    def begun_text(self) -> str:
        """Turns at which it may have begun unnoticed, in words; else empty."""
        if self.witness is None:
            return ""
        return (
            f"at level actions it may have begun at any turn after {self.witness}, the last whose "
            "digest is in the run, or in an episode before"
        )

    def __str__(self) -> str:
        place = replace(self, agent=None).place_text
        key = f"{self.field}[{self.agent!r}]" if self.agent is not None else self.field_text
        recorded, replayed = shown_pair(self.recorded, self.replayed)
        values = [f"recorded: {recorded}", f"replayed: {replayed}"]
        lines = ["the digests differ"] if self.are_digests else values
        first = ", ".join(filter(None, [place, key]))
        return "\n  ".join([first, *lines, *filter(None, [self.begun_text])])

    def _repr_html_(self) -> str:
        both = shown_pair(self.recorded, self.replayed)
        caption = ", ".join(filter(None, ["First difference", self.place_text]))
        return html_table(
            [["field", "recorded", "replayed"], [self.field_text, *both]], caption=caption
        )


class Comparison:
    """Compares two records of one episode, some turns at a time; its attributes say what came out.

    Args:
        known: how far the recorded episode goes.
        tolerance: numbers that differ by no more count as equal; None: bit for bit.
        is_kept: the recorded one is of level `actions`; its rows tell that, where it has any.
    """

    def __init__(
        self,
        known: Extent,
        *,
        tolerance: float | None = None,
        volatile: Collection[str] = (),
        is_kept: bool = False,
    ) -> None:
        self._known, self._tolerance, self._volatile = known, tolerance, volatile
        self.is_exact = True
        """All that was compared is equal bit for bit."""
        self.largest = 0.0
        """The largest difference of two numbers that was passed over as within tolerance."""
        self.divergence: Divergence | None = None
        """The first place where they differ by more than the tolerance, if there is one."""
        self._last: tuple[Episode, Episode] | None = None
        self._is_kept = is_kept

    def add(self, recorded: Episode, replayed: Episode) -> bool:
        """Compares the next turns; True while there is no divergence."""
        self._is_kept = self._is_kept or recorded.is_actions
        known = clipped(replayed.kept() if self._is_kept else replayed, self._known)
        self._last = recorded, replayed
        numbers = _different_turns(recorded, known, self._volatile)
        self.is_exact = self.is_exact and not numbers
        turns = zip(_turns_at(recorded, numbers), _turns_at(known, numbers), strict=True)
        for number, pair in zip(numbers, turns, strict=True):
            self.divergence, size = _first(
                recorded, known, number, pair, self._tolerance, self._volatile
            )
            self.largest = max(self.largest, size)
            if self.divergence is not None:
                if self._is_kept and number:
                    witness = (number - 1) // EVERY * EVERY
                    self.divergence = replace(self.divergence, witness=witness)
                return False
        return True

    def ends(self) -> None:
        """Compares the reasons for which agents ended, once all turns were compared."""
        if self.divergence is not None or self._last is None:
            return
        recorded, replayed = self._last
        if not is_open(recorded.header) and recorded.endings != replayed.endings:
            values = dict(recorded.endings), dict(replayed.endings)
            self.divergence = Divergence(recorded.episode, None, None, "endings", *values)
            self.is_exact = False


def compare(
    recorded: Episode,
    replayed: Episode,
    *,
    tolerance: float | None = None,
    volatile: Collection[str] = (),
    is_kept: bool = False,
) -> Comparison:
    """Compares two records of one episode row by row.

    Args:
        recorded: may be at level "digest"; then the other's rows are digested for the comparison.
        tolerance: numbers that differ by no more, absolutely or relative to the larger one, count
            as equal; None: bit for bit.
        is_kept: as for `Comparison`.
    """
    known = extent_of(recorded)
    found = Comparison(known, tolerance=tolerance, volatile=volatile, is_kept=is_kept)
    found.add(recorded, replayed)
    found.ends()
    return found


def turn_checksums(episode: Episode, *, volatile: Collection[str]) -> list[int]:
    """Returns 32 bits for each turn: two episodes whose bits differ at a turn differ there."""
    found = _by_turn(episode, volatile)
    turns = range(max(found, default=-1) + 1)
    return [zlib.crc32(repr(found.get(turn)).encode()) for turn in turns]


def _turns_at(episode: Episode, numbers: list[int]) -> Iterator[Turn | None]:
    """Yields the turn of each of the rising `numbers`; None where no row has it."""
    turns = iter(episode.turns)
    turn = next(turns, None)
    for number in numbers:
        while turn is not None and turn.index < number:
            turn = next(turns, None)
        yield turn if turn is not None and turn.index == number else None


def _different_turns(left: Episode, right: Episode, volatile: Collection[str]) -> list[int]:
    """The turns at which rows, infos or states differ, in their order."""
    if _are_equal(left, right):
        return []
    one, two = (_by_turn(episode, volatile) for episode in (left, right))
    return [turn for turn in sorted(one.keys() | two.keys()) if one.get(turn) != two.get(turn)]


@legible
def _are_equal(left: Episode, right: Episode) -> bool:
    """True if all rows are the same, one by one."""
    if left.steps.num_rows != right.steps.num_rows or (left.states is None) != (
        right.states is None
    ):
        return False
    for name in ("turn", "info"):
        if not left.steps[name].equals(right.steps[name]):
            return False
    if not np.array_equal(left.digests, right.digests):
        return False
    if left.states is None or right.states is None:
        return True
    return bool(left.states["turn"].equals(right.states["turn"])) and _states(
        left.states
    ) == _states(right.states)


@legible
def _by_turn(episode: Episode, volatile: Collection[str]) -> dict[int, list[Any]]:
    """For each turn, what has to be equal: digests of rows, infos, state."""
    found: dict[int, list[Any]] = {}
    columns = (
        episode.steps["turn"].to_pylist(),
        episode.digests,
        episode.steps["info"].to_pylist(),
    )
    for turn, digest, info in zip(*columns, strict=True):
        entry = found.setdefault(turn, [])
        entry.append(digest.tobytes())
        entry.append(without(info, volatile))
    if episode.states is not None:
        for turn, state in zip(
            episode.states["turn"].to_pylist(), _states(episode.states), strict=True
        ):
            found.setdefault(turn, []).append(state)
    return found


def _states(states: pa.Table) -> list[Any]:
    parts: list[list[Any]] = [states["nonconforming"].to_pylist()]
    for column in value_columns(states.schema, "state"):
        cells = cells_of(column, states[column.name])
        parts.append(
            [row.tobytes() for row in cells.values] if isinstance(cells, Raw) else cells.values
        )
    return list(zip(*parts, strict=True))


def _first(
    left: Episode,
    right: Episode,
    number: int,
    turns: tuple[Turn | None, Turn | None],
    tolerance: float | None,
    volatile: Collection[str],
) -> tuple[Divergence | None, float]:
    """The first field of a turn that differs, and the largest difference passed over on the way."""
    a, b = turns
    names = [None if turn is None else list(turn.agents) for turn in turns]
    if names[0] != names[1]:
        errors = [
            None if turn is not None else _error(episode)
            for turn, episode in ((a, left), (b, right))
        ]
        if errors[0] != errors[1]:  # a reset raised, so there is no row that says it
            return Divergence(left.episode, number, None, "raised", *errors), 0.0
        return Divergence(left.episode, number, None, "rows", *names), 0.0
    largest = 0.0
    states = _state_at(left, number), _state_at(right, number)
    pairs = iter(()) if a is None or b is None else _pairs(a, b, volatile, _is_digest(left, right))
    for agent, field, recorded, replayed in chain(pairs, [(None, "state", *states)]):
        # action 2 isn't nearly action 3
        is_whole = field == "order" or (
            field == "action" and isinstance(recorded, int | np.integer)
        )
        size = difference(recorded, replayed, None if is_whole else tolerance)
        if size is None:
            return Divergence(left.episode, number, agent, field, recorded, replayed), largest
        largest = max(largest, size)
    if a is not None and b is not None and (tolerance is None or _is_digest(left, right)):
        for agent, one, two in zip(a.agents, a.digests, b.digests, strict=True):
            if one != two:
                # at level actions all else is equal: what differs is the turn's witness
                where = None if left.is_actions else agent
                return Divergence(left.episode, number, where, "digest", one, two), largest
    if tolerance is None:  # texts that spell equal values differently: no recorder wrote them
        return Divergence(left.episode, number, None, "rows", *names), largest
    return None, largest


def _is_digest(*episodes: Episode) -> bool:
    return any(episode.is_digest for episode in episodes)


def _error(episode: Episode) -> str | None:
    """The last line of what ended an episode: type and text of an exception."""
    text = episode.header.get("error")
    return text.strip().splitlines()[-1] if text and text.strip() else None


def _state_at(episode: Episode, number: int) -> Any:
    """`state()` at a turn; of one that left no value, the name of its type."""
    state = episode.state(number)
    if state is not None or episode.states is None:
        return state
    rows = episode.states.filter(pc.equal(episode.states["turn"], number))["nonconforming"]
    kept = rows.drop_null().to_pylist()
    entry = json.loads(kept[0])["state"] if kept else {"value": None}
    return entry.get("value", entry)


def _pairs(
    a: Turn, b: Turn, volatile: Collection[str], is_digest: bool
) -> Iterator[tuple[str | None, str, Any, Any]]:
    """Every field of two turns of the same rows, in the order in which it came about."""
    for agent in a.agents:
        if not is_digest:
            yield from _observations(agent, a.observations.get(agent), b.observations.get(agent))
        for field, one, two in (
            ("action_mask", a.masks.get(agent), b.masks.get(agent)),
            ("cumulative_reward", a.cumulative_reward.get(agent), b.cumulative_reward.get(agent)),
            ("terminated", a.terminated.get(agent), b.terminated.get(agent)),
            ("truncated", a.truncated.get(agent), b.truncated.get(agent)),
            ("info", _info(a, agent, volatile), _info(b, agent, volatile)),
            ("live", agent in a.live, agent in b.live),
            ("order", _place(a, agent), _place(b, agent)),
            ("action", a.actions.get(agent), b.actions.get(agent)),
            ("raised", a.raised.get(agent), b.raised.get(agent)),
            ("reward", a.rewards.get(agent), b.rewards.get(agent)),
            ("nonconforming", a.nonconforming.get(agent), b.nonconforming.get(agent)),
        ):
            if not (is_digest and field == "action_mask"):
                yield agent, field, one, two
        paid = a.terms.get(agent, {}), b.terms.get(agent, {})
        for term in dict.fromkeys([*paid[0], *paid[1]]):
            yield agent, f"reward.{term}", paid[0].get(term), paid[1].get(term)


def _observations(
    agent: str, one: Any, two: Any, path: str = "obs"
) -> Iterator[tuple[str, str, Any, Any]]:
    """An observation leaf by leaf, so that the field names the part that differs."""
    joint = "." if path == "obs" else "/"
    if isinstance(one, dict) and isinstance(two, dict) and one.keys() == two.keys():
        for key in one:
            yield from _observations(agent, one[key], two[key], f"{path}{joint}{key}")
    elif isinstance(one, tuple) and isinstance(two, tuple) and len(one) == len(two):
        for place, (x, y) in enumerate(zip(one, two, strict=True)):
            yield from _observations(agent, x, y, f"{path}{joint}{place}")
    else:
        yield agent, path, one, two


def _place(turn: Turn, agent: str) -> int | None:
    return turn.order.index(agent) if agent in turn.order else None


def _info(turn: Turn, agent: str, volatile: Collection[str]) -> Any:
    info = turn.infos.get(agent)
    return drop(info, volatile) if volatile and isinstance(info, dict) else info


def compare_chunks(
    recorded: EpisodeChunks,
    replayed: EpisodeChunks,
    *,
    known: Extent,
    tolerance: float | None = None,
    volatile: Collection[str] = (),
) -> Comparison:
    """Compares two records of one episode, a range of turns of each in memory.

    Args:
        known: how far the recorded one goes.
    """
    found = Comparison(known, tolerance=tolerance, volatile=volatile)
    for episode, before in recorded.stretches():
        if not found.add(episode, replayed.take(_end(episode) if before is None else before)):
            break
    else:
        nothing = recorded.take(None)
        # further turns of the other one are a divergence, unless the end of this one is unknown
        for rest, _ in replayed.stretches():
            if known.turns is not None or not found.add(nothing, rest):
                break
        found.ends()
    return found


def _end(episode: Episode) -> int:
    """The turn after all those that have a row or a state."""
    tables = [table for table in (episode.steps, episode.states) if table is not None]
    return max(
        (int(table["turn"][-1].as_py()) + 1 for table in tables if table.num_rows), default=0
    )
