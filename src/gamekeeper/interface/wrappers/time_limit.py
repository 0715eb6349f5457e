"""A time limit around an environment: all that still live are truncated, nobody is terminated."""

from typing import Any, Final

from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.wrappers import BaseParallelWrapper, BaseWrapper

from gamekeeper.errors import SpecError
from gamekeeper.interface.author_calls import HORIZON, after_end
from gamekeeper.interface.env_inside import EnvInside
from gamekeeper.interface.wrappers.transform import is_parallel

BOOKS: Final = (
    "agents",
    "rewards",
    "_cumulative_rewards",
    "terminations",
    "truncations",
    "infos",
    "agent_selection",
)
"""Attributes of an AEC environment that are copied as time is up."""


def time_limit(env: Any, steps: int) -> Any:
    """Truncates all live agents once the environment has made so many steps in an episode.

    A step of an AEC environment is one turn of a live agent. An agent that a rule ends in the last
    step is terminated and not truncated. The environment inside isn't stepped again until a reset.

    Args:
        env: AECEnv or ParallelEnv.
        steps: 1 or more.
    Raises:
        SpecError: it is no environment, or no number of steps.
    """
    if type(steps) is not int or steps < 1:
        raise SpecError(
            "there is no such time limit",
            where="time_limit, steps",
            expected="a whole number, 1 or more",
            actual=repr(steps),
            fix="give the number of steps of an episode",
        )
    form = ParallelTimeLimit if is_parallel(env, "time_limit") else AECTimeLimit
    return form(env, steps)


class TimeLimit(EnvInside):
    """Part that both forms share."""

    def __str__(self) -> str:
        return f"TimeLimit<{self.env}>"


class ParallelTimeLimit(TimeLimit, BaseParallelWrapper[Any, Any, Any]):
    """Use `time_limit`."""

    def __init__(self, env: ParallelEnv[Any, Any, Any], steps: int) -> None:
        super().__init__(env)
        self._steps, self._made = steps, 0

    @property
    def agents(self) -> Any:
        """Live agents; none once time is up."""
        return self.env.agents if self._made < self._steps else []

    @property
    def endings(self) -> Any:
        """Reasons of endings, where the environment gives any."""
        reasons = self.env.endings
        if self._made < self._steps:
            return reasons
        return {**reasons, **{a: HORIZON for a in self.env.agents if a not in reasons}}

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, Any]:
        """Begins an episode of the environment, with the same seed and options."""
        observations, infos = self.env.reset(seed=seed, options=options)
        self._made = 0
        return observations, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Any]:
        """Steps the environment; the last step truncates.

        Raises:
            OrderError: time was up.
        """
        if self._made >= self._steps:
            raise after_end("step")
        observations, rewards, terminations, truncations, infos = self.env.step(actions)
        self._made += 1
        if self._made == self._steps:
            cut = {a: not terminations.get(a, False) for a in self.env.agents}
            truncations = {**truncations, **cut}
        return observations, rewards, terminations, truncations, infos


class AECTimeLimit(TimeLimit, BaseWrapper[Any, Any, Any]):
    """Use `time_limit`.

    Until time is up the books are the environment's own. Then they are copied, the live are
    truncated, and the turns in which agents leave are played in the copy.
    """

    def __init__(self, env: AECEnv[Any, Any, Any], steps: int) -> None:
        super().__init__(env)
        self._steps, self._made = steps, 0

    def __getattr__(self, name: str) -> Any:
        if name == "_cumulative_rewards":
            return self.env._cumulative_rewards
        return super().__getattr__(name)

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """Begins an episode of the environment, with the same seed and options."""
        self.env.reset(seed=seed, options=options)
        self._made = 0
        for name in BOOKS:
            self.__dict__.pop(name, None)

    def step(self, action: Any) -> None:
        """One turn; the last one truncates all that live."""
        if self._made == self._steps:
            if not self.agents:
                raise after_end("step")
            self._was_dead_step(action)
            return
        self.env.step(action)
        if action is not None:
            self._made += 1
        if self._made == self._steps and action is not None:
            self._cut()

    def _cut(self) -> None:
        env = self.env
        self.agents = list(env.agents)
        for name in BOOKS[1:-1]:
            setattr(self, name, dict(getattr(env, name)))
        for agent in self.agents:
            if not self.terminations[agent]:
                self.truncations[agent] = True
        # Last turns of agents that a rule has ended come first, as in PettingZoo; then those of the
        # living, from the one in turn on.
        waiting = [a for a in self.agents if env.terminations[a] or env.truncations[a]]
        live = [a for a in self.agents if a not in waiting]
        turn = env.agent_selection
        first = live.index(turn) if turn in live else 0
        self.agents = [*waiting, *live[first:], *live[:first]]
        if self.agents:
            self.agent_selection = self.agents[0]
