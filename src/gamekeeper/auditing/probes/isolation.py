"""Probes of what plays share: global generators, other instances, other processes."""

import inspect
import math
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, Final

from gamekeeper.auditing.draw_places import OwnCode, moving_lines
from gamekeeper.auditing.meeting import meeting
from gamekeeper.auditing.other_process import (
    ROSTERS,
    hash_seeds,
    played_elsewhere,
    reason_against,
    roster_watch,
)
from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.checks.compared_reproducer import env_steps_of
from gamekeeper.checks.facts.seed_facts import (
    HashSeed,
    MovedGenerator,
    NumberedObjects,
    OtherInstance,
    RosterElsewhere,
    SettledElsewhere,
    UnmovedGenerator,
)
from gamekeeper.checks.object_ids import ids_from
from gamekeeper.checks.probe_evidence import ProbeCounterfactual
from gamekeeper.episodes.episode import Episode
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult
from gamekeeper.rollouts.interventions.generator_futures import GlobalGeneratorsDisturbed
from gamekeeper.rollouts.process_randomness import held, states

OTHER: Final = 5_180_211
"""Seed of the global generators while the second instance is built."""


DISTURBED: Final = 3
"""Plays that are disturbed whatever they do; of others only what moves a generator."""
WATCHED: Final = 100
"""Plays at most, within the ration."""


def _generators_plays(session: ProbeSession) -> Iterator[EpisodePlan]:
    """Long ones, and more where these end early: some draw at an end alone, or when two meet."""
    first = list(session.plays(DISTURBED, runs=2))
    yield from first
    for k in range(DISTURBED, WATCHED):
        yield replace(first[0], seed=session.seed + k, stream=k)


