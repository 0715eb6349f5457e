"""Answers from outcomes: the ideal substitutes that restore. Pure."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.diagnosis.trials import (
    CONTROL,
    ENVIRONMENT,
    PERCEPTION,
    POLICY,
    TIMING,
    IdealSubstitute,
)
from gamekeeper.diagnosis.undos import MESSAGES
from gamekeeper.episodes.outcome import LABELS
from gamekeeper.statistics.paired import PairedEffect, paired_effect
from gamekeeper.statistics.significance import holm, wilson

Answer = Literal[
    "healthy",
    "not_failing",
    "isolated",
    "joint",
    "ambiguous",
    "environment",
    "protocol",
    "elsewhere",
    "unexplained",
    "not_tried",
]
CAUSES: Final = ("isolated", "joint", "ambiguous", "environment", "protocol")
"""The answers that name a cause."""
Successes = NDArray[np.float64]
"""[episodes] 1 where the episode didn't fail, paired by seed between arms."""

EITHER: Final = f"{PERCEPTION} or {CONTROL}"
OR_DRAWN: Final = f"{TIMING} or what it draws"
OR_KEPT: Final = f"{TIMING} or what it keeps"
"""Places of a fault that are shown where an undo leaves its label open."""
HIDDEN: Final = {OR_DRAWN: "draws", OR_KEPT: "what is kept between turns"}
ALPHA: Final = 0.05
EXPECTED: Final = 0.9
"""The share of episodes that succeed where nothing is wrong, unless told otherwise."""
PART: Final = 0.7
"""An ideal substitute restores where it closes this part of the gap to the expected share."""

EASED: Final = 0.5
"""The part of the gap above which one undo of a pair is no fault that the other one hides."""


@dataclass(frozen=True, slots=True)
class Tried:
    """One ideal substitute against the unchanged rerun.

    Attributes:
        substitute: what was put at its ideal.
        effect: the change of the share of successes, with its interval.
        p: the effect's p-value, corrected for the number of ideal substitutes (Holm).
        recovered: the part of the gap that it closes; 1: up to the expected share.
        restores: it closes the stated part, and the effect isn't chance.
    """

    substitute: IdealSubstitute
    effect: PairedEffect
    p: float
    recovered: float
    restores: bool


@dataclass(frozen=True, slots=True)
class ScopeFinding:
    """Answer for one scope: the team, a role or an agent.

    Attributes:
        answer: as the glossary of `docs/diagnosis.md` has them; never `elsewhere`.
        labels: the causes that it names; none for a whole policy, or for all that it keeps.
        substitutes: the least ideal substitutes that restore.
        tried: everything that was tried on fresh seeds.
        success: the share of successes as it is: (share, low, high).
        why: in a sentence.
        beside: whole policies in an agent's place that restore as well as an undo that is named.
    """

    answer: Answer
    labels: tuple[str, ...]
    substitutes: tuple[IdealSubstitute, ...]
    tried: tuple[Tried, ...]
    success: tuple[float, float, float]
    why: str
    beside: tuple[IdealSubstitute, ...] = ()


def is_failing(unchanged: Successes, expected: float) -> bool:
    """The set-up fails more often than declared, beyond chance."""
    return wilson(int(unchanged.sum()), len(unchanged)).high < expected


def recovered(unchanged: Successes, arm: Successes, expected: float) -> float:
    """The part of the gap to the expected share that an arm closes; 0 where there is no gap."""
    gap = expected - float(unchanged.mean())
    return float(arm.mean() - unchanged.mean()) / gap if gap > 0 else 0.0


