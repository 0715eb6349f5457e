"""Effects of one replaced action: on which agent, in what, how much later."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias

import numpy as np

from gamekeeper.checks.probe_evidence import ProbeCounterfactual
from gamekeeper.checks.rounds import movers, ticks
from gamekeeper.episodes.episode import Episode, Turn
from gamekeeper.statistics.significance import FloatArray, wilson

On: TypeAlias = Literal["observation", "reward", "ending"]


MOST_PLACES: Final = 4_096
"""Places that are told apart in one observation."""


@dataclass(frozen=True, slots=True)
class ActionEffect:
    """One look at whether an action changed something.

    Attributes:
        source: whose action was replaced.
        target: whose observation, reward or ending was looked at.
        on: which of them.
        lag: in turns; of a reward or an ending from the step of that action to its own, of an
            observation from that action to the decision that is made with it.
        is_changed: whether it differs from what it was.
    """

    source: str
    target: str
    on: On
    lag: int
    is_changed: bool


def effects(counterfactual: ProbeCounterfactual) -> Iterator[ActionEffect]:
    """Yields the effects of one replaced action, as long as the unchanged rerun agrees."""
    source, start = str(counterfactual.change["agent"]), int(counterfactual.change["turn"])
    later = int(counterfactual.change["later"])
    end = _last_equal(counterfactual)
    base = by_turn(counterfactual.base, start, end)
    changed = by_turn(counterfactual.episode, start, end)
    names = sorted({name for turn in base.values() for name in turn.agents})
    for turn in sorted(base.keys() & changed.keys()):
        one, two = base[turn], changed[turn]
        if turn > start + later + 1:
            return
        if one.order and two.order and turn <= start + later:
            for name in names:
                paid = one.rewards.get(name, 0.0), two.rewards.get(name, 0.0)
                yield ActionEffect(source, name, "reward", turn - start, _differ(*paid))
        if turn == start:
            continue
        for name in names:
            is_changed = (name in one.ended) != (name in two.ended)
            yield ActionEffect(source, name, "ending", turn - start - 1, is_changed)
            if name in one.observations and name in two.observations:
                values = one.observations[name], two.observations[name]
                yield ActionEffect(source, name, "observation", turn - start, _differ(*values))


def later_looks(counterfactual: ProbeCounterfactual) -> Iterator[tuple[tuple[int, str], bool]]:
    """Turn and agent of those who act later in the tick, and whether they observe the change."""
    start = int(counterfactual.change["turn"])
    tick = next((each for each in ticks(counterfactual.base) if start in each), range(0))
    acted = {turn.index: movers(turn) for turn in counterfactual.base.turns if turn.index in tick}
    for effect in effects(counterfactual):
        turn = start + effect.lag
        if effect.on == "observation" and effect.target in acted.get(turn, ()):
            yield (turn, effect.target), effect.is_changed


def by_turn(episode: Episode, start: int, end: int | None = None) -> dict[int, Turn]:
    """The turns from `start` on, by number; those before `end`."""
    return {
        turn.index: turn
        for turn in episode.turns
        if turn.index >= start and (end is None or turn.index < end)
    }


def changed_numbers(one: Any, two: Any) -> frozenset[int]:
    """The places of the numbers that differ in two values of one form; of images in bins."""
    left, right = numbers_in(one), numbers_in(two)
    if left.shape != right.shape:
        return frozenset()
    same = (left == right) | (np.isnan(left) & np.isnan(right))
    places = np.flatnonzero(~same)
    if len(left) > MOST_PLACES:
        places = np.unique(places * MOST_PLACES // len(left))
    return frozenset(places.tolist())


def _last_equal(counterfactual: ProbeCounterfactual) -> int | None:
    """Turns from here on differ although nothing was changed; None: there is no such turn."""
    noise = counterfactual.noise
    return None if noise is None else (noise.turn or 0)


def _differ(one: Any, two: Any) -> bool:
    if isinstance(one, dict) and isinstance(two, dict):
        return one.keys() != two.keys() or any(_differ(one[key], two[key]) for key in one)
    if isinstance(one, list | tuple) and isinstance(two, list | tuple):
        return len(one) != len(two) or any(map(_differ, one, two))
    if isinstance(one, np.ndarray) or isinstance(two, np.ndarray):
        left, right = np.asarray(one), np.asarray(two)
        is_float = left.dtype.kind == right.dtype.kind == "f"
        return not np.array_equal(left, right, equal_nan=is_float)
    return bool(one != two) and not (one != one and two != two)


def numbers_in(value: Any) -> FloatArray:
    """The numbers in a value, as a vector; those of a dictionary in the order of its keys."""
    if isinstance(value, Mapping):
        parts = [numbers_in(value[key]) for key in sorted(value, key=str)]
    elif isinstance(value, tuple | list):
        parts = [numbers_in(each) for each in value]
    elif isinstance(value, np.ndarray):
        return value.astype(np.float64).ravel() if value.dtype.kind in "biuf" else np.empty(0)
    elif isinstance(value, bool | int | float | np.number | np.bool_):
        return np.array([value], np.float64)
    else:
        return np.empty(0)
    return np.concatenate(parts) if parts else np.empty(0)


SHOWN_AGENTS: Final = 6
"""In larger rosters only influence that was seen at least once is listed."""


def influence_rows(
    looks: Mapping[tuple[str, str, str, int], int], hits: Mapping[tuple[str, str, str, int], int]
) -> list[dict[str, Any]]:
    """Rows of influence for documents, with Wilson's 95 % interval.

    Args:
        looks: replaced actions by source, target, place and lag.
        hits: those of them that changed something there.
    """
    is_small = len({source for source, *_ in looks}) <= SHOWN_AGENTS
    rows = []
    for key in sorted(looks):
        if hits[key] or is_small:
            share = wilson(hits[key], looks[key])
            figures = {name: round(getattr(share, name), 4) for name in ("p", "low", "high")}
            rows.append(
                {
                    **dict(zip(("from", "to", "on", "lag"), key, strict=True)),
                    **figures,
                    "n": share.n,
                }
            )
    return rows
