"""The only experiment: play a trace again, as it was or with exactly one thing done differently."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gamekeeper.core.trace import Trace, Turn
from gamekeeper.game.aec import AECGame
from gamekeeper.game.parallel import ParallelGame
from gamekeeper.run.play import Cast


def replay_trace(
    trace: Trace,
    game: ParallelGame | AECGame,
    *,
    agents: Mapping[str, Any],
    cast: Cast | None = None,
    run_seed: int | None = None,
    after_turn: Callable[[], None] | None = None,
) -> None:
    """Plays `trace` again in `game`: its reset, its actions in their order.

    An environment that raises where it raised before is taken at its word and played on; one that
    raises elsewhere ends the episode as failed. Whether the rows came out the same is for a
    comparison to say.

    Args:
        agents: the environment's own identity of each agent by its name in the evidence.
        cast: policies that choose in place of the recorded actions (the loop is closed); open if None.
        run_seed: seeds the policies of a closed loop.
    """
    if cast is not None and run_seed is not None:
        cast.begin(run_seed, trace.episode)
    game.reset(trace.seed, trace.options)
    for turn in trace.turns:
        if not turn.order or not game.to_move:
            break
        try:
            _step(game, turn, agents, cast, trace.action_types)
        except Exception:  # the rows say what was raised; a recorded raise is matched, others end it
            if not turn.raised:
                break
        if after_turn is not None:
            after_turn()
    game.end_episode()


def _step(
    game: ParallelGame | AECGame,
    turn: Turn,
    agents: Mapping[str, Any],
    cast: Cast | None,
    types: Mapping[str, str],
) -> None:
    if isinstance(game, ParallelGame):
        if cast is None:
            actions = {agents.get(name, name): _action(turn, name, types) for name in turn.order}
        else:
            seen, infos = game.observations, game.infos
            actions = {a: cast.act(a, seen.get(a), infos.get(a)) for a in game.to_move}
        game.step(actions)
        return
    name = turn.order[0]
    looked = name in turn.observations
    if looked or cast is not None:
        observation, _, terminated, truncated, info = game.last()
    if cast is None:
        game.step(_action(turn, name, types))
    else:
        agent = game.to_move[0]
        game.step(None if terminated or truncated else cast.act(agent, observation, info))


def _action(turn: Turn, name: str, types: Mapping[str, str]) -> Any:
    action = turn.actions.get(name)
    return int(action) if types.get(name) == "int" and action is not None else action