def judged(
    unchanged: Successes,
    arms: Mapping[IdealSubstitute, Successes],
    *,
    expected: float = EXPECTED,
    part: float = PART,
    everything: Successes | None = None,
    skipped: Sequence[IdealSubstitute] = (),
    limit: str = "budget",
    dropped: int = 0,
    paired: int = 0,
    least: Collection[str] = (),
    acquitted: Collection[str] = (),
    rng: Generator,
) -> ScopeFinding:
    """The answer that fresh seeds give.

    Args:
        unchanged: the set-up as it is, on fresh seeds.
        arms: each ideal substitute on the same seeds.
        expected: the declared share of successes.
        part: of the gap to it that an ideal substitute has to close.
        everything: all ideal substitutes at once, on the same seeds.
        skipped: ideal substitutes that weren't played, as the budget was spent.
        limit: what may be played at most, in words.
        dropped: undos and policies of peers that the search tried and dropped.
        paired: pairs of undos that the search tried.
        least: names of groups of which nothing can be left out; such a group goes before a part of
            it that it beats beyond chance.
        acquitted: agents whose undos show no fault of theirs.
        rng: for intervals that are drawn.
    """
    share = wilson(int(unchanged.sum()), len(unchanged))
    success = (share.p, share.low, share.high)
    tried = _tried(unchanged, arms, expected, part, dropped + paired, rng)
    blank = ScopeFinding("unexplained", (), (), tried, success, "")
    if not is_failing(unchanged, expected):
        why = (
            f"{int(unchanged.sum())} of {len(unchanged)} new episodes succeed ({share.p:.0%}, 95 % "
            f"interval {share.low:.0%} to {share.high:.0%}), not significantly below the expected "
            f"{expected:.0%}"
        )
        return replace(blank, answer="healthy" if share.p >= expected else "not_failing", why=why)
    wider = [one for one in tried if one.restores and one.substitute.name in least]
    best = _unbeaten(_least(_outdone(tried, wider, arms, rng)), arms, rng)
    # The smallest answer goes first: one substitute; a pair that beats both of its parts; all at
    # once.
    best = [one for one in best if not _is_cleared(one.substitute, acquitted)]
    best = [one for one in best if not _is_eased(one, tried)]
    singles = [one for one in best if not _is_of_several(one.substitute)]
    if singles:
        found = _of_singles(singles, blank, skipped, acquitted)
        return _beside_policies(found, arms, rng)
    better = [one for one in best if _beats_its_parts(one, arms, rng)]
    if better:
        return _of_pairs(better, blank)
    if best:
        why = (
            "a pair restores success, and one of its parts may do as well: more episodes would tell"
        )
        named = tuple(one.substitute for one in best)
        return replace(blank, answer="ambiguous", labels=_labels(named), substitutes=named, why=why)
    if everything is not None and recovered(unchanged, everything, expected) >= part:
        why = (
            "all ideal substitutes at once restore success, and no single one or pair that was "
            "played does"
        )
        return replace(blank, answer="ambiguous", labels=_labels(arms), why=why)
    why = _why_none(arms, everything, skipped, limit, dropped)
    why += f", nor do {paired} pairs of changes at two agents" if paired else ""
    return replace(blank, answer="unexplained" if arms or dropped else "not_tried", why=why)


def _is_eased(pair: Tried, tried: Sequence[Tried]) -> bool:
    """One undo of a pair does most of what both do: the other may only make up for the rest."""
    parts = {part.name for part in pair.substitute.parts} if pair.substitute.is_pair else ()
    return any(one.substitute.name in parts and one.recovered > EASED for one in tried)


def _is_cleared(one: IdealSubstitute, acquitted: Collection[str]) -> bool:
    return one.undo is not None and bool(one.agents) and {*one.agents} <= {*acquitted}


def _is_of_several(one: IdealSubstitute) -> bool:
    """Tells if it is of several components, or undos of several agents: each part may be enough."""
    return "+" in one.component or one.is_pair


def cut_early(finding: ScopeFinding, turn: int | None, horizon: int | None) -> ScopeFinding:
    """Answer from evidence alone, where no experiment gave one: cut off before the horizon.

    Args:
        turn: at which every failed recorded episode was truncated; None: they weren't.
        horizon: the declared one.
    """
    if turn is None or finding.answer not in ("unexplained", "not_tried"):
        return finding
    why = (
        f"every recorded episode that failed was truncated after {turn} turns, before the declared "
        f"horizon of {horizon}; by the evidence alone, as no argument that cuts it was found"
    )
    return replace(finding, answer="protocol", why=why)


def _why_none(
    arms: Mapping[IdealSubstitute, Successes],
    everything: Successes | None,
    skipped: Sequence[IdealSubstitute],
    limit: str,
    dropped: int,
) -> str:
    """Reason why no cause is named although the set-up fails."""
    if dropped:
        count = dropped + sum(one.undo is not None for one in arms)
        ideals = [one for one in arms if one.undo is None]
        begin = "no ideal substitute restores success, nor does any" if ideals else "none"
        end = ", each alone" if ideals else " restores success alone"
        what = "changes to an agent's observations, actions, memory or policy"
        return f"{begin} of {count} {what}{end}"
    if skipped:
        played = f"none of {len(arms)} that were played restores success" if arms else "none was"
        return f"the {limit} was reached before every ideal substitute was played, and {played}"
    if not arms:
        return (
            "nothing could be tested, as no knob that the contract declares ([knobs]) differs from "
            "its ideal value, and the environment has no reference policy"
        )
    if everything is None:
        return (
            "no single ideal substitute restores success, and the budget was spent before several "
            "at once were played"
        )
    return "no ideal substitute restores success, nor do all at once"


