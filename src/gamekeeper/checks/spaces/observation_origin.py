"""Checks of whose observations are given, and of which moment."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from gamekeeper.checks.check import HIGH, MEDIUM, Case, Cases, check
from gamekeeper.checks.effects import MOST_PLACES, by_turn, numbers_in
from gamekeeper.checks.owners import doings, is_crossed, is_own
from gamekeeper.checks.probe_evidence import ProbeCounterfactual, ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode
from gamekeeper.statistics.significance import FloatArray

LEAST_EPISODES: Final = 4
LEAST_LOOKS: Final = 20
LEAST_TRIALS: Final = 10
STEADY: Final = 0.9


def numbers(value: Any) -> list[float]:
    """Numbers of an observation, those of a dictionary in the order of its keys."""
    if isinstance(value, dict):
        return [each for key in sorted(value, key=str) for each in numbers(value[key])]
    if isinstance(value, (tuple, list)):
        return [each for part in value for each in numbers(part)]
    return [float(each) for each in np.ravel(value)]


def assert_keeps_its_number(make: Any, seed: Any, actions: Any, agent: Any, place: int) -> None:
    """Raises where a number that names an agent at the reset is another one after the steps."""
    env = make()
    first = {str(a): each for a, each in env.reset(seed=seed)[0].items()}
    own = numbers(first[agent])[place]
    others = [numbers(each)[place] for a, each in first.items() if a != agent]
    for each in actions:
        seen = {str(a): part for a, part in env.step(each)[0].items()}
        if agent in seen:
            now = numbers(seen[agent])[place]
            assert now == own or now not in others, f"{agent} observes {now}, another one's number"


def assert_shows_the_step(
    make: Any, seed: Any, actions: Any, turn: int, agent: Any, choice: Any
) -> None:
    """Raises where an action changes a reward at once, and observations only one step later."""

    def play(script: Any) -> Any:
        env, given = make(), []
        env.reset(seed=seed)
        for each in script:
            out = env.step(each)
            given.append(
                (
                    {str(a): numbers(o) for a, o in out[0].items()},
                    [float(r) for r in out[1].values()],
                )
            )
        return given[turn:]

    other = [dict(each) for each in actions[: turn + 2]]
    other[turn] = {a: choice if str(a) == agent else each for a, each in other[turn].items()}
    one, two = play(actions[: turn + 2]), play(other)
    is_paid = one[0][1] != two[0][1]
    is_seen = one[0][0] != two[0][0]
    assert is_seen or not is_paid or one[1][0] == two[1][0], "observations are one step old"


@check(
    "GK217",
    HIGH,
    "rollout",
    api="parallel",
    confidence=0.9,
    looks_at="a number of the observations that at each reset is another one for each agent",
)
def observations_are_of_their_own_agent(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent is given its own observation by every step, as by the reset: no other agent's.

    A policy that acts on what another agent sees plays for that one.

    Judged by numbers that name an agent: at every reset the same for one agent, and another one for
    each. It is broken where such a number is one of these in all observations that steps give, and
    for an agent that of another in nine of ten: of always the same one, or of one that all agents
    are given alike.

    Bad:
        for agent in self.agents: self.move(agent)
        observations = {a: self.observe(agent) for a in self.agents}     # the loop's last agent

    Good: `observations = {a: self.observe(a) for a in self.agents}`.

    Fix: make each agent's observation for that agent alone
    """
    naming = _constant(_first(evidence["rollout"]))
    steps = [step for episode in evidence["rollout"] for step in _steps(episode)]
    episode = next((each for each in evidence["rollout"] if len(each.turns) > 1), None)
    if not naming or episode is None or len(steps) < LEAST_LOOKS:
        return
    for place in _naming_places(naming):
        owners = {float(naming[agent][place]): agent for agent in naming}
        given = [{a: float(v[place]) for a, v in step.items() if a in naming} for step in steps]
        if not all(number in owners for each in given for number in each.values()):
            continue
        for agent in sorted(naming):
            whose = _whose(agent, owners, given)
            if whose is not None:
                where = episode.at(1, agent, "observations")
                seen = f"number {place} of the observations that steps give is {whose!r}'s"
                proof = reproducer_of(assert_keeps_its_number, agent=agent, place=place)
                yield Case(where, whose == agent, "its own number, as at the reset", seen, proof)
        return


