"""Probes of what plays share: global generators, other instances, other processes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, Final

from gamekeeper.auditing.elsewhere import hash_seeds, played_elsewhere, reason_against
from gamekeeper.auditing.meeting import meeting
from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.checks.facts.seed_facts import (
    HashSeed,
    MovedGenerator,
    OtherInstance,
    SettledElsewhere,
    UnmovedGenerator,
)
from gamekeeper.checks.probe_evidence import ProbeCounterfactual
from gamekeeper.episodes.episode import Episode
from gamekeeper.rollouts.episode_loop import Actions, EpisodePlan, EpisodeResult
from gamekeeper.rollouts.interventions.generator_futures import GlobalGeneratorsDisturbed
from gamekeeper.rollouts.process_randomness import held, states

OTHER: Final = 5_180_211
"""Seed of the global generators while the second instance is built."""


DISTURBED: Final = 3
"""Plays that are disturbed whatever they do; of others only what moves a generator."""
WATCHED: Final = 100
"""Plays at most, within the ration."""


def _generators_plays(lab: ProbeSession) -> Iterator[EpisodePlan]:
    """Long ones, and more where these end early: some draw at an end alone, or when two meet."""
    first = list(lab.plays(DISTURBED, runs=2))
    yield from first
    for k in range(DISTURBED, WATCHED):
        yield replace(first[0], seed=lab.seed + k, stream=k)


@probe("generators", share=1.5, plays=_generators_plays)
def generators(lab: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """The generators that all of a process shares: watched in one play, disturbed in the next.

    A counterfactual, and what became of the global generators meanwhile.

    Facts:
        `UnmovedGenerator`, `MovedGenerator`.
    """
    moved: dict[str, tuple[str, int]] = {}
    with held():
        seen = states()

        def notice(call: str, turn: int) -> None:
            now = states()
            for name in now.keys() & seen.keys():
                if now[name] != seen[name]:
                    moved.setdefault(name, (call, turn))
            seen.update(now)

        def watch(turn: int, env: Any, out: Any) -> None:
            notice("step" if turn else "reset", turn)

        env = lab.env()
        notice("make", 0)
        base = lab.play(play, env, watch=watch)
    for name in sorted(seen):
        if name in moved:
            call, turn = moved[name]
            yield lab.fact(MovedGenerator(name, call), turn=turn, field=name)
        else:
            yield lab.fact(UnmovedGenerator(name), field=name)
    if not moved and play.stream >= DISTURBED:
        return
    change = GlobalGeneratorsDisturbed()
    with held(OTHER):
        disturbed = lab.play(base.play, lab.env(), change=change)
    is_same = lab.divergence(base.trace, disturbed.trace) is None
    unchanged_rerun = base if is_same else lab.fresh(base.play)
    yield lab.beside(base.trace, unchanged_rerun.trace, disturbed.trace, change.to_json())


APART: Final = 500
"""Distance of the other instance's seed from that of the episode."""


