"""The life of an instance: before a reset, after the end, resets at any time, closing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

from gamekeeper.audit.lab import Called, Lab, Saw
from gamekeeper.audit.probes import _after
from gamekeeper.audit.probes._sight import Sight, is_dead
from gamekeeper.core.layout import agent_name
from gamekeeper.run.episode import Failed, Play, Played

SHARE: Final = 2.0
PARTS: Final = (0.6, 0.2)
"""Of the ration, for the plays: one as long as it may be, to reach its end, and a shorter one."""
SHORT: Final = 3
"""Turns that are played after a reset."""
MOST_TRIES: Final = 4
"""Turns whose actions are tried after the end: a mask may forbid those of some."""
OUT: Final = ("observations", "rewards", "terminations", "truncations", "infos")


def plays(lab: Lab) -> Iterator[Play]:
    """A long one and a shorter one."""
    for k, part in enumerate(PARTS):
        turns = max(int(lab.ration * part), 20)
        yield Play(seed=lab.seed + k, stream=k, most_turns=turns)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """One instance through its life; with the first play also two that were never reset.

    Facts:
        `after_end`: a step after the end; {"raised": kind or None, "gave": what came of it, in
            words; empty where nothing did}.
        `reset`: a reset, then a few turns; {"when", "raised": None or words, "agents": how many}.
        `ignored`: resets in the midst of an episode; whether all gave what stood there before.
        `dead_action`: (AEC) a dead agent did something but None; {"agent", "raised"}.
        `iterated`: (AEC) `agent_iter` over the first turns; {"named", "selected", "asked"}.
        `resets_with`: by arguments in words, what `reset` raised, or None.
        `unborn_step`: a step before any reset; as `after_end`.
        `close`: by when, what it raised, or None.
    """
    env = lab.env()
    sight = Sight(lab)
    base = lab.play(play, env, watch=sight.watch, state=False)
    sight.settle(env)
    yield base.trace
    if base.is_over and not lab.call("agents", getattr, env, "agents").value:
        yield _after_end(lab, env, base)
    yield from _resets(lab, env, base, sight)
    if lab.api == "aec":
        yield from _dead_action(lab, env, base, sight.dead)
        yield from _iterated(lab, env, base)
    yield _arguments(lab, env, base)
    if lab.can_make:
        yield from _closed(lab, env, base)


def _after_end(lab: Lab, env: Any, base: Played) -> Saw:
    """Steps with actions of earlier turns once the episode is over."""
    turns = list(base.play.actions or ())[-MOST_TRIES:][::-1]
    latest: dict[Any, Any] = {}
    for actions in base.play.actions or ():
        latest.update(actions)
    actions, called, gave = latest, Called(), ""
    for actions in [latest, *turns] if lab.api == "parallel" else turns:
        called, gave = _step(lab, env, actions)
        if gave:
            break
    return lab.fact(
        "after_end", {"raised": _kind(called.failed), "gave": gave},
        turn=len(base.play.actions or ()), field="after_end",
        proof=_after.goes_on(lab.api, actions, plays=True),
    )  # fmt: skip


def _step(lab: Lab, env: Any, actions: Mapping[Any, Any]) -> tuple[Called, str]:
    """A step where none should be, and what came of it in words."""
    if lab.api == "aec":
        called = lab.step(env, next(iter(actions.values()), None))
        left = lab.call("agents", getattr, env, "agents").value
        return called, f"a turn, and {left} go on" if called.failed is None and left else ""
    called = lab.step(env, dict(actions))
    out = called.value if isinstance(called.value, tuple) else ()
    gave = [name for name, part in zip(OUT, out, strict=False) if part]
    return called, ", ".join(gave)


def _resets(lab: Lab, env: Any, base: Played, begun: Sight) -> Iterator[Saw]:
    """Resets after the play, in the midst of an episode, and twice, each with a few turns."""
    before, latest = base, begun.last
    ignored = []
    for resets in (1, 1, 2):
        when = "after the end" if before.is_over else "in mid-episode"
        when = when if resets == 1 else "twice in a row"
        twice = lab.call("reset", env.reset, seed=base.play.seed) if resets == 2 else Called()
        sight = Sight(lab)
        short = replace(base.play, actions=None, most_turns=SHORT)
        played = lab.play(short, env, watch=sight.watch, state=False)
        sight.settle(env)
        raised = _words(twice.failed or _by_reset(played, base))
        yield lab.fact(
            "reset", {"when": when, "raised": raised, "agents": sight.agents},
            field=f"reset {when}",
            proof=_after.begins(lab.api, resets, played.play.actions or ()),
        )  # fmt: skip
        if sight.first is not None and not before.is_over:
            ignored.append(sight.first == latest and sight.first != begun.first)
        before, latest = played, sight.last
    if ignored:
        yield lab.fact("ignored", all(ignored), field="ignored", proof=_after.IGNORED[lab.api])


def _by_reset(played: Played, base: Played) -> Failed | None:
    """What raised, where the reset is to blame: a turn may raise in a fresh instance too."""
    failed = played.failed
    if failed is None or failed.call == "reset":
        return failed
    return None if base.failed is not None or failed.call == "policy" else failed


def _dead_action(lab: Lab, env: Any, base: Played, dead: list[int]) -> Iterator[Saw]:
    """What a dead agent's action comes to, at the first None turn of the play."""
    actions = base.play.actions or ()
    if not dead:
        return
    turn = dead[0]
    lab.play(_cut(base.play, turn), env, state=False)
    agent = lab.call("agent_selection", getattr, env, "agent_selection").value
    own = [each[agent] for each in actions[:turn] if each.get(agent) is not None]
    if own and is_dead(lab, env):
        raised = _kind(lab.step(env, own[-1]).failed)
        yield lab.fact(
            "dead_action", {"agent": agent, "raised": raised}, turn=turn, agent=agent,
            field="dead_action", proof=_after.refuses(own[-1]),
        )  # fmt: skip