@probe("generators", share=1.5, plays=_generators_plays)
def generators(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """The global generators of a process: watched in one episode, disturbed in the next.

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

        env = session.env()
        notice("make", 0)
        base = session.play(play, env, watch=watch)
    lines: dict[str, list[str]] = {}
    if moved and play.stream < DISTURBED:
        with moving_lines(OwnCode.of(env), moved) as lines:
            session.fresh(base.play)
    for name in sorted(seen):
        if name in moved:
            call, turn = moved[name]
            used = MovedGenerator(name, call, tuple(lines.get(name, ())))
            yield session.fact(used, turn=turn, field=name)
        else:
            yield session.fact(UnmovedGenerator(name), field=name)
    if not moved and play.stream >= DISTURBED:
        return
    change = GlobalGeneratorsDisturbed()
    with held(OTHER):
        disturbed = session.play(base.play, session.env(), change=change)
    is_same = session.divergence(base.episode, disturbed.episode) is None
    unchanged_rerun = base if is_same else session.fresh(base.play)
    yield session.beside(base.episode, unchanged_rerun.episode, disturbed.episode, change.to_json())


APART: Final = 500
"""Distance of the other instance's seed from that of the episode."""
BESIDE: Final = 8
"""Plays beside another instance, within the ration."""


def _alternated_plays(session: ProbeSession) -> Iterator[EpisodePlan]:
    """Two that fill the ration, and more where these end early: some share what comes up late."""
    first = list(session.plays(2, runs=4))
    return session.plays_of([first[0].most_turns] * BESIDE)


@probe("alternated", share=1.0, plays=_alternated_plays, fresh=True)
def alternated(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """An episode while another instance is built, reset and stepped in between.

    The episode alone, and beside the other instance.

    Facts:
        `OtherInstance`.
    """
    base = session.fresh(play)
    seed = (base.play.seed or 0) + APART
    turns = max(len(base.play.actions or ()), 1)
    other = session.fresh(EpisodePlan(seed, base.play.stream + APART, most_turns=turns))
    actions = other.play.actions or ()
    with held():
        env = session.env()
        with held():
            beside = session.env()

        def step_beside(turn: int, env: Any, out: Any) -> None:
            with held():  # its exceptions and global draws have no effect here
                if turn == 0:
                    session.call("reset", beside.reset, seed=seed)
                elif turn <= len(actions):
                    if session.api == "aec":
                        session.call("last", beside.last)
                    session.step(beside, session.handed(dict(actions[turn - 1])))

        counterfactual = session.play(base.play, env, watch=step_beside)
    unchanged_rerun = base
    if session.divergence(base.episode, counterfactual.episode) is not None:
        unchanged_rerun = session.fresh(base.play)
        yield session.fact(OtherInstance(seed, actions))
    change = {"change": "another instance beside"}
    yield session.beside(base.episode, unchanged_rerun.episode, counterfactual.episode, change)


MOST_TURNS: Final = 100
FEWEST_TURNS: Final = 30
HERE: Final = 4
"""Further plays in this process, to see how often two are equal."""
BY_CHANCE: Final = 1 / 1_000
"""Probability that processes agree by chance, where they are said to agree."""
MOST_PROCESSES: Final = 12
"""Most processes that are tried; where more would have to agree, they count as not settled."""


OBJECTS: Final = "agents are objects that no other process knows"
READ: Final = "no other process reads what has another form than the API's"


def against(session: ProbeSession) -> str | None:
    """Only what is named by text can be opened elsewhere, and only agents that are values named."""
    if session.by_place:
        return reason_against(session) or OBJECTS
    return reason_against(session) or (READ if session.readings else None)


def _other_process_plays(session: ProbeSession) -> Iterator[EpisodePlan]:
    """One at random, one that brings agents together; more of the latter where these end early."""
    turns = min(max(session.ration // 8, FEWEST_TURNS), MOST_TURNS)
    return session.plays_of([turns] * (WHOLE + SINGLE))


ASKS: Final = re.compile(r"\bid\b")
STARTS: Final = (1, 2, 5)
"""Numbers of the first object: an order by addresses, or their remainder, is another by one."""
WHOLE: Final = 2
"""Plays under all hash seeds that are needed to turn any two names in a set."""
SINGLE: Final = 4
"""Further plays, each under one of them: a set may be in use for the last ticks of an episode."""


@probe("other_process", share=1.5, plays=_other_process_plays, against=against, tries=2)
def other_process(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """An episode in this process and in others with another order of the names in sets.

    The episode here and its counterfactual there, up to the first that differs.

    Facts:
        `HashSeed`, `NumberedObjects`, `RosterElsewhere`, `SettledElsewhere`.
    """
    if session.by_place:
        return  # agents that a reset makes are called otherwise by each play: none is like another
    is_steered = session.api == "parallel" and play.stream > 0
    steer = partial(meeting, session.contract) if is_steered else None
    rosters: list[list[str]] = []
    base = session.fresh(play, steer=steer, watch=roster_watch(rosters))
    numbered = _numbered(session, base.play) if play.stream == 0 else None
    if numbered is not None:
        yield session.fact(numbered, turn=numbered.turn, field="id")
        if numbered.turn is not None:
            return  # in no other process has an object the same address
    seeds = hash_seeds(tuple(sorted(session.agents)))
    for seed in seeds if play.stream < WHOLE else (seeds[play.stream % len(seeds)],):
        there = played_elsewhere(session, base, seed)
        if there is None:
            return
        if session.divergence(base.episode, there) is None:
            yield _elsewhere(session, base.episode, base.episode, there, seed)
            yield from _roster_elsewhere(session, rosters, there.header.get(ROSTERS), seed)
            continue
        unchanged_rerun = session.fresh(base.play).episode
        yield session.fact(HashSeed(seed))
        first = base.episode
        if session.divergence(first, unchanged_rerun) is not None:
            yield session.fact(SettledElsewhere(_is_settled_elsewhere(session, base, there, seed)))
        else:
            second = _second_elsewhere(session, base, there, seed)
            if second is not None:
                yield session.fact(SettledElsewhere(True))
                first, unchanged_rerun, there = there, second, second
        yield _elsewhere(session, first, unchanged_rerun, there, seed)
        return


def _numbered(session: ProbeSession, play: EpisodePlan) -> NumberedObjects | None:
    """The first numbers of objects with which an episode is another one.

    None where the environment's modules don't name id(), or episodes with equal numbers differ.
    """
    env = session.env()
    if not any(ASKS.search(source) for source in _sources(env)):
        return None

    def played(start: int) -> Episode:
        modules = ids_from(env, start)
        try:
            return session.fresh(play).episode
        finally:
            for each in modules:
                del each["id"]

    first = played(0)
    if session.divergence(first, played(0)) is not None:
        return None
    for start in STARTS:
        found = session.divergence(first, played(start))
        if found is not None:
            return NumberedObjects(start, env_steps_of(found) or 0)
    return NumberedObjects(0, None)


def _sources(env: Any) -> Iterator[str]:
    """Source of the modules of an environment's own classes, as far as there is one."""
    for cls in type(env.unwrapped).__mro__:
        with suppress(OSError, TypeError):
            yield inspect.getsource(cls)


def _elsewhere(
    session: ProbeSession, base: Episode, unchanged_rerun: Episode, there: Episode, hash_seed: int
) -> ProbeCounterfactual:
    change = {"change": "another process", "hash_seed": hash_seed}
    return session.beside(base, unchanged_rerun, there, change)


def _roster_elsewhere(
    session: ProbeSession, here: list[list[str]], there: Any, hash_seed: int
) -> Iterator[Saw]:
    """Yields the first rosters that aren't in one order, else the last ones."""
    pairs = [*enumerate(zip(here, there or (), strict=False))]
    for turn, (one, two) in [each for each in pairs if each[1][0] != each[1][1]][:1] or pairs[-1:]:
        value = RosterElsewhere(tuple(one), tuple(two), hash_seed)
        yield session.fact(value, turn=turn, field="agents")


def _second_elsewhere(
    session: ProbeSession, base: EpisodeResult, there: Episode, hash_seed: int
) -> Episode | None:
    """The episode by a second instance of a new process, where only the first plays as new ones do.

    All episodes here may be alike by then, as those before have left what instances share as it
    stays.
    """
    again = played_elsewhere(session, base, hash_seed)
    second = played_elsewhere(session, base, hash_seed, instance=2)
    if again is None or second is None or session.divergence(there, again) is not None:
        return None
    return None if session.divergence(there, second) is None else second


def _is_settled_elsewhere(
    session: ProbeSession, base: EpisodeResult, there: Episode, hash_seed: int
) -> bool:
    """Tells whether new processes agree with each other, though plays in this one don't.

    A rare draw that nobody seeded leaves two episodes equal by chance: as often as plays here are
    equal. So as many processes must agree as chance lets agree in one of 1,000 cases.
    """
    here = (session.fresh(base.play).episode for _ in range(HERE))
    alike = sum(session.divergence(base.episode, each) is None for each in here)
    chance = (alike + 1) / (HERE + 2)  # Laplace's rule of succession
    needed = math.ceil(math.log(BY_CHANCE) / math.log(chance))
    if needed > MOST_PROCESSES:
        return False
    others = (played_elsewhere(session, base, hash_seed) for _ in range(needed))
    return all(other is not None and session.divergence(there, other) is None for other in others)
