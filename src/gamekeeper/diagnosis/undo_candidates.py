"""Undos that are worth trying on the agents of an opened set-up, and the order in which they are.

Response tests leave out what they contradict: a lag that wasn't measured isn't settled, fields to
which a policy is deaf aren't exchanged, and one that reacts to nothing misreads nothing.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from typing import Any, Final, Literal, TypeAlias

import numpy as np

from gamekeeper.diagnosis.open_setup import OpenSetup
from gamekeeper.diagnosis.response_tests import ResponseTest
from gamekeeper.diagnosis.undos import BoundaryUndo, Way, passed_with
from gamekeeper.rollouts.interventions.fields import NumberField, acted_fields, observed_fields
from gamekeeper.rollouts.interventions.perturbation import action_space, observation_space

MOST_FIELDS: Final = 40
"""Fields of an observation up to which single ones and pairs of them are tried."""
MOST_UNLIKE: Final = 8
"""Fields of an observation up to which any two are exchanged; of more, neighbours and equals."""
MOST_SCALED: Final = 1_000
"""Fields of an observation up to which it is rescaled."""
MOST_VALUES: Final = 10
"""Values of an axis up to which pairs of them are exchanged."""
FACTORS: Final = (0.5, 2.0, 0.1, 10.0, 1 / 255, 255.0)
"""The last one, from 1 to the range of pixels, only where bounds don't contradict it: elsewhere it
drives every action to its bound, which may do for a success."""
MOST_LAG: Final = 20
"""Decisions up to which a policy's slowest reactions are settled."""
UNKNOWN: Final = 0.5
"""Part of the shown values that may lie outside of what was recorded of a field."""
MOST_SHIFTED: Final = 12
"""Numbers up to which constants are added to single ones."""
PARTS: Final = (0.2, 0.35, 0.1, 0.6)
"""Parts of a span that are added, likely ones first."""
SHIFTED: Final = 4
"""Tier of constants: they are many. Factors of one number come after them."""
NONE: Final = frozenset[str]()
HOLDS: Final = (2, 4)
WAKING: Final = ("exchange fields", "rescale fields", "normalize fields")
"""Undos that may show a policy that reacts to nothing what it would react to."""
COMMONEST_OF: Final = 9
DRAWN: Final = 0.05
"""Part of the actions from which on a policy counts as one that draws them."""
Candidate: TypeAlias = tuple[int, BoundaryUndo]
"""An undo and its tier: lower ones are tried first."""


def observation_undos(
    agents: tuple[str, ...], fields: Sequence[NumberField], deaf: frozenset[str]
) -> Iterator[Candidate]:
    """Undos of what agents observe; what only touches fields they are deaf to is left out."""
    shown = fields if len(fields) <= MOST_FIELDS else ()
    for one in shown:
        if one.name not in deaf and one.low != one.high:
            yield 0, BoundaryUndo(agents, "mirror field", (one.place,), names=(one.name,))
            yield from _value_undos(agents, one, "exchange values", one.name, tier=3)
    for one, two in combinations(shown, 2):
        is_near = two.place - one.place == 1 or len(shown) <= MOST_UNLIKE
        is_close = is_near and one.part.space.dtype == two.part.space.dtype
        if not {one.name, two.name} <= deaf and (_are_alike(one, two) or is_close):
            names = (one.name, two.name)
            yield from _pair_undos(agents, one, two, "exchange fields", "turn fields", names)
    yield from _part_undos(agents, shown, deaf)
    if fields and len(fields) <= MOST_SCALED and not any(each.is_whole for each in fields):
        most = max(abs(end) for each in fields for end in (each.low, each.high))
        for factor in FACTORS if most <= 1 or most == np.inf else FACTORS[:-1]:
            yield 0, BoundaryUndo(agents, "rescale fields", amount=factor)
        if all(
            np.isfinite([each.low, each.high]).all() and each.low < each.high for each in fields
        ):
            for bottom in (0.0, -1.0):
                yield 0, BoundaryUndo(agents, "normalize fields", amount=bottom)


def _pair_undos(
    agents: tuple[str, ...],
    one: NumberField,
    two: NumberField,
    exchange: Way,
    turn: Way,
    names: tuple[str, ...] = (),
) -> Iterator[Candidate]:
    """Two numbers exchanged, and neighbours of equal bounds turned about their middle."""
    apart, is_alike = two.place - one.place, _are_alike(one, two)
    pair = BoundaryUndo(agents, exchange, (one.place, two.place), names=names)
    yield (0 if apart == 1 else 1 + apart) + (not is_alike), pair
    # without bounds the middle is 0
    if is_alike and apart == 1 and np.isfinite(one.low) == np.isfinite(one.high):
        for quarters in (1, 2, 3) if one.low != one.high else ():
            yield 1, replace(pair, way=turn, amount=float(quarters))


