"""A multi-agent environment of ours as RLlib's MultiAgentEnv: agents by name, each with its end.

A `World` plays the environment from one decision of a learner to the next: other agents act by
their policies, and agents that ended make their last turns.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from ray.rllib.env.multi_agent_env import MultiAgentEnv

from gamekeeper.adapters.requirements import checked
from gamekeeper.adapters.rllib.rllib_game import RLlibMultiAgentEnv, opened_game
from gamekeeper.episodes.exception_text import said_by
from gamekeeper.errors import ActionError, ContractError
from gamekeeper.interface.action_mask import reader
from gamekeeper.interface.joint_policy import Choices, JointPolicy
from gamekeeper.interface.legality import forbidden
from gamekeeper.randomness.seeds import EpisodeSeeds


@dataclass(frozen=True, slots=True)
class StepOutput:
    """Observation and reward of a learner before its next decision, or at its end.

    Attributes:
        observation, info: as the environment gave them.
        reward: sum since its last decision.
        terminated, truncated: True where it ended so.
    """

    observation: Any
    reward: float
    info: Any
    terminated: bool = False
    truncated: bool = False

    @property
    def ended(self) -> bool:
        """True if it takes no further decision."""
        return self.terminated or self.truncated


class World:
    """One copy of an environment, from one decision of a learner to the next.

    Args:
        env: a ParallelEnv or AECEnv.
        learners: agents that learn, in the order of `possible_agents`.
        others: policies of the rest; None where all agents learn.

    Attributes:
        paid: by agent, learners and others, its rewards in the episode.
        live: learners that were observed and haven't ended.
    """

    def __init__(self, env: Any, learners: Collection[Any], others: JointPolicy | None) -> None:
        self.env, self.learners, self.others = env, tuple(learners), others
        self.paid: dict[Any, float] = {}
        self.live: dict[Any, StepOutput] = {}
        self._ended: set[Any] = set()

    @property
    def is_over(self) -> bool:
        """True if no decision follows: no agent is live, or all that learn have ended."""
        return not self.env.agents or len(self._ended) == len(self.learners)

    def begin(self, seed: int, options: Mapping[str, Any] | None) -> dict[Any, StepOutput]:
        """Begins an episode; returns the observations of learners that decide first."""
        self.paid, self.live, self._ended = {}, {}, set()
        self._reset({"seed": seed} if options is None else {"seed": seed, "options": options})
        told = self._first()
        return told if any(not one.ended for one in told.values()) else self._on(told)

    def act(self, actions: Mapping[Any, Any]) -> dict[Any, StepOutput]:
        """Plays on until a learner decides again or the episode is over.

        Args:
            actions: of exactly the learners that were observed last and are live.
        Returns:
            Learners that decide next or ended meanwhile; a learner of an AEC environment that waits
            for its turn isn't among them.
        Raises:
            ActionError: an action is missing, or is of an agent that doesn't decide now.
            ContractError: an agent that ended has come back.
        """
        return self._on(self._play(actions))

    def _on(self, told: dict[Any, StepOutput]) -> dict[Any, StepOutput]:
        """Plays on while no learner decides, as none of them is live or has the turn."""
        while not self.is_over and all(one.ended for one in told.values()):
            told |= self._play({})
        return {agent: told[agent] for agent in self.learners if agent in told}

    def _note(self, agent: Any, told: StepOutput) -> StepOutput:
        """Notes that a learner is live, or has ended."""
        if agent in self._ended:
            raise ContractError(
                f"{agent!r} has ended and is back within the episode",
                where=f"the roster, {agent!r}",
                expected="an end that lasts until the episode is over",
                actual="the agent among those that live",
                fix="name an agent that joins later anew; RLlib has one stream for each name",
            )
        if told.ended:
            self._ended.add(agent)
            self.live.pop(agent, None)
        else:
            self.live[agent] = told
        return told

    def _pay(self, agent: Any, reward: Any) -> float:
        amount = float(reward)
        self.paid[agent] = self.paid.get(agent, 0.0) + amount
        return amount

    def _by_others(self, agent: Any, observation: Any, info: Any) -> Any:
        assert self.others is not None  # every agent that doesn't learn has a policy
        return self.others.act(agent, observation, {} if info is None else info)

    def _chosen(self, actions: Mapping[Any, Any], agent: Any) -> Any:
        try:
            return actions[agent]
        except KeyError:
            raise ActionError(
                f"{agent!r} was observed and has no action",
                where="step",
                expected=f"an action of {agent!r}",
                actual=", ".join(map(str, actions)) or "no actions",
                fix="give an action to each agent of the last observations that hasn't ended",
            ) from None

    def _reset(self, arguments: Mapping[str, Any]) -> None:
        raise NotImplementedError

    def _first(self) -> dict[Any, StepOutput]:
        raise NotImplementedError

    def _play(self, actions: Mapping[Any, Any]) -> dict[Any, StepOutput]:
        raise NotImplementedError


class Ticks(World):
    """A Parallel environment: all live agents decide in each tick."""

    def _reset(self, arguments: Mapping[str, Any]) -> None:
        self._seen, self._infos = self.env.reset(**arguments)

    def _first(self) -> dict[Any, StepOutput]:
        live = set(self.env.agents)
        return {
            agent: self._note(agent, StepOutput(self._seen[agent], 0.0, self._infos.get(agent)))
            for agent in self.learners
            if agent in live
        }

    def _play(self, actions: Mapping[Any, Any]) -> dict[Any, StepOutput]:
        mine, before = set(self.learners), list(self.env.agents)
        strangers = [agent for agent in actions if agent not in before or agent not in mine]
        if strangers:
            raise ActionError(
                f"{strangers[0]!r} doesn't decide now",
                where="step",
                actual=repr(strangers[0]),
                expected=", ".join(str(agent) for agent in before if agent in mine),
                fix="give actions to the agents of the last observations alone",
            )
        acts = {
            agent: self._chosen(actions, agent)
            if agent in mine
            else self._by_others(agent, self._seen[agent], self._infos.get(agent))
            for agent in before
        }
        self._seen, rewards, terms, truncs, self._infos = self.env.step(acts)
        paid = {agent: self._pay(agent, rewards.get(agent, 0.0)) for agent in before}
        live, told = set(self.env.agents), {}
        for agent in self.learners:
            was_there = agent in acts
            if not was_there and agent not in live:
                continue
            if was_there and agent not in live and not (terms.get(agent) or truncs.get(agent)):
                told[agent] = self._note(agent, self._gone(agent, paid[agent]))
                continue
            one = StepOutput(
                self._seen[agent],
                paid.get(agent, 0.0),
                self._infos.get(agent),
                bool(terms.get(agent)),
                bool(truncs.get(agent)),
            )
            told[agent] = self._note(agent, one)
        return told

    def _gone(self, agent: Any, reward: float) -> StepOutput:
        """Output of an agent that left without an ending: terminated, with its last observation."""
        last = self.live[agent]
        return StepOutput(
            self._seen.get(agent, last.observation),
            reward,
            self._infos.get(agent, last.info),
            terminated=True,
        )


class Turns(World):
    """An AEC environment: one agent decides at a time; ended agents have turns of their own."""

    def _reset(self, arguments: Mapping[str, Any]) -> None:
        self.env.reset(**arguments)

    def _first(self) -> dict[Any, StepOutput]:
        return self._to_a_learner()

    def _play(self, actions: Mapping[Any, Any]) -> dict[Any, StepOutput]:
        agent = self.env.agent_selection
        strangers = [other for other in actions if other != agent]
        if strangers:
            raise ActionError(
                f"{strangers[0]!r} acts out of turn",
                where="step",
                expected=repr(agent),
                actual=repr(strangers[0]),
                fix="give one action, that of the agent in the last observations",
            )
        self.env.step(self._chosen(actions, agent))
        return self._to_a_learner()

    def _to_a_learner(self) -> dict[Any, StepOutput]:
        """Makes the turns of ended and of other agents; stops where a learner decides."""
        env, mine = self.env, set(self.learners)
        told: dict[Any, StepOutput] = {}
        while env.agents:
            agent = env.agent_selection
            observation, reward, terminated, truncated, info = env.last()
            amount = self._pay(agent, reward)
            if agent in mine and (agent in self.live or not (terminated or truncated)):
                one = StepOutput(observation, amount, info, bool(terminated), bool(truncated))
                told[agent] = self._note(agent, one)
                if not one.ended:
                    break
            elif agent in mine:  # it ended before it had decided anything
                self._ended.add(agent)
            is_dead = terminated or truncated
            env.step(None if is_dead else self._by_others(agent, observation, info))
            if len(self._ended) == len(self.learners):
                for other in env.agents:  # rewards that no turn of theirs will show
                    self._pay(other, env._cumulative_rewards.get(other, 0.0))
                break
        for agent in [one for one in self.live if one not in env.agents]:
            told[agent] = self._note(agent, self._gone(agent))
        return told

    def _gone(self, agent: Any) -> StepOutput:
        """Output of an agent that left without a last turn, with its last observation."""
        env, last = self.env, self.live[agent]
        amount = self._pay(agent, env._cumulative_rewards.get(agent, 0.0))
        is_cut = bool(env.truncations.get(agent)) and not env.terminations.get(agent)
        return StepOutput(last.observation, amount, last.info, not is_cut, is_cut)


ALL: Final = "__all__"
FIX_OF_MASKED: Final = (
    "config.rl_module(rl_module_spec=rllib.modules(spec)), whose networks read masks, with PPO"
)
LOOK: Final[tuple[int, dict[str, Any]]] = (42, {})
"""Seed and options with which RLlib resets an environment to check it before the run.

