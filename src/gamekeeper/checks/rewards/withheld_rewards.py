"""Rewards of environments that pay in every step: lost by a truncation, or some steps late."""

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import MEDIUM, Case, Cases, check
from gamekeeper.checks.effects import by_turn, changed_numbers
from gamekeeper.checks.literal import literal
from gamekeeper.checks.probe_evidence import ProbeCounterfactual, ProbeEvidence
from gamekeeper.checks.rewards.reward_delay import hang_on_later_draws
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode, Turn

DENSE: Final = 0.9
"""Part of the steps that pay somebody."""
LEAST_STEPS: Final = 60
LEAST_CUTS: Final = 4
"""Episodes, each of its own seed, that were truncated."""
LEAST_TRIALS: Final = 10
STEADY: Final = 0.9
"""Part of the replaced actions that move a reward with the same delay."""
MOST_LATE: Final = 4


def _paid_steps(episode: Episode) -> Iterator[tuple[Turn, Turn, bool]]:
    """Steps of live agents: the turn, the one after it, and whether somebody was paid."""
    turns = episode.turns
    for turn, after in pairwise(turns):
        if turn.order and not set(turn.order) <= turn.ended and not turn.raised:
            yield turn, after, any(turn.rewards.values())


@check(
    "GK412",
    MEDIUM,
    "rollout",
    confidence=0.9,
    looks_at="four truncated episodes whose other steps almost all pay a reward",
)
def truncations_lose_no_reward(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The step that truncates an episode pays like any other: its reward isn't lost.

    A limit from outside changes nothing of what was earned. A learner that is paid nothing in the
    last step values what led there wrongly, and returns are short of it.

    Judged only where at least 90 % of all other steps pay somebody: then each step that truncates
    paying nobody at all, in four episodes of different seeds or more, is no chance.

    Bad:
        if self.time >= self.horizon:
            return observations, dict.fromkeys(self.agents, 0.0), terminations, truncations, infos

    Good: compute the rewards of the step first, then the flags.

    Fix: leave the rewards of the last step as they are where truncations are set
    """
    ordinary: list[bool] = []
    cuts: dict[Any, list[tuple[Episode, Turn, bool]]] = {}
    for episode in evidence["rollout"]:
        for turn, after, is_paid in _paid_steps(episode):
            live = after.live - after.ended
            is_cut = any(after.truncated.values()) and not (live or any(after.terminated.values()))
            if is_cut:
                cuts.setdefault(episode.seed, []).append((episode, turn, is_paid))
            elif not after.ended:
                ordinary.append(is_paid)
    if len(ordinary) < LEAST_STEPS or sum(ordinary) < DENSE * len(ordinary):
        return
    looks = [each for seed in cuts for each in cuts[seed][:1]]
    is_lost = not any(is_paid for *_, is_paid in looks)
    books = "rewards" if evidence.api == "parallel" else "env.rewards"
    for episode, turn, _ in looks if len(looks) >= LEAST_CUTS else ():
        where = episode.at(turn, None, "rewards")
        expected = f"a reward, as in {sum(ordinary)} of {len(ordinary)} other steps"
        seen = f"nobody is paid in a step that truncates, in each of {len(looks)} episodes"
        yield Case(where, not is_lost, expected, seen, f"assert any({books}.values()), {books}")


@check(
    "GK413",
    MEDIUM,
    "influence",
    "rollout",
    confidence=0.8,
    looks_at="ten replaced actions that move a reward, in an environment whose steps almost all "
    "pay a reward",
)
def rewards_are_not_held_back(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A reward isn't held back for some steps: not the first steps pay nothing, nor is it lost.

    What is paid late credits other actions with it, and the last of an episode is never paid.

    Measured by intervention: one action is replaced, all others stay. It is broken only where each
    of these is seen: no action moved any reward of its own step, nine of ten (ten at least) moved
    one just the same number of steps later first; so many steps at the beginning of every episode
    pay nobody, and of all others 90 % pay somebody; the observation after the step shows what was
    done; no number of it moves for the first time when the reward does, as it would where
    goods that are paid arrive then; none waits with it, different until the reward is paid and no
    more after that, as that of goods on their way; and other draws in the step that pays don't
    change what the action is worth, as they do on a market.

    Bad: `self.due.append(rewards); return self.due.pop(0)`.

    Good: `return rewards`.

    Fix: pay in the step that earns it; where a delay is meant, show it in the observations
    """
    trials = [each for each in evidence.counterfactuals("influence") if each.noise is None]
    moved = [(each, lag) for each in trials if (lag := _first_lag(each)) is not None]
    if len(moved) < LEAST_TRIALS:
        return
    late, count = Counter(lag for _, lag in moved).most_common(1)[0]
    is_held_back = (
        0 < late <= MOST_LATE
        and min(lag for _, lag in moved) == late
        and count >= STEADY * len(moved)
        and not hang_on_later_draws(evidence)
        and _begins_unpaid(evidence, late)
        and _shows_at_once([each for each, lag in moved if lag == late], late)
    )
    for each, lag in moved:
        if lag == late or not is_held_back:
            agent, turn = str(each.change["agent"]), int(each.change["turn"])
            yield Case(
                each.base.at(turn + lag, agent, "rewards"),
                not is_held_back,
                "what an agent does moves a reward of the same step, if any",
                f"what it does at turn {turn} first moves a reward {lag} step{'s' * (lag > 1)} "
                "later, and so does each other action; the first steps pay nobody",
                _proof(evidence.api, each, lag),
            )


def _first_lag(trial: ProbeCounterfactual) -> int | None:
    """Steps from a replaced action to the first reward of anybody that it moves."""
    start = int(trial.change["turn"])
    base, changed = by_turn(trial.base, start), by_turn(trial.episode, start)
    for turn in sorted(base.keys() & changed.keys()):
        one, two = base[turn], changed[turn]
        if one.order and two.order and dict(one.rewards) != dict(two.rewards):
            return turn - start
    return None


def _begins_unpaid(evidence: ProbeEvidence, late: int) -> bool:
    """Tells whether the first steps of every episode pay nobody, and almost all others do."""
    steps = [
        (turn.index, is_paid)
        for episode in evidence["rollout"]
        for turn, _, is_paid in _paid_steps(episode)
    ]
    first = [is_paid for index, is_paid in steps if index < late]
    rest = [is_paid for index, is_paid in steps if index >= late]
    is_dense = len(rest) >= LEAST_STEPS and sum(rest) >= DENSE * len(rest)
    return is_dense and bool(first) and not any(first)


def _shows_at_once(trials: list[ProbeCounterfactual], late: int) -> bool:
    """Tells whether observations show an action at once, and neither its payment nor the wait."""
    prompt, new, awaited = 0, Counter[int](), Counter[int]()
    at_once = set[int]()
    for trial in trials:
        by_agent = _moved_numbers(trial, late)
        moved = [set().union(*each.values()) for each in by_agent]
        prompt += bool(moved[0])
        at_once |= set().union(*moved[:late])
        new.update(moved[late] - set().union(*moved[:late]))
        awaited.update(_until_paid(by_agent[:late], by_agent[late]))
    least = STEADY * len(trials) / 2
    is_new = any(n >= least for place, n in new.items() if place not in at_once)
    is_awaited = any(n >= least for n in awaited.values())
    return prompt >= STEADY * len(trials) and not is_new and not is_awaited


def _moved_numbers(trial: ProbeCounterfactual, late: int) -> list[dict[str, frozenset[int]]]:
    """Numbers that a replaced action moved, by agent: after its step, up to the one that pays."""
    start = int(trial.change["turn"])
    base, changed = by_turn(trial.base, start), by_turn(trial.episode, start)
    moved = []
    for turn in range(start + 1, start + late + 2):
        one, two = (each[turn].observations if turn in each else {} for each in (base, changed))
        names = one.keys() & two.keys()
        moved.append({name: changed_numbers(one[name], two[name]) for name in names})
    return moved


def _until_paid(
    before: list[dict[str, frozenset[int]]], paid: dict[str, frozenset[int]]
) -> set[int]:
    """Numbers that differ up to the step that pays and no more after it, as goods on their way."""
    found = set[int]()
    for name, after in paid.items():
        found |= next((each[name] for each in before[::-1] if name in each), after) - after
    return found


def _proof(api: str, trial: ProbeCounterfactual, late: int) -> Reproducer:
    agent, turn = str(trial.change["agent"]), int(trial.change["turn"])
    action = by_turn(trial.episode, turn)[turn].actions.get(agent, trial.change["action"])
    paid = "dict(env.step(each)[1])" if api == "parallel" else "(env.step(each), dict(env.rewards))"
    replaced = (
        f"{{**other[{turn}], {agent!r}: {literal(action)}}}"
        if api == "parallel"
        else literal(action)
    )
    return Reproducer(
        "def rewards(actions):\n"
        "    env = make()\n"
        "    env.reset(seed=SEED)\n"
        f"    return [{paid} for each in actions]\n"
        "\n"
        f"other = list(ACTIONS[:{turn + late + 1}])\n"
        f"other[{turn}] = {replaced}\n"
        f"one, two = rewards(ACTIONS[:{turn + late + 1}]), rewards(other)\n"
        f"differ = [a != b for a, b in zip(one, two)]\n"
        f"assert not differ[{turn + late}] or any(differ[:{turn + late}]), 'a reward comes late'",
        plays=False,
        compares=True,
    )
