"""The two faces of a game towards PettingZoo: who steps one can't tell it from the environment."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Final

from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.interface.actions_captures import (
    AECActionsCapture,
    BookkeptActionsCapture,
    ParallelActionsCapture,
)
from gamekeeper.interface.aec_accounts import books_of
from gamekeeper.interface.aec_capture import AECCapture, BookkeptCapture
from gamekeeper.interface.bookkeeping import Books
from gamekeeper.interface.capture import AgentId, Capture
from gamekeeper.interface.openings import Openings
from gamekeeper.interface.parallel_capture import ParallelCapture

OWN: Final = ("_game", "_on_close")  # attributes of a face itself


class _RecordedEnv:
    """Part that both recorded forms share: all but steps goes to the environment itself."""

    _hot: ClassVar[tuple[str, ...]]
    _game: Any
    _on_close: Callable[[], None] | None

    def __init__(self, game: Capture, *, on_close: Callable[[], None] | None = None) -> None:
        """A face over `game`; `on_close` is called once, before the environment is closed."""
        self._game = game
        self._on_close = on_close
        for name in self._hot:  # called as they are: a layer between costs 0.1 us a call
            object.__setattr__(self, name, getattr(game, name))

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name in OWN:
            raise AttributeError(name)
        return getattr(self._game.env, name)

    def __setattr__(self, name: str, value: Any) -> None:
        """Sets the attribute on the environment inside."""
        if name in OWN:
            object.__setattr__(self, name, value)
        else:
            game = self._game
            if isinstance(game.openings, Openings):
                game.openings.set(name, value, turn=game.turn, is_open=game.is_open)
            setattr(game.env, name, value)

    @property
    def unwrapped(self) -> Any:
        """The environment under all wrappers."""
        return self._game.env.unwrapped

    @property
    def agents(self) -> Any:
        """The live agents: the environment's own list."""
        return self._game.env.agents

    @property
    def possible_agents(self) -> Any:
        """All agents that may appear: the environment's own list."""
        return self._game.env.possible_agents

    @property
    def num_agents(self) -> Any:
        """Number of live agents, as the environment says."""
        return self._game.env.num_agents

    @property
    def max_num_agents(self) -> Any:
        """Number of possible agents, as the environment says."""
        return self._game.env.max_num_agents

    @property
    def metadata(self) -> Any:
        """The environment's own metadata."""
        return self._game.env.metadata

    def observation_space(self, agent: AgentId) -> Any:
        """The environment's own observation space of `agent`."""
        return self._game.env.observation_space(agent)

    def action_space(self, agent: AgentId) -> Any:
        """The environment's own action space of `agent`."""
        return self._game.env.action_space(agent)

    @property
    def observation_spaces(self) -> Any:
        """The environment's own dictionary of observation spaces."""
        return self._game.env.observation_spaces

    @property
    def action_spaces(self) -> Any:
        """The environment's own dictionary of action spaces."""
        return self._game.env.action_spaces

    def state(self) -> Any:
        """The environment's own state."""
        return self._game.env.state()

    def render(self) -> Any:
        """The environment's own frame."""
        return self._game.env.render()

    def close(self) -> None:
        """Closes the environment, and what is recorded of it; a second call does nothing more."""
        on_close, self._on_close = self._on_close, None
        try:
            try:
                self._game.end_episode()
            finally:
                if on_close is not None:  # first: some environments take the process with them
                    on_close()
        finally:
            self._game.close()

    def __str__(self) -> str:
        return str(self._game.env)

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        """A copy plays on by itself and isn't recorded: a run has one writer."""
        return face_of(type(self._game)(copy.deepcopy(self._game.env, memo)))

    def __reduce__(self) -> Any:
        """Pickled as the environment alone, for the same reason."""
        return _revive, (type(self._game), self._game.env)


class RecordedParallelEnv(_RecordedEnv, ParallelEnv[Any, Any, Any]):
    """A ParallelEnv over a game."""

    _hot = ("reset", "step")

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> Any:
        """Resets the environment and returns what it returned."""
        return self._game.reset(seed, options)

    def step(self, actions: Mapping[AgentId, Any]) -> Any:
        """Steps the environment and returns what it returned."""
        return self._game.step(actions)


class RecordedAECEnv(_RecordedEnv, AECEnv[Any, Any, Any]):
    """An AECEnv over a game."""

    _hot = ("reset", "step", "last", "observe")

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Resets the environment."""
        self._game.reset(seed, options)

    def step(self, action: Any) -> None:
        """One turn of the agent whose turn it is."""
        self._game.step(action)

    def last(self, observe: bool = True) -> Any:
        """Returns the environment's own `last()`."""
        return self._game.last(observe)

    def observe(self, agent: AgentId) -> Any:
        """Returns the environment's own `observe`."""
        return self._game.observe(agent)

    def agent_iter(self, max_iter: int = 2**63) -> Any:
        """The environment's own iteration, its checks included."""
        return self._game.env.agent_iter(max_iter)


def _book(name: str) -> property:
    """A property that hands out one of the environment's own books."""
    return property(
        lambda face: getattr(face._game.env, name), doc=f"The environment's own `{name}`."
    )


for _name in (
    "agent_selection",
    "rewards",
    "_cumulative_rewards",
    "terminations",
    "truncations",
    "infos",
):
    setattr(RecordedAECEnv, _name, _book(_name))


def face_of(
    game: Capture, *, on_close: Callable[[], None] | None = None
) -> RecordedParallelEnv | RecordedAECEnv:
    """The face of `game` that has the API of its environment."""
    face = RecordedParallelEnv if isinstance(game, ParallelCapture) else RecordedAECEnv
    return face(game, on_close=on_close)


def game_of(env: Any, **settings: Any) -> ParallelCapture | AECCapture:
    """A game behind the door for a PettingZoo environment; a face gives up the one it has.

    Args:
        env: a ParallelEnv or AECEnv.
        settings: `sink`, `frames`, `state` as in `Capture`.
    """
    if isinstance(env, _RecordedEnv) and env._game.sink is None:
        env = env._game.env
    is_small = getattr(settings.get("sink"), "level", None) == "actions"
    if isinstance(env, ParallelEnv):
        return (ParallelActionsCapture if is_small else ParallelCapture)(env, **settings)
    if isinstance(books_of(env), Books):
        return (BookkeptActionsCapture if is_small else BookkeptCapture)(env, **settings)
    return (AECActionsCapture if is_small else AECCapture)(env, **settings)


def _revive(kind: type[Capture], env: Any) -> Any:
    return face_of(kind(env))
