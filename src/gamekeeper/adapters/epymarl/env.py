"""The environment that EPyMARL's runners step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.adapters.epymarl.seen import Seen
from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import role as role_in_name
from gamekeeper.core.seeds import episode_seed
from gamekeeper.errors import ActionError, OrderError, SpecError
from gamekeeper.game.casting.cast import Choices
from gamekeeper.game.converting.slim import slim
from gamekeeper.game.declared import declared_contract
from gamekeeper.game.open import Opened
from gamekeeper.record.recording import cast_of


class MultiAgentEnv:
    """Use `multi_agent_env`.

    Attributes:
        env: the multi-agent environment.
        agents: names of the agents, in EPyMARL's order.
        n_agents: how many.
        episode_limit: steps of the longest episode.
        common_reward, is_mean: how rewards are told.
        live: [agent], who is there.
        rewards, terminations, truncations: [agent], of the last step.
        infos: of the last step, by name.
        episode: its number in the run; -1 where `reset` was given a seed of its own.
    """

    common_reward, is_mean = True, False

    def __init__(
        self,
        opened: Opened,
        role: str | None,
        others: Choices,
        *,
        time_limit: int | None,
        state: str | None,
        seed: int,
    ) -> None:
        """Takes over an open environment."""
        self.env: Any = slim(opened.env)
        self._is_aec = opened.api == "aec"
        self._contract = declared_contract(None, opened) or Contract()
        everybody = list(opened.env.possible_agents)
        self.agents = [a for a in everybody if role in (None, self._role_of(a), str(a))]
        self._check_cast(role, others, everybody)
        self.n_agents = len(self.agents)
        self.episode_limit = self._limit(time_limit)
        self._cast = cast_of(others, opened.env, self._contract)
        self._seen = {a: Seen(self.env, self._contract, a) for a in self.agents}
        self._obs_size = max(one.length for one in self._seen.values())
        self._actions = max(one.actions for one in self._seen.values())
        self._has_state = self._own_state(state)
        self._run_seed, self._next = seed, 0
        self.episode = -1
        self._is_begun = False

    # -- who plays

    def _role_of(self, agent: Any) -> str:
        return self._contract.role_of(agent) or role_in_name(str(agent))

    def _check_cast(self, role: str | None, others: Choices, everybody: list[Any]) -> None:
        if not self.agents:
            known = sorted({self._role_of(a) for a in everybody})
            raise SpecError(
                f"nobody has the role {role!r}", where="role", expected=", ".join(known),
                seen=repr(role),
            )  # fmt: skip
        rest = [str(a) for a in everybody if a not in self.agents]
        if bool(rest) != (others is not None):
            raise SpecError(
                "the other agents have no policy" if rest else "there is nobody else",
                where="others", expected=f"policies for {', '.join(rest)}" if rest else "none",
                seen=repr(others)[:100],
                mend="others='random', or by role" if rest else "name the role that is learnt",
            )  # fmt: skip

    def _limit(self, time_limit: int | None) -> int:
        limit = self._contract.schedule.horizon if time_limit is None else time_limit
        if limit is None or (self._is_aec and time_limit is None) or limit < 1:
            raise SpecError(
                "nothing says how many steps an episode has at most", where="time_limit",
                expected="a number of steps; of turns in an AEC environment", seen=repr(time_limit),
                mend="time_limit=N, or schedule.horizon in the contract of a Parallel environment",
            )  # fmt: skip
        return limit

    def _own_state(self, state: str | None) -> bool:
        space = getattr(self.env.unwrapped, "state_space", None)
        if isinstance(space, spaces.Box) and state != "observations":
            self._state_size = int(np.prod(space.shape))
            return True
        if state == "state":
            raise SpecError(
                "the environment declares no state_space that is a Box", where="state",
                seen=repr(space), mend="state='observations'",
            )  # fmt: skip
        self._state_size = self.n_agents * self._obs_size
        return False

    # -- a run

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[list[NDArray[np.float32]], dict[str, Any]]:
        """Begins an episode: everybody's observations, and an empty info.

        Args:
            seed: of this episode, for the environment and for who follows; None: the run's next.
            options: handed to the environment.
        """
        if seed is None:
            self.episode = self._next
            self._cast.begin(self._run_seed, self.episode)
            seed, self._next = episode_seed(self._run_seed, self._next), self._next + 1
        else:
            self.episode = -1
            self._cast.begin(seed, 0)  # the others' draws are another seed's too
        more = {} if options is None else {"options": dict(options)}
        out = self.env.reset(seed=seed, **more)
        self._steps = 0
        self._given: dict[Any, Any] = {}
        self.infos: dict[Any, Any] = {}
        self._ended: set[Any] = set()
        self._clear()
        if self._is_aec:
            self._turns()
        else:
            self._given, self.infos = dict(out[0]), dict(out[1])
        self._is_begun = bool(self.env.agents)
        self._look()
        return self.get_obs(), {}

    def step(
        self, actions: Sequence[int]
    ) -> tuple[list[NDArray[np.float32]], Any, bool, bool, dict[str, Any]]:
        """One step of everybody; of agents that aren't there, actions are passed over.

        Args:
            actions: [agent], numbers from 0.
        Returns:
            Observations, the common reward or [agent] rewards, whether the last agent was
            terminated, whether all was truncated, an info of numbers.
        Raises:
            OrderError: nobody is there: `reset` comes first.
            ActionError: an action isn't available, or there isn't one for each agent.
        """
        chosen = self._chosen(actions)
        if self._steps:  # what came before anybody's first turn is told with that
            self._clear()
        self._steps += 1
        if self._is_aec:
            self.env.step(chosen[self.env.agent_selection])
            self._note()
            self._turns()
        else:
            self._tick(chosen)
        is_over = not self.env.agents
        is_cut = not is_over and self._steps >= self.episode_limit
        self._look()
        if is_cut:  # those who are there now, not those who were there before the step
            self.truncations |= self.live
        self._is_begun = not (is_over or is_cut)
        terminated = is_over and not self._is_all_cut
        truncated = is_cut or (is_over and not terminated)
        return self.get_obs(), self._reward(), terminated, truncated, {"episode_limit": truncated}

    def _clear(self) -> None:
        self.rewards = np.zeros(self.n_agents)
        self.terminations = np.zeros(self.n_agents, bool)
        self.truncations = np.zeros(self.n_agents, bool)
        self._is_all_cut = True

    def _chosen(self, actions: Sequence[int]) -> dict[Any, Any]:
        if not self._is_begun:
            raise OrderError("nobody is there to act", where="step", mend="reset() comes first")
        if len(actions) != self.n_agents:
            raise ActionError(
                "there isn't one action for each agent", where="actions",
                expected=f"{self.n_agents}", seen=f"{len(actions)}",
            )  # fmt: skip
        chosen = {}
        for i, agent in enumerate(self.agents):
            action = int(actions[i])
            if not 0 <= action < self._actions or not self._available[i][action]:
                raise ActionError(
                    "an action isn't available", where=f"agent {agent!r}",
                    expected=f"one of {np.flatnonzero(self._available[i]).tolist()}",
                    seen=str(action), mend="get_avail_actions() says which are",
                )  # fmt: skip
            chosen[agent] = self._seen[agent].start + action
        return chosen

    def _tick(self, chosen: Mapping[Any, Any]) -> None:
        acts = {
            a: chosen[a]
            if a in chosen
            else self._cast.act(a, self._given[a], self.infos.get(a, {}))
            for a in self.env.agents
        }
        self._given, paid, terms, truncs, self.infos = self.env.step(acts)
        self._book(paid, terms, truncs)

    def _note(self) -> None:
        """What a turn paid, and whom it ended."""
        env = self.env
        self._book(env.rewards, env.terminations, env.truncations)

    def _book(self, paid: Any, terms: Any, truncs: Any) -> None:
        """Adds what was paid; ends are noted once, though an AEC environment shows them longer."""
        ended = [a for a in terms if (terms[a] or truncs[a]) and a not in self._ended]
        self._ended.update(ended)
        self._ended -= {a for a in terms if not (terms[a] or truncs[a])}  # who came again
        if ended:
            self._is_all_cut = not any(terms[a] for a in ended)
        for i, agent in enumerate(self.agents):
            self.rewards[i] += float(paid.get(agent, 0.0))
            if agent in ended:
                self.terminations[i], self.truncations[i] = terms[agent], truncs[agent]

    def _turns(self) -> None:
        """Plays the None turns of the dead and the turns of who follows, up to one of ours."""
        env = self.env
        while env.agents:
            agent = env.agent_selection
            observation, _, terminated, truncated, info = env.last()
            self.infos[agent] = info
            if terminated or truncated:
                self._given[agent] = observation
                env.step(None)
                self._note()
                continue
            if agent in self._seen:
                break
            env.step(self._cast.act(agent, observation, info))
            self._note()
        self._given |= {a: env.observe(a) for a in self.agents if a in env.agents}

    # -- what is given

    def _look(self) -> None:
        """Observations and available actions of everybody, as they stand now."""
        env, here = self.env, set(self.env.agents)
        if self._is_aec:
            here -= {a for a in here if env.terminations[a] or env.truncations[a]}
        turn = {env.agent_selection} if self._is_aec and here else here
        self.live = np.array([agent in here for agent in self.agents])
        self._obs, self._available = [], []
        for agent in self.agents:
            seen = self._seen[agent]
            observation, info = self._given.get(agent), self.infos.get(agent, {})
            row = np.zeros(self._obs_size, np.float32)
            if observation is not None:
                row[: seen.length] = seen.flat(observation)
            flags = np.zeros(self._actions, np.int64)
            if agent in turn:
                flags[: seen.actions] = seen.legal(observation, info)
            else:
                flags[seen.noop] = 1
            self._obs.append(row)
            self._available.append(flags)
        if not self._is_aec:  # who ended in this step is shown once
            self._given = {a: one for a, one in self._given.items() if a in here}
        else:
            self._given = {}

    def _reward(self) -> Any:
        if not self.common_reward:
            return self.rewards.tolist()
        return float(self.rewards.mean() if self.is_mean else self.rewards.sum())

    def get_obs(self) -> list[NDArray[np.float32]]:
        """Everybody's observations, [agent] of [observation]."""
        return [row.copy() for row in self._obs]

    def get_obs_agent(self, agent_id: int) -> NDArray[np.float32]:
        """One agent's."""
        return self._obs[agent_id].copy()

    def get_obs_size(self) -> int:
        """How long the longest is."""
        return self._obs_size

    def get_state(self) -> NDArray[np.float32]:
        """The environment's `state()` as a flat vector, or all observations in a row."""
        if self._has_state:
            return np.asarray(self.env.state(), np.float32).reshape(-1)
        return np.concatenate(self._obs)

    def get_state_size(self) -> int:
        """How long the state is."""
        return self._state_size

    def get_avail_actions(self) -> list[list[int]]:
        """1 for each action that an agent may take now, [agent] of [action]."""
        return [flags.tolist() for flags in self._available]

    def get_avail_agent_actions(self, agent_id: int) -> list[int]:
        """One agent's."""
        found: list[int] = self._available[agent_id].tolist()
        return found

    def get_total_actions(self) -> int:
        """How many actions there are for who has most."""
        return self._actions

    def get_env_info(self) -> dict[str, Any]:
        """Sizes, for EPyMARL's schemes."""
        return {
            "state_shape": self.get_state_size(), "obs_shape": self.get_obs_size(),
            "n_actions": self.get_total_actions(), "n_agents": self.n_agents,
            "episode_limit": self.episode_limit,
        }  # fmt: skip

    def get_stats(self) -> dict[str, Any]:
        """Nothing: evidence (`gk.rollout`, `gk.record`) has it all."""
        return {}

    def seed(self, seed: int | None = None) -> int:
        """The seed of the run from the next reset on; returns the one that holds."""
        if seed is not None:
            self._run_seed, self._next = seed, 0
        return self._run_seed

    def render(self) -> Any:
        """As the environment renders."""
        return self.env.render()

    def save_replay(self) -> None:
        """Refused: `gk.record` keeps episodes, with frames where asked.

        Raises:
            SpecError: always.
        """
        raise SpecError(
            "replays aren't saved here", where="save_replay", mend="gk.rollout(spec, out='runs/x')"
        )

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()