def _are_alike(one: NumberField, two: NumberField) -> bool:
    return (one.low, one.high) == (two.low, two.high)


def _part_undos(
    agents: tuple[str, ...], fields: Sequence[NumberField], deaf: frozenset[str]
) -> Iterator[Candidate]:
    """Parts of several numbers exchanged as wholes, as two entries of a Dict of one shape."""
    several = [part for part in _parts(fields) if len(part) > 1]
    for one, two in combinations(several, 2):
        bounds = [[(each.low, each.high) for each in part] for part in (one, two)]
        if bounds[0] == bounds[1] and not {each.name for each in (*one, *two)} <= deaf:
            places = tuple(each.place for each in (*one, *two[::-1]))
            names = tuple(".".join(map(str, part[0].part.path)) for part in (one, two))
            yield 0, BoundaryUndo(agents, "exchange fields", places, names=names)


def action_undos(agents: tuple[str, ...], axes: Sequence[NumberField]) -> Iterator[Candidate]:
    """Undos of what agents do."""
    for one in axes:
        if one.low != one.high:
            yield 0, BoundaryUndo(agents, "mirror axis", (one.place,))
    for one, two in combinations(axes if len(axes) <= MOST_FIELDS else (), 2):
        if _are_alike(one, two):
            yield from _pair_undos(agents, one, two, "exchange axes", "turn axes")
    for one in axes:
        name, tier = ("", 0) if len(axes) == 1 else (f"axis {one.place}", 2)
        yield from _value_undos(agents, one, "exchange actions", name, tier=tier)
    if axes and not any(each.is_whole for each in axes):
        for factor in FACTORS[:4]:
            yield 0, BoundaryUndo(agents, "rescale axes", amount=factor)


def _value_undos(
    agents: tuple[str, ...],
    axis: NumberField,
    way: Literal["exchange values", "exchange actions"],
    name: str,
    *,
    tier: int,
) -> Iterator[Candidate]:
    """Whole numbers exchanged, and those of an action shifted."""
    if not axis.is_whole or not np.isfinite([axis.low, axis.high]).all():
        return
    count = int(axis.high - axis.low) + 1
    for one in range(count if 2 < count <= MOST_VALUES else 0):
        for two in range(one + 1, count):
            values = (int(axis.low) + one, int(axis.low) + two)
            yield (
                tier,
                BoundaryUndo(agents, way, (axis.place, *values), names=(name,) if name else ()),
            )
    if count > 2 and way == "exchange actions":
        for by in (1.0, -1.0):
            yield tier, BoundaryUndo(agents, "shift actions", (axis.place,), by)


def shift_undos(
    agents: tuple[str, ...],
    fields: Sequence[NumberField],
    deaf: frozenset[str],
    axes: Sequence[NumberField],
    own: Sequence[Any],
) -> Iterator[Candidate]:
    """Constants added to a field of what an agent observes, or an axis of what it does; factors.

    How much is added is told by recorded values: a few parts of the span of most of them.
    """
    for one in fields if len(fields) <= MOST_SHIFTED else ():
        values = _numbers(one, own)
        if one.name in deaf or not values.size:
            continue
        low, high = np.quantile(values, (0.05, 0.95))
        undo = BoundaryUndo(agents, "shift field", (one.place,), names=(one.name,))
        for by in _constants(float(high - low), is_whole=one.is_whole):
            yield SHIFTED, replace(undo, amount=by)
        for by in (1.0, -1.0) if 2 <= _span(one) < MOST_VALUES else ():
            yield SHIFTED, replace(undo, way="shift values", amount=by)
        yield from _scaled(replace(undo, way="rescale fields"), one, fields)
    yield from _scaled_together(agents, fields if len(fields) <= MOST_SHIFTED else (), deaf)
    for one in axes if len(axes) <= MOST_SHIFTED else ():
        if np.isfinite([one.low, one.high]).all() and not one.is_whole:
            for by in _constants(one.high - one.low, is_whole=False):
                yield SHIFTED, BoundaryUndo(agents, "shift axis", (one.place,), by)
        yield from _scaled(BoundaryUndo(agents, "rescale axes", (one.place,)), one, axes)


