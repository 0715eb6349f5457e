"""Answers about time: their contradictions, and the API that follows from them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from gamekeeper.errors import SpecError

ORDER_TEXTS: Final = {
    "fixed": "a fixed order",
    "rotating": "a rotating order",
    "random": "a random order",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """Answers about the order of actions, and of what is observed; None: not answered yet.

    Args:
        stages: roles that act together, group after group.
        sizes: number of agents in each stage.
        observe: observations are of the state `after tick` or `after turn`.
        order: within a stage: none, fixed, rotating, state, random.
        conflicts: rule for actions that exclude each other.
        api: `aec` or `parallel`.
    """

    stages: Sequence[Sequence[str]]
    sizes: Sequence[int]
    observe: str | None = None
    order: str | None = None
    conflicts: str | None = None
    api: str | None = None

    @property
    def is_seen(self) -> bool:
        """Agents observe others' actions of the same round before they act."""
        return self.observe == "after turn"


def check_timing(timing: Timing) -> Timing:
    """Returns the answers, as far as they are given, if they don't contradict each other.

    Raises:
        SpecError: two of them contradict each other; says why, and names answers that don't.
    """
    for error in _contradictions(timing):
        raise error
    return timing


def _contradictions(timing: Timing) -> Iterator[SpecError]:
    order, conflicts = timing.order, timing.conflicts
    if timing.is_seen and sum(timing.sizes) == 1:
        yield _contradiction(
            "one agent has no others whose actions it could observe",
            "--sees yes, --agents",
            "--sees no; or --agents with another one",
        )
    if timing.is_seen and order == "none" and len(timing.stages) == 1:
        yield _contradiction(
            "agents that act all at once can't observe each other's actions before they act",
            "--sees yes, --order none",
            "--order fixed, rotating, random or state; or --sees no; or --stages with a comma, "
            "where one role acts after another",
        )
    if (
        timing.observe == "after tick"
        and order in ORDER_TEXTS
        and conflicts not in (None, "ordered")
    ):
        yield _contradiction(
            f"{ORDER_TEXTS[order]} that no agent observes, and that settles no conflict, has no "
            "effect",
            f"--sees no, --order {order}, --conflicts {conflicts!r}",
            "--order none; or --sees yes, where later agents observe earlier actions; or "
            "--conflicts ordered, where the earlier of two actions counts",
        )
    if order == "none" and conflicts == "ordered":
        yield _contradiction(
            "no action comes first where agents act all at once, so the first can't win a conflict",
            "--order none, --conflicts ordered",
            "--order fixed, rotating, random or state; or --conflicts 'joint rule', priority or "
            "random",
        )
    if order in ("rotating", "state", "random") and max(timing.sizes) == 1:
        yield _contradiction(
            f"each group has one agent, which leaves nothing for the order {order!r} to change",
            f"--order {order}, --agents, --stages",
            "--order fixed; or --stages with a +, where roles act in one group",
        )
    if timing.api == "parallel" and timing.is_seen:
        yield _contradiction(
            "a ParallelEnv can't show anything before its tick is over",
            "--sees yes, --api parallel",
            "--api aec; or --sees no",
        )
    if timing.api == "parallel" and order in ("rotating", "state", "random"):
        yield _contradiction(
            f"a ParallelEnv takes all actions at once, so the order {order!r} isn't one of turns",
            f"--order {order}, --api parallel",
            "--api aec; or --order none",
        )


def _contradiction(what: str, where: str, fix: str) -> SpecError:
    return SpecError(
        what, where=where, expected="answers that are true together", actual=where, fix=fix
    )


@dataclass(frozen=True, slots=True)
class TimingAdvice:
    """An API, and the reason for it in one sentence; `reasons` are all reasons for it."""

    api: str
    why: str
    reasons: tuple[str, ...] = ()


def advise(timing: Timing) -> TimingAdvice:
    """Advises the API that fits a schedule.

    AEC where an agent's observation, its turn or its reward depends on the order of actions in a
    round: a Parallel environment gives all observations before any agent acts. Parallel everywhere
    else: it has no order that a policy could exploit, and a joint step is cheaper than turns.
    """
    reasons = []
    stages, order, conflicts = timing.stages, timing.order or "none", timing.conflicts
    if order == "state":
        reasons.append("the next agent depends on the state")
    if timing.is_seen and len(stages) > 1:
        first, then = (" and ".join(stage) for stage in stages[:2])
        reasons.append(f"{then} must observe the actions of {first} in the same round")
    elif timing.is_seen and order in ORDER_TEXTS:
        reasons.append(f"agents act in {ORDER_TEXTS[order]} and observe each turn before theirs")
    elif timing.is_seen:
        reasons.append("an agent observes others' actions of the same round before it acts")
    if conflicts == "ordered":
        turns = f" in {ORDER_TEXTS[order]}" if order in ORDER_TEXTS else ""
        reasons.append(f"of two actions{turns} that exclude each other the earlier one counts")
    if reasons:
        return TimingAdvice("aec", "; ".join(reasons), tuple(reasons))
    rule = {"priority": "by priority", "random": "at random"}.get(
        conflicts or "", "by one joint rule"
    )
    reason = (
        "agents don't observe others' actions of the same round before acting, and a tick is "
        f"resolved {rule}"
    )
    if len(stages) > 1:
        reason += ", group after group inside it"
    return TimingAdvice("parallel", reason, (reason,))
