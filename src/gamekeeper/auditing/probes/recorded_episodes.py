"""Probes of recorded plays: rollouts from several seeds, and a replay from evidence alone."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Space

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import RESET_STEPS, ProbeSession, Saw
from gamekeeper.auditing.probes.moves import affordable
from gamekeeper.auditing.probes.state_calls import form_of, space_of
from gamekeeper.auditing.probes.surface import TIME, far_limits, limits_of
from gamekeeper.checks.facts.episode_facts import (
    AgentNames,
    NearLimit,
    RaisedCall,
    SelectedAgents,
    StateForms,
    TurnRosters,
    UnwrittenActions,
)
from gamekeeper.checks.facts.state_facts import StateAnswer
from gamekeeper.checks.literal import is_value
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.layout import agent_name
from gamekeeper.interface.env_source import possible_agents_of
from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.rollouts.episode_loop import EpisodePlan, FailedCall
from gamekeeper.rollouts.memory import MemorySink
from gamekeeper.rollouts.process_randomness import held
from gamekeeper.rollouts.reruns import replayed_episode

PLAYS: Final = 8
"""Episodes at least, however long."""
SHORT_PLAYS: Final = 56
"""Further episodes at most, where the first ones ended early and left steps to spend."""


@probe(
    "rollout",
    share=6.0,
    plays=lambda session: session.plays_of(
        [max(session.ration // PLAYS, 20)] * (PLAYS + SHORT_PLAYS)
    ),
)
def rollout(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Rollouts from several seeds with random legal actions, long enough to see endings.

    The episode, and what raised.

    Facts:
        `RaisedCall`, `SelectedAgents`, `TurnRosters`, `StateForms`.
    """
    env = session.env()
    watched = _Watched(session.api)
    played = session.play(play, env, watch=watched.watch)
    yield played.episode
    yield from _states(session, space_of(session, env), played.episode)
    yield session.fact(TurnRosters(watched.rosters), field="agents")
    if session.api == "aec":
        yield session.fact(SelectedAgents(watched.selected), field="agent_selection")
    if played.failed is not None:
        yield session.fact(_raised(played.failed), turn=played.failed.turn, field="raised")


@dataclass(slots=True)
class _Watched:
    """`agents` and (AEC) the selected one, at the start of each turn."""

    api: str
    rosters: list[list[str]] = field(default_factory=list)
    selected: list[tuple[str | None, bool]] = field(default_factory=list)

    def watch(self, turn: int, env: Any, out: Any) -> None:
        """One turn's start."""
        agents = env.agents
        self.rosters.append([agent_name(agent) for agent in agents])
        if self.api == "aec" and agents:
            chosen = getattr(env, "agent_selection", None)
            self.selected.append((None if chosen is None else agent_name(chosen), chosen in agents))


def _raised(failed: FailedCall) -> RaisedCall:
    return RaisedCall(failed.call, failed.kind, failed.text)


NEAR: Final = (7, 11)
"""Limits of the two plays with a near one."""
MOST_NAMES: Final = 3


def _turns_to(session: ProbeSession, limit: int) -> int:
    """Turns in which a limit of ticks is met, and two ticks more."""
    agents = max(len(session.agents), 2)
    return limit + 2 if session.api == "parallel" else (limit + 4) * agents


