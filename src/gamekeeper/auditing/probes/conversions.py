"""Probes of copies of an environment and of its conversion to Parallel."""

import copy
import pickle
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from operator import methodcaller
from typing import Any, Final

from gymnasium.utils import EzPickle

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import Called, ProbeSession, Saw
from gamekeeper.checks.facts.copy_facts import ChangedView, ConvertedEnv, CopiedEnv, WithinCycle
from gamekeeper.checks.probe_evidence import Fact
from gamekeeper.contract import Contract
from gamekeeper.interface.env_inside import pettingzoo_parallel
from gamekeeper.rollouts.episode_loop import Actions, EpisodePlan, actions_of
from gamekeeper.rollouts.process_randomness import HELD, kept_global_generators, seed_all
from gamekeeper.rollouts.snapshots import is_same, snapshot

MOMENTS: Final = 8
"""Parts of an episode, between which copies are made."""
SHORT: Final = 3
"""Turns that a copy goes on; the one of the middle goes on to the end."""
ELSEWHERE: Final = 1000
"""Distance of the seed of another episode, for the original of a copy."""
WAYS: Final[Mapping[str, Callable[[Any], Any]]] = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
}
Told = list[tuple[str, Any, Any]]
"""By and by what was given: what it is, whose, a snapshot."""


