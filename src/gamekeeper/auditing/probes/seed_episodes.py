"""Probes of seeds: the same seed, special ones, none, and a second episode."""

from collections.abc import Iterator
from dataclasses import replace
from hashlib import blake2b
from typing import Any, Final

from gamekeeper.auditing.draw_places import OwnCode, entropy_lines
from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.checks.facts.seed_facts import (
    AskedEntropy,
    EpisodeBefore,
    EpisodeElsewhere,
    LaterSeeds,
    PlainSeed,
    SeededEpisodes,
    SpecialRefused,
    UnseededAgain,
    UnseededEpisodes,
    UnseededOpenings,
)
from gamekeeper.checks.paired_episodes import told_difference
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.episode import digests_of
from gamekeeper.episodes.layout import agent_name
from gamekeeper.interface.generators import is_same_state
from gamekeeper.rollouts.episode_loop import Actions, EpisodePlan, EpisodeResult, StepHook
from gamekeeper.rollouts.interventions.generator_futures import GeneratorsElsewhere
from gamekeeper.rollouts.process_randomness import LATER_S, held, later, reseed, standing

PLAYS: Final = 3


OTHERWISE: Final = 90_127
"""Seed of the global generators in the episode that starts them elsewhere."""


@probe("same_seed", share=1.5, plays=lambda session: session.plays(PLAYS, runs=3))
def same_seed(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """The same seed and actions again, in a second instance where possible.

    The episode and its counterfactual; generators of the whole process start from the same state.

    Counterfactuals by `change`: `nothing`; `the global generators`, which start from another state;
    in the first episode also `empty options`, whose unchanged
    rerun is that, and `the time of day`, where nothing else made a difference.

    Facts:
        `AskedEntropy`.
    """
    base = session.fresh(play)
    with entropy_lines(OwnCode.of(session.opened.env)) as lines:
        again = session.fresh(base.play)
    same = session.beside(base.episode, base.episode, again.episode, {"change": "nothing"})
    yield same
    if lines:
        yield session.fact(AskedEntropy(tuple(lines)))
    if same.divergence is None:
        with held(OTHERWISE):
            elsewhere = session.play(base.play, session.env(), hold=False)
        change: dict[str, Any] = {"change": "the global generators"}
        yield session.beside(base.episode, again.episode, elsewhere.episode, change)
    if session.number == 0 and same.divergence is None:
        for seconds in LATER_S:
            with held(), later(seconds):
                other = session.play(base.play, session.env())
            change = {"change": "the time of day", "later_s": seconds}
            moved = session.beside(base.episode, again.episode, other.episode, change)
            yield moved
            if moved.divergence is not None:
                break
    if session.number == 0 and play.options is None:
        short = replace(base.play, options={}, actions=(base.play.actions or ())[:1])
        empty = session.fresh(short)
        if empty.failed is None:  # a reset that refuses options is another promise
            none = session.fresh(replace(short, options=None)).episode
            yield session.beside(none, none, empty.episode, {"change": "empty options"})


SPECIAL_SEEDS: Final = (0, 2**31 - 1)
PLAIN: Final = 12345
"""A seed like any other, to compare with."""
SPECIAL_TURNS: Final = 8
AGAIN: Final = 4
"""Further plays of a seed: where few openings are possible, two are often equal by chance."""


def _special_seeds_plays(session: ProbeSession) -> Iterator[EpisodePlan]:
    """One for each of the seeds."""
    plays = session.plays(len(SPECIAL_SEEDS), runs=AGAIN + 1, most_turns=SPECIAL_TURNS)
    return (replace(play, seed=seed) for seed, play in zip(SPECIAL_SEEDS, plays, strict=True))


@probe("special_seeds", share=1.0, plays=_special_seeds_plays)
def special_seeds(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Seeds that are easily mishandled: 0 taken for none, large integers.

    The episode and its counterfactual.

    Facts:
        `SpecialRefused`, `PlainSeed`.
    """
    one, two, is_used = _twice(session, play)
    change = {"change": "nothing", "seed": play.seed, "is_used": is_used}
    yield session.beside(one.episode, one.episode, two.episode, change)
    is_refused = one.failed is not None and one.failed.call == "reset"
    if one.failed is not None and is_refused:
        yield session.fact(SpecialRefused(one.failed.said))
    if is_refused or _parts(session, one, two):
        plain, again, _ = _twice(session, replace(play, seed=PLAIN, actions=None))
        is_same = not _parts(session, plain, again)
        raises = plain.failed is not None and plain.failed.call == "reset"
        yield session.fact(PlainSeed(is_same and not raises))


def _twice(session: ProbeSession, play: EpisodePlan) -> tuple[EpisodeResult, EpisodeResult, bool]:
    """The episode, and another one of it that differs because of its seed, where one does.

    The last tells whether it is of a used instance.

    What differs only in a used instance is the seed's doing where plays without a seed go the same
    way; else it is what the last play left.
    """
    one = _fresh(session, play)[0]
    script = replace(play, actions=one.play.actions)
    again, env = _fresh(session, script)
    used = [again]
    while len(used) < AGAIN and not _parts(session, one, used[-1]):
        used.append(session.play(script, env))
    if len(used) == 1 or not _parts(session, one, used[-1]):
        return one, used[-1], len(used) > 1
    if not _parts(session, used[-1], _unseeded(session, script, len(used))):
        return one, used[-1], True
    for _ in range(AGAIN):
        again = _fresh(session, script)[0]
        if _parts(session, one, again):
            break
    return one, again, False


def _unseeded(session: ProbeSession, script: EpisodePlan, count: int) -> EpisodeResult:
    """The last of so many plays in one instance, of which only the first has its seed."""
    played, env = _fresh(session, script)
    for _ in range(count - 1):
        played = session.play(replace(script, seed=None), env)
    return played


def _fresh(session: ProbeSession, play: EpisodePlan) -> tuple[EpisodeResult, Any]:
    with held():
        env = session.env()
    return session.play(play, env), env


def _parts(session: ProbeSession, one: EpisodeResult, two: EpisodeResult) -> bool:
    return session.divergence(one.episode, two.episode) is not None


FEW: Final = 4
"""Plays of a kind, unless something is suspicious."""
MANY: Final = 16
"""Plays of a kind, where one kind varies and the other doesn't."""
UNSEEDED_TURNS: Final = 25
LATER_PLAYS: Final = 3
"""Number of episodes that may be longer, where none has made a difference so far."""
LONG: Final = 100
GLOBAL: Final = 2
"""The first places are those of Python's and NumPy's generators, of which other probes see."""
ELSEWHERE: Final = 7_919
"""Any number that nobody is likely to seed with."""


# what is drawn at the reset shows at once
@probe(
    "unseeded", share=0.5, plays=lambda session: session.plays(1, runs=8, most_turns=UNSEEDED_TURNS)
)
def unseeded(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Resets with several seeds beside resets without one.

    What plays came to, as digests.

    Facts:
        `SeededEpisodes`, `UnseededEpisodes`, `UnseededOpenings`, `EpisodeElsewhere`,
        `UnseededAgain`.
    """
    seeded = [_told(session.play(play, session.env(), hold=False))]
    _until_two(seeded, FEW, lambda: _told(_seeded(session, play, len(seeded))))
    env, other = session.env(), session.env() if session.can_make else None
    first = replace(play, actions=session.base.actions if session.base else None)
    begun = [_told(session.play(first, env, hold=False))]
    again = replace(play, seed=None)
    played = session.play(again, env, hold=False)
    if played.failed is not None and played.failed.call == "reset":
        return  # that none is needed is another promise
    unseeded = [_told(played)]
    _until_two(unseeded, FEW, lambda: _told(session.play(again, env, hold=False)))
    if other is not None:
        begun.append(_told(session.play(first, other, hold=False)))
        if len(set(begun)) == 1:
            asked: list[bool] = []
            with entropy_lines(OwnCode.of(session.opened.env)) as lines:

                def note(turn: int, env: Any, out: Any) -> None:
                    asked.append(bool(lines))

                told = _told(session.play(again, other, hold=False, watch=note))
            is_same = told == unseeded[0]
            if is_same or asked[:1] == [True]:  # else what nobody ever seeds is to blame
                yield session.fact(UnseededAgain(is_same))
    kinds = len(set(seeded)), len(set(unseeded))
    if kinds[0] > 1 and kinds[1] == 1:
        while len(seeded) < MANY:
            seeded.append(_told(_seeded(session, play, len(seeded))))
        while len(unseeded) < MANY and len(set(unseeded)) == 1:
            unseeded.append(_told(session.play(again, env, hold=False)))
    elif kinds[0] == 1 and kinds[1] > 1:
        _until_two(seeded, MANY, lambda: _told(_seeded(session, play, len(seeded))))
        yield session.fact(UnseededOpenings(_drawn_openings(session)))
    elif kinds == (1, 1):
        yield session.fact(EpisodeElsewhere(_elsewhere(session, play)))
    yield session.fact(SeededEpisodes(seeded))
    yield session.fact(UnseededEpisodes(unseeded))


def _until_two(found: list[str], most: int, more: Any) -> None:
    """Goes on until two differ."""
    while len(found) < most and len(set(found)) < 2:
        found.append(more())


def _seeded(session: ProbeSession, play: EpisodePlan, number: int) -> EpisodeResult:
    return session.play(replace(play, seed=(play.seed or 0) + number), session.env(), hold=False)


def _told(played: EpisodeResult) -> str:
    """All that was given and done, and nothing of how it came about."""
    episode = played.episode
    text = blake2b(digests_of(episode.steps).tobytes(), digest_size=8)
    for info in episode.steps["info"].to_pylist():
        text.update(str(info).encode())
    return text.hexdigest()


def _elsewhere(session: ProbeSession, play: EpisodePlan) -> str | None:
    """Course of an episode from elsewhere in the streams that don't depend on the seed.

    A game without chance draws from nothing, or what it draws makes no difference.
    """
    if play.actions is None:
        play = replace(
            play, most_turns=max(play.most_turns, min(session.ration // LATER_PLAYS, LONG))
        )
    played, begun = [], []
    for number in range(LATER_PLAYS):
        stands: list[Any] = []
        again = replace(play, seed=(play.seed or 0) + number)
        played.append(session.play(again, session.env(), watch=_noting(stands), hold=False))
        begun.append(stands)
    if len(set(map(_told, played))) > 1:
        return None  # later on they part
    places = [
        place
        for place, stand in enumerate(zip(*begun, strict=False))
        if place >= GLOBAL and all(is_same_state(stand[0], each) for each in stand[1:])
    ]
    change = GeneratorsElsewhere(tuple(places), number=ELSEWHERE)
    other = session.play(played[0].play, session.env(), change=change, hold=False)
    found = session.divergence(played[0].episode, other.episode)
    return None if found is None else told_difference(found)


def _noting(stands: list[Any]) -> StepHook:
    """Notes where the generators stand after the reset."""

    def watch(turn: int, env: Any, out: Any) -> None:
        if turn == 0:
            stands.extend(standing(env))

    return watch


def _drawn_openings(session: ProbeSession) -> list[str]:
    """Openings of resets without a seed; of those that no draw decides, the first.

    These differ since something of an earlier episode is left, and not since a seed is ignored.
    """
    found = _openings(session, session.env(), 0)
    is_drawn = any(_openings(session, session.env(), number) != found for number in (0, 1))
    return found if is_drawn else found[:1]


def _openings(session: ProbeSession, env: Any, number: int) -> list[str]:
    """Openings of resets without a seed, with generators that `number` settles."""
    found = []
    for k in range(FEW):
        session.meter.count()
        reseed(env, number * FEW + k)
        out = session.call("reset", env.reset)
        if out.failed is not None:
            break
        seen = out.value[0] if session.api == "parallel" else _observed(session, env)
        found.append(to_json(list(seen.values()) if isinstance(seen, dict) else seen))
    return found


def _observed(session: ProbeSession, env: Any) -> dict[str, Any]:
    return {
        agent_name(agent): session.call("observe", env.observe, agent).value for agent in env.agents
    }


APART: Final = 1000
"""Distance of the last episode's seed from that of the present one."""
RESETS: Final = 6
"""Resets that go before an episode; what counts them shows after a few."""
BEFORE: Final = (1, 4)
"""Plays of an episode, one after the other, that go before it, by look: the most."""


def _second_episode_plays(session: ProbeSession) -> Iterator[EpisodePlan]:
    """One that differed in a used instance, if any; long ones, so that whole episodes go before."""
    yield from session.unlike
    yield from session.plays(2, runs=7)


@probe("second_episode", share=1.5, plays=_second_episode_plays)
def second_episode(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """An episode in a used instance, beside the same in a fresh one.

    Counterfactuals: what went before the episode differs.

    The same episode, up to `BEFORE` times, one of another seed that is cut in its middle, the same
    cut before its largest reward, `RESETS` resets with the same seed and no step. Each comes only
    where those before it told nothing. Facts, beside a counterfactual that parts:
        `EpisodeBefore`, `LaterSeeds`.
    """
    base = session.fresh(play)
    change = {"change": "an episode before"}
    resets = replace(base.play, actions=(), most_turns=0)
    for before in (base.play, _cut(session, base), *_unpaid(base), resets):
        times = RESETS if before is resets else 1
        if before is base.play:
            after, times = _once_more(session, base, BEFORE[session.number % len(BEFORE)])
        else:
            after = session.after(before, base.play, times)
        if not _parts(session, base, after):
            yield session.beside(base.episode, base.episode, after.episode, change)
            continue
        unchanged_rerun = session.fresh(base.play)
        yield session.beside(base.episode, unchanged_rerun.episode, after.episode, change)
        if not _parts(session, base, unchanged_rerun):
            script = None if before is base.play else _script_of(session, before)
            yield session.fact(EpisodeBefore(script, times))
            if after.failed is None or after.failed.call != "reset":  # else no seed is looked at
                yield session.fact(LaterSeeds(*_seeds_matter(session, before, base, after, times)))
        return


def _cut(session: ProbeSession, base: EpisodeResult) -> EpisodePlan:
    # an odd number of turns in one look, an even one in the other: somebody else may be in turn
    turns = len(base.play.actions or ()) // 4 * 2 + 1 + session.number % 2
    seed = (base.play.seed or 0) + APART
    return EpisodePlan(seed=seed, stream=base.play.stream + APART, most_turns=turns)


def _unpaid(base: EpisodeResult) -> Iterator[EpisodePlan]:
    """The episode up to the step that pays most: what is owed then is paid later."""
    turns = base.episode.turns
    paid = [max((abs(x or 0.0) for x in turn.rewards.values()), default=0.0) for turn in turns]
    at = max(range(len(paid)), key=paid.__getitem__, default=0)
    if at and paid[at] > min(paid[:-1]):  # a turn's rewards are those of its own step
        yield replace(base.play, actions=(base.play.actions or ())[:at], most_turns=at)


def _once_more(session: ProbeSession, base: EpisodeResult, most: int) -> tuple[EpisodeResult, int]:
    """The episode after itself, until it is another, and how often it went before."""
    with held():
        env = session.env()
    session.play(base.play, env)
    for times in range(1, most + 1):
        after = session.play(base.play, env)
        if _parts(session, base, after):
            return after, times
    return after, most


def _script_of(
    session: ProbeSession, before: EpisodePlan
) -> tuple[int | None, tuple[Actions, ...]]:
    if before.actions is None:
        before = session.fresh(before).play
    return before.seed, before.actions or ()


def _seeds_matter(
    session: ProbeSession,
    before: EpisodePlan,
    base: EpisodeResult,
    after: EpisodeResult,
    times: int,
) -> tuple[bool, bool]:
    """Tells whether another seed makes another episode, in a fresh instance and a used one."""
    other = replace(base.play, seed=(base.play.seed or 0) + 1)
    used = session.after(before, other, times)
    return _parts(session, base, session.fresh(other)), _parts(session, after, used)
