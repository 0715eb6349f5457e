"""Messages between agents that nothing declares: fields that carry what another agent did last.

Each agent in turn acts at random for a few episodes while all others go on as they are. A field of
another agent's observation that then follows those actions carries a message, and one that follows
them late or in part shows that messages are late, lost or changed on their way.
"""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.open_setup import OpenSetup, Setup
from gamekeeper.diagnosis.undos import BoundaryUndo
from gamekeeper.episodes.episode import Episode
from gamekeeper.rollouts.interventions.fields import NumberField, acted_fields, observed_fields
from gamekeeper.rollouts.interventions.perturbation import action_space, observation_space

PROBED: Final = 4
"""Episodes in which one agent acts at random."""
MOST_AGENTS: Final = 8
"""Agents up to which their messages are looked for."""
MOST_FIELDS: Final = 100
"""Fields of an observation up to which it is looked for messages."""
FEWEST: Final = 8
"""Decisions of a listener below which nothing is said."""
FOLLOWS: Final = 0.95
"""The part of the decisions at which a field that carries a message has to follow it."""
CONSTANT: Final = 0.9
"""The part of the decisions at which one value would do, above which a field shows nothing."""
MOST_LAG: Final = 40
ORDER: Final = 1
"""Decisions by which a message is late where agents take turns and the world moves after them."""
NEAR: Final = 1e-4
"""Difference below which two numbers are one, in the precision of float32."""
Series: TypeAlias = NDArray[np.float64]
Heard: TypeAlias = tuple[str, int, int]
"""Listener, its field, and the speaker's axis."""


@dataclass(frozen=True, slots=True)
class MessageChannel:
    """Fields of one agent's observation that carry what another did last.

    Attributes:
        source, to: the speaker and the listener.
        axes, fields: of its action, and of the listener's observation, in pairs.
        is_whole: the fields always follow the speaker's last action.
        is_equal: they hold the same numbers.
        lag: decisions of the speaker by which they are late.
    """

    source: str
    to: str
    axes: tuple[int, ...]
    fields: tuple[int, ...]
    is_whole: bool = True
    is_equal: bool = False
    lag: int = 0


def channels_of(
    setup: Setup, contract: Contract, agents: Sequence[str], *, seed: int
) -> tuple[MessageChannel, ...]:
    """The messages between agents of a set-up, looked for by random actions of one at a time.

    Args:
        agents: those that are looked at.
        seed: run seed of the episodes.
    """
    found: list[MessageChannel] = []
    for source in agents:
        with OpenSetup(setup.with_policy(source, "random"), contract) as open_setup:
            axes = acted_fields(space) if (space := action_space(open_setup.env, source)) else ()
            listeners = {
                agent: observed_fields(contract, agent, seen)
                for agent in agents
                if agent != source
                and (seen := observation_space(open_setup.env, agent)) is not None
            }
            played = [open_setup.played(seed, episode).episode for episode in range(PROBED)]
        for to, fields in listeners.items():
            if axes and 0 < len(fields) <= MOST_FIELDS:
                found += channels_between(played, source, to, axes, fields)
    return tuple(one for one in found if not _is_passed_on(one, found))


def _is_passed_on(one: MessageChannel, every: Sequence[MessageChannel]) -> bool:
    """Another agent hears it and says it again to the same fields."""
    hearers = {each.to for each in every if each.source == one.source}
    return any(
        each.source in hearers and each.to == one.to and set(one.fields) <= set(each.fields)
        for each in every
    )