def _iterated(lab: Lab, env: Any, base: Played) -> Iterator[Saw]:
    """`agent_iter` over the first turns of the play."""
    actions = (base.play.actions or ())[:SHORT]
    named: list[str] = []
    selected: list[str] = []
    if lab.call("reset", env.reset, seed=base.play.seed).failed is not None or not actions:
        return

    def iterate() -> None:
        for agent in env.agent_iter(len(actions)):
            selected.append(agent_name(env.agent_selection))
            named.append(agent_name(agent))
            if len(named) > len(actions):
                return
            env.last()
            lab.meter.count()
            env.step(next(iter(actions[len(named) - 1].values()), None))

    failed = lab.call("agent_iter", iterate).failed
    left = lab.call("agents", getattr, env, "agents").value
    if failed is None and (left or len(named) >= len(actions)):
        value = {"named": named, "selected": selected, "asked": len(actions)}
        yield lab.fact("iterated", value, turn=len(actions), field="agent_iter",
                       proof=_after.ITERATES)  # fmt: skip


def _arguments(lab: Lab, env: Any, base: Played) -> Saw:
    """Resets with the arguments that every environment of PettingZoo takes."""
    seed = base.play.seed
    ways: dict[str, dict[str, Any]] = {
        "": {},
        f"seed={seed!r}": {"seed": seed},
        "options=None": {"options": None},
        f"seed={seed!r}, options=None": {"seed": seed, "options": None},
    }
    raised = {}
    for words, named in ways.items():
        lab.meter.count()
        raised[words] = _words(lab.call("reset", env.reset, **named).failed)
    return lab.fact("resets_with", raised, field="reset")


def _closed(lab: Lab, env: Any, base: Played) -> Iterator[Saw]:
    """Closes twice; with the first play also an instance that was never reset."""
    raised = {when: _words(lab.call("close", env.close).failed)
              for when in ("after a reset", "twice")}  # fmt: skip
    if lab.number == 0:
        raised["before any reset"] = _words(lab.call("close", lab.make().close).failed)
        for actions in (base.play.actions or ())[:1]:
            called, gave = _step(lab, lab.make(), actions)
            value = {"raised": _kind(called.failed), "gave": gave}
            proof = _after.goes_on(lab.api, actions, plays=False)
            yield lab.fact("unborn_step", value, turn=1, field="unborn_step", proof=proof)
    yield lab.fact("close", raised, field="close")


def _kind(failed: Failed | None) -> str | None:
    return None if failed is None else failed.kind


def _words(failed: Failed | None) -> str | None:
    return None if failed is None else f"{failed.call}: {failed.kind}: {failed.text}"


def _cut(play: Play, turns: int) -> Play:
    return replace(play, actions=(play.actions or ())[:turns], most_turns=max(turns, 1))
