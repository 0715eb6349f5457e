"""Probe of a life cycle: resets, steps out of their order, closing."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import Called, ProbeSession, Saw
from gamekeeper.auditing.probes.moves import cut
from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.facts.lifecycle_facts import (
    Closings,
    DeadAction,
    IgnoredResets,
    IteratedAgents,
    LaterReset,
    ResetArguments,
    StepAfterEnd,
    StepBeforeReset,
)
from gamekeeper.checks.literal import literal, step_literal
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import agent_iter_names_actors, reset_forgets
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.layout import agent_name
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult, FailedCall

MOST_SEEN: Final = 3
"""Agents whose observations are compared in an AEC environment: they may be large."""


@dataclass(slots=True)
class StartAndEnd:
    """Texts of the start and the end of an episode; None where they can't be told.

    Attributes:
        agents: how many stood in `agents` at the start; None where nobody can, which is a fault of
            the roster's.
        dead: (AEC) turns at which somebody was to act whose flags were up.
    """

    session: ProbeSession
    first: str | None = None
    last: str | None = None
    agents: int | None = None
    dead: list[int] = field(default_factory=list)
    _out: Any = None

    def watch(self, turn: int, env: Any, out: Any) -> None:
        """Looks at the start, and keeps in mind what came last."""
        self._out = out
        if turn == 0:
            self.first = self._seen(env)
            possible, agents = self._roster(env, "possible_agents"), self._roster(env, "agents")
            self.agents = len(agents or ()) if possible is None or len(possible) else None
        if self.session.api == "aec" and not self.dead and is_dead(self.session, env):
            self.dead.append(turn)

    def settle(self, env: Any) -> None:
        """Looks at the end."""
        self.last = self._seen(env)

    def _seen(self, env: Any) -> str | None:
        if self.session.api == "parallel":
            seen = self._out[0] if isinstance(self._out, tuple) and self._out else None
            if isinstance(seen, Mapping):  # who has just ended is seen once more, by no reset
                live = list(self._roster(env, "agents") or ())
                seen = {agent: item for agent, item in seen.items() if agent in live}
            return None if seen is None else to_json(seen)
        agents = list(self._roster(env, "agents") or ())[:MOST_SEEN]
        called = [self.session.call("observe", env.observe, agent) for agent in agents]
        return None if any(each.failed for each in called) else to_json([e.value for e in called])

    def _roster(self, env: Any, name: str) -> Any:
        return self.session.call(name, getattr, env, name).value


def is_dead(session: ProbeSession, env: Any) -> bool:
    """Tells whether the agent in turn has its flags up."""
    if not session.call("agents", getattr, env, "agents").value:
        return False
    agent = session.call("agent_selection", getattr, env, "agent_selection").value
    books = (
        session.call(name, getattr, env, name).value for name in ("terminations", "truncations")
    )
    return any(isinstance(book, Mapping) and bool(book.get(agent)) for book in books)


def goes_on(api: str, actions: Mapping[Any, Any], *, plays: bool) -> Reproducer:
    """A step where none should be raises, or gives no reward, flag or turn."""
    start = "" if plays else "env = make()\n"
    if api == "parallel":
        lines = (
            f"try:\n    out = env.step({step_literal(api, actions)})\n"
            "except Exception:\n    out = ()  # refused\n"
            "assert not any(out[1:4]), out[1:4]  # rewards, terminations, truncations"
        )
    else:
        lines = (
            f"try:\n    env.step({step_literal(api, actions)})\n"
            "except Exception:\n    was_refused = True\n"
            "else:\n    was_refused = not env.agents\nassert was_refused, env.agents"
        )
    return Reproducer(start + lines, plays=plays)


def refuses(action: Any) -> Reproducer:
    """A dead agent's action raises."""
    return Reproducer(
        f"try:\n    env.step({literal(action)})\nexcept Exception:\n    was_refused = True\n"
        "else:\n    was_refused = False\n"
        "assert was_refused, 'an action was taken of an agent that has ended'"
    )


HAS_AGENTS: Final = "assert env.agents, 'there is no agent after the reset'\n"
ENDED: Final = "if env.last()[2] or env.last()[3]:\n    "


