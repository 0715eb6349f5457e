"""AECEnv and ParallelEnv over a capture: recorded, and stepped like the environment itself."""

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
from gamekeeper.interface.env_inside import handed_on
from gamekeeper.interface.openings import Openings
from gamekeeper.interface.parallel_capture import ParallelCapture

OWN: Final = ("_capture", "_on_close")  # attributes of the recorded environment itself


class _RecordedEnv:
    """Part that both recorded forms share: all but steps goes to the environment itself."""

    _hot: ClassVar[tuple[str, ...]]
    _capture: Any
    _on_close: Callable[[], None] | None

    def __init__(self, capture: Capture, *, on_close: Callable[[], None] | None = None) -> None:
        """A recorded environment; `on_close` is called once, before the environment is closed."""
        self._capture = capture
        self._on_close = on_close
        for name in self._hot:  # called as they are: a layer between costs 0.1 us a call
            object.__setattr__(self, name, getattr(capture, name))

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name in OWN:
            raise AttributeError(name)
        return getattr(self._capture.env, name)

    def __setattr__(self, name: str, value: Any) -> None:
        if name in OWN:
            object.__setattr__(self, name, value)
        else:
            capture = self._capture
            if isinstance(capture.openings, Openings):
                capture.openings.set(name, value, turn=capture.turn, is_open=capture.is_open)
            setattr(capture.env, name, value)

    def close(self) -> None:
        """Closes the environment, and what is recorded of it; a second call does nothing more."""
        on_close, self._on_close = self._on_close, None
        try:
            try:
                self._capture.end_episode()
            finally:
                if on_close is not None:  # first: some environments take the process with them
                    on_close()
        finally:
            self._capture.close()

    def __str__(self) -> str:
        return str(self._capture.env)

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        """A copy plays on by itself and isn't recorded: a run has one writer."""
        return recorded_of(type(self._capture)(copy.deepcopy(self._capture.env, memo)))

    def __reduce__(self) -> Any:
        """Pickled as the environment alone, for the same reason."""
        return _revive, (type(self._capture), self._capture.env)


for _name in (
    "unwrapped",
    "agents",
    "possible_agents",
    "num_agents",
    "max_num_agents",
    "metadata",
    "observation_space",
    "action_space",
    "observation_spaces",
    "action_spaces",
    "state",
    "render",
):
    setattr(_RecordedEnv, _name, handed_on(f"_capture.env.{_name}"))


class RecordedParallelEnv(_RecordedEnv, ParallelEnv[Any, Any, Any]):
    """A ParallelEnv over a capture."""

    _hot = ("reset", "step")

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> Any:
        """Resets the environment and returns what it returned."""
        return self._capture.reset(seed, options)

    def step(self, actions: Mapping[AgentId, Any]) -> Any:
        """Steps the environment and returns what it returned."""
        return self._capture.step(actions)


class RecordedAECEnv(_RecordedEnv, AECEnv[Any, Any, Any]):
    """An AECEnv over a capture."""

    _hot = ("reset", "step", "last", "observe")

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Resets the environment."""
        self._capture.reset(seed, options)

    def step(self, action: Any) -> None:
        """One turn of the agent whose turn it is."""
        self._capture.step(action)

    def last(self, observe: bool = True) -> Any:
        """Returns the environment's own `last()`."""
        return self._capture.last(observe)

    def observe(self, agent: AgentId) -> Any:
        """Returns the environment's own `observe`."""
        return self._capture.observe(agent)


for _name in (
    "agent_iter",
    "agent_selection",
    "rewards",
    "_cumulative_rewards",
    "terminations",
    "truncations",
    "infos",
):
    setattr(RecordedAECEnv, _name, handed_on(f"_capture.env.{_name}"))


def recorded_of(
    capture: Capture, *, on_close: Callable[[], None] | None = None
) -> RecordedParallelEnv | RecordedAECEnv:
    """The recorded environment over `capture`, with the API of its environment."""
    wrapped = RecordedParallelEnv if isinstance(capture, ParallelCapture) else RecordedAECEnv
    return wrapped(capture, on_close=on_close)


def capture_of(env: Any, **settings: Any) -> ParallelCapture | AECCapture:
    """A capture of a PettingZoo environment; a recorded one gives up the capture that it has.

    Args:
        env: a ParallelEnv or AECEnv.
        settings: `sink`, `frames`, `state` as in `Capture`.
    """
    if isinstance(env, _RecordedEnv) and env._capture.sink is None:
        env = env._capture.env
    is_small = getattr(settings.get("sink"), "level", None) == "actions"
    if isinstance(env, ParallelEnv):
        return (ParallelActionsCapture if is_small else ParallelCapture)(env, **settings)
    if isinstance(books_of(env), Books):
        return (BookkeptActionsCapture if is_small else BookkeptCapture)(env, **settings)
    return (AECActionsCapture if is_small else AECCapture)(env, **settings)


def _revive(kind: type[Capture], env: Any) -> Any:
    return recorded_of(kind(env))
