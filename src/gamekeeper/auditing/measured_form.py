"""The structure as it was seen, beside what is declared. Pure."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.auditing.measure import form, roles, roster_changes, trials
from gamekeeper.auditing.measure.advice import FormAdvice, RoundSigns, advice
from gamekeeper.auditing.measure.payments import payments
from gamekeeper.checks.facts.episode_facts import OrderOutcome
from gamekeeper.checks.facts.form_facts import (
    DrawnPriority,
    EpisodeShape,
    FormError,
    MoveTrial,
    UnsettledMoves,
)
from gamekeeper.checks.facts.surface_facts import TimeLimits
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.contract import Contract
from gamekeeper.episodes.layout import role
from gamekeeper.statistics.significance import holm

PROBES: Final[tuple[str, ...]] = ("rollout", "order", "form", "same_seed")
"""Probes whose looks it reads."""
LEVEL: Final = 0.01
NOT_SEEN: Final[Mapping[str, str]] = {
    "stages": "fewer than three rounds in which agents acted in an order that means something",
    "order": "no round had two agents, or it isn't known whether their actions are simultaneous",
    "observe": "too few comparisons of what later agents of a round observe, or no observation "
    "shows its own step's action",
    "conflicts": "too few actions of one tick changed each other's rewards to tell a joint rule "
    "from a fixed order of names, or random draws hide it",
    "legality": "too few comparisons of masks of other agents",
    "messages": "too few comparisons of what replaced actions change",
    "deterministic": "no episode was rerun, or the rerun in a used instance can't be compared, as "
    "that differs from a new one (GK604)",
    "horizon": "no two whole episodes were truncated at the same length",
    "symmetric": "too few episodes in which two agents of a role came to different results",
    "advice": "too few comparisons",
}
"""Reasons why a field has no value."""


def measured(contract: Contract, evidence: ProbeEvidence) -> dict[str, Any]:
    """Measured structure, by the names of the audit's document; None where it couldn't be.

    The contract only says which agents are of one role; nothing is judged here.
    """
    episodes, api = evidence["rollout"], evidence.api
    shapes = [fact.value for fact in evidence.facts(EpisodeShape)]
    moves, order = evidence.facts(MoveTrial), {} if evidence.blind else _order(evidence)
    within = trials.within_rounds(moves)
    if not order and shapes and api == "parallel" and _most_movers(shapes) == 1:
        order = {"result": "none"}  # of one action there is one order
    drawn = [fact.value for fact in evidence.facts(DrawnPriority)]
    ticks = moves if api == "parallel" else ()
    priority, ranked = roles.priority(drawn, ticks, list(evidence.agents))
    advised = advice(_signs(evidence, shapes, within, priority, order))
    turn_order = form.order_of_turns(shapes, [fact.value for fact in moves])
    play_order = _play_order(api, advised, turn_order, shapes)
    settled = _deterministic(evidence)  # else draws that no seed determines are held equal
    by_role, paid = roles_of(contract, evidence), payments(episodes, api)
    # one reward for all is changed by every move: it doesn't show whose move came first
    is_joint = not paid.get("shared") and trials.contests(moves) >= roles.ALIKE
    limit = roster_changes.horizon(shapes)
    found = {
        "stages": form.stages(shapes, by_role, play_order),
        "order": play_order,
        "observe": _observe(api, within, moves),
        "conflicts": _conflicts(api, advised, priority, order, is_joint=is_joint),
        "legality": trials.legality(moves),
        "messages": trials.messages(moves),
        "order_sensitive": order.get("result"),
        "order_ticks": order.get("ticks"),
        "deterministic": None if settled is False and _depends_on_use(evidence) else settled,
        "horizon": limit,
        "near_limits": _near(limit, evidence),
        "symmetric": roles.symmetric(
            [] if settled is False else shapes,
            [] if settled is False else episodes,
            {
                name: agents
                for name, agents in by_role.items()
                if priority != "unclear" or name not in ranked
            },
            _first_comes(within, ranked, play_order),
        ),
        "reward": {**paid, "pairs": trials.pairs(moves)},
        "endings": {**form.endings(episodes), "kinds": roster_changes.kinds_of_endings(shapes)},
        "may_join": roster_changes.joined(shapes) if shapes else None,
        "may_leave": roster_changes.left(shapes) if shapes else None,
        "influence": trials.influence(moves),
        "looked_ahead": max((fact.value.ahead for fact in moves), default=0) or None,
        "advice": advised.api,
        "because": list(advised.because),
        "why": advised.why,
        "errors": _errors(evidence),
    }
    silent = {key: why for key, why in NOT_SEEN.items() if found[key] is None}
    if "symmetric" in silent:
        silent["symmetric"] = _asymmetric(by_role, settled, priority) or silent["symmetric"]
    return {**found, "not_measured": silent}


def _near(horizon: int | None, evidence: ProbeEvidence) -> dict[str, int]:
    """Attributes and arguments called like a limit that miss the measured horizon by one tick."""
    named = [fact.value.limits for fact in evidence.facts(TimeLimits)]
    if horizon is None or any(horizon in each.values() for each in named):
        return {}
    return {
        name: value
        for each in named[:1]
        for name, value in each.items()
        if abs(value - horizon) == 1
    }


def _asymmetric(
    by_role: Mapping[str, Sequence[str]], settled: bool | None, priority: str | None
) -> str | None:
    """Reason why symmetry of roles wasn't looked at; None where it was."""
    if all(len(agents) < 2 for agents in by_role.values()):
        return "each role has one agent (roles by declaration, else by names without their number)"
    if settled is False:
        return "reruns of one seed differ by themselves"
    if priority == "unclear":
        return "it isn't known whether an order of the names decides conflicts"
    return None