@probe("copies", share=0.8, plays=lambda session: session.plays(1, runs=8, most_turns=60))
def copies(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Copies made in mid-episode, stepped with the same actions as the original.

    Copies at several moments of the episode; then the copy goes on, then the original.

    Facts:
        `CopiedEnv`.
    """
    base = session.play(play, state=False)
    script = base.play.actions or ()
    if not script:
        return
    (_, told), (_, again) = (_led(session, play, script) for _ in range(2))
    differs_by_itself = len(told) != len(script) or _first_divergence(told, again) is not None
    if differs_by_itself or not all(told):  # or a step gives nothing in the promised form
        return
    for way, duplicate in WAYS.items():
        facts = list(_copied(session, play, way, duplicate, script, told))
        yield from facts
        if way == "deepcopy" and not any(map(_is_wrong, facts)):
            yield _apart(session, play, script, told)


def _apart(
    session: ProbeSession, play: EpisodePlan, script: Sequence[Any], told: list[Told]
) -> Fact[CopiedEnv]:
    """Result of a copy that goes on while its original plays another episode."""
    at = len(script) // 2
    env, _ = _led(session, play, script[:at])
    made = copy.deepcopy(env)
    with kept_global_generators():
        session.call("reset", env.reset, seed=(play.seed or 0) + ELSEWHERE)
    ours = _tell(session, made, script[at:])
    session.call("close", made.close)
    first = _first_divergence(told[at:], ours)
    turn = None if first is None else at + first[0] + 1
    wrong = None if first is None else f"{first[1]} at turn {turn}, once its original was reset"
    return session.fact(
        CopiedEnv(None, wrong, None, at, is_apart=True), turn=turn, field="deepcopy"
    )


def _copied(
    session: ProbeSession,
    play: EpisodePlan,
    way: str,
    duplicate: Callable[[Any], Any],
    script: Sequence[Any],
    told: list[Told],
) -> Iterator[Fact[CopiedEnv]]:
    """Copies made in one way at several moments of an episode, up to the first that differs."""
    count = len(script)
    moments = sorted({count * k // MOMENTS for k in range(1, MOMENTS)})
    env, _ = _led(session, play, script[: moments[0]])
    for at, until in pairwise((*moments, count)):
        after = count if at == count // 2 else min(at + SHORT, count)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            pair = env, session.call(way, duplicate, env)
        fact = _beside(session, way, pair, script, told, (at, until, after))
        if not _is_wrong(fact):
            yield fact
            continue
        if at != moments[0]:  # an earlier copy may be to blame: once more where there was none
            env, _ = _led(session, play, script[:at])
            pair = env, session.call(way, duplicate, env)
            alone = _beside(session, way, pair, script, told, (at, count, count))
            if _is_wrong(alone) or fact.value.original is None:
                fact = alone
        yield fact
        return


def _is_wrong(fact: Fact[CopiedEnv]) -> bool:
    return any((fact.value.refused, fact.value.copy, fact.value.original))


def _beside(
    session: ProbeSession,
    way: str,
    pair: tuple[Any, Called],
    script: Sequence[Any],
    told: list[Told],
    turns: tuple[int, int, int],
) -> Fact[CopiedEnv]:
    """Result of a copy, and then of the original.

    Args:
        turns: at which it was copied, until which the original goes on, and until which the copy.
    """
    env, made = pair
    at, until, after = turns
    if made.failed is not None:
        return session.fact(CopiedEnv(made.said, None, None, at), field=way)
    if not getattr(made.value, "agents", None) or _begins_anew(env):
        refused = "the copy begins anew: it wants a reset"
        return session.fact(CopiedEnv(refused, None, None, at), field=way)
    # who draws from the global generators is told so elsewhere: here both go on from one place
    with kept_global_generators():
        ours = _tell(session, made.value, script[at:after])
    theirs = _tell(session, env, script[at:until])
    session.call("close", made.value.close)
    unsteppable = None
    if ours and ours[0][0][0] == "raises" and told[at][0][0] != "raises":
        unsteppable = f"the copy can't be stepped: {ours[0][0][2]}"
    seen: list[int] = []
    found: dict[str, str] = {}
    for name, gave, end in (("copy", ours, after), ("original", theirs, until)):
        first_divergence = _first_divergence(told[at:end], gave)
        if first_divergence is not None and not (name == "copy" and unsteppable):
            seen.append(at + first_divergence[0] + 1)
            found[name] = f"{first_divergence[1]} at turn {seen[-1]}"
    value = CopiedEnv(unsteppable, found.get("copy"), found.get("original"), at)
    return session.fact(value, turn=min(seen, default=None), field=way)


def _begins_anew(env: Any) -> bool:
    """Tells whether a copy is built from the constructor's arguments alone, as EzPickle says.

    Some constructors fill `agents`, so that such a copy can be stepped before its reset.
    """
    bare = getattr(env, "unwrapped", env)
    inner = type(getattr(bare, "guest", bare))  # another library's environment
    return issubclass(inner, EzPickle) and inner.__getstate__ is EzPickle.__getstate__


def _led(session: ProbeSession, play: EpisodePlan, script: Sequence[Any]) -> tuple[Any, list[Told]]:
    """An instance to which these turns have happened, and what they gave."""
    env = session.env()
    seed_all(HELD)  # who draws from the global generators is told so elsewhere
    session.reset(env, play)
    return env, _tell(session, env, script)


def _tell(session: ProbeSession, env: Any, script: Sequence[Any]) -> list[Told]:
    """Steps, and tells of each step all that it gave."""
    told = []
    for actions in actions_of(script):
        told.append(_step(session, env, dict(actions)))
        if (told[-1] and told[-1][0][0] == "raises") or not getattr(env, "agents", None):
            break
    return told


def _step(session: ProbeSession, env: Any, actions: dict[Any, Any]) -> Told:
    contract = session.contract
    gave: Told = []
    if session.api == "aec":
        last = session.call("last", env.last)
        if last.failed is not None:
            return [("raises", None, last.said)]
        agent = getattr(env, "agent_selection", None)
        gave.append(("last()", agent, _quiet(last.value, contract)))
    done = session.step(env, session.handed(actions))
    if done.failed is not None:
        return [("raises", None, done.said)]
    if session.api == "aec":
        gave.append(("rewards", None, snapshot(getattr(env, "rewards", None))))
    elif isinstance(done.value, tuple) and len(done.value) == 5:
        names = ("observations", "rewards", "terminations", "truncations")
        pairs = zip(names, done.value, strict=False)
        gave += [(name, None, snapshot(part)) for name, part in pairs]
        infos = done.value[4]
        if isinstance(infos, dict):
            gave.append(("infos", None, {a: _without(i, contract) for a, i in infos.items()}))
    state = session.call("state", methodcaller("state"), env)
    if state.failed is None:
        gave.append(("state()", None, snapshot(state.value)))
    return gave


def _quiet(last: Any, contract: Contract) -> Any:
    """Values of `last()` without fields of the info that may differ between equal episodes."""
    if not isinstance(last, tuple) or len(last) != 5:
        return snapshot(last)
    return snapshot((*last[:4], _without(last[4], contract)))


def _without(info: Any, contract: Contract) -> Any:
    volatile = contract.volatile_infos()
    if not isinstance(info, dict):
        return snapshot(info)
    return snapshot({key: item for key, item in info.items() if key not in volatile})


def _first_divergence(told: list[Told], other: list[Told]) -> tuple[int, str] | None:
    """The first step that gave something else, and what."""
    for turn, (one, two) in enumerate(zip(told, other, strict=False)):
        for (name, agent, value), (name_2, agent_2, value_2) in zip(one, two, strict=False):
            if name != name_2:
                return turn, str(value_2) if name_2 == "raises" else f"{name} is missing"
            if agent != agent_2 or not is_same(_bare(value), _bare(value_2)):
                return turn, f"{name} differs" if agent == agent_2 else "agent_selection differs"
        if len(one) != len(two):
            return turn, "there is more or less of it"
    if len(told) != len(other):
        return min(len(told), len(other)), "the episode has another length"
    return None


def _bare(value: Any) -> Any:
    """A snapshot with its objects that couldn't be copied left out."""
    if isinstance(value, dict):
        return {key: _bare(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_bare(item) for item in value]
    return None if type(value).__name__ == "OpaqueValue" else value


def _conversion_plays(session: ProbeSession) -> Iterator[EpisodePlan]:
    """Plays in ticks; each tick is a turn of every agent."""
    agents = max(len(session.agents), 1)
    yield from session.plays(3, runs=2 * agents, most_turns=60)


@probe("conversion", share=0.8, plays=_conversion_plays, api="aec")
def conversion(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """An AEC environment with is_parallelizable, under PettingZoo's aec_to_parallel.

    Plays it behind the conversion, and looks whether observations wait for the cycle's end.

    Facts:
        `ConvertedEnv`, `WithinCycle`.
    """
    env = session.env()
    metadata = getattr(env, "metadata", None)
    said = bool(isinstance(metadata, dict) and metadata.get("is_parallelizable"))
    if not said:
        yield session.fact(ConvertedEnv(said=False, failed=None, ticks=0), field="metadata")
        return
    made = session.call("aec_to_parallel", pettingzoo_parallel, env)
    if made.failed is not None:
        value = ConvertedEnv(said=True, failed=made.said, ticks=0)
        yield session.fact(value, turn=0, field="conversion")
        return
    played = session.play(play, made.value, state=False)
    ticks = len(played.play.actions or ())
    session.meter.count(ticks * max(len(session.agents) - 1, 0))  # a tick is a step of each of them
    failed = None if played.failed is None else played.failed.said
    value = ConvertedEnv(said=True, failed=failed, ticks=ticks)
    turn = None if played.failed is None else ticks
    yield session.fact(value, turn=turn, field="conversion")
    if played.failed is None:
        yield _cycles(session, play, list(played.play.actions or ()))


def _cycles(session: ProbeSession, play: EpisodePlan, script: list[Actions]) -> Saw:
    """Plays the same actions turn by turn, and compares what was seen within each cycle."""
    env = session.env()
    looks, found, seen_at = 0, None, None
    if session.call("reset", env.reset, seed=play.seed).failed is not None:
        script = []
    for tick, actions in enumerate(script):
        agents = [a for a in env.agents if not (env.terminations[a] or env.truncations[a])]
        shown = {a: snapshot(session.call("observe", env.observe, a).value) for a in agents}
        acted: list[Any] = []
        while env.agents and len(acted) < len(agents) and found is None:
            agent = env.agent_selection
            if env.terminations[agent] or env.truncations[agent]:
                break
            now = session.call("observe", env.observe, agent).value
            looks += 1
            if agent in shown and not is_same(now, shown[agent]):
                found, seen_at = ChangedView(agent, list(acted)), tick
            if session.step(env, actions.get(agent)).failed is not None:
                break
            acted.append(agent)
        while env.agents and _is_over(env) and session.step(env, None).failed is None:
            pass
        if found is not None:
            break
    agent = None if found is None else found.agent
    return replace(
        session.fact(WithinCycle(looks=looks, changed=found), agent=agent, field="cycle"),
        where=session.at(None if seen_at is None else seen_at + 1, agent, "cycle"),
    )


def _is_over(env: Any) -> bool:
    agent = env.agent_selection
    return bool(env.terminations.get(agent) or env.truncations.get(agent))