def begins(api: str, resets: int, turns: Sequence[Mapping[Any, Any]]) -> Reproducer:
    """After so many resets there are agents, and the turns can be played.

    A None step is one of an agent that has ended: it is left out where the agent lives, as it may
    once the cause is held still.
    """
    look = "" if api == "parallel" else "env.last()\n"
    arguments = [step_literal(api, actions) for actions in turns]
    each_step = (f"{ENDED if each == 'None' else ''}env.step({each})\n" for each in arguments)
    steps = "".join(look + each for each in each_step)
    # what the last step left
    seen = "" if api == "parallel" else "if env.agents:\n    env.last()\n"
    return Reproducer("env.reset(seed=SEED)\n" * resets + HAS_AGENTS + steps + seen)


PARTS: Final = (0.6, 0.2)
"""Parts of the ration: one episode as long as it may be, to its end, and a shorter one."""
SHORT: Final = 3
"""Turns that are played after a reset."""
MOST_TRIES: Final = 4
"""Turns whose actions are tried after the end: a mask may forbid those of some."""
LEARNED: Final = ("rewards", "terminations", "truncations")
"""Parts of a step that a learner needs: without them it learns from no step after the end."""


@probe(
    "lifecycle",
    share=2.0,
    plays=lambda session: session.plays_of(max(int(session.ration * x), 20) for x in PARTS),
)
def lifecycle(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Calls before the first reset and after the end, resets at any time, close().

    One instance through its life; with the first episode also two that were never reset.

    Facts:
        `StepAfterEnd`, `LaterReset`, `IgnoredResets`, `DeadAction`, `IteratedAgents`,
        `ResetArguments`, `StepBeforeReset`, `Closings`.
    """
    env = session.env()
    sight = StartAndEnd(session)
    base = session.play(play, env, watch=sight.watch, state=False)
    sight.settle(env)
    yield base.episode
    if base.is_over and not session.call("agents", getattr, env, "agents").value:
        yield _after_end(session, env, base)
    yield from _resets(session, env, base, sight)
    if session.api == "aec":
        yield from _dead_action(session, env, base, sight.dead)
        yield from _iterated(session, env, base)
    yield _arguments(session, env, base)
    if session.can_make:
        yield from _closed(session, env, base)


def _after_end(session: ProbeSession, env: Any, base: EpisodeResult) -> Saw:
    """Steps with actions of earlier turns once the episode is over."""
    turns = list(base.play.actions or ())[-MOST_TRIES:][::-1]
    latest: dict[Any, Any] = {}
    for actions in base.play.actions or ():
        latest.update(actions)
    actions, gave = latest, ""
    for actions in [latest, *turns] if session.api == "parallel" else turns:
        gave = _step(session, env, actions)
        if gave:
            break
    end, proof = len(base.play.actions or ()), goes_on(session.api, actions, plays=True)
    return session.fact(StepAfterEnd(gave), turn=end, field="after_end", proof=proof)


def _step(session: ProbeSession, env: Any, actions: Mapping[Any, Any]) -> str:
    """Result of a step where none should be, in words."""
    called = session.step(env, session.handed(dict(actions)))
    if session.api == "aec":
        left = session.call("agents", getattr, env, "agents").value
        return f"a turn, and {left} go on" if called.failed is None and left else ""
    out = called.value if isinstance(called.value, tuple) else ()
    return ", ".join(name for name, part in zip(LEARNED, out[1:4], strict=False) if part)


def _resets(
    session: ProbeSession, env: Any, base: EpisodeResult, begun: StartAndEnd
) -> Iterator[Saw]:
    """Resets after the episode, in the midst of an episode, and twice, each with a few turns."""
    if base.failed is not None and base.failed.call == "reset":
        first = LaterReset(when="the first one", raised=_words(base.failed), agents=None)
        yield session.fact(first, field="reset", proof=begins(session.api, 1, ()))
        return
    before, latest = base, begun.last
    ignored = []
    for resets in (1, 1, 2):
        when = "after the end" if before.is_over else "in mid-episode"
        when = when if resets == 1 else "twice in a row"
        twice = session.call("reset", env.reset, seed=base.play.seed) if resets == 2 else Called()
        sight = StartAndEnd(session)
        short = replace(base.play, actions=None, most_turns=SHORT)
        played = session.play(short, env, watch=sight.watch, state=False)
        sight.settle(env)
        raised = _words(twice.failed or _by_reset(played, base))
        later = LaterReset(when=when, raised=raised, agents=sight.agents)
        proof = begins(session.api, resets, played.play.actions or ())
        yield session.fact(later, field=f"reset {when}", proof=proof)
        if sight.first is not None and not before.is_over:
            ignored.append(sight.first == latest and sight.first != begun.first)
        before, latest = played, sight.last
    if ignored:
        proof = reproducer_of(reset_forgets, compares=True)
        yield session.fact(IgnoredResets(all(ignored)), field="ignored", proof=proof)


def _by_reset(played: EpisodeResult, base: EpisodeResult) -> FailedCall | None:
    """Exception of a reset; a turn may raise in a fresh instance too."""
    failed = played.failed
    if failed is None or failed.call == "reset":
        return failed
    return None if base.failed is not None or failed.call == "policy" else failed


def _dead_action(
    session: ProbeSession, env: Any, base: EpisodeResult, dead: list[int]
) -> Iterator[Saw]:
    """Result of an ended agent's action, at the first None turn of the episode."""
    actions = base.play.actions or ()
    if not dead:
        return
    turn = dead[0]
    session.play(cut(base.play, turn), env, state=False)
    agent = session.call("agent_selection", getattr, env, "agent_selection").value
    own = [each[agent] for each in actions[:turn] if each.get(agent) is not None]
    if own and is_dead(session, env):
        failed = session.step(env, own[-1]).failed
        value = DeadAction(agent=agent, raised=None if failed is None else failed.kind)
        proof = refuses(own[-1])
        yield session.fact(value, turn=turn, agent=agent, field="dead_action", proof=proof)


def _iterated(session: ProbeSession, env: Any, base: EpisodeResult) -> Iterator[Saw]:
    """`agent_iter` over the first turns of the episode."""
    actions = (base.play.actions or ())[:SHORT]
    named: list[str] = []
    selected: list[str] = []
    if session.call("reset", env.reset, seed=base.play.seed).failed is not None or not actions:
        return

    def iterate() -> None:
        for agent in env.agent_iter(len(actions)):
            selected.append(agent_name(env.agent_selection))
            named.append(agent_name(agent))
            if len(named) > len(actions):
                return
            env.last()
            session.meter.count()
            env.step(next(iter(actions[len(named) - 1].values()), None))

    failed = session.call("agent_iter", iterate).failed
    left = session.call("agents", getattr, env, "agents").value
    if failed is None and (left or len(named) >= len(actions)):
        value = IteratedAgents(named=named, selected=selected, asked=len(actions))
        proof = reproducer_of(agent_iter_names_actors)
        yield session.fact(value, turn=len(actions), field="agent_iter", proof=proof)


def _arguments(session: ProbeSession, env: Any, base: EpisodeResult) -> Saw:
    """Resets with the arguments that every environment of PettingZoo takes."""
    seed = base.play.seed
    ways: dict[str, dict[str, Any]] = {
        "": {},
        f"seed={seed!r}": {"seed": seed},
        "options=None": {"options": None},
        f"seed={seed!r}, options=None": {"seed": seed, "options": None},
        "options={}": {"options": {}},
    }
    raised: dict[str, str | None] = {}
    for words, named in ways.items():
        session.meter.count()
        raised[words] = _words(session.call("reset", env.reset, **named).failed)
    return session.fact(ResetArguments(raised), field="reset")


def _closed(session: ProbeSession, env: Any, base: EpisodeResult) -> Iterator[Saw]:
    """Closes twice; with the first episode also an instance that was never reset."""
    raised = {
        when: _words(session.call("close", env.close).failed) for when in ("after a reset", "twice")
    }
    if session.number == 0:
        raised["before any reset"] = _words(session.call("close", session.make().close).failed)
        for actions in (base.play.actions or ())[:1]:
            value = StepBeforeReset(_step(session, session.make(), actions))
            proof = goes_on(session.api, actions, plays=False)
            yield session.fact(value, turn=1, field="unborn_step", proof=proof)
    yield session.fact(Closings(raised), field="close")


def _words(failed: FailedCall | None) -> str | None:
    return None if failed is None else f"{failed.call}: {failed.said}"