def _scaled(
    undo: BoundaryUndo, one: NumberField, every: Sequence[NumberField]
) -> Iterator[Candidate]:
    """One of several numbers multiplied, after all constants."""
    for factor in () if one.is_whole or len(every) == 1 else FACTORS[:4]:
        yield SHIFTED + 1, replace(undo, amount=factor)


def _scaled_together(
    agents: tuple[str, ...], fields: Sequence[NumberField], deaf: frozenset[str]
) -> Iterator[Candidate]:
    """Two neighbours of equal bounds multiplied, and parts of more: vectors have one unit."""
    vectors = [
        (one, two)
        for one, two in pairwise(fields)
        if one.part.path == two.part.path and _are_alike(one, two)
    ]
    parts = [tuple(part) for part in _parts(fields) if len(part) > 2]
    for vector in (*vectors, *parts):
        names = tuple(each.name for each in vector)
        if len(vector) < len(fields) and not any(x.is_whole or x.name in deaf for x in vector):
            places = tuple(each.place for each in vector)
            for factor in FACTORS[:4]:
                undo = BoundaryUndo(agents, "rescale fields", places, factor, names)
                yield SHIFTED + 2, undo


def _parts(fields: Sequence[NumberField]) -> Iterable[list[NumberField]]:
    """Numbers of each part, as of an entry of a Dict."""
    parts: dict[tuple[Any, ...], list[NumberField]] = {}
    for each in fields:
        parts.setdefault(each.part.path, []).append(each)
    return parts.values()


def _constants(span: float, *, is_whole: bool) -> list[float]:
    """Constants of both signs, rounded for people; of whole numbers 1 and 2."""
    if not span > 0:
        return []
    parts = (1.0, 2.0) if is_whole else [float(f"{part * span:.2g}") for part in PARTS]
    return [sign * part for part in parts for sign in (1, -1)]


def call_undos(
    agents: tuple[str, ...], lags: Sequence[int], randomness: float
) -> Iterator[Candidate]:
    """Undos of when policies are asked: a lag only where one was measured, draws where it draws."""
    for lag in sorted({lag for lag in lags if lag > 0}):
        yield 0, BoundaryUndo(agents, "settle", amount=float(lag))
    if randomness >= DRAWN:
        yield 0, BoundaryUndo(agents, "commonest", amount=float(COMMONEST_OF))
    for turns in HOLDS:
        yield 0, BoundaryUndo(agents, "hold", amount=float(turns))


def is_known_range(
    undo: BoundaryUndo, fields: Sequence[NumberField], own: Sequence[Any], known: Sequence[Any]
) -> bool:
    """Tells whether an undo shows an agent values as they occur in its fields.

    Where it doesn't, as of a clock that is mirrored below 0, what it restores shows no fault of
    perception: the policy may only be kept from what sets its fault off. Exchanged and rescaled
    fields may well leave what was recorded of a failing agent; where a declared bound was reached,
    all within the bounds may occur.

    Args:
        own: recorded observations of the agents that it is for.
        known: those of all agents with their space.
    """
    if undo.way not in ("mirror field", "turn fields") or not own:
        return True
    shown = [*map(passed_with(undo, fields, is_action=False), own)]
    for field in (fields[place] for place in undo.places):
        there = _numbers(field, known)
        now = _numbers(field, shown)
        if not there.size or there.min() <= field.low or there.max() >= field.high:
            continue
        if np.mean((now < there.min()) | (now > there.max())) > UNKNOWN:
            return False
    return True


def _numbers(field: NumberField, observations: Sequence[Any]) -> Any:
    read = [field.read(each) for each in observations]
    return np.array([number for number in read if number is not None], np.float64)


def candidates_of(
    open_setup: OpenSetup,
    responses: Mapping[str, ResponseTest],
    agents: Sequence[str],
    seen: Mapping[str, Sequence[Any]] | None = None,
) -> list[BoundaryUndo]:
    """The undos of single agents and of agents that one policy plays, likely ones first.

    Agents take turns, so that those of one with few aren't put off by another's many. Constants
    come last.

    Args:
        open_setup: the set-up as it is.
        responses: response tests of its policies; of agents without one nothing is left out.
        agents: those that are tried.
        seen: recorded observations by agent; undos that show others are left out.
    """
    ranked: list[tuple[bool, int, int, BoundaryUndo]] = []
    for number, group in enumerate(_groups(open_setup, agents)):
        likely = sorted(
            _of_group(open_setup, group, responses, seen or {}), key=lambda each: each[0]
        )
        ranked += [
            (tier >= SHIFTED, place, number, undo) for place, (tier, undo) in enumerate(likely)
        ]
    return [undo for *_, undo in sorted(ranked, key=lambda each: each[:3])]