def _naming_places(naming: Mapping[str, FloatArray]) -> list[int]:
    """Places of numbers that are another one for each agent, and never change at resets."""
    table = np.stack([*naming.values()])
    return [
        int(place)
        for place in np.flatnonzero(~np.isnan(table).any(axis=0))
        if len(set(table[:, place].tolist())) == len(table) > 1
    ]


def _whose(
    agent: str, owners: Mapping[float, str], given: Sequence[Mapping[str, float]]
) -> str | None:
    """Agent whose number an agent is given by steps; None where that can't be said.

    Another one's only where it is always the same agent's, or all agents are given one and the same
    number in each step.
    """
    own = [each[agent] for each in given if agent in each]
    wrong = [owners[number] for number in own if owners[number] != agent]
    if len(own) < LEAST_LOOKS or len(wrong) < STEADY * len(own):
        return agent if own and not wrong else None
    is_fixed = len(set(own)) == 1
    is_shared = all(len(set(each.values())) == 1 for each in given if len(each) > 1)
    return wrong[0] if is_fixed or is_shared else None


def _steps(episode: Episode) -> list[dict[str, FloatArray]]:
    """Observations of each step by agent."""
    found: dict[int, dict[str, FloatArray]] = {}
    for index, agent, vector in _vectors(episode):
        if index > 0:
            found.setdefault(index, {})[agent] = vector
    return [*found.values()]


def _vectors(episode: Episode) -> Iterator[tuple[int, str, FloatArray]]:
    """Each observation of an episode as numbers, those of at most `MOST_PLACES`."""
    for turn in episode.turns:
        for agent, seen in turn.observations.items():
            vector = numbers_in(seen)
            if 0 < len(vector) <= MOST_PLACES:
                yield turn.index, agent, vector


def _first(episodes: Sequence[Episode]) -> dict[str, list[FloatArray]]:
    """Observations of resets by agent, one for each seed."""
    found: dict[str, dict[Any, FloatArray]] = {}
    for episode in episodes:
        for index, agent, vector in _vectors(episode):
            if index == 0:
                found.setdefault(agent, {})[episode.seed] = vector
    return {a: [*each.values()] for a, each in found.items() if len(each) >= LEAST_EPISODES}


def _constant(vectors: Mapping[str, list[FloatArray]]) -> dict[str, FloatArray]:
    """For each agent the numbers that are the same in all its observations; NaN for others."""
    sizes = {len(each) for rows in vectors.values() for each in rows}
    if len(sizes) != 1:
        return {}
    rows = {agent: np.stack(each) for agent, each in vectors.items()}
    return {a: np.where((each == each[0]).all(axis=0), each[0], np.nan) for a, each in rows.items()}