def _tried(
    unchanged: Successes,
    arms: Mapping[IdealSubstitute, Successes],
    expected: float,
    part: float,
    dropped: int,
    rng: Generator,
) -> tuple[Tried, ...]:
    """Effects of the arms; p is corrected for those that the search dropped, too."""
    effects = {
        substitute: paired_effect(unchanged, arm, rng=rng) for substitute, arm in arms.items()
    }
    corrected = holm([*(effect.p for effect in effects.values()), *[1.0] * dropped])
    return tuple(
        Tried(
            substitute,
            effect,
            p,
            share := recovered(unchanged, arms[substitute], expected),
            restores=share >= part and effect.value > 0 and p < ALPHA,
        )
        for (substitute, effect), p in zip(effects.items(), corrected, strict=False)
    )


def _least(tried: Sequence[Tried]) -> list[Tried]:
    """Interventions that restore success and contain no smaller one that does."""
    restoring = [one for one in tried if one.restores]
    return [
        one
        for one in restoring
        if not any(_is_within(other.substitute, one.substitute) for other in restoring)
    ]


def _outdone(
    tried: Sequence[Tried],
    wider: Sequence[Tried],
    arms: Mapping[IdealSubstitute, Successes],
    rng: Generator,
) -> list[Tried]:
    """Leaves out parts of a wider group, where the group beats them beyond chance."""
    return [
        one
        for one in tried
        if not any(
            one.substitute.name in whole.substitute.contains
            and one.substitute.component == whole.substitute.component
            and paired_effect(arms[one.substitute], arms[whole.substitute], rng=rng).low > 0
            for whole in wider
        )
    ]


def _unbeaten(
    least: list[Tried], arms: Mapping[IdealSubstitute, Successes], rng: Generator
) -> list[Tried]:
    """Those that restore, without undos that another undo beats beyond chance."""
    undos = [one for one in least if one.substitute.undo is not None]
    if not undos:
        return least
    best = max(undos, key=lambda one: float(arms[one.substitute].mean()))
    beaten = [
        one
        for one in undos
        if paired_effect(arms[one.substitute], arms[best.substitute], rng=rng).low > 0
    ]
    return [one for one in least if one not in beaten]


def _is_within(part: IdealSubstitute, whole: IdealSubstitute) -> bool:
    """One makes up for another, or several for all that fewer of them do and for more."""
    is_set = bool(whole.parts)
    fewer = part.component == whole.component and set(part.agents) < set(whole.agents)
    more = bool(part.parts) and part.contains < whole.contains
    return part.name in whole.contains or (is_set and (fewer or more))


def _beats_its_parts(
    pair: Tried, arms: Mapping[IdealSubstitute, Successes], rng: Generator
) -> bool:
    """A pair restores more episodes than either of its parts, beyond chance."""
    whole = arms[pair.substitute]
    return all(
        paired_effect(part, whole, rng=rng).low > 0
        for substitute, part in arms.items()
        if substitute.name in pair.substitute.contains
    )


def _of_singles(
    least: Sequence[Tried],
    blank: ScopeFinding,
    skipped: Sequence[IdealSubstitute],
    acquitted: Collection[str],
) -> ScopeFinding:
    tried = blank.tried
    substitutes = _at_both(_with_peers([one.substitute for one in least], tried))
    # What leaves the cause open is asked first: an agent is blamed only by what passes all of it.
    rivals = [one for one in skipped if not any(_is_within(each, one) for each in substitutes)]
    answer, why = _answer_of(substitutes, rivals, tried)
    if answer == "isolated":
        ties = [one for one in _ties(least, tried) if not _is_cleared(one, acquitted)]
        names = " and by ".join(one.name for one in ties)
        why += f"; as much changes by {names}, not yet beyond chance" if ties else ""
        answer, substitutes = "ambiguous" if ties else answer, (*substitutes, *ties)
    labels = _labels((*substitutes, *rivals))
    return replace(blank, answer=answer, labels=labels, substitutes=substitutes, why=why)


def _ties(least: Sequence[Tried], tried: Sequence[Tried]) -> list[IdealSubstitute]:
    """Others of another place, in which the success rate rises as much, if not beyond chance.

    The correction for all that were tried may let one of several equal effects pass: that one
    isn't shown to be the only one.
    """
    names = {one.substitute.name for one in least}
    places = {(one.substitute.component, one.substitute.agents) for one in least}
    most = max(one.effect.value for one in least)
    return [
        one.substitute
        for one in tried
        if not one.restores
        and one.effect.value >= most
        and one.effect.low > 0
        and not one.substitute.contains & names
        and not _is_of_several(one.substitute)
        and (one.substitute.component, one.substitute.agents) not in places
    ]


