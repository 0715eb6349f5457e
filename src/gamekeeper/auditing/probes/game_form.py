"""Probe of the structure: whole episodes, and moves replaced along them, one at a time."""

import copy
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from gamekeeper.auditing.branches import Board, BranchStep, EpisodeSteps, branch, value_digest
from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.auditing.probes.moves import legal_or_first, other_action
from gamekeeper.checks.facts.form_facts import (
    AgentEnding,
    DrawnPriority,
    EpisodeShape,
    FormError,
    MoveLook,
    MoveTrial,
    UnsettledMoves,
)
from gamekeeper.episodes.layout import agent_name, role
from gamekeeper.interface.generators import is_same_state
from gamekeeper.rollouts.episode_loop import EpisodePlan
from gamekeeper.rollouts.process_randomness import kept_global_generators, reseed, standing, states
from gamekeeper.rollouts.snapshots import spaces_in


def rounds_of(steps: Sequence[BranchStep], first: Iterable[Any], api: str) -> list[int]:
    """The round of each env step: a tick, or turns until an agent would act again or all have.

    The step of an agent that had ended belongs to the round before it.
    """
    if api == "parallel":
        return list(range(len(steps)))
    found, number, acted = [], 0, set[Any]()
    live = set(first)
    for step in steps:
        mover = next(iter(step.given), None)
        if mover is not None:
            if mover in acted or (acted and live <= acted):
                number, acted = number + 1, set()
            acted.add(mover)
        found.append(number)
        live = {agent for agent in step.roster if agent not in step.ended}
    return found


def shape(script: EpisodeSteps, *, is_over: bool, api: str) -> EpisodeShape:
    """The shape of an episode; of one that was cut only whole rounds count for fares."""
    movers: dict[int, list[str]] = {}
    endings, joined, left = [], [], []
    live: dict[int, int] = {}
    roster, ended = set(script.first), set[Any]()
    for place, (step, number) in enumerate(zip(script.steps, script.rounds, strict=True)):
        movers.setdefault(number, []).extend(map(agent_name, step.given))
        new = [agent for agent in step.ended if agent not in ended]
        if new:
            live[place] = len((roster | set(step.roster)) - ended)
        endings += [AgentEnding(agent_name(a), number, place, step.ended[a]) for a in new]
        joined += [(agent_name(agent), number) for agent in step.roster if agent not in roster]
        gone = roster - set(step.roster) - set(step.ended)
        left += [(agent_name(agent), number) for agent in sorted(gone, key=str)]
        roster, ended = set(step.roster), set(step.ended)
    return EpisodeShape(
        rounds=tuple(tuple(each) for _, each in sorted(movers.items()) if each),
        first=tuple(map(agent_name, script.first)),
        endings=tuple(endings),
        joined=tuple(joined),
        left=tuple(left),
        live=live,
        fares=_fares(script, is_whole=is_over or api == "parallel"),
        is_over=is_over,
    )


def _fares(script: EpisodeSteps, *, is_whole: bool) -> dict[str, tuple[float, ...]]:
    """By agent: rewards, their magnitudes, payments, actions, and whether it terminated."""
    last = None if is_whole or not script.rounds else script.rounds[-1]
    found: dict[Any, list[float]] = {agent: [0.0] * 5 for agent in script.first}
    for step, number in zip(script.steps, script.rounds, strict=True):
        if number == last:
            break
        for agent, paid in step.rewards.items():
            if agent in found:
                found[agent][0] += paid
                found[agent][1] += abs(paid)
                found[agent][2] += paid != 0
        for agent in step.given:
            if agent in found:
                found[agent][3] += 1
        for agent, kind in step.ended.items():
            if agent in found:
                found[agent][4] = float(kind == "termination")
    return {agent_name(agent): tuple(values) for agent, values in found.items()}


