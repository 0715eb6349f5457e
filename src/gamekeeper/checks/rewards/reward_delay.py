"""Checks of the turn at which a reward is paid."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import MEDIUM, Case, Cases, check
from gamekeeper.checks.effects import by_turn, changed_numbers, numbers_in
from gamekeeper.checks.facts.episode_facts import LateEffect, PaymentTime
from gamekeeper.checks.literal import literal
from gamekeeper.checks.probe_evidence import Fact, ProbeCounterfactual, ProbeEvidence
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Turn
from gamekeeper.episodes.where import Where
from gamekeeper.statistics.significance import FloatArray

LEAST = 5
"""Replaced actions that must have moved the next reward, and none its own."""
PROMPT = 0.8
"""Part of them whose effect was in the very next observation."""
PART_LEAST = 10
"""The same where some rewards come at once: the rest must be seen to be late more often."""
PART = 0.5
"""Part of all that shows at once that moves the next reward; of a sparse one it is a tenth."""
MOST_DRIFTS: Final = 64
"""Numbers of an observation among which such a drift is looked for."""
CHANCE: Final = 0.1
"""Probability that the signs of some numbers agree with those of all effects by chance."""
DRAWN = 0.5
"""Part of the late effects that may hang on draws of the step that pays: some events do."""
RARE_LEAST = 4
"""Payments of one size that must be seen to be late, and none on time."""
ALIKE = 1.3
"""Ratio of two sizes that are still about one."""
STEADY = 3
"""Numbers of an observation that lag behind so often do so by the rules."""
REWARDS: Final = (
    "def rewards(actions):\n"
    "    env, paid = make(), []\n"
    "    env.reset(seed=SEED)\n"
    "    for each in actions:\n"
    "{play}"
    "    return paid\n"
    "\n"
)
"""Lines of a program that play, with `play` as the step and what it pays."""


@dataclass(frozen=True, slots=True)
class _Trial:
    """Effect of one replaced action on its own agent.

    Attributes:
        first: how many rewards later the first one moved; None: none did.
        others_at_once: a reward of somebody moved in the step of the action.
        prompt: numbers of the observation that moved at once.
        late: numbers that moved in the observation after that.
        step: of the reward, of each number that moved at once, and of each in the base from this
            observation to the next: how far they went.
    """

    counterfactual: ProbeCounterfactual
    first: int | None
    others_at_once: bool
    prompt: frozenset[int]
    late: frozenset[int]
    step: tuple[float, FloatArray, FloatArray] | None = None


@check(
    "GK411",
    MEDIUM,
    "influence",
    "payment_times",
    confidence=0.9,
    looks_at="an action that, replaced alone, moves a reward of its own step, five that move the "
    "next one, or four unusual rewards of one size: a larger --budget tries more",
)
def rewards_come_with_the_tick_that_earns_them(
    contract: Contract, evidence: ProbeEvidence
) -> Cases:
    """A reward comes with the step that earns it, not one step later.

    Rewards that come one step late credit every action with what the one before it earned, and the
    last action of an episode with nothing.

    Measured by intervention: one action is replaced, all others stay. It is broken only where
    all of these are seen: no action ever moved a reward of its own tick, anybody's; its own agent's
    next reward moved at least five times, and at most a quarter as often did one later move first;
    the observation of the same step already showed what was done, and no number of it lags
    behind as steadily (a position that follows a velocity does: then the rules are slow, not the
    reward); and the first step, before any action could matter, already pays different amounts. A
    game whose events take a tick by its rules shows them a tick later too, or pays the same
    at first, so it isn't called broken; a false alarm needs all seven to agree by chance.

    Each term that a Parallel environment tells (`terms`) is judged by itself. Where it tells none,
    a part that comes late beside another on time is known by what moves it: at least ten actions,
    and half of all that show at once, move the next reward and nobody's of their own step,
    and at most a quarter as many move one of their own step. A rare event that takes two actions
    doesn't: hardly any action decides it.

    A rare reward, a bonus or a penalty, is followed back by itself: where at least four of one
    size were looked into, none that any agent could have changed in its own tick (AEC: by its last
    turn), and all but a fifth decided in the tick before. A delay that is a rule of the environment
    isn't called broken, as far as observations tell it: a number that announces the payment and is
    back afterwards, or one that moves with it.

    Bad:
        rewards = {a: self.reward(a) for a in self.agents}
        for agent in self.agents:
            self.move(agent, actions[agent])

    Good:
        for agent in self.agents:
            self.move(agent, actions[agent])
        rewards = {a: self.reward(a) for a in self.agents}

    Fix: compute the rewards after the moves of the tick, from the state that the observations of
    the same step show
    """
    follows = False
    for part in _parts(evidence):
        trials = _trials(evidence, part)
        follows = follows or _follows_a_drift(trials)
        yield from _judged(evidence, trials, part)
    for alike in () if follows else _by_size(evidence.facts(PaymentTime)):
        yield from _rare(evidence.api, alike)


def hang_on_later_draws(evidence: ProbeEvidence) -> bool:
    """Tells whether most late effects of actions are worth what is drawn in the step that pays."""
    drawn = [fact.value.is_drawn for fact in evidence.facts(LateEffect)]
    return sum(drawn) > DRAWN * len(drawn)


def _parts(evidence: ProbeEvidence) -> tuple[str | None, ...]:
    """The reward terms that a Parallel environment tells; None stands for the whole reward."""
    if evidence.api != "parallel":
        return (None,)
    bases = {id(each.base): each.base for each in evidence.counterfactuals("influence")}
    turns = (turn for base in bases.values() for turn in base.turns)
    found = {name for turn in turns for terms in turn.terms.values() for name in terms}
    return tuple(sorted(found)) or (None,)


def _trials(evidence: ProbeEvidence, part: str | None) -> list[_Trial]:
    found = (
        _trial(each, evidence.api, part)
        for each in evidence.counterfactuals("influence")
        if int(each.change["later"]) >= 2
    )
    return [trial for trial in found if trial is not None]


def _judged(evidence: ProbeEvidence, trials: list[_Trial], part: str | None) -> Cases:
    moved = [trial for trial in trials if trial.first is not None]
    at_once = [trial for trial in moved if trial.first == 0]
    next_one = [trial for trial in moved if trial.first == 1 and not trial.others_at_once]
    is_late = (
        len(next_one) >= LEAST
        and (_is_whole_late if not at_once else _is_part_late)(trials)
        and sum(bool(trial.prompt) for trial in next_one) >= PROMPT * len(next_one)
        and not _lagging(trials)
        and not hang_on_later_draws(evidence)
        and not _follows_a_drift(trials)
        and _pays_different_amounts_at_first(evidence, part)
    )
    for trial in at_once:
        yield _case(trial, ok=True, api=evidence.api, part=part)
    if (at_once and not is_late) or len(next_one) < LEAST:
        return
    for trial in next_one:
        yield _case(trial, ok=not is_late, api=evidence.api, part=part)


def _is_whole_late(trials: list[_Trial]) -> bool:
    """Tells whether what moves the reward moves the next one first, three times of four."""
    moved = [trial for trial in trials if trial.first is not None]
    others = sum(trial.first != 1 for trial in moved)
    return not any(t.others_at_once for t in trials) and 4 * others <= len(moved) - others


def _is_part_late(trials: list[_Trial]) -> bool:
    """Tells whether most of what shows at once is paid one step later, and hardly at once."""
    shown = [trial for trial in trials if trial.prompt]
    late = sum(trial.first == 1 and not trial.others_at_once for trial in shown)
    at_once = sum(trial.first == 0 or trial.others_at_once for trial in trials)
    return late >= max(PART_LEAST, PART * len(shown)) and 4 * at_once <= late


def _trial(counterfactual: ProbeCounterfactual, api: str, part: str | None) -> _Trial | None:
    """Effect of the action on its agent's rewards and observations; None: not long enough.

    An action that ends its agent moves a reward in the one look that is left, or in none: what
    comes at once counts all the same.
    """
    agent, start = str(counterfactual.change["agent"]), int(counterfactual.change["turn"])
    noise = counterfactual.noise
    end = None if noise is None else (noise.turn or 0)
    base = by_turn(counterfactual.base, start, end)
    changed = by_turn(counterfactual.episode, start, end)
    if api == "parallel":
        pairs = [(base.get(start + k), changed.get(start + k)) for k in (1, 2)]
    else:
        own = [
            [t for t in turns.values() if t.index > start and agent in t.order]
            for turns in (base, changed)
        ]
        pairs = list(zip(*(each[:2] for each in own), strict=False))
    looks = [(one, two) for one, two in pairs if one is not None and two is not None]
    if part is None:
        received = [[turn.cumulative_reward for turn in pair] for pair in looks]
    else:
        received = [
            [_paid(turns[start + k], part) for turns in (base, changed)] for k in range(len(looks))
        ]
    found = [one.get(agent, 0.0) != two.get(agent, 0.0) for one, two in received]
    first = found.index(True) if any(found) else None
    step = [_paid(turns[start], part) for turns in (base, changed) if start in turns]
    names = {name for paid in step for name in paid}
    others = len({tuple(paid.get(name, 0.0) for name in sorted(names)) for paid in step}) > 1
    if len(looks) < 2 and first != 0 and not others:
        return None
    shown = [changed_numbers(*(t.observations.get(agent) for t in pair)) for pair in looks]
    prompt, late, *_ = *shown, frozenset[int](), frozenset[int]()
    return _Trial(counterfactual, first, others, prompt, late, _step(agent, looks, received))


def _step(
    agent: str,
    looks: Sequence[tuple[Turn, Turn]],
    received: Sequence[Sequence[Mapping[str, float]]],
) -> tuple[float, FloatArray, FloatArray] | None:
    """Moves of the second reward, of the first observation, and of the base's to the second one."""
    if len(looks) < 2:
        return None
    (one, two), (later, _) = looks[:2]
    here, there, then = (numbers_in(each.observations.get(agent)) for each in (one, two, later))
    if not len(here) == len(there) == len(then) <= MOST_DRIFTS:
        return None
    paid, instead = (each.get(agent, 0.0) for each in received[1])
    return instead - paid, there - here, then - here


