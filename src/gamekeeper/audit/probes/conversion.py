"""An AEC environment that calls itself parallelizable behind PettingZoo's own conversion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.game.converting.peers import pettingzoo_parallel
from gamekeeper.run.episode import Actions, Play
from gamekeeper.run.handed import is_same, snapshot

SHARE: Final = 0.8
API: Final = "aec"


def plays(lab: Lab) -> Iterator[Play]:
    """Plays in ticks; each tick is a turn of every agent."""
    agents = max(len(lab.agents), 1)
    yield from lab.plays(3, runs=2 * agents, most_turns=60)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """Plays it behind the conversion, and looks whether observations wait for the cycle's end.

    Facts:
        `converted`: `said`: whether the metadata say that it is parallelizable; `failed`: None, or
            what was raised behind the conversion; `ticks`: played so.
        `cycle`: `looks`: at an agent's observation when its turn came, beside the one from the
            cycle's start; `changed`: None, or the first `agent` for whom it had changed, and
            `after`, who had acted in between.
    """
    env = lab.env()
    metadata = getattr(env, "metadata", None)
    said = bool(isinstance(metadata, dict) and metadata.get("is_parallelizable"))
    if not said:
        yield lab.fact("converted", {"said": False, "failed": None, "ticks": 0}, field="metadata")
        return
    made = lab.call("aec_to_parallel", pettingzoo_parallel, env)
    if made.failed is not None:
        text = f"{made.failed.kind}: {made.failed.text}"
        value = {"said": True, "failed": text, "ticks": 0}
        yield lab.fact("converted", value, turn=0, field="conversion")
        return
    played = lab.play(play, made.value, state=False)
    ticks = len(played.play.actions or ())
    lab.meter.count(ticks * max(len(lab.agents) - 1, 0))  # a tick is a step of each of them
    failed = None if played.failed is None else f"{played.failed.kind}: {played.failed.text}"
    value = {"said": True, "failed": failed, "ticks": ticks}
    turn = None if played.failed is None else ticks
    yield lab.fact("converted", value, turn=turn, field="conversion")
    if played.failed is None:
        yield _cycles(lab, play, list(played.play.actions or ()))


def _cycles(lab: Lab, play: Play, paper: list[Actions]) -> Saw:
    """Plays the same actions turn by turn, and compares what was seen within each cycle."""
    env = lab.env()
    looks, found, seen_at = 0, None, None
    if lab.call("reset", env.reset, seed=play.seed).failed is not None:
        paper = []
    for tick, actions in enumerate(paper):
        agents = [a for a in env.agents if not (env.terminations[a] or env.truncations[a])]
        shown = {a: snapshot(lab.call("observe", env.observe, a).value) for a in agents}
        acted: list[Any] = []
        while env.agents and len(acted) < len(agents) and found is None:
            agent = env.agent_selection
            if env.terminations[agent] or env.truncations[agent]:
                break
            now = lab.call("observe", env.observe, agent).value
            looks += 1
            if agent in shown and not is_same(now, shown[agent]):
                found, seen_at = {"agent": agent, "after": list(acted)}, tick
            if lab.step(env, actions.get(agent)).failed is not None:
                break
            acted.append(agent)
        while env.agents and _is_over(env) and lab.step(env, None).failed is None:
            pass
        if found is not None:
            break
    agent = None if found is None else found["agent"]
    return replace(
        lab.fact("cycle", {"looks": looks, "changed": found}, agent=agent, field="cycle"),
        where=lab.at(None if seen_at is None else seen_at + 1, agent, "cycle"),
    )


def _is_over(env: Any) -> bool:
    agent = env.agent_selection
    return bool(env.terminations.get(agent) or env.truncations.get(agent))