def _signs(
    evidence: ProbeEvidence,
    shapes: Sequence[EpisodeShape],
    within: Mapping[str, trials.Within],
    priority: str | None,
    order: Mapping[str, Any],
) -> RoundSigns:
    hits, looks = trials.between_agents(evidence.facts(MoveTrial))
    return RoundSigns(
        api=evidence.api,
        within=within,
        hits=hits,
        looks=looks,
        most_in_a_round=_most_movers(shapes),
        priority=priority,
        dictionary=order.get("result"),
        unsettled=bool(evidence.facts(UnsettledMoves)),
    )


def _errors(evidence: ProbeEvidence) -> list[dict[str, Any]]:
    """Exceptions of the environment that kept episodes or replaced moves from being looked at."""
    counts = Counter((fact.value.during, fact.value.error) for fact in evidence.facts(FormError))
    return [
        {"during": during, "error": error, "episodes": count}
        for (during, error), count in counts.most_common()
    ]


def _most_movers(shapes: Sequence[EpisodeShape]) -> int:
    """The most agents that acted in one round."""
    return max((len(each) for shape in shapes for each in shape.rounds), default=0)


def _play_order(
    api: str, advised: FormAdvice, order: str | None, shapes: Sequence[EpisodeShape]
) -> str | None:
    """Order of the contract's words: `none` where moves are made together, whatever the turns."""
    if api == "parallel":
        return "none" if shapes else None
    return {"parallel": "none", None: None}.get(advised.api, order)


def _observe(api: str, within: Mapping[str, trials.Within], moves: trials.Trials) -> str | None:
    if api == "parallel":  # seen in what the step itself hands out, with which the next is decided
        return "after tick" if trials.is_observed_at_once(moves) else None
    if within["state"].hits or within["legality"].hits:
        return "after turn"
    return "after tick" if within["state"].looks >= trials.FEWEST else None


def _conflicts(
    api: str, advised: FormAdvice, priority: str | None, order: Mapping[str, Any], *, is_joint: bool
) -> str | None:
    """The rule for conflicts; a joint one where agents took from each other, or nothing at all."""
    if api == "parallel":
        if order.get("result") == "outcome":
            return "priority"
        words = {"roster": "priority", "random": "random", "unclear": None, "noisy": None}
        is_shown = advised.api == "either" or (advised.api == "parallel" and is_joint)
        return words.get(priority or "", "joint rule" if is_shown else None)
    if advised.api == "aec":
        return "ordered"
    return "joint rule" if advised.api else None


def _first_comes(
    within: Mapping[str, trials.Within], ranked: frozenset[str], order: str | None
) -> dict[str, str]:
    """Roles in which an order of the names decides, and the reason."""
    found = dict.fromkeys(sorted(ranked), "of two moves the first agent's in the roster counts")
    if order == "fixed":
        names = sorted({name for each in within.values() for name in each.roles})
        found.update(dict.fromkeys(names, "its agents act in a fixed order that decides"))
    return found


def _order(evidence: ProbeEvidence) -> dict[str, Any]:
    """Effect of other orders of the action dictionary at worst, and in how many ticks."""
    found: dict[str, Any] = {}
    facts = [fact.value for fact in evidence.facts(OrderOutcome)]
    corrected = iter(holm([p for value in facts for p in value.p_values]))
    ranks = ("none", "draws", "outcome")
    for value in facts:
        p = min((next(corrected) for _ in value.p_values), default=1.0)
        result = {"draws": "draws", "undecided": "draws", "outcome": "outcome"}.get(value.result)
        if value.result == "noise":
            continue
        result = "outcome" if p <= LEVEL else result or "none"
        worst = max(result, found.get("result", "none"), key=ranks.index)
        found = {"result": worst, "ticks": found.get("ticks", 0) + value.ticks}
    return found


def _deterministic(evidence: ProbeEvidence) -> bool | None:
    """Tells whether seed and actions settled every rerun; None where there was none with a turn."""
    influence = evidence.counterfactuals("influence")
    unchanged_reruns = {id(x.unchanged_rerun): x.noise is None for x in influence}
    rollouts = evidence["rollout"]
    if evidence.blind or (rollouts and not any(episode.turns for episode in rollouts)):
        return None
    orders = [fact.value.result != "noise" for fact in evidence.facts(OrderOutcome)]
    again = _repeats(evidence, "nothing", "the global generators")
    again += [x.divergence is None for x in evidence.counterfactuals("generators")]
    elsewhere = evidence.counterfactuals("other_process")
    again += [x.divergence is None for x in elsewhere if x.noise is None]
    reruns = [*unchanged_reruns.values(), *orders, *again]
    return all(reruns) if reruns else None


def _repeats(evidence: ProbeEvidence, *changes: str) -> list[bool]:
    """For each episode played again from its seed with one of these changes, if it was the same."""
    again = evidence.counterfactuals("same_seed")
    return [x.divergence is None for x in again if x.change["change"] in changes]


def _depends_on_use(evidence: ProbeEvidence) -> bool:
    """Tells whether fresh instances give the same episode again, and a used one doesn't.

    Then reruns in one instance differ by that fault, and say nothing of seeds.
    """
    again, used = _repeats(evidence, "nothing"), evidence.counterfactuals("second_episode")
    is_used = any(each.divergence is not None and each.noise is None for each in used)
    return bool(again) and all(again) and is_used


def roles_of(contract: Contract, evidence: ProbeEvidence) -> Mapping[str, Sequence[str]]:
    """The agents by their declared role, else by their names without a number."""
    found: dict[str, list[str]] = {}
    for agent in evidence.agents:
        found.setdefault(contract.role_of(agent) or role(agent), []).append(agent)
    return found
