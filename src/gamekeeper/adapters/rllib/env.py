"""A multi-agent environment of ours as RLlib's MultiAgentEnv: agents by name, each with its end."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any, Final

from ray.rllib.env.multi_agent_env import MultiAgentEnv

from gamekeeper.adapters.checked import checked
from gamekeeper.adapters.rllib.game import Game, opened_game
from gamekeeper.adapters.rllib.worlds import Ticks, Told, Turns
from gamekeeper.core.episode_seeds import EpisodeSeeds
from gamekeeper.game.casting.cast import Choices

ALL: Final = "__all__"
LOOK: Final[tuple[int, dict[str, Any]]] = (42, {})
"""Seed and options with which RLlib looks at an environment before the run.

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
    | changed | an observation becomes `{"action_mask", "observations"}` where the environment has masks (`masks=False`: it doesn't; the info keeps the mask); `flatten=True` makes one row of float32 of it; a Discrete or MultiDiscrete action counts from 0; names are texts. RLlib takes an episode for terminated as soon as all the agents that it has seen have flags of their own: so those whom the last step truncates are told by `__all__` alone (one that is terminated in that step is both, and counts as terminated), and an end is told with the next step where others are still to come. Who leaves without an ending is truncated. The episode is over once all learners have ended |
    | lost | what an agent is paid before its first decision, and an agent that never decides; `state()`; what the others see and are paid (`returns` has the sums) |
    | refused | others without a policy (`others=`), an environment that doesn't name its agents before it runs, one that breaks its contract (`check=None` lets it pass), a name that comes back after its end |

    Args:
        spec: where the environment comes from, as `gk.make` takes it.
        role: the role, or the one agent, that RLlib plays; None: everybody.
        others: policies of who isn't played by it, one for all or by agent or role.
        check: "quick": the quick audit, once for each source digest, before the first step.
        seed: of the run; episode k has `episode_seed(seed, k)`.
        masks: whether masks stand in observations.
        flatten: makes one row of numbers of an observation, for RLlib's own networks.
        env_kwargs: handed to the environment.
        episodes: the episodes that this copy plays, where several share a run; a seed handed to
            `reset` is then passed over. None: 0, 1, 2, ..., and `reset(seed=s)` begins run s.
    Raises:
        SpecError: see *refused*.
        ContractError: see *refused*.
    """  # noqa: E501  # a row of a table is one line
    checked(spec, check, env_kwargs=env_kwargs)
    game = opened_game(
        spec, role=role, others=others, masks=masks, flatten=flatten, env_kwargs=env_kwargs
    )
    return AgentsEnv(game, seed=seed, episodes=episodes)


class AgentsEnv(MultiAgentEnv):
    """Use `multi_agent_env`.

    Attributes:
        env: the environment itself.
        episode: the number of the episode in the run; -1 before the first.
        role_of: by agent, learners and others, its role.
        returns: by agent, learners and others, what it was paid in the episode; as known to RLlib's
            names.
    """

    def __init__(self, game: Game, *, seed: int, episodes: Iterator[int] | None) -> None:
        """Takes over an open environment."""
        self.possible_agents = list(game.sights)
        self.agents: list[str] = []
        self.observation_spaces = {a: one.observation_space for a, one in game.sights.items()}
        self.action_spaces = {a: one.action_space for a, one in game.sights.items()}
        self.metadata = dict(getattr(game.env, "metadata", None) or {})  # RLlib writes into it
        self.render_mode = getattr(game.env, "render_mode", None)
        super().__init__()
        self.env, self.role_of, self.episode = game.env, dict(game.role_of), -1
        self._game = game
        kind = Turns if game.api == "aec" else Ticks
        self._world = kind(game.env, [game.agent_of[name] for name in game.sights], game.cast)
        self._run, self._seeds = seed, EpisodeSeeds(seed)
        self._is_shared = episodes is not None
        self._episodes: Iterator[int] = itertools.count() if episodes is None else episodes
        self._known: set[str] = set()
        self._held: dict[str, Told] = {}

    @property
    def returns(self) -> dict[str, float]:
        """What each agent, learner or not, was paid in the episode; 0 for who wasn't in it."""
        paid = self._world.paid
        return {name: paid.get(self._game.agent_of[name], 0.0) for name in self.role_of}

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begins an episode: observations and infos of who decides first."""
        run, is_look = self._run, self._is_shared and (seed, options) == LOOK
        if is_look:
            run, number, options = LOOK[0], 0, None
        elif seed is not None and not self._is_shared:
            self._run = run = seed
            self._seeds, self._episodes = EpisodeSeeds(seed), itertools.count()
        if not is_look:
            number = self.episode = next(self._episodes)
        if self._game.cast is not None:
            self._game.cast.begin(run, number)
        seeds = EpisodeSeeds(run) if is_look else self._seeds
        told = self._named(self._world.begin(seeds[number], options))
        self._known, self._held = set(told), {}
        self.agents = list(told)
        return self._observations(told), self._infos(told)

    def step(self, action_dict: Mapping[str, Any]) -> tuple[dict[str, Any], ...]:
        """Plays on until somebody decides: observations, rewards, ends, truncations, infos."""
        sights, agent_of = self._game.sights, self._game.agent_of
        told = self._named(
            self._world.act(
                {agent_of[name]: sights[name].meant(act) for name, act in action_dict.items()}
            )
        )
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

    def render(self) -> Any:
        """As the environment renders."""
        return self.env.render()

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()

    def _named(self, told: Mapping[Any, Told]) -> dict[str, Told]:
        return {self._game.name_of[agent]: one for agent, one in told.items()}

    def _tellable(self, told: dict[str, Told], *, is_over: bool) -> dict[str, Told]:
        """What RLlib can be told now: ends wait while nobody that it has seen would go on."""
        told = {**self._held, **told}
        self._held = {}
        goes_on = any(self._game.agent_of[name] in self._world.live for name in self._known)
        if not is_over and not goes_on:
            self._held = {name: one for name, one in told.items() if one.ended}
            told = {name: one for name, one in told.items() if not one.ended}
        self._known |= set(told)
        return {name: told[name] for name in self.possible_agents if name in told}

    def _observations(self, told: Mapping[str, Told]) -> dict[str, Any]:
        sights = self._game.sights
        return {name: sights[name].shown(one.observation, one.info) for name, one in told.items()}

    def _infos(self, told: Mapping[str, Told]) -> dict[str, Any]:
        return {name: dict(one.info or {}) for name, one in told.items()}


def _flags(told: Mapping[str, Told], *, is_over: bool) -> tuple[dict[str, bool], dict[str, bool]]:
    """Who is terminated and who truncated, so that RLlib keeps the two apart."""
    terms = {name: one.terminated for name, one in told.items()}
    truncs = {name: one.truncated and not one.terminated for name, one in told.items()}
    is_cut = is_over and any(truncs.values())
    if is_cut:  # flags of their own would make RLlib say of all that they were terminated
        truncs = dict.fromkeys(truncs, False)
    return {**terms, ALL: is_over and not is_cut}, {**truncs, ALL: is_cut}