@probe(
    "near_limit",
    share=0.0,
    on_top=0.12,
    fresh=True,
    tries=3,
    plays=lambda session: session.plays_of(_turns_to(session, limit) for limit in NEAR),
)
def near_limit(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """An episode of an instance that is built with a nearer limit than its own.

    A limit of thousands of steps is met by no rollout, and what happens there by no check. Its
    argument is one of the constructor that is called like a limit and is larger, or None; another
    one is tried where an episode with it doesn't end. Where no argument sets it, an attribute or a
    constant names it, and half of what the probe may take is enough, it is met as it is.

    The episode.

    Facts:
        `NearLimit`.
    """
    limit = NEAR[play.stream % len(NEAR)]
    for name in far_limits(session.env(), session.kwargs, max(NEAR))[:MOST_NAMES]:
        options = {name: limit}
        made = session.call("make", session.make, **options)
        if made.failed is None:
            saw = list(_to_its_end(session, play, made.value, options, options))
            if saw:
                yield from saw
                return
    env = session.env()
    longest = session.ration // len(NEAR)
    limits = {name: x for name, x in limits_of(env).items() if _turns_to(session, x) <= longest}
    turns = _turns_to(session, max(limits.values(), default=0))
    if limits and affordable(session, turns) == turns:
        whole = replace(play, most_turns=turns) if play.actions is None else play
        yield from _to_its_end(session, whole, env, limits, {})


def _to_its_end(
    session: ProbeSession,
    play: EpisodePlan,
    env: Any,
    limits: dict[str, int],
    options: dict[str, int],
) -> Iterator[Saw]:
    """The episode and its facts, if an agent ends in it."""
    watched = _Watched(session.api)
    played = session.play(play, env, watch=watched.watch)
    if any(turn.ended for turn in played.episode.turns):
        raised = None if played.failed is None else _raised(played.failed)
        of_time = {name: x for name, x in limits.items() if TIME.search(name) is not None}
        yield played.episode
        yield session.fact(
            NearLimit(of_time, options, watched.rosters, watched.selected, raised),
            turn=None if played.failed is None else played.failed.turn,
            field="raised",
        )


def _states(session: ProbeSession, space: Space[Any] | None, episode: Episode) -> Iterator[Saw]:
    """The forms of state() in an episode; rare ones are met in long plays alone."""
    forms: dict[str, StateAnswer] = {}
    for turn in episode.turns if episode.states is not None else ():
        if isinstance(turn.state, np.ndarray):
            form = form_of(turn.index, turn.state, space)
            forms.setdefault(str(replace(form, turn=0)), form)
    if forms:
        yield session.fact(StateForms(answers=list(forms.values())), field="state")


MOST_TURNS: Final = 60


@probe(
    "evidence",
    share=0.5,
    plays=lambda session: session.plays(2, runs=3, most_turns=affordable(session, MOST_TURNS)),
)
def evidence(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """An episode recorded, and replayed from its evidence alone.

    An episode, the same again, and what its evidence alone gives.

    Counterfactuals:
        `Replayed`.

    Facts:
        `AgentNames`, `UnwrittenActions`.
    """
    env = session.env()
    names: dict[Any, list[str]] = {}

    def watch(turn: int, env: Any, out: Any) -> None:
        for agent in [*possible_agents_of(env), *env.agents]:
            names.setdefault(agent, [str(agent), type(agent).__name__])

    base = session.play(play, env, watch=watch)
    no_values = [text for agent, (text, _) in names.items() if not is_value(agent)]
    yield session.fact(AgentNames(list(names.values()), no_values), field="agents")
    texts = {text for text, _ in names.values()}
    if base.failed is not None or no_values or len(texts) < len(names):
        return
    unchanged_rerun = session.play(base.play)
    agents = {agent_name(agent): agent for agent in names}
    again = _replayed(session, base.episode, session.env(), agents)
    if isinstance(again, Episode):
        yield session.beside(base.episode, unchanged_rerun.episode, again, {"change": "Replayed"})
    else:
        yield session.fact(UnwrittenActions(again), turn=0, field="actions")


def _replayed(
    session: ProbeSession, episode: Episode, env: Any, agents: dict[str, Any]
) -> Episode | str:
    """The episode of a replay; what was said where an action couldn't be built from its text."""
    declared: Contract = session.contract
    sink = MemorySink(terms=tuple(declared.rewards), volatile=declared.volatile_infos())
    capture = capture_of(env, sink=sink)
    capture.episode = episode.episode - 1
    session.meter.count(RESET_STEPS)
    count = session.meter.count
    with held():  # as the episode itself was: generators of the whole process are for other probes
        done = session.call(
            "replay", replayed_episode, episode, capture, agents=agents, after_turn=count
        )
    if done.failed is not None:
        return done.failed.text
    return sink.episode()
