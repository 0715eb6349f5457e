"""A transform around an environment, for either of PettingZoo's interfaces."""

from collections.abc import Mapping
from typing import Any

from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.wrappers import BaseParallelWrapper, BaseWrapper

from gamekeeper.interface.author_calls import AgentId
from gamekeeper.interface.env_inside import handed_on
from gamekeeper.interface.wrappers.transform import (
    Transform,
    TransformedSpaces,
    infos_by,
    is_parallel,
)


class ParallelTransformed(TransformedSpaces, BaseParallelWrapper[Any, Any, Any]):
    """A ParallelEnv whose agents see, act and are paid through a transform."""

    terms: Any

    def __init__(self, env: ParallelEnv[Any, Any, Any], transform: Transform) -> None:
        super().__init__(env)
        self._seen: Mapping[Any, Any] = {}
        self._infos: Mapping[Any, Any] = {}
        self._take(transform)
        if self._pays:
            self.terms = None  # they no longer add up to the reward

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[Any, Any], dict[Any, Any]]:
        """Begins an episode of the environment, with the same seed and options."""
        self._seen, self._infos = self.env.reset(seed=seed, options=options)
        self.transform.begin(seed)
        return self._shown()

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Any]:
        """Steps the environment once; actions that it refuses leave everything as it was."""
        transform, seen = self.transform, self._seen
        inside, noted = actions, None
        if self._acts:
            act = transform.action
            inside = {agent: act(agent, action) for agent, action in actions.items()}
        if self._notes:
            noted = transform.notes(seen, inside)
        self._seen, rewards, terminations, truncations, self._infos = self.env.step(inside)
        if self._notes:
            transform.keep_all(noted)
        if self._pays:
            rewards = {agent: transform.reward(agent, paid) for agent, paid in rewards.items()}
        observations, infos = self._shown()
        return observations, rewards, terminations, truncations, infos

    def _shown(self) -> tuple[Any, Any]:
        """Observations and infos as agents are given them."""
        seen, infos, transform = self._seen, self._infos, self.transform
        shown, informed = seen, infos
        if self._gives:
            given, info = transform.given, infos_by(infos)
            for agent, observation in seen.items():
                given(agent, observation, info(agent, {}))
        if self._shows:
            shown = transform.observations(seen, infos)
        if self._informs:
            informed = {a: transform.info(a, seen.get(a), info) for a, info in infos.items()}
        return shown, informed


class AECTransformed(TransformedSpaces, BaseWrapper[Any, Any, Any]):
    """An AECEnv whose agents see, act and are paid through a transform."""

    terms: Any

    def __init__(self, env: AECEnv[Any, Any, Any], transform: Transform) -> None:
        super().__init__(env)
        self._infos: dict[AgentId, Any] = {}
        self._take(transform)
        self._touches = self._acts or self._notes
        if self._pays:
            self.terms = None  # they no longer add up to the reward

    agents = handed_on("env.agents")
    agent_selection = handed_on("env.agent_selection")
    terminations = handed_on("env.terminations")
    truncations = handed_on("env.truncations")

    @property
    def infos(self) -> Any:
        """Each agent's info."""
        infos = self.env.infos
        return {agent: self._info_of(agent) for agent in infos} if self._informs else infos

    def _info_of(self, agent: AgentId) -> Any:
        """An agent's info, the same object until the next turn."""
        found = self._infos.get(agent)
        if found is None:
            seen, info = self.env.observe(agent), self.env.infos[agent]
            found = self._infos[agent] = self.transform.info(agent, seen, info)
        return found

    @property
    def rewards(self) -> Any:
        """Rewards of the last turn."""
        return self._paid if self._pays else self.env.rewards

    @property
    def _cumulative_rewards(self) -> Any:
        """Rewards since each agent's last turn."""
        return self._sums if self._pays else self.env._cumulative_rewards

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """Begins an episode of the environment, with the same seed and options."""
        self.env.reset(seed=seed, options=options)
        self._infos = {}
        self.transform.begin(seed)
        if self._pays:
            reward = self.transform.reward
            self._paid = {agent: reward(agent, paid) for agent, paid in self.env.rewards.items()}
            before = self.env._cumulative_rewards.items()
            self._sums = {agent: reward(agent, paid) for agent, paid in before}
        if self._gives:
            self._give()

    def _give(self) -> None:
        env, agent = self.env, self.env.agent_selection
        if agent in env.infos:
            self.transform.given(agent, env.observe(agent), env.infos[agent])

    def observe(self, agent: AgentId) -> Any:
        """Returns the observation that the agent is shown, at its turn or between its turns."""
        seen = self.env.observe(agent)
        if not self._shows or seen is None:
            return seen
        return self.transform.observation(agent, seen, infos_by(self.env.infos)(agent, {}))

    def last(self, observe: bool = True) -> tuple[Any, Any, Any, Any, Any]:
        """Returns what the agent in turn is given."""
        env = self.env
        agent = env.agent_selection
        seen = env.observe(agent) if observe else None
        info, sums = env.infos[agent], self._cumulative_rewards
        shown = seen
        if self._shows and seen is not None:
            shown = self.transform.observation(agent, seen, info)
        if self._informs:
            info = self._info_of(agent)
        return shown, sums[agent], env.terminations[agent], env.truncations[agent], info

    def step(self, action: Any) -> None:
        """One turn of the environment; an action that it refuses leaves everything as it was."""
        env, transform, noted = self.env, self.transform, None
        agent, ends = env.agent_selection, action is None
        if self._touches and not ends:
            if self._acts:
                action = transform.action(agent, action)
            if self._notes:
                noted = transform.note(agent, env.observe(agent), action)
        env.step(action)
        self._infos = {}
        if self._notes and not ends:
            transform.keep(agent, noted)
        if self._pays:
            self._account(agent, ends=ends)
        if self._gives:
            self._give()

    def _account(self, actor: AgentId, *, ends: bool) -> None:
        """Writes down what the turn paid; the turn of an agent that has ended pays nothing."""
        reward, before = self.transform.reward, self._sums
        self._paid = paid = {a: reward(a, amount) for a, amount in self.env.rewards.items()}
        if ends:
            self._sums = {agent: before.get(agent, 0) for agent in paid}
            return
        before[actor] = 0  # before the turn's own pay is added, as AECEnv does it
        self._sums = {agent: before.get(agent, 0) + amount for agent, amount in paid.items()}


def wrapped(env: Any, transform: Transform) -> Any:
    """The environment seen through a transform, with the interface that it has.

    Raises:
        SpecError: it is no PettingZoo environment, or its spaces can't be changed so.
    """
    form = ParallelTransformed if is_parallel(env, type(transform).__name__) else AECTransformed
    return form(env, transform)