def _at_both(substitutes: Sequence[IdealSubstitute]) -> tuple[IdealSubstitute, ...]:
    """The same; a place of a fault stays no longer open where both boundaries have an undo."""
    touched: dict[tuple[str, ...], set[str]] = {}
    for one in substitutes:
        for leaf in one.leaves:
            touched.setdefault(leaf.agents, set()).add(leaf.component)

    def told(one: IdealSubstitute) -> IdealSubstitute:
        if one.parts:
            return replace(one, parts=tuple(map(told, one.parts)))
        is_told = one.open_as == EITHER and {PERCEPTION, CONTROL} <= touched[one.agents]
        return replace(one, open_as="") if is_told else one

    return tuple(map(told, substitutes))


def _answer_of(
    substitutes: Sequence[IdealSubstitute],
    rivals: Sequence[IdealSubstitute],
    tried: Sequence[Tried],
) -> tuple[Answer, str]:
    """Answer and reason where each of some substitutes restores.

    Args:
        rivals: others, which weren't played on fresh seeds.
    """
    names = ", ".join(substitute.name for substitute in substitutes)
    if rivals:
        is_undo = any(one.undo is not None for one in rivals)
        what = "other undos from outside" if is_undo else "other ideal substitutes"
        return "ambiguous", (
            f"{names} restores success, and {len(rivals)} {what} weren't played on fresh seeds, "
            "as the budget was spent: they may restore it too"
        )
    if all(one.cut_off == "later" for one in substitutes):
        why = f"{names} restores success: it is cut off too early, or its agents are too slow"
        return "ambiguous", why
    if all(one.cut_off is not None for one in substitutes):
        return (
            "protocol",
            f"{names} restores success, and nothing that was changed of an agent does",
        )
    if all(one.component == ENVIRONMENT for one in substitutes):
        why = f"{names} restores success, which is the same for all agents and nobody's own"
        return "environment", why
    if all(one.component == MESSAGES for one in substitutes):
        why = f"undone by {names}: messages are late or lost on their way, which is no agent's own"
        return "environment", why
    if any(one.between for one in substitutes):
        places = " or ".join(dict.fromkeys(one.shown for one in substitutes))
        return "ambiguous", (
            f"undone by {' or '.join(one.name for one in substitutes)}: {places}; whether messages "
            "are said or read wrongly, or change on their way, can't be told apart by this"
        )
    if len({(one.component, one.agents) for one in substitutes}) > 1:
        why = f"each of {names} restores success, so these causes can't be told apart"
        return "ambiguous", why
    if substitutes[0].undo is not None:
        return "isolated", _undone_by(substitutes)
    if len(substitutes) == 1 and _is_joint(substitutes[0], tried):
        return "joint", f"{names}: all together restore success, none does alone"
    why = f"{names} restores success, and no other ideal substitute that was played does"
    if len(substitutes[0].leaves) > 1:
        why += f": it is {substitutes[0].shown}, all of which is needed"
    elif not _labels(substitutes):
        why += f": it is {substitutes[0].shown}; which part of it can't be told apart by this"
    return "isolated", why


def _undone_by(substitutes: Sequence[IdealSubstitute]) -> str:
    """Reason of an answer that undos from outside give, and what it leaves open."""
    why = f"undone by {' or '.join(one.name for one in substitutes)}"
    if is_any_scale(substitutes):
        return (
            f"{why}: as several scales do alike, the units aren't shown to be wrong; what its "
            "policy does with what it observes may be"
        )
    if is_any_exchange(substitutes):
        return (
            f"{why}: as several exchanges of one field do alike, none is shown to be taken for "
            "another; what its policy does with that field may be wrong"
        )
    if (hidden := HIDDEN.get(substitutes[0].open_as)) is not None:
        return f"{why}: it is {substitutes[0].shown}; an action that is held also hides {hidden}"
    if substitutes[0].open_as == POLICY:
        return f"{why}, as it reacts to nothing without; which part of it can't be told apart"
    if substitutes[0].open_as:
        return (
            f"{why}: it is {substitutes[0].shown}; no undo of the other boundary that was tried "
            "could do the same"
        )
    return why