def _paid(turn: Turn, part: str | None) -> Mapping[str, float]:
    """Rewards that a step paid, by agent, or one term of them."""
    if part is None:
        return turn.rewards
    return {agent: terms.get(part, 0.0) for agent, terms in turn.terms.items()}


def _lagging(trials: list[_Trial]) -> bool:
    """Tells whether some number of the observation steadily moves later than at once."""
    prompt = frozenset[int]().union(*(trial.prompt for trial in trials))
    late: dict[int, int] = {}
    for trial in trials:
        for place in trial.late - prompt:
            late[place] = late.get(place, 0) + 1
    return any(count >= STEADY for count in late.values())


def _follows_a_drift(trials: Sequence[_Trial]) -> bool:
    """Tells whether a number that no action moves says, by its next step, which way actions pay.

    A price that goes up or down after the purchase is one.
    """
    late = [trial for trial in trials if trial.first == 1 and not trial.others_at_once]
    steps = [trial.step for trial in late if trial.step is not None]
    if len({len(moved) for _, moved, _ in steps}) != 1:
        return False
    gained = np.sign([gain for gain, *_ in steps])[:, None, None]
    moved = np.sign([each for _, each, _ in steps])
    drift = np.sign([each for *_, each in steps])[:, ~(moved != 0).any(axis=0)]
    signs = gained * moved[:, :, None] * drift[:, None, :]
    counts = [(signs == sign).sum(axis=0) for sign in (1, -1)]
    pairs = 2 * int((moved != 0).any(axis=0).sum()) * drift.shape[1]  # of numbers, by either sign
    is_no_chance = pairs * 0.5 ** np.maximum(*counts) < CHANCE
    goes_both = np.logical_and(*((drift == sign).sum(axis=0) >= 2 for sign in (1, -1)))
    return bool((is_no_chance & (np.minimum(*counts) == 0) & goes_both).any())