def channels_between(
    episodes: Sequence[Episode],
    source: str,
    to: str,
    axes: Sequence[NumberField],
    fields: Sequence[NumberField],
) -> list[MessageChannel]:
    """The messages from one agent to another, by episodes in which the first acts at random.

    Those that arrive as they were said are one channel; those that are late or lost one each.
    """
    spoken = [_spoken(episode, source, to, axes, fields) for episode in episodes]
    grouped: dict[tuple[bool, bool, int], list[tuple[int, int]]] = defaultdict(list)
    for place, field in enumerate(fields):
        for axis in range(len(axes)):
            kind = _kind(spoken, axis, place, is_whole_number=axes[axis].is_whole)
            if kind is not None:
                grouped[kind].append((axis, field.place))
                break
    return [
        MessageChannel(
            source,
            to,
            tuple(axes[axis].place for axis, _ in pairs),
            tuple(place for _, place in pairs),
            is_whole=is_whole,
            is_equal=is_equal,
            lag=lag,
        )
        for (is_whole, is_equal, lag), pairs in grouped.items()
    ]


Spoken: TypeAlias = tuple[Series, NDArray[np.int64], Series]
"""[words, axes] the speaker's actions; by decision of the listener the number of words before it,
and [decisions, fields] what it was given."""


def _spoken(
    episode: Episode,
    source: str,
    to: str,
    axes: Sequence[NumberField],
    fields: Sequence[NumberField],
) -> Spoken:
    """Words and what was heard of one episode."""
    words: list[list[float]] = []
    before: list[int] = []
    heard: list[list[float]] = []
    for turn in episode.turns:
        if to in turn.order and to not in turn.ended and turn.has_observation(to):
            row = [each.read(turn.observations[to]) for each in fields]
            before.append(len(words))
            heard.append([np.nan if number is None else number for number in row])
        action = turn.actions.get(source) if source in turn.order else None
        if action is not None and source not in turn.ended:
            row = [each.read(action) for each in axes]
            words.append([np.nan if number is None else number for number in row])
    return (
        np.array(words, np.float64).reshape(-1, len(axes)),
        np.array(before, np.int64),
        np.array(heard, np.float64).reshape(-1, len(fields)),
    )


def _kind(
    spoken: Sequence[Spoken], axis: int, field: int, *, is_whole_number: bool
) -> tuple[bool, bool, int] | None:
    """Whole, equal and lag of what a field shows of an axis; None: nothing."""
    if not any(len(rows) and _varies(rows[:, field]) for _, _, rows in spoken):
        return None
    for lag in range(MOST_LAG):
        said, heard = _paired(spoken, axis, field, lag)
        if len(said) < FEWEST:
            return None
        same = np.abs(said - heard) < NEAR
        is_telling = _share(heard) <= CONSTANT
        if is_telling and same.mean() >= FOLLOWS:
            return True, True, lag
        if lag <= ORDER and is_telling and (_maps if is_whole_number else _is_linear)(said, heard):
            return True, False, lag
        if lag <= ORDER and _is_lossy(said, heard, same, is_whole_number=is_whole_number):
            return False, True, lag
    return None


def _paired(spoken: Sequence[Spoken], axis: int, field: int, lag: int) -> tuple[Series, Series]:
    """Each word, and what the listener was given as the last but `lag`."""
    said, heard = list[Series](), list[Series]()
    for words, before, rows in spoken:
        places = before - 1 - lag
        known = (places >= 0) & np.isfinite(rows[:, field])
        said.append(words[places[known], axis])
        heard.append(rows[known, field])
    return np.concatenate(said), np.concatenate(heard)


def _varies(values: Series) -> bool:
    known = values[np.isfinite(values)]
    return bool(known.size and np.ptp(known) > NEAR)


def _share(values: Series) -> float:
    """Share of the most frequent value."""
    return max(Counter(values.round(5).tolist()).values()) / len(values)


def _maps(said: Series, heard: Series) -> bool:
    """Tells whether a field is a function of the word, by words that were said more than once."""
    by_word: dict[float, Counter[float]] = defaultdict(Counter)
    for word, value in zip(said.tolist(), heard.round(5).tolist(), strict=True):
        by_word[word][value] += 1
    hits = of = 0
    kinds = set[float]()
    for counts in by_word.values():
        total, (value, most) = sum(counts.values()), counts.most_common(1)[0]
        if total > 1:
            of, kinds = of + total, kinds | {value}
            hits += most if most > 1 else 0
    return of >= 2 * FEWEST and len(kinds) > 1 and hits >= FOLLOWS * of