@check(
    "GK218",
    MEDIUM,
    "influence",
    "rollout",
    api="parallel",
    confidence=0.8,
    looks_at="ten replaced actions that move a reward of their own step",
)
def observations_show_their_step(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The observations that a step returns show what it did, not the state before it.

    A policy that is shown the last step's state decides on what is over, and its last observation
    doesn't show how the episode ended.

    Measured by intervention: one action is replaced, all others stay. It is broken only where each
    of these is seen: ten actions or more moved a reward of their own step; none of all moved an
    observation of that step, anybody's; nine of ten of them moved one of the next step; and the
    first step of each episode gives every agent what the reset gave.

    Bad:
        observations = {a: self.observe(a) for a in self.agents}
        for agent in self.agents: self.move(agent, actions[agent])

    Good: move first, then observe.

    Fix: make the observations at the end of step(), after all that changes the state
    """
    trials = [each for each in evidence.counterfactuals("influence") if each.noise is None]
    moved = [(each, *_moved(each)) for each in trials]
    paid = [each for each, is_paid, *_ in moved if is_paid]
    if len(paid) < LEAST_TRIALS:
        return
    later = sum(is_paid and is_later for _, is_paid, _, is_later in moved)
    is_old = (
        not any(at_once for *_, at_once, _ in moved)
        and later >= STEADY * len(paid)
        and _begins_twice(evidence["rollout"])
    )
    for each in paid:
        agent, turn = str(each.change["agent"]), int(each.change["turn"])
        choice = by_turn(each.episode, turn)[turn].actions.get(agent, each.change["action"])
        where = each.base.at(turn + 1, agent, "observations")
        told: dict[str, Any] = {"turn": turn, "agent": agent, "choice": choice}
        seen = (
            f"what it does at turn {turn} moves a reward at once, and observations only one step "
            "later; the first step gives what the reset gave"
        )
        proof = reproducer_of(assert_shows_the_step, compares=True, **told)
        yield Case(where, not is_old, "observations after the step", seen, proof)


def _moved(trial: ProbeCounterfactual) -> tuple[bool, bool, bool]:
    """Tells whether an action moved a reward of its step, and observations of it and the next."""
    start = int(trial.change["turn"])
    base, changed = by_turn(trial.base, start), by_turn(trial.episode, start)
    rows = [(base.get(start + k), changed.get(start + k)) for k in range(3)]
    seen = [
        one is not None
        and two is not None
        and any(
            not np.array_equal(numbers_in(one.observations[a]), numbers_in(two.observations[a]))
            for a in one.observations.keys() & two.observations.keys()
        )
        for one, two in rows[1:]
    ]
    one, two = rows[0]
    is_paid = one is not None and two is not None and dict(one.rewards) != dict(two.rewards)
    return is_paid, seen[0], seen[1]


def _begins_twice(episodes: Sequence[Episode]) -> bool:
    """Tells whether the first step of every episode gives each agent what the reset gave."""
    seeds = set()
    for episode in episodes:
        looks = list(episode.turns[:2])
        if len(looks) < 2:
            continue
        seeds.add(episode.seed)
        one, two = ({a: numbers_in(o) for a, o in t.observations.items()} for t in looks)
        is_same = one.keys() == two.keys() and all(np.array_equal(one[a], two[a]) for a in one)
        if not is_same or not any(map(len, one.values())):
            return False
    return len(seeds) >= LEAST_EPISODES


def assert_shows_its_own(
    make: Any, seed: Any, actions: Any, turn: int, agents: Any, choice: Any, place: int
) -> None:
    """Raises where another action moves a number that another agent observes, not the own one."""

    def shown(replaced: bool) -> Any:
        env = make()
        env.reset(seed=seed)
        for each in actions[:turn]:
            env.step(each)
        action = actions[turn]
        if replaced:
            action = {**action, agents[0]: choice} if isinstance(action, dict) else choice
        out = env.step(action)
        seen = out[0] if out else {each: env.observe(each) for each in env.agents}
        return [numbers(seen[each])[place] for each in agents]

    (own, others), (own_now, others_now) = shown(False), shown(True)
    is_own = own != own_now or others == others_now
    assert is_own, f"what {agents[0]} does is shown to {agents[1]} in its place"


@check(
    "GK220",
    HIGH,
    "influence",
    "form",
    confidence=0.8,
    looks_at="three replaced actions of each agent that move one and the same agent's number of "
    "the observation, and as many that move the reward, or an ending, of their own agent alone",
    doubt="the environment may show agents only what another one does",
)
def observations_show_their_own_agent(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent observes what it does itself, where it is paid for that or ended by it.

    A policy that is given another one's observation plays for that one.

    Measured by intervention: one action is replaced, all others stay. It is broken only where each
    of these is seen, while all agents are in the game: the reward, or the ending, moves by
    the actions of its own agent alone; and of the numbers that one agent's actions move in one
    observation alone, each is in another agent's, always the same one, and none in its own.

    It is only suspected, as an environment may mean to show agents only what another one does.

    Bad: `return self._view_of(self.agents[self.agents.index(agent) - 1])`.

    Good: `return self._view_of(agent)`.

    Fix: make each agent's observation for that agent alone
    """
    done = doings(evidence)
    shown = done.shown()
    if not shown or not any(map(is_own, (done.rewards.by_agent(), done.endings.by_agent()))):
        return
    pairs = {pair for owners in shown.values() for pair in owners.items()}
    is_swapped = all(map(is_crossed, shown.values())) and len(dict(pairs)) == len(pairs)
    place, owners = next(iter(shown.items()))
    for agent, other in owners.items():
        trial = done.places[place].trials[agent, other]
        told: dict[str, Any] = {"turn": trial.turn, "choice": trial.choice, "place": place}
        proof = reproducer_of(assert_shows_its_own, compares=True, agents=[agent, other], **told)
        where, proven = replace(trial.where, field="observations"), proof if is_swapped else None
        expected = "a number of its own observation moves, as its reward or its ending does"
        seen = f"another action of {agent!r} moves number {place} of what {other!r} observes alone"
        yield Case(where, not is_swapped, expected, seen, proven)