MOST_EPISODES: Final = 120
LONGEST: Final = 1_000
MOST_STEPS: Final = 5_000
MOST_AGENT_STEPS: Final = 60_000
"""Steps of the environment, times agents in a Parallel one: enough for shares of a percent."""
EPISODES: Final = 8
"""Episodes that the budget holds at least, however long; longer ones are cut."""
PER_STEP: Final = 3
"""Steps of branches for each step of an episode."""
AHEAD: Final = 10
"""Rounds after a move that are looked at, at every fourth episode; else the move's and the next."""
LONG: Final = 4
EVERY: Final = 3
HABIT: Final = 0.8
"""Chance of each agent's first action again, at every third episode."""
MOST_MOVERS: Final = 6
"""Moves of one round that are replaced, each by itself."""
MOST_TARGETS: Final = 24
"""Agents of a large roster at which effects are looked for."""
FUTURES: Final = 12
"""Random draws for one pair: two of six agents in a drawn order come first in one of 15."""
OFTEN: Final = 3
"""Episodes for one pair that is tried against several futures."""


def _form_plays(session: ProbeSession) -> Iterator[EpisodePlan]:
    """As many episodes as the budget holds; long ones are cut."""
    each = len(session.agents) if session.api == "parallel" else 1
    ration = min(session.ration, MOST_STEPS, MOST_AGENT_STEPS // max(each, 1))
    turns = max(ration // (EPISODES * (1 + PER_STEP)), 20)
    begun = session.meter.steps
    for k in range(MOST_EPISODES):
        if session.meter.steps - begun >= ration:
            return
        yield EpisodePlan(seed=session.seed + k, stream=k, most_turns=min(turns, LONGEST))


@probe("form", share=0.0, on_top=0.5, plays=_form_plays, tries=0)
def form(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Whole episodes with random legal actions; in some rounds each is replaced, one at a time.

    What differs from the unchanged rerun in the rounds after is that move's doing: masks and
    observations that decisions are made with, rewards, endings, and the order of turns.

    Nothing of the contract is read. Its steps are counted on top of the budget of the checks.

    Facts:
        `EpisodeShape`, `MoveTrial`, `DrawnPriority`, `UnsettledMoves`, `FormError`.
    """
    done = session.call("play", _Forms, session, play)
    if done.said is not None:
        yield session.fact(FormError("an episode", done.said))
        return
    forms = done.value
    session.base = forms.plan
    yield session.fact(shape(forms.script, is_over=forms.is_over, api=session.api))
    trials: list[Any] = []
    with kept_global_generators():
        tried = session.call("branches", lambda: trials.extend(forms.trials()))
    yield from (session.fact(each, turn=each.turn) for each in trials)
    if tried.said is not None:
        yield session.fact(FormError("replaced moves", tried.said))


class _Forms:
    """One episode and its branches."""

    def __init__(self, session: ProbeSession, play: EpisodePlan) -> None:
        self._session, self._stream, self._seed = session, play.stream, play.seed
        self._rng = np.random.default_rng([23, session.seed, play.stream])
        self._spaces = _spaces(session, play.stream)
        self._env = session.env()
        self._can_copy = True
        self._habits: dict[Any, Any] = {}
        self._stands: dict[int, list[Any]] = {}
        board = Board(session, self._env)
        board.reset(play.seed)
        before = states()
        first, steps = tuple(self._env.agents), list[BranchStep]()
        while not board.is_over and len(steps) < play.most_turns:
            steps.append(board.step(self._chosen(board)))
        self.is_over = board.is_over
        self._is_global = states() != before  # it draws from generators of the whole process
        self.script = EpisodeSteps(play.seed, first, steps, rounds_of(steps, first, session.api))

    def trials(self) -> Iterator[MoveTrial | DrawnPriority | UnsettledMoves]:
        """Yields what replaced moves changed, as far as the unchanged rerun agrees."""
        ahead = AHEAD if self._stream % LONG == LONG - 1 else 1
        spots = self._spots(ahead)
        boards, settled = self._led({step for spot in spots for step in spot})
        if settled < len(self.script.steps):
            self._session.unlike[:] = self._session.unlike or [self.plan]
            yield UnsettledMoves(settled)
        if self._can_copy and spots:
            done = self._session.call("copies", self._copies_well, boards, settled, ahead)
            self._can_copy = done.value is True
        if not self._can_copy:
            spots = spots[: self._affordable(spots, ahead)]
        is_tried = self._session.api == "aec" or self._stream % OFTEN > 0
        for spot in spots:
            found = []
            for step in spot:
                for agent in self._few(list(self.script.steps[step].given)):
                    trial = self._trial(boards, step, agent, ahead, settled)
                    if trial is not None:
                        found.append(trial)
            yield from (trial for trial, _ in found)
            if not is_tried and spot[0] < settled:
                for priority in self._priorities(boards, spot[0], found):
                    is_tried = True
                    yield priority

    @property
    def plan(self) -> EpisodePlan:
        """The episode with its actions written out."""
        actions = tuple(dict(step.actions or {}) for step in self.script.steps)
        return EpisodePlan(self._seed, self._stream, actions, max(len(actions), 1))

    def _chosen(self, board: Board) -> dict[Any, Any]:
        """A legal action of each agent that decides; in some episodes often the one it began with.

        So rare places are met that a random walk doesn't come to.
        """
        done = {}
        for agent, given in board.given.items():
            space = self._space(agent)
            drawn = other_action(space, given.mask, None, self._rng)[1]
            habit = self._habits.setdefault(agent, drawn)
            if self._stream % EVERY == EVERY - 1 and self._rng.random() < HABIT:
                drawn = legal_or_first(space, given.mask, habit)
            done[agent] = drawn
        return done

    def _space(self, agent: Any) -> Any:
        name = agent_name(agent)
        if name not in self._spaces:  # a reset named it, not possible_agents
            place = len(self._spaces)
            self._spaces[name] = _seeded(self._session.space_of(agent), self._stream, place)
        return self._spaces[name]

    def _few(self, agents: list[Any]) -> list[Any]:
        if len(agents) <= MOST_MOVERS:
            return agents
        return [agents[at] for at in self._rng.permutation(len(agents))[:MOST_MOVERS]]

    def _spots(self, ahead: int) -> list[list[int]]:
        """The steps of some rounds, so many that branches take no more than their part."""
        by_round: dict[int, list[int]] = {}
        for step, number in enumerate(self.script.rounds):
            if self.script.steps[step].given:
                by_round.setdefault(number, []).append(step)
        if not by_round:
            return []
        size = max(map(len, by_round.values()))
        movers = max(len(each.given) for each in self.script.steps) if size == 1 else size
        cost = size * (ahead + 1) * min(movers, MOST_MOVERS)
        count = max(PER_STEP * len(self.script.steps) // max(cost, 1), 1)
        numbers = self._rng.permutation(len(by_round))[:count]
        spots = [by_round[sorted(by_round)[at]] for at in numbers]
        return [
            spot
            if len(spot) <= MOST_MOVERS
            else [spot[at] for at in sorted(self._rng.permutation(len(spot))[:MOST_MOVERS])]
            for spot in spots
        ]

    def _led(self, at: set[int]) -> tuple[dict[int, Board], int]:
        """Copies of the environment before these steps, and the step at which the rerun differs."""
        boards: dict[int, Board] = {}
        board = Board(self._session, self._env, shared=spaces_in(self._env))
        board.reset(self._seed)
        for place, written in enumerate(self.script.steps):
            if written.given.keys() != board.given.keys() or written.actions is None:
                return boards, place
            if place in at and self._can_copy:
                copied = self._session.call("deepcopy", board.waiting, with_globals=self._is_global)
                self._can_copy = copied.failed is None
                if self._can_copy:
                    boards[place] = copied.value
            is_same = _is_same(board.step(written.actions), written)
            if place in at and self._session.api == "aec":
                self._stands[place] = standing(board.env)
            if not is_same:
                return boards, place
        return boards, len(self.script.steps)

    def _copies_well(self, boards: Mapping[int, Board], settled: int, ahead: int) -> bool:
        """Tells whether a copy goes on as its original did; many build themselves anew instead."""
        step = min(boards)
        steps = branch(boards[step].taken_up(), self.script, step, {}, ahead, self._fitting)
        return all(
            _is_same(each, self.script.steps[place]) for place, each in steps if place < settled
        )

    def _affordable(self, spots: Sequence[Sequence[int]], ahead: int) -> int:
        """Number of the spots that branches afford which begin at the reset; one at least."""
        left, count = float(PER_STEP * len(self.script.steps)), 0
        for spot in spots:
            movers = max(len(spot), min(len(self.script.steps[spot[0]].given), MOST_MOVERS))
            left -= movers * (spot[0] + (ahead + 1) * len(spot))
            count += left >= 0
        return max(count, 1)

    def _arrived(self, boards: Mapping[int, Board], step: int) -> Board:
        """The environment before a step: a copy, else led there from the reset."""
        if self._can_copy and step in boards:
            return boards[step].taken_up()
        board = Board(self._session, self._env)
        board.reset(self._seed)
        for written in self.script.steps[:step]:
            board.step(written.actions or {})
        return board

    def _fitting(self, agent: Any, mask: Any, action: Any) -> Any:
        return legal_or_first(self._space(agent), mask, action)

    def _trial(
        self, boards: Mapping[int, Board], step: int, agent: Any, ahead: int, settled: int
    ) -> tuple[MoveTrial, Any] | None:
        """One move replaced; None where there is no other, or the rerun differs before it."""
        written = self.script.steps[step]
        own = (written.actions or {})[agent]
        mask = written.given[agent].mask
        is_found, action = other_action(self._space(agent), mask, own, self._rng)
        if not is_found or step >= settled:
            return None
        board = self._arrived(boards, step)
        steps = branch(board, self.script, step, {agent: action}, ahead, self._fitting)
        looks: list[MoveLook] = []
        is_moved = is_shifted = False
        for place, changed in steps:
            if place >= settled:
                break
            if place == step in self._stands:
                is_shifted = not _alike(self._stands[step], standing(board.env))
            base = self.script.steps[place]
            if changed.actions is None:
                before = self.script.steps[place - 1]
                is_alike = changed.ended == before.ended and bool(base.given and changed.given)
                is_moved = is_alike and base.given.keys() != changed.given.keys()
            looks += self._looks(step, place, changed)
        movers = tuple(agent_name(each) for each in self._movers(step))
        at = agent_name(agent), self.script.rounds[step], step
        trial = MoveTrial(*at, action, movers, tuple(looks), ahead, is_moved, is_shifted)
        return trial, action

    def _last_of(self, number: int) -> int:
        """The last step of a round at which an agent moved; ended ones step after it."""
        steps = self.script.steps
        places = (k for k, each in enumerate(self.script.rounds) if each == number)
        return max(k for k in places if steps[k].given)

    def _movers(self, step: int) -> list[Any]:
        number = self.script.rounds[step]
        places = (k for k, each in enumerate(self.script.rounds) if each == number)
        return [agent for k in places for agent in self.script.steps[k].given]

    def _looks(self, step: int, place: int, changed: BranchStep) -> Iterator[MoveLook]:
        base, rounds = self.script.steps[place], self.script.rounds
        lag = rounds[place] - rounds[step]
        is_early = place < self._last_of(rounds[step])

        def look(agent: Any, on: Any, is_changed: bool) -> MoveLook:
            early = is_early if on in ("reward", "ending") else lag == 0
            return MoveLook(agent_name(agent), on, lag, is_changed, early, place)

        if place > step:
            for agent, one in base.given.items():
                two = changed.given.get(agent)
                if two is not None:
                    yield look(agent, "observation", one.observation != two.observation)
                    if one.mask is not None or two.mask is not None:
                        yield look(agent, "mask", one.mask_digest != two.mask_digest)
        if changed.actions is None:
            return
        for agent in self._targets(base):
            paid = base.rewards.get(agent, 0.0), changed.rewards.get(agent, 0.0)
            yield look(agent, "reward", paid[0] != paid[1] and paid[0] == paid[0])
            if agent in changed.rewards or agent in changed.ended:  # else it hasn't joined there
                yield look(agent, "ending", (agent in base.ended) != (agent in changed.ended))

    def _targets(self, base: BranchStep) -> list[Any]:
        agents = list(base.rewards)
        step = max(len(agents) // MOST_TARGETS, 1)
        return agents[::step]

    def _priorities(
        self, boards: Mapping[int, Board], step: int, trials: Sequence[tuple[MoveTrial, Any]]
    ) -> Iterator[DrawnPriority]:
        """Pairs of one role of which one's move changes the other's reward, in several futures."""
        hits = {
            (trial.agent, look.target)
            for trial, _ in trials
            for look in trial.looks
            if look.on == "reward" and look.lag == 0 and look.is_changed
        }
        actions = {trial.agent: action for trial, action in trials}
        pairs = [
            (one, two)
            for one, two in sorted(hits)
            if one != two and two in actions and (two, one) not in hits and role(one) == role(two)
        ]
        if pairs:
            pair = pairs[int(self._rng.integers(len(pairs)))]
            found = self._ways(boards, step, pair, actions)
            if found is not None:
                yield found

    def _ways(
        self,
        boards: Mapping[int, Board],
        step: int,
        pair: tuple[str, str],
        actions: Mapping[str, Any],
    ) -> DrawnPriority | None:
        """Effects of both on each other by future; None: a move changes how many are drawn."""
        written = self.script.steps[step].actions or {}
        names = {agent_name(agent): agent for agent in written}
        first, second = (names[name] for name in pair)
        # what made way for the other is likely to do so for the other's move too
        yields = self._fitting(second, self.script.steps[step].given[second].mask, actions[pair[0]])
        is_other = value_digest(yields) != value_digest(written[second])
        its = yields if is_other else actions[pair[1]]
        changes: tuple[dict[Any, Any], ...] = ({}, {first: actions[pair[0]]}, {second: its})
        ways = []
        for future in range(FUTURES):
            outs = []
            for change in changes:
                board = self._arrived(boards, step)
                if future:
                    reseed(board.env, future)
                rewards = board.step({**written, **change}).rewards
                outs.append((rewards, standing(board.env) if future == 0 else ()))
            if future == 0 and not all(_alike(outs[0][1], each[1]) for each in outs[1:]):
                return None
            base, one, two = (rewards for rewards, _ in outs)
            ways.append((_takes(base, one, first, second), _takes(base, two, second, first)))
        return DrawnPriority(pair, step, tuple(ways)) if any(map(any, ways)) else None


def _takes(base: Mapping[Any, float], changed: Mapping[Any, float], taker: Any, other: Any) -> bool:
    """Tells whether one agent's move gave it what the other lost, or left the other what it had."""
    own, its = (changed.get(each, 0.0) - base.get(each, 0.0) for each in (taker, other))
    return own * its < 0


def _spaces(session: ProbeSession, stream: int) -> dict[str, Any]:
    """The action spaces by agent, copies of their own with a seed."""
    return {
        name: _seeded(spec.action_space, stream, place)
        for place, (name, spec) in enumerate(session.agents.items())
        if spec.action_space is not None
    }


def _seeded(space: Any, stream: int, place: int) -> Any:
    """A copy of a space with a seed of its own."""
    space = copy.deepcopy(space)
    space.seed(int(np.random.default_rng([29, stream, place]).integers(1 << 31)))
    return space


def _alike(one: Sequence[Any], two: Sequence[Any]) -> bool:
    """Tells whether generators stand at the same places."""
    return len(one) == len(two) and all(map(is_same_state, one, two))


def _is_same(one: BranchStep, two: BranchStep) -> bool:
    """Tells whether two steps gave, paid and ended the same."""
    given = [
        {agent: (each.observation, each.mask_digest) for agent, each in step.given.items()}
        for step in (one, two)
    ]
    rest = [(step.rewards, step.ended, step.roster) for step in (one, two)]
    return given[0] == given[1] and rest[0] == rest[1]