def _is_linear(said: Series, heard: Series) -> bool:
    """Tells whether a field is the number that was said, rescaled or shifted."""
    if len(said) < 2 * FEWEST or not _varies(said):
        return False
    slope, start = np.polyfit(said, heard, 1)
    off = np.abs(slope * said + start - heard)
    return bool(abs(slope) > NEAR and (off < NEAR * max(float(np.ptp(heard)), 1)).mean() >= FOLLOWS)


def _is_lossy(said: Series, heard: Series, same: Any, *, is_whole_number: bool) -> bool:
    """The same number arrives at times: a real one never by chance, a whole one where all do."""
    if not is_whole_number:
        return int(same.sum()) >= 3 and len(set(heard[same].round(5).tolist())) >= 3
    blank = Counter(heard.tolist()).most_common(1)[0][0]
    arrived = heard != blank
    kinds = set(heard[arrived].tolist())
    return int(arrived.sum()) >= 5 and len(kinds) > 1 and float(same[arrived].mean()) >= FOLLOWS


def sound_ways(channels: Sequence[MessageChannel]) -> frozenset[tuple[str, str]]:
    """Speakers and listeners between whom all that is said arrives as it was said."""
    sound = [one.is_equal and one.is_whole and one.lag <= ORDER for one in channels]
    ways = [(one.source, one.to) for one in channels]
    unsound = {way for way, is_sound in zip(ways, sound, strict=True) if not is_sound}
    return frozenset(ways) - unsound


def deliveries(channels: Sequence[MessageChannel]) -> list[BoundaryUndo]:
    """Undos of messages that are late or lost: the listener is given what was said last."""
    joined: dict[tuple[str, str], list[tuple[int, int]]] = defaultdict(list)
    for one in channels:
        if one.is_equal and (one.lag or not one.is_whole):
            pairs = zip(one.fields, one.axes, strict=True)
            joined[one.source, one.to] += [*pairs]
    return [
        BoundaryUndo(
            (to,),
            "deliver messages",
            (*(field for field, _ in pairs), *(axis for _, axis in pairs)),
            names=(source,),
        )
        for (source, to), pairs in joined.items()
    ]


def between(
    undo: BoundaryUndo, channels: Sequence[MessageChannel], places: Mapping[str, int]
) -> tuple[str, ...]:
    """The speaker and the listeners whose messages alone an undo of one agent touches.

    One of when a policy is asked makes up for messages that come late or at intervals.

    Args:
        places: by agent, the number of axes of its action.
    Returns:
        The speaker first; empty where it touches anything else, or is an undo of several agents.
    """
    if len(undo.agents) != 1 or undo.way == "deliver messages":
        return ()
    (agent,) = undo.agents
    is_value = undo.way in ("exchange values", "exchange actions", "shift actions")
    touched = set(undo.places[:1] if is_value else undo.places)
    if undo.component == "perception" and touched:
        for one in channels:
            way = (one.source, one.to)
            mine = {f for x in channels if (x.source, x.to) == way for f in x.fields}
            if one.to == agent and touched <= mine:
                return one.source, agent
    if undo.component == "control":
        touched = touched or set(range(places.get(agent, 0)))
        listeners = [one.to for one in channels if one.source == agent and touched & set(one.axes)]
        said = {axis for one in channels if one.source == agent for axis in one.axes}
        if listeners and touched <= said:
            return (agent, *dict.fromkeys(listeners))
    if undo.component == "timing":  # an agent that acts on the last message outlasts a gap
        late = [x for x in channels if x.to == agent and (x.lag > ORDER or not x.is_whole)]
        return (late[0].source, agent) if late else ()
    return ()
