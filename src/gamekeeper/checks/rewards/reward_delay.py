"""Checks of the turn at which a reward is paid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import MEDIUM, Case, check
from gamekeeper.checks.effects import by_turn, changed_numbers
from gamekeeper.checks.literal import literal
from gamekeeper.checks.probe_evidence import ProbeCounterfactual, ProbeEvidence
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Turn
from gamekeeper.episodes.where import Where

LEAST = 5
"""Replaced actions that must have moved the next reward, and none its own."""
PROMPT = 0.8
"""Part of them whose effect was in the very next observation."""
STEADY = 3
"""Numbers of an observation that lag behind so often do so by the rules."""


@dataclass(frozen=True, slots=True)
class _Trial:
    """Effect of one replaced action on its own agent.

    Attributes:
        first: how many rewards later the first one moved; None: none did.
        prompt: numbers of the observation that moved at once.
        late: numbers that moved in the observation after that.
    """

    counterfactual: ProbeCounterfactual
    first: int | None
    prompt: frozenset[int]
    late: frozenset[int]


@check(
    "GK411",
    needs=("influence",),
    severity=MEDIUM,
    fix="compute the rewards after the moves of the tick, from the state that the observations "
    "of the same step show",
    confidence=0.9,
)
def rewards_come_with_the_tick_that_earns_them(
    contract: Contract, evidence: ProbeEvidence
) -> Iterator[Case]:
    """A reward comes with the step that earns it, not one step late from before the moves.

    Rewards that come one step late credit every action with what the one before it earned, and the
    last action of an episode with nothing.

    Measured by intervention: one action is replaced, all others stay. It is broken only where
    all of these are seen: no action ever moved a reward of its own tick, anybody's; its own agent's
    next reward moved at least five times, and at most a quarter as often did one later move first;
    the observation of the same step already showed what was done, and no number of it lags
    behind as steadily (a position that follows a velocity does: then the rules are slow, not the
    reward); and the first step, before any action could matter, already pays different amounts. A
    game whose events take a tick by its rules shows them a tick later too, or pays the same
    at first, so it isn't called broken; a false alarm needs all five to agree by chance.

    Bad:

        rewards = {a: self.reward(a) for a in self.agents}
        for agent in self.agents:
            self.move(agent, actions[agent])

    Good:

        for agent in self.agents:
            self.move(agent, actions[agent])
        rewards = {a: self.reward(a) for a in self.agents}
    """
    trials, others_moved = [], False
    for counterfactual in evidence.counterfactuals("influence"):
        if int(counterfactual.change["later"]) < 2:
            continue
        trial = _trial(counterfactual, evidence.api)
        if trial is not None:
            trials.append(trial)
            others_moved = others_moved or _moved_at_once(counterfactual, evidence.api)
    moved = [trial for trial in trials if trial.first is not None]
    at_once = [trial for trial in moved if trial.first == 0]
    for trial in at_once:
        yield _case(trial, ok=True, api=evidence.api)
    next_one = [trial for trial in moved if trial.first == 1]
    if at_once or len(next_one) < LEAST:
        return
    is_late = (
        not others_moved
        and 4 * (len(moved) - len(next_one)) <= len(next_one)
        and sum(bool(trial.prompt) for trial in next_one) >= PROMPT * len(next_one)
        and not _lagging(trials)
        and _pays_different_amounts_at_first(evidence)
    )
    for trial in next_one:
        yield _case(trial, ok=not is_late, api=evidence.api)


def _trial(counterfactual: ProbeCounterfactual, api: str) -> _Trial | None:
    """Effect of the action on its agent's rewards and observations; None: not long enough."""
    agent, start = str(counterfactual.change["agent"]), int(counterfactual.change["turn"])
    noise = counterfactual.noise
    end = None if noise is None else (noise.turn or 0)
    base, changed = (
        by_turn(counterfactual.base, start, end),
        by_turn(counterfactual.trace, start, end),
    )
    if api == "parallel":
        pairs = [(base.get(start + k), changed.get(start + k)) for k in (1, 2)]
    else:
        own = [
            [t for t in turns.values() if t.index > start and agent in t.order]
            for turns in (base, changed)
        ]
        pairs = list(zip(*(each[:2] for each in own), strict=False))
    looks = [(one, two) for one, two in pairs if one is not None and two is not None]
    if len(looks) < 2:
        return None
    first = next((k for k, pair in enumerate(looks) if _cumulative_reward(pair, agent)), None)
    prompt, late = (_moved_numbers(pair, agent) for pair in looks)
    return _Trial(counterfactual, first, prompt, late)