def is_either(open_setup: OpenSetup, undo: BoundaryUndo) -> bool:
    """Tells whether no undo at the other boundary could do what this one does, so far as is tried.

    What a policy does with whole numbers may be undone by other values of what it observes or of
    what it does; only pairs of a few values are exchanged, and observed ones aren't shifted.
    """
    agent = undo.agents[0]
    observed, acted = observation_space(open_setup.env, agent), action_space(open_setup.env, agent)
    if observed is None or acted is None:
        return False
    own: Sequence[NumberField] = observed_fields(open_setup.contract, agent, observed)
    others: Sequence[NumberField] = acted_fields(acted)
    if undo.component == "control":
        own, others = others, own
    most: float = 2 if undo.way == "shift actions" else MOST_VALUES
    span = _span(own[undo.places[0]]) if undo.way in ("mirror field", "mirror axis") else 0.0
    if span > 2:  # it exchanges two pairs of values or more, and of others only one is
        most = 3 if undo.component == "control" else min(span, most)  # an action for each value
    elif undo.component != "perception" and undo.way not in ("shift actions", "exchange actions"):
        return False
    return any(most <= _span(each) < np.inf for each in others)


def _span(field: NumberField) -> float:
    """The span of a field's whole numbers; 0 where it has others."""
    return field.high - field.low if field.is_whole else 0.0


def is_unmoved(agents: Sequence[str], responses: Mapping[str, ResponseTest]) -> bool:
    """Tells whether policies that were tested reacted to no change of what they observe.

    Reactions to changes that stay count, too.
    """
    known = [responses[agent] for agent in agents if agent in responses]
    tests = [each for each in known if each.is_repeatable]
    reacted = any(each.reactions or each.lasting for each in tests)
    return bool(tests) and not reacted and all(each.changes for each in tests)


def _groups(open_setup: OpenSetup, agents: Sequence[str]) -> list[tuple[str, ...]]:
    """Each agent, and agents with equal spaces that one policy plays, together."""
    together: dict[str, list[str]] = {}
    for agent in agents:
        spaces = (observation_space(open_setup.env, agent), action_space(open_setup.env, agent))
        named = open_setup.joint_policy.chosen_for(agent)
        together.setdefault(f"{named.name} {named.version} {spaces}", []).append(agent)
    several = [tuple(group) for group in together.values() if len(group) > 1]
    return [*several, *((agent,) for agent in agents)]


def _of_group(
    open_setup: OpenSetup,
    group: tuple[str, ...],
    responses: Mapping[str, ResponseTest],
    seen: Mapping[str, Sequence[Any]],
) -> Iterator[Candidate]:
    known = [responses[agent] for agent in group if agent in responses]
    tests = [each for each in known if each.is_repeatable]
    env, first = open_setup.env, group[0]
    observed, acted = observation_space(env, first), action_space(env, first)
    slowest = [max((x for x in each.lags if x <= MOST_LAG), default=0) for each in tests]
    patient = [max((x for x in each.lasting if x <= MOST_LAG), default=0) for each in tests]
    lags = [*slowest, *patient, *(each.lag or 0 for each in tests)]
    yield from call_undos(group, lags, max((each.randomness for each in known), default=0.0))
    is_still = is_unmoved(group, responses)
    fields: Sequence[NumberField] = ()
    own = [each for agent in group for each in seen.get(agent, ())]
    deaf = frozenset.intersection(*(frozenset(each.deaf) for each in tests)) if tests else NONE
    if observed is not None:
        fields = observed_fields(open_setup.contract, first, observed)
        alike = [a for a in seen if str(observation_space(env, a)) == str(observed)]
        known = [each for agent in alike for each in seen[agent]]
        for tier, undo in observation_undos(group, fields, NONE if is_still else deaf):
            # what was recorded may lie beyond what it reacts to: in another field, or in its scale
            is_apt = undo.way in WAKING if is_still else True
            if is_apt and is_known_range(undo, fields, own, known):
                yield tier, undo
    if is_still:
        return  # one constant in place of another would make up for nothing that it misreads
    axes = () if acted is None else acted_fields(acted)
    yield from action_undos(group, axes)
    if len(group) == 1:  # at all of several it would make up for what pushes them all
        yield from shift_undos(group, fields, deaf, axes, own)