Source: `check_multiagent_environments` in ray/rllib/utils/pre_checks/env.py of 2.60.
"""


def multi_agent_env(
    spec: object,
    *,
    role: str | None = None,
    others: Choices = None,
    check: str | None = "quick",
    seed: int = 0,
    masks: bool = True,
    flatten: bool = False,
    env_kwargs: Mapping[str, Any] | None = None,
    episodes: Iterator[int] | None = None,
) -> AgentsEnv:
    """A multi-agent environment for RLlib's new API stack; `register` hands it to a config.

    | | |
    |---|---|
    | kept | agents by name, in the order of `possible_agents`; each one's own spaces, end, last observation, info; truncation apart from termination; who joins late comes when it comes; AEC: only who has the turn is observed, and its reward is all that it was paid since its last action, its last one comes with its end; seeds: episode k of run s is reset as `gk.rollout` resets it, and env runners play disjoint episodes |
    | changed | an observation becomes `{"action_mask", "observations"}` where the environment has masks (`masks=False`: it doesn't; the info keeps the mask); `flatten=True` makes one row of float32 of it; a Discrete or MultiDiscrete action counts from 0; names are texts. RLlib takes an episode for terminated as soon as all the agents that it has seen have flags of their own: so those whom the last step truncates are told by `__all__` alone (one that is terminated in that step is both, and counts as terminated), and an end is told with the next step where others are still to come. Who leaves without an ending is terminated. The episode is over once all learners have ended |
    | lost | what an agent is paid before its first decision, and an agent that never decides; `state()`; what the others see and are paid (`returns` has the sums) |
    | refused | others without a policy (`others=`), MultiBinary actions, Dict and Tuple actions whose parts don't count from 0, an environment that doesn't name its agents before it runs, one that breaks its contract (`check=None` lets it pass), a name that comes back after its end |

    Args:
        spec: where the environment comes from, as `gk.make` takes it.
        role: role, or the one agent, that RLlib plays; None: all agents.
        others: policies of the other agents, one for all or by agent or role.
        check: "quick": the quick audit, once for each source digest, before the first step.
        seed: of the run; episode k has `episode_seed(seed, k)`.
        masks: masks stand in observations.
        flatten: makes one row of numbers of an observation, for RLlib's own networks.
        env_kwargs: handed to the environment.
        episodes: the episodes that this copy plays, where several share a run; a seed handed to
            `reset` is then passed over. None: 0, 1, 2, ..., and `reset(seed=s)` begins run s.
    Raises:
        SpecError: see *refused*.
        ContractError: see *refused*.
    """  # noqa: E501  # a row of a table is one line
    checked(spec, check, env_kwargs=env_kwargs)
    capture = opened_game(
        spec, role=role, others=others, masks=masks, flatten=flatten, env_kwargs=env_kwargs
    )
    return AgentsEnv(capture, seed=seed, episodes=episodes)


class AgentsEnv(MultiAgentEnv):
    """Use `multi_agent_env`.

    Attributes:
        env: the environment itself.
        episode: the number of the episode in the run; -1 before the first.
        role_of: by agent, learners and others, its role.
        returns: by agent, learners and others, its return so far, under RLlib's names.
    """

    def __init__(
        self, capture: RLlibMultiAgentEnv, *, seed: int, episodes: Iterator[int] | None
    ) -> None:
        self.possible_agents = list(capture.sights)
        self.agents: list[str] = []
        self.observation_spaces = {a: one.observation_space for a, one in capture.sights.items()}
        self.action_spaces = {a: one.action_space for a, one in capture.sights.items()}
        self.metadata = dict(getattr(capture.env, "metadata", None) or {})  # RLlib writes into it
        self.render_mode = getattr(capture.env, "render_mode", None)
        super().__init__()
        self.env, self.role_of, self.episode = capture.env, dict(capture.role_of), -1
        self._capture = capture
        kind = Turns if capture.api == "aec" else Ticks
        self._world = kind(
            capture.env, [capture.agent_of[name] for name in capture.sights], capture.policies
        )
        self._run, self._seeds = seed, EpisodeSeeds(seed)
        self._is_shared = episodes is not None
        self._episodes: Iterator[int] = itertools.count() if episodes is None else episodes
        self._known: set[str] = set()
        self._held: dict[str, StepOutput] = {}

    @property
    def returns(self) -> dict[str, float]:
        """Return of each agent in the episode, learner or not; 0 of an agent that wasn't in it."""
        paid = self._world.paid
        return {name: paid.get(self._capture.agent_of[name], 0.0) for name in self.role_of}

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begins an episode; returns observations and infos of the agents that decide first."""
        run, is_look = self._run, self._is_shared and (seed, options) == LOOK
        if is_look:
            run, number, options = LOOK[0], 0, None
        elif seed is not None and not self._is_shared:
            self._run = run = seed
            self._seeds, self._episodes = EpisodeSeeds(seed), itertools.count()
        if not is_look:
            number = self.episode = next(self._episodes)
        if self._capture.policies is not None:
            self._capture.policies.begin(run, number)
        seeds = EpisodeSeeds(run) if is_look else self._seeds
        told = self._named(self._world.begin(seeds[number], options))
        self._known, self._held = set(told), {}
        self.agents = list(told)
        return self._observations(told), self._infos(told)

    def step(self, action_dict: Mapping[str, Any]) -> tuple[dict[str, Any], ...]:
        """Plays on to the next decision; returns observations, rewards, both flags, infos."""
        sights, agent_of = self._capture.sights, self._capture.agent_of
        acts = {agent_of[name]: sights[name].meant(act) for name, act in action_dict.items()}
        try:
            told = self._named(self._world.act(acts))
        except Exception as error:
            for agent, act in acts.items():
                masked = self._masked(agent, act, said_by(error))
                if masked is not None:
                    raise masked from error
            raise
        is_over = self._world.is_over
        told = self._tellable(told, is_over=is_over)
        terms, truncs = _flags(told, is_over=is_over)
        self.agents = [
            name
            for name in self.possible_agents
            if name in told or (name in self._known and agent_of[name] in self._world.live)
        ]
        rewards = {name: one.reward for name, one in told.items()}
        return self._observations(told), rewards, terms, truncs, self._infos(told)

    def _masked(self, agent: Any, action: Any, then: str) -> ActionError | None:
        """Error of a learner that did what its mask forbids, before `then`."""
        seen = self._world.live.get(agent)
        sight = self._capture.sights.get(self._capture.name_of.get(agent, ""))
        if seen is None or sight is None:
            return None
        mask, space = reader(sight.place)(seen.observation, seen.info), self.env.action_space(agent)
        return forbidden(agent, action, space, mask, then=then, fix=FIX_OF_MASKED)

    def render(self) -> Any:
        """Renders the environment."""
        return self.env.render()

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()

    def _named(self, told: Mapping[Any, StepOutput]) -> dict[str, StepOutput]:
        return {self._capture.name_of[agent]: one for agent, one in told.items()}

    def _tellable(self, told: dict[str, StepOutput], *, is_over: bool) -> dict[str, StepOutput]:
        """Returns outputs that RLlib can take now.

        RLlib takes an episode for over once all agents that it has seen have ended, so ends wait
        until another agent goes on or joins.
        """
        told = {**self._held, **told}
        self._held = {}
        goes_on = any(self._capture.agent_of[name] in self._world.live for name in self._known)
        if not is_over and not goes_on:
            self._held = {name: one for name, one in told.items() if one.ended}
            told = {name: one for name, one in told.items() if not one.ended}
        self._known |= set(told)
        return {name: told[name] for name in self.possible_agents if name in told}

    def _observations(self, told: Mapping[str, StepOutput]) -> dict[str, Any]:
        sights = self._capture.sights
        return {name: sights[name].shown(one.observation, one.info) for name, one in told.items()}

    def _infos(self, told: Mapping[str, StepOutput]) -> dict[str, Any]:
        return {name: dict(one.info or {}) for name, one in told.items()}


def _flags(
    told: Mapping[str, StepOutput], *, is_over: bool
) -> tuple[dict[str, bool], dict[str, bool]]:
    """Returns terminations and truncations, such that RLlib keeps the two apart."""
    terms = {name: one.terminated for name, one in told.items()}
    truncs = {name: one.truncated and not one.terminated for name, one in told.items()}
    is_cut = is_over and any(truncs.values())
    if is_cut:  # flags of their own would make RLlib say of all that they were terminated
        truncs = dict.fromkeys(truncs, False)
    return {**terms, ALL: is_over and not is_cut}, {**truncs, ALL: is_cut}