def _cumulative_reward(pair: tuple[Turn, Turn], agent: str) -> bool:
    one, two = (turn.cumulative_reward.get(agent, 0.0) for turn in pair)
    return one != two


def _moved_numbers(pair: tuple[Turn, Turn], agent: str) -> frozenset[int]:
    return changed_numbers(*(turn.observations.get(agent) for turn in pair))


def _moved_at_once(counterfactual: ProbeCounterfactual, api: str) -> bool:
    """Tells whether the reward of any agent changed in the same step."""
    start = int(counterfactual.change["turn"])
    pair = [
        by_turn(trace, start, start + 1).get(start)
        for trace in (counterfactual.base, counterfactual.trace)
    ]
    one, two = ({} if turn is None else dict(turn.rewards) for turn in pair)
    return any(one.get(name, 0.0) != two.get(name, 0.0) for name in one.keys() | two.keys())


def _lagging(trials: list[_Trial]) -> bool:
    """Tells whether some number of the observation steadily moves later than at once."""
    prompt = frozenset[int]().union(*(trial.prompt for trial in trials))
    late: dict[int, int] = {}
    for trial in trials:
        for place in trial.late - prompt:
            late[place] = late.get(place, 0) + 1
    return any(count >= STEADY for count in late.values())


def _pays_different_amounts_at_first(evidence: ProbeEvidence) -> bool:
    """Tells whether first steps give rewards that aren't always the same."""
    amounts = set[float]()
    for look in evidence.looks.get("influence", ()):
        for trace in {
            id(counterfactual.base): counterfactual.base for counterfactual in look.counterfactuals
        }.values():
            turn = next(trace.turns, None)
            if turn is not None:
                amounts.update(turn.rewards.values())
    return len(amounts) > 1


def _case(trial: _Trial, *, ok: bool, api: str) -> Case:
    change = trial.counterfactual.change
    agent, turn = str(change["agent"]), int(change["turn"])
    is_parallel = api == "parallel"
    proof = _proof(agent, turn, change["action"]) if is_parallel else _aec_proof(turn, change)
    where: Where = trial.counterfactual.base.at(turn + 2, agent, "cumulative_reward")
    return Case(
        where,
        ok,
        "what an agent does moves its reward of the same step, if any",
        f"what it does at turn {turn} moves nobody's reward of that step, only its next one",
        proof=proof,
    )


def _proof(agent: str, turn: int, action: Any) -> Reproducer:
    return Reproducer(
        "def rewards(actions):\n"
        "    env, paid = make(), []\n"
        "    env.reset(seed=SEED)\n"
        "    for each in actions:\n"
        "        paid.append(dict(env.step(each)[1]))\n"
        "    return paid\n"
        "\n"
        f"other = [dict(each) for each in ACTIONS]\n"
        f"other[{turn}][{agent!r}] = {literal(action)}\n"
        "one, two = rewards(ACTIONS), rewards(other)\n"
        f"same_step = one[{turn}] != two[{turn}]\n"
        f"next_step = one[{turn + 1}][{agent!r}] != two[{turn + 1}][{agent!r}]\n"
        'assert same_step or not next_step, "the reward comes one step late"',
        plays=False,
        compares=True,
    )


def _aec_proof(turn: int, change: Any) -> Reproducer:
    return Reproducer(
        "def received(actions):\n"
        "    env, found = make(), []\n"
        "    env.reset(seed=SEED)\n"
        "    for action in actions:\n"
        "        found.append((env.agent_selection, env.last()[1]))\n"
        "        env.step(action)\n"
        "    return [*found, (env.agent_selection, env.last()[1])]\n"
        "\n"
        "other = list(ACTIONS)\n"
        f"other[{turn}] = {literal(change['action'])}\n"
        "one, two = received(ACTIONS), received(other)\n"
        f"later = [k for k in range({turn + 1}, len(one)) if one[k][0] == one[{turn}][0]]\n"
        "first, then = [one[k] != two[k] for k in later[:2]]\n"
        'assert first or not then, "the reward comes one round late"',
        plays=False,
        compares=True,
    )
