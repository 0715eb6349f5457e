"""A multi-agent environment of ours as RLlib's MultiAgentEnv: agents by name, each with its end."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any, Final

from ray.rllib.env.multi_agent_env import MultiAgentEnv

from gamekeeper.adapters.learner_steps import LearnerTicks, LearnerTurns, StepOutput
from gamekeeper.adapters.requirements import checked
from gamekeeper.adapters.rllib.rllib_game import RLlibMultiAgentEnv, opened_game
from gamekeeper.episodes.exception_text import said_by
from gamekeeper.errors import ActionError
from gamekeeper.interface.action_mask import reader
from gamekeeper.interface.joint_policy import Choices
from gamekeeper.interface.legality import forbidden
from gamekeeper.randomness.seeds import EpisodeSeeds

ALL: Final = "__all__"
FIX_OF_MASKED: Final = (
    "config.rl_module(rl_module_spec=rllib.modules(spec)), whose networks read masks, with PPO"
)
PRE_CHECK: Final[tuple[int, dict[str, Any]]] = (42, {})
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
        self.possible_agents = list(capture.views)
        self.agents: list[str] = []
        self.observation_spaces = {a: one.observation_space for a, one in capture.views.items()}
        self.action_spaces = {a: one.action_space for a, one in capture.views.items()}
        self.metadata = dict(getattr(capture.env, "metadata", None) or {})  # RLlib writes into it
        self.render_mode = getattr(capture.env, "render_mode", None)
        super().__init__()
        self.env, self.role_of, self.episode = capture.env, dict(capture.role_of), -1
        self._capture = capture
        kind = LearnerTurns if capture.api == "aec" else LearnerTicks
        self._steps = kind(
            capture.env, [capture.agent_of[name] for name in capture.views], capture.policies
        )
        self._run, self._seeds = seed, EpisodeSeeds(seed)
        self._is_shared = episodes is not None
        self._episodes: Iterator[int] = itertools.count() if episodes is None else episodes
        self._known: set[str] = set()
        self._held: dict[str, StepOutput] = {}

    @property
    def returns(self) -> dict[str, float]:
        """Return of each agent in the episode, learner or not; 0 of an agent that wasn't in it."""
        paid = self._steps.paid
        return {name: paid.get(self._capture.agent_of[name], 0.0) for name in self.role_of}

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begins an episode; returns observations and infos of the agents that decide first."""
        run, is_pre_check = self._run, self._is_shared and (seed, options) == PRE_CHECK
        if is_pre_check:
            run, number, options = PRE_CHECK[0], 0, None
        elif seed is not None and not self._is_shared:
            self._run = run = seed
            self._seeds, self._episodes = EpisodeSeeds(seed), itertools.count()
        if not is_pre_check:
            number = self.episode = next(self._episodes)
        if self._capture.policies is not None:
            self._capture.policies.begin(run, number)
        seeds = EpisodeSeeds(run) if is_pre_check else self._seeds
        outputs = self._named(self._steps.begin(seeds[number], options))
        self._known, self._held = set(outputs), {}
        self.agents = list(outputs)
        return self._observations(outputs), self._infos(outputs)

    def step(self, action_dict: Mapping[str, Any]) -> tuple[dict[str, Any], ...]:
        """Plays on to the next decision; returns observations, rewards, both flags, infos."""
        views, agent_of = self._capture.views, self._capture.agent_of
        acts = {agent_of[name]: views[name].meant(act) for name, act in action_dict.items()}
        try:
            outputs = self._named(self._steps.act(acts))
        except Exception as error:
            for agent, act in acts.items():
                masked = self._masked(agent, act, said_by(error))
                if masked is not None:
                    raise masked from error
            raise
        is_over = self._steps.is_over
        outputs = self._tellable(outputs, is_over=is_over)
        terms, truncs = _flags(outputs, is_over=is_over)
        self.agents = [
            name
            for name in self.possible_agents
            if name in outputs or (name in self._known and agent_of[name] in self._steps.live)
        ]
        rewards = {name: one.reward for name, one in outputs.items()}
        return self._observations(outputs), rewards, terms, truncs, self._infos(outputs)

    def _masked(self, agent: Any, action: Any, then: str) -> ActionError | None:
        """Error of a learner that did what its mask forbids, before `then`."""
        seen = self._steps.live.get(agent)
        view = self._capture.views.get(self._capture.name_of.get(agent, ""))
        if seen is None or view is None:
            return None
        mask, space = reader(view.place)(seen.observation, seen.info), self.env.action_space(agent)
        return forbidden(agent, action, space, mask, then=then, fix=FIX_OF_MASKED)

    def render(self) -> Any:
        """Renders the environment."""
        return self.env.render()

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()

    def _named(self, outputs: Mapping[Any, StepOutput]) -> dict[str, StepOutput]:
        return {self._capture.name_of[agent]: one for agent, one in outputs.items()}

    def _tellable(self, outputs: dict[str, StepOutput], *, is_over: bool) -> dict[str, StepOutput]:
        """Returns outputs that RLlib can take now.

        RLlib takes an episode for over once all agents that it has seen have ended, so ends wait
        until another agent goes on or joins.
        """
        outputs = {**self._held, **outputs}
        self._held = {}
        goes_on = any(self._capture.agent_of[name] in self._steps.live for name in self._known)
        if not is_over and not goes_on:
            self._held = {name: one for name, one in outputs.items() if one.ended}
            outputs = {name: one for name, one in outputs.items() if not one.ended}
        self._known |= set(outputs)
        return {name: outputs[name] for name in self.possible_agents if name in outputs}

    def _observations(self, outputs: Mapping[str, StepOutput]) -> dict[str, Any]:
        views = self._capture.views
        return {name: views[name].shown(one.observation, one.info) for name, one in outputs.items()}

    def _infos(self, outputs: Mapping[str, StepOutput]) -> dict[str, Any]:
        return {name: dict(one.info or {}) for name, one in outputs.items()}


def _flags(
    outputs: Mapping[str, StepOutput], *, is_over: bool
) -> tuple[dict[str, bool], dict[str, bool]]:
    """Returns terminations and truncations, such that RLlib keeps the two apart."""
    terms = {name: one.terminated for name, one in outputs.items()}
    truncs = {name: one.truncated and not one.terminated for name, one in outputs.items()}
    is_cut = is_over and any(truncs.values())
    if is_cut:  # flags of their own would make RLlib say of all that they were terminated
        truncs = dict.fromkeys(truncs, False)
    return {**terms, ALL: is_over and not is_cut}, {**truncs, ALL: is_cut}