@probe("alternated", share=1.0, plays=lambda lab: lab.plays(2, runs=4), fresh=True)
def alternated(lab: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """A play beside another instance that is built, reset and stepped in turns with it.

    The play alone, and beside the other instance.

    Facts:
        `OtherInstance`.
    """
    base = lab.fresh(play)
    seed = (base.play.seed or 0) + APART
    turns = max(len(base.play.actions or ()), 1)
    other = lab.fresh(EpisodePlan(seed, base.play.stream + APART, most_turns=turns))
    course = other.play.actions or ()
    with held():
        env = lab.env()
        with held():
            beside = lab.env()
        counterfactual = lab.play(base.play, env, watch=_Beside(lab, beside, seed, course))
    unchanged_rerun = base
    if lab.divergence(base.trace, counterfactual.trace) is not None:
        unchanged_rerun = lab.fresh(base.play)
        yield lab.fact(OtherInstance(seed, course))
    change = {"change": "another instance beside"}
    yield lab.beside(base.trace, unchanged_rerun.trace, counterfactual.trace, change)


class _Beside:
    """Resets the other instance right after the first one's reset, and steps it at every turn."""

    def __init__(self, lab: ProbeSession, env: Any, seed: int, course: tuple[Actions, ...]) -> None:
        self._lab, self._env, self._seed, self._course = lab, env, seed, course

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """Steps the other instance; its exceptions and global draws have no effect here."""
        with held():
            if turn == 0:
                self._lab.call("reset", self._env.reset, seed=self._seed)
            elif turn <= len(self._course):
                self._step(self._course[turn - 1])

    def _step(self, actions: Actions) -> None:
        if self._lab.api == "aec":
            self._lab.call("last", self._env.last)
            self._lab.step(self._env, next(iter(actions.values()), None))
        else:
            self._lab.step(self._env, dict(actions))


MOST_TURNS: Final = 100
FEWEST_TURNS: Final = 30
HERE: Final = 4
"""Further plays in this process, to see how often two are equal."""
BY_CHANCE: Final = 1 / 1_000
"""Probability that processes agree by chance, where they are said to agree."""
MOST_PROCESSES: Final = 12
"""Most processes that are tried; where more would have to agree, they count as not settled."""


def against(lab: ProbeSession) -> str | None:
    """Only what is named by text can be opened elsewhere."""
    return reason_against(lab)


def _other_process_plays(lab: ProbeSession) -> Iterator[EpisodePlan]:
    """One at random, one that brings agents together; more of the latter where these end early."""
    turns = min(max(lab.ration // 8, FEWEST_TURNS), MOST_TURNS)
    return lab.plays_of([turns] * (WHOLE + SINGLE))


WHOLE: Final = 2
"""Plays under all hash seeds that are needed to turn any two names in a set."""
SINGLE: Final = 4
"""Further plays, each under one of them: a set may be in use for the last ticks of an episode."""


@probe("other_process", share=1.5, plays=_other_process_plays, against=against, tries=2)
def other_process(lab: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """A play in this process and in others, under hash seeds that turn the order of names in sets.

    The play here and its counterfactual there, up to the first that differs.

    Facts:
        `HashSeed`, `SettledElsewhere`.
    """
    is_steered = lab.api == "parallel" and play.stream > 0
    base = lab.fresh(play, steer=partial(meeting, lab.contract) if is_steered else None)
    seeds = hash_seeds(tuple(sorted(lab.agents)))
    for seed in seeds if play.stream < WHOLE else (seeds[play.stream % len(seeds)],):
        there = played_elsewhere(lab, base, seed)
        if there is None:
            return
        if lab.divergence(base.trace, there) is None:
            yield _elsewhere(lab, base.trace, base.trace, there, seed)
            continue
        unchanged_rerun = lab.fresh(base.play).trace
        yield lab.fact(HashSeed(seed))
        first = base.trace
        if lab.divergence(first, unchanged_rerun) is not None:
            yield lab.fact(SettledElsewhere(_is_settled_elsewhere(lab, base, there, seed)))
        else:
            second = _second_elsewhere(lab, base, there, seed)
            if second is not None:
                yield lab.fact(SettledElsewhere(True))
                first, unchanged_rerun, there = there, second, second
        yield _elsewhere(lab, first, unchanged_rerun, there, seed)
        return


def _elsewhere(
    lab: ProbeSession, base: Episode, unchanged_rerun: Episode, there: Episode, hash_seed: int
) -> ProbeCounterfactual:
    change = {"change": "another process", "hash_seed": hash_seed}
    return lab.beside(base, unchanged_rerun, there, change)


def _second_elsewhere(
    lab: ProbeSession, base: EpisodeResult, there: Episode, hash_seed: int
) -> Episode | None:
    """The play by a second instance of a new process, where only the first plays as new ones do.

    All plays here may be alike by then, as those before have left what instances share as it stays.
    """
    again = played_elsewhere(lab, base, hash_seed)
    second = played_elsewhere(lab, base, hash_seed, instance=2)
    if again is None or second is None or lab.divergence(there, again) is not None:
        return None
    return None if lab.divergence(there, second) is None else second


def _is_settled_elsewhere(
    lab: ProbeSession, base: EpisodeResult, there: Episode, hash_seed: int
) -> bool:
    """Tells whether new processes agree with each other, though plays in this one don't.

    A rare draw that nobody seeded leaves two plays equal by chance: as often as plays here are
    equal. So as many processes must agree as chance lets agree in one of 1,000 cases.
    """
    here = (lab.fresh(base.play).trace for _ in range(HERE))
    alike = sum(lab.divergence(base.trace, each) is None for each in here)
    chance = (alike + 1) / (HERE + 2)  # Laplace's rule of succession
    needed = math.ceil(math.log(BY_CHANCE) / math.log(chance))
    if needed > MOST_PROCESSES:
        return False
    others = (played_elsewhere(lab, base, hash_seed) for _ in range(needed))
    return all(other is not None and lab.divergence(there, other) is None for other in others)