def _pays_different_amounts_at_first(evidence: ProbeEvidence, part: str | None) -> bool:
    """Tells whether first steps give rewards that aren't always the same."""
    amounts = set[float]()
    for look in evidence.looks.get("influence", ()):
        for episode in {
            id(counterfactual.base): counterfactual.base for counterfactual in look.counterfactuals
        }.values():
            for turn in episode.turns[:1]:
                amounts.update(_paid(turn, part).values())
    return len(amounts) > 1


def _by_size(facts: Sequence[Fact[PaymentTime]]) -> Iterator[Sequence[Fact[PaymentTime]]]:
    """Unusual payments of one sign and about one size, from small to large."""
    for is_positive in (True, False):
        group: list[Fact[PaymentTime]] = []
        of_sign = [each for each in facts if (each.value.amount > 0) == is_positive]
        for fact in sorted(of_sign, key=lambda each: abs(each.value.amount)):
            if group and abs(fact.value.amount) > ALIKE * abs(group[-1].value.amount):
                yield group
                group = []
            group.append(fact)
        yield group


def _rare(api: str, facts: Sequence[Fact[PaymentTime]]) -> Cases:
    """Cases of unusual payments of one size: on time, or one tick late, all of them."""
    late = [fact for fact in facts if fact.value.decided is not None]
    on_time = [fact for fact in facts if fact.value.is_on_time]
    for fact in on_time:
        yield _rare_case(fact, ok=True, api=api)
    if on_time or len(late) < RARE_LEAST or len(late) < PROMPT * len(facts):
        return
    told = [fact.value.shown - fact.value.after for fact in late]
    with_it = [fact.value.after - fact.value.shown for fact in late]
    if _steady(told, len(late)) or _steady(with_it, len(late)):
        return
    if sum(bool(fact.value.shown) for fact in late) < PROMPT * len(late):
        return
    for fact in late:
        yield _rare_case(fact, ok=False, api=api)