def _beside_policies(
    finding: ScopeFinding, arms: Mapping[IdealSubstitute, Successes], rng: Generator
) -> ScopeFinding:
    """The same, and in its reason the policies in an agent's place that restore as it does.

    They make up for what is named, and for all else of that agent: one that restores more shows
    that the rest may matter.
    """
    named = {one.name for one in finding.substitutes}
    found = [
        one.substitute
        for one in finding.tried
        if one.restores
        and one.substitute.component == POLICY
        and not one.substitute.parts
        and one.substitute.name not in named
        and one.substitute.contains & named
    ]
    if not found:
        return finding
    best = max((arms[one] for one in arms if one.name in named), key=np.mean)
    more = [one for one in found if paired_effect(best, arms[one], rng=rng).low > 0]
    why = f"{finding.why}; so does {' or '.join(one.name for one in found if one not in more)}"
    why = finding.why if len(more) == len(found) else why
    if more:
        names = " or ".join(one.name for one in more)
        why += f"; {names} restores more: something else of its policy may be wrong too"
    if more and finding.answer == "isolated":  # a part that makes up for some of it is no cause
        wider = tuple(
            one if one.undo is None else replace(one, open_as=POLICY) for one in finding.substitutes
        )
        finding = replace(finding, substitutes=wider, labels=())
    return replace(finding, why=why, beside=tuple(found))


def _with_peers(
    substitutes: Sequence[IdealSubstitute], tried: Sequence[Tried]
) -> tuple[IdealSubstitute, ...]:
    """The same; of messages only the side whose policy, replaced by another's, restores alone.

    The other side gets along with that policy, so that the messages between them are sound.
    """
    swapped = {
        one.substitute.agents
        for one in tried
        if one.restores and one.substitute.component == POLICY and one.substitute.undo is None
    }
    found: list[IdealSubstitute] = []
    for one in substitutes:
        sides = [agent for agent in one.between if (agent,) in swapped]
        if len(sides) != 1:
            found.append(one)
        elif one.agents == (sides[0],):
            found.append(replace(one, between=()))
    return tuple(found) or tuple(substitutes)


def _is_joint(whole: IdealSubstitute, tried: Sequence[Tried]) -> bool:
    """Tells whether it is of several agents, each of whose parts was tried and restores nothing."""
    failed = {one.substitute.name for one in tried if not one.restores}
    is_of_several = len({leaf.agents for leaf in whole.leaves}) > 1
    return is_of_several and {leaf.name for leaf in whole.leaves} <= failed


def _of_pairs(least: Sequence[Tried], blank: ScopeFinding) -> ScopeFinding:
    """Pairs restore, and neither of their parts does."""
    substitutes = _at_both([one.substitute for one in least])
    names = "; ".join(substitute.name for substitute in substitutes)
    answer: Answer = "joint" if len(substitutes) == 1 else "ambiguous"
    why = f"several pairs restore success ({names}), so these causes can't be told apart"
    if answer == "joint":
        why = f"{names}: both together restore success, neither does alone"
    labels = _labels(substitutes)
    return replace(blank, answer=answer, labels=labels, substitutes=substitutes, why=why)


def is_any_scale(substitutes: Sequence[IdealSubstitute]) -> bool:
    """Tells whether different scales of one agent's observation restore: none is the right one."""
    undos = [one.undo for one in substitutes if one.undo is not None]
    scales = {(each.way, each.amount) for each in undos if each.way in SCALES}
    return len(scales) > 1


def is_any_exchange(substitutes: Sequence[IdealSubstitute]) -> bool:
    """Tells whether one field may be exchanged for different others: none is taken for another.

    What they share is that a field isn't shown as it is, which may set a fault off.
    """
    undos = [one.undo for one in substitutes if one.undo is not None]
    pairs = {(each.agents, frozenset(each.places)) for each in undos if each.way == EXCHANGE}
    return any(
        one[0] == two[0] and one[1] != two[1] and one[1] & two[1] for one in pairs for two in pairs
    )


def _labels(substitutes: Any) -> tuple[str, ...]:
    every = tuple(substitutes)
    if is_any_exchange(substitutes):
        substitutes = [one for one in substitutes if one.undo is None or one.undo.way != EXCHANGE]
    if is_any_scale(substitutes):
        scales = (*SCALES, "rescale axes")
        substitutes = [one for one in substitutes if one.undo is None or one.undo.way not in scales]
    named = {label for one in substitutes if not _is_open(one, every) for label in one.labels}
    return tuple(label for label in LABELS if label in named)


def _is_open(one: IdealSubstitute, rivals: Any) -> bool:
    """Tells whether an undo without a label does as well at the same agents: then none is sure."""
    return any((each.is_gain or each.is_offset) and each.agents == one.agents for each in rivals)


EXCHANGE: Final = "exchange fields"
SCALES: Final = ("rescale fields", "normalize fields")
"""Undos that scale what an agent observes."""
