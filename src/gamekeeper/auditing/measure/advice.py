"""AEC or Parallel: one of them or either, from what later agents of a round find otherwise. Pure.

AEC fits where the order of a round decides state, legality or reward. Parallel fits where moves are
made together: it says what an agent knew when it chose, and costs one step a round. Where agents of
a round have nothing to do with each other both keep the game.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gamekeeper.auditing.measure.trials import FEWEST, Within
from gamekeeper.statistics.significance import wilson

REASONS: Final = ("state", "legality", "reward")
EITHER: Final = (
    "agents of a round don't affect each other; Parallel takes one step a round, AEC one for each "
    "agent"
)


@dataclass(frozen=True, slots=True)
class FormAdvice:
    """The API that fits, the reasons for AEC, and the evidence in words."""

    api: str | None
    because: tuple[str, ...]
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RoundSigns:
    """All that the advice reads.

    Attributes:
        api: `aec` or `parallel`, which the environment has.
        within: by reason, looks at later agents of the round of a replaced move.
        hits: changes of anything of another agent, at any lag.
        looks: at other agents.
        most_in_a_round: agents; with one there is nothing to order.
        priority: `roster`, `random`, `unclear`, `noisy` or None, as `roles.priority` has it.
        dictionary: effect of other orders of the action dictionary: none, draws, outcome, None.
        unsettled: the unchanged rerun differs, so that nothing can be said.
    """

    api: str
    within: Mapping[str, Within]
    hits: int
    looks: int
    most_in_a_round: int
    priority: str | None
    dictionary: str | None
    unsettled: bool


def advice(signs: RoundSigns) -> FormAdvice:
    """The API that fits what was seen; None where too little was."""
    found = _of_aec(signs) if signs.api == "aec" else _of_parallel(signs)
    if found is not None:
        return found
    if signs.most_in_a_round == 1:
        return FormAdvice("either", (), f"there is one agent; {EITHER}")
    if signs.looks < FEWEST:
        reason = "the unchanged rerun differs by itself" if signs.unsettled else "few could be made"
        text = (
            f"only {signs.looks} comparisons of other agents with one action replaced ({reason}): "
            "declare schedule.order and schedule.observe"
        )
        return FormAdvice(None, (), text)
    bound = wilson(0, signs.looks).high
    if not signs.hits:
        text = (
            f"no action changed anything of another agent in {signs.looks:,} comparisons "
            f"(below {bound:.3f})"
        )
        return FormAdvice("either", (), f"{text}; {EITHER}")
    return _together(signs)


def _of_aec(signs: RoundSigns) -> FormAdvice | None:
    because = tuple(reason for reason in REASONS if signs.within[reason].hits)
    if not because:
        return None
    parts = []
    for reason in because:
        each = signs.within[reason]
        share = wilson(each.hits, max(each.looks, each.hits))
        parts.append(
            f"{reason}: {each.shown} ({each.hits} of {each.looks} comparisons of later agents of "
            f"a round, 95 % interval {share.low:.2f} to {share.high:.2f})"
        )
    return FormAdvice("aec", because, f"the order of a round decides {'; '.join(parts)}")


def _of_parallel(signs: RoundSigns) -> FormAdvice | None:
    if signs.dictionary == "outcome":
        text = (
            "as it is, the order of the action dictionary decides the outcome; in AEC an order "
            "is part of the rules; Parallel fits once a rule without an order decides"
        )
        return FormAdvice("aec", ("reward",), text)
    if signs.priority == "roster":
        text = (
            "of two agents of a role, the action of the one that is first in the roster changes "
            "what the other is paid in the same tick, and never the reverse, whatever is drawn: "
            "ticks are resolved in turns, in an order that nobody declared"
        )
        return FormAdvice("aec", ("reward",), text)
    if signs.priority == "unclear":
        text = (
            "where only one of two agents of a role changed the other's reward of the same tick, "
            "it was always the earlier one in the roster, or always the later one; too rare to "
            "exclude chance: declare schedule.conflicts, or raise the budget"
        )
        return FormAdvice(None, (), text)
    return None


def _together(signs: RoundSigns) -> FormAdvice:
    if signs.api == "parallel":
        drawn = "; another order of the actions changed only which random draw was whose"
        drawn = drawn if signs.dictionary == "draws" else ""
        text = (
            "no order of the actions of a tick was found to matter, though actions affect other "
            f"agents (in {signs.hits:,} of {signs.looks:,} comparisons){drawn}"
        )
        return FormAdvice("parallel", (), text)
    looks = min(signs.within[reason].looks for reason in ("state", "reward"))
    if looks < FEWEST:
        text = f"only {looks} comparisons within a round: declare schedule.order and observe"
        return FormAdvice(None, (), text)
    return FormAdvice(
        "parallel",
        (),
        f"in {looks} comparisons with one action replaced no later agent of the round had "
        f"another observation, mask or reward (below {wilson(0, looks).high:.3f}): actions are "
        "simultaneous, though taken in turns",
    )