def _steady(places: Sequence[frozenset[int]], of: int) -> bool:
    """Tells whether one number is among almost all of them."""
    return any(
        sum(place in each for each in places) >= PROMPT * of for place in frozenset().union(*places)
    )


def _rare_case(fact: Fact[PaymentTime], *, ok: bool, api: str) -> Case:
    value, turn = fact.value, fact.where.turn
    mover = value.agent if value.decided is None else value.decided[1]
    at = turn if value.decided is None else value.decided[0]
    return Case(
        fact.where,
        ok,
        "an unusual reward is decided by the actions of its own tick",
        f"{value.agent!r} is paid {value.amount:g} more than usual at turn {turn}, which none of "
        f"{len(value.tried)} other actions of that tick changes; one of {mover!r} at turn {at} "
        "does",
        proof=None if ok else _rare_proof(fact, api),
    )


def _rare_proof(fact: Fact[PaymentTime], api: str) -> Reproducer:
    value, paid = fact.value, fact.where.turn or 0
    then, mover, action = value.decided or (0, "", None)
    if api == "parallel":
        play = "        paid.append(dict(env.step(each)[1]))\n"
        replace = "    other[turn] = {**other[turn], agent: action}\n"
    else:
        play = (
            "        env.last()\n        env.step(each)\n        paid.append(dict(env.rewards))\n"
        )
        replace = "    other[turn] = action\n"
    return Reproducer(
        f"{REWARDS.format(play=play)}"
        "def change(turn, agent, action):\n"
        f"    other = list(ACTIONS[:{paid + 1}])\n"
        f"{replace}"
        f"    pair = rewards(ACTIONS[:{paid + 1}])[-1], rewards(other)[-1]\n"
        f"    return abs(pair[0].get({value.agent!r}, 0.0) - pair[1].get({value.agent!r}, 0.0))\n"
        "\n"
        f"own_tick = {literal(list(value.tried))}\n"
        "changes = [change(*each) for each in own_tick]\n"
        f"late = change({then}, {mover!r}, {literal(action)})\n"
        f"enough = {abs(value.amount) / 2!r}\n"
        'assert max(changes) >= enough or late < enough, "the reward comes one tick late"',
        plays=False,
        compares=True,
    )


def _case(trial: _Trial, *, ok: bool, api: str, part: str | None) -> Case:
    change = trial.counterfactual.change
    agent, turn = str(change["agent"]), int(change["turn"])
    action = by_turn(trial.counterfactual.episode, turn)[turn].actions.get(agent, change["action"])
    is_parallel = api == "parallel"
    proof = _proof(agent, turn, action, part) if is_parallel else _aec_proof(turn, action)
    field = "cumulative_reward" if part is None else f"terms[{part!r}]"
    where: Where = trial.counterfactual.base.at(turn + 2, agent, field)
    reward = "reward" if part is None else f"{part!r}"
    expected = f"what an agent does moves its {reward} of the same step, if any"
    seen = f"what it does at turn {turn} moves nobody's {reward} of that step, only its next one"
    return Case(where, ok, expected, seen, proof)


def _proof(agent: str, turn: int, action: Any, part: str | None) -> Reproducer:
    paid = "dict(env.step(each)[1])"
    if part is not None:
        paid = f"{{str(a): t.get({part!r}, 0.0) for a, t in env.unwrapped.terms.items()}}"
    step = "" if part is None else "        env.step(each)\n"
    play = f"{step}        paid.append({paid})\n"
    return Reproducer(
        f"{REWARDS.format(play=play)}"
        f"other = [dict(each) for each in ACTIONS]\n"
        f"other[{turn}][{agent!r}] = {literal(action)}\n"
        "one, two = rewards(ACTIONS), rewards(other)\n"
        f"same_step = one[{turn}] != two[{turn}]\n"
        f"next_step = one[{turn + 1}].get({agent!r}) != two[{turn + 1}].get({agent!r})\n"
        'assert same_step or not next_step, "the reward comes one step late"',
        plays=False,
        compares=True,
    )


def _aec_proof(turn: int, action: Any) -> Reproducer:
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
        f"other[{turn}] = {literal(action)}\n"
        "one, two = received(ACTIONS), received(other)\n"
        f"later = [k for k in range({turn + 1}, len(one)) if one[k][0] == one[{turn}][0]]\n"
        "first, then = [one[k] != two[k] for k in later[:2]]\n"
        'assert first or not then, "the reward comes one round late"',
        plays=False,
        compares=True,
    )
