"""Plays episodes: the one loop over a game, the same for both APIs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Protocol

from gamekeeper.core.seeds import episode_seed
from gamekeeper.game.aec import AECGame
from gamekeeper.game.door import AgentId
from gamekeeper.game.parallel import ParallelGame


class Cast(Protocol):
    """The policies of all agents, as `gamekeeper.game.policy.assign` makes them."""

    def begin(self, run_seed: int, episode: int) -> None:
        """Seeds every policy for an episode."""

    def act(self, agent: AgentId, observation: Any, info: Any) -> Any:
        """What `agent` does."""


def play(
    game: ParallelGame | AECGame,
    cast: Cast,
    episodes: Iterable[int],
    *,
    seed: int,
    options: Mapping[str, Any] | None = None,
    most_turns: int,
    after_turn: Callable[[], None] | None = None,
    after_episode: Callable[[int], None] | None = None,
) -> None:
    """Plays the episodes numbered in `episodes`, each from its own seed.

    Args:
        game: an open game; whatever it records, it records.
        episodes: numbers of episodes in the run; episode k is reset with `episode_seed(seed, k)`.
        options: handed to every reset.
        most_turns: an episode that is longer is cut.
        after_turn: called after every turn, for progress and signs of life.
        after_episode: called after every episode with how many have been played.
    """
    turn = _tick_of(game) if isinstance(game, ParallelGame) else _turn_of(game)
    for done, episode in enumerate(episodes, start=1):
        cast.begin(seed, episode)
        game.reset(episode_seed(seed, episode), options)
        for _ in range(most_turns):
            if not turn(cast):
                break
            if after_turn is not None:
                after_turn()
        game.end_episode()
        if after_episode is not None:
            after_episode(done)


def _tick_of(game: ParallelGame) -> Callable[[Cast], bool]:
    def tick(cast: Cast) -> bool:
        movers = game.to_move
        if not movers:
            return False
        seen, infos, act = game.observations, game.infos, cast.act
        game.step({agent: act(agent, seen.get(agent), infos.get(agent)) for agent in movers})
        return True

    return tick


def _turn_of(game: AECGame) -> Callable[[Cast], bool]:
    def turn(cast: Cast) -> bool:
        movers = game.to_move
        if not movers:
            return False
        observation, _, terminated, truncated, info = game.last()
        agent = movers[0]
        game.step(None if terminated or truncated else cast.act(agent, observation, info))
        return True

    return turn
