"""A play recorded, and played again from nothing but its evidence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from gamekeeper.audit.lab import RESET_STEPS, Lab, Saw
from gamekeeper.audit.probes._moves import affordable
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Twin
from gamekeeper.core.layout import agent_name
from gamekeeper.core.trace import Trace
from gamekeeper.game.faces import game_of
from gamekeeper.run.episode import Play
from gamekeeper.run.memory import MemorySink
from gamekeeper.run.rerun import replay_trace

SHARE: Final = 0.5
MOST_TURNS: Final = 60


def plays(lab: Lab) -> Iterator[Play]:
    """Two; each played, played again, and replayed from its evidence."""
    yield from lab.plays(2, runs=3, most_turns=affordable(lab, MOST_TURNS))


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """A play, the same again, and what its evidence alone gives.

    Twins:
        `Replayed`: only the evidence of the play was known: its seed, options and recorded actions.

    Facts:
        `names`: every agent that was seen, as [text, type of its identity], in the order of
            `possible_agents` and then of appearance.
        `unwritten`: why the actions couldn't be taken from the evidence, in words.
    """
    env = lab.env()
    names: dict[Any, list[str]] = {}

    def watch(turn: int, env: Any, out: Any) -> None:
        for agent in [*(getattr(env, "possible_agents", None) or ()), *env.agents]:
            names.setdefault(agent, [str(agent), type(agent).__name__])

    base = lab.play(play, env, watch=watch)
    yield lab.fact("names", list(names.values()), field="agents")
    if base.failed is not None or len({text for text, _ in names.values()}) < len(names):
        return
    sham = lab.play(base.play)
    again = _replayed(lab, base.trace, lab.env(), {agent_name(agent): agent for agent in names})
    if isinstance(again, Trace):
        volatile = tuple(lab.contract.volatile_infos())
        yield Twin(base.trace, sham.trace, again, {"change": "Replayed"}, volatile)
    else:
        yield lab.fact("unwritten", again, turn=0, field="actions")


def _replayed(lab: Lab, trace: Trace, env: Any, agents: dict[str, Any]) -> Trace | str:
    """The trace of a replay; what was said where an action couldn't be built from its text."""
    declared: Contract = lab.contract
    sink = MemorySink(terms=tuple(declared.rewards), volatile=declared.volatile_infos())
    game = game_of(env, sink=sink)
    game.episode = trace.episode - 1
    lab.meter.count(RESET_STEPS)
    done = lab.call("replay", replay_trace, trace, game, agents=agents, after_turn=lab.meter.count)
    if done.failed is not None:
        return done.failed.text
    return next(iter(sink.evidence({}, contract=declared).traces))
