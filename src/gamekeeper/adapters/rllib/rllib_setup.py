"""Parts of an RLlib config: an environment by name, a module for each role with its masks.

Also a trained algorithm as a policy (`rllib:CHECKPOINT`, or an algorithm in memory), and a callback
that logs the mean return of each agent and each role over episodes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Unpack

import numpy as np
import torch
from gymnasium import spaces
from ray import cloudpickle
from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModule, MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.policy.policy import PolicySpec
from ray.rllib.utils.spaces.space_utils import get_base_struct_from_space, unsquash_action
from ray.tune.registry import register_env

from gamekeeper.adapters.requirements import checked, not_learnt, weights_digest
from gamekeeper.adapters.rllib.rllib_env import AgentsEnv, multi_agent_env
from gamekeeper.adapters.rllib.rllib_game import (
    OBSERVATIONS,
    AgentView,
    Options,
    RLlibMultiAgentEnv,
    opened_game,
)
from gamekeeper.episodes.layout import role as role_in_name
from gamekeeper.errors import PolicyError, SpecError
from gamekeeper.vector.vector_form import MASK

CONSTRUCTED: Final = "class_and_ctor_args.pkl"
MODULES: Final = "learner_group/learner/rl_module"
CONNECTORS: Final = ("_env_to_module_connector", "_module_to_env_connector")


class ModulePolicy:
    """Modules of RLlib that play the agents that they learnt to play.

    Args:
        modules: by name.
        mapped: who is played by which, and how it sees.
        version: kept with the evidence.
        deterministic: takes the likeliest action; else one is drawn.
        unsquash: whether continuous actions were learnt in [-1, 1].
    """

    def __init__(
        self,
        modules: Mapping[str, Any],
        mapped: Mapped,
        *,
        version: str,
        deterministic: bool = True,
        unsquash: bool = True,
    ) -> None:
        self.modules, self.mapped, self.version = modules, mapped, version
        self.deterministic, self._unsquash = deterministic, unsquash

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        """The action of one agent."""
        name = str(agent)
        view = self.mapped.views.get(name)
        if view is None:
            raise not_learnt(name, self.mapped.views)
        module = self.modules[self.mapped(name)]
        batch = {Columns.OBS: _tensors(view.shown(observation, info))}
        with torch.no_grad(), torch.random.fork_rng(devices=[]):
            if self.deterministic:
                logits = module.forward_inference(batch)[Columns.ACTION_DIST_INPUTS]
                kind = module.get_inference_action_dist_cls()
                drawn = kind.from_logits(logits).to_deterministic().sample()
            else:
                torch.manual_seed(int(rng.integers(2**31)))
                logits = module.forward_exploration(batch)[Columns.ACTION_DIST_INPUTS]
                drawn = module.get_exploration_action_dist_cls().from_logits(logits).sample()
        action = _bare(drawn)
        if self._unsquash:
            action = unsquash_action(action, get_base_struct_from_space(view.action_space))
        return view.meant(action)


def policy(model: Any, *, deterministic: bool = True, version: str | None = None) -> ModulePolicy:
    """A policy of an algorithm in memory as it is now, or of its checkpoint.

    A checkpoint is code as well as numbers: it is unpickled.

    Args:
        model: an algorithm whose config has `policy_mapping`'s, or the folder that its
            `save_to_path` made.
        deterministic: takes the likeliest action.
        version: kept with the evidence; None: the digest of its weights.
    Raises:
        PolicyError: there is no such checkpoint, or one that can't be played from here.
    """
    if not isinstance(model, str | Path):
        with tempfile.TemporaryDirectory() as folder:
            model.save_to_path(folder)
            return policy(folder, deterministic=deterministic, version=version)
    path = Path(model).resolve()
    config = _config(path)
    mapped = config.get("policy_mapping_fn")
    if not isinstance(mapped, Mapped):
        raise PolicyError(
            "the checkpoint doesn't say who is played by which module",
            where=str(path),
            expected="a config with multi_agent(**policy_mapping(spec))",
            actual=repr(mapped)[:200],
            fix="train with gamekeeper.adapters.rllib.policy_mapping",
        )
    own = [name for name in CONNECTORS if config.get(name) is not None]
    modules = dict(MultiRLModule.from_checkpoint(str(path / MODULES)).items())
    if own or any(module.is_stateful() for module in modules.values()):
        raise PolicyError(
            "what it decides depends on more than an observation",
            where=str(path),
            expected="modules without a memory, and RLlib's own connectors",
            actual=", ".join(own) or "a module with a memory",
            fix="flatten=True in place of a connector; a policy of your own for the rest",
        )
    return ModulePolicy(
        modules,
        mapped,
        version=version or weights_digest(_named_weights(modules)),
        deterministic=deterministic,
        unsquash=bool(config.get("normalize_actions", True)),
    )


def _config(path: Path) -> Mapping[str, Any]:
    file = path / CONSTRUCTED
    if not (file.is_file() and (path / MODULES).is_dir()):
        raise PolicyError(
            "there is no checkpoint of an algorithm",
            where=str(path),
            expected=f"{CONSTRUCTED} and {MODULES} in it",
            actual="no such folder" if not path.is_dir() else "a folder of something else",
            fix="algorithm.save_to_path(FOLDER)",
        )
    with file.open("rb") as stream:
        arguments, keywords = cloudpickle.load(stream)["ctor_args_and_kwargs"]
    config = keywords.get("config", arguments[0] if arguments else {})
    return config if isinstance(config, Mapping) else config.to_dict()


def _tensors(observation: Any) -> Any:
    """One observation as a batch of tensors."""
    if isinstance(observation, dict):
        return {key: _tensors(part) for key, part in observation.items()}
    array = np.asarray(observation)
    if np.issubdtype(array.dtype, np.floating):
        array = array.astype(np.float32)
    return torch.from_numpy(np.ascontiguousarray(array)[None])


def _bare(drawn: Any) -> Any:
    """A batch of one action as an action: numbers and arrays in the form of the space."""
    if isinstance(drawn, dict):
        return {key: _bare(part) for key, part in drawn.items()}
    if isinstance(drawn, tuple | list):
        return tuple(_bare(part) for part in drawn)
    value = drawn[0].cpu().numpy()
    return int(value) if value.ndim == 0 and np.issubdtype(value.dtype, np.integer) else value


def _named_weights(modules: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for name in sorted(modules):
        for key, value in sorted(modules[name].state_dict().items()):
            yield f"{name}.{key}", value


TEAM: Final = "team"


class ReturnsCallback(RLlibCallback):
    """Logs the mean return over episodes of each agent, each role and the team.

    `config.callbacks(ReturnsCallback)`; they stand in a result under `env_runners/gamekeeper`:
    `agent/<name>`, `role/<name>` (the mean of its agents), `team` (the sum of all), and `episodes`.
    An episode is the unit: one in which an agent wasn't counts as 0 for it, and agents that don't
    learn are told too; RLlib's own `agent_episode_returns_mean` has neither. Likewise under
    `evaluation/env_runners/gamekeeper`.
    """

    def on_episode_end(
        self, *, env: Any, env_index: int, env_runner: Any, metrics_logger: Any, **_: Any
    ) -> None:
        """Logs the episode that is over."""
        copy = env.envs[env_index].unwrapped
        if not isinstance(copy, AgentsEnv):
            return
        window = env_runner.config.metrics_num_episodes_for_smoothing
        returns = copy.returns
        by_role: dict[str, list[float]] = {}
        for agent, paid in returns.items():
            by_role.setdefault(copy.role_of[agent], []).append(paid)
            metrics_logger.log_value(("gamekeeper", "agent", agent), paid, window=window)
        for role, amounts in by_role.items():
            mean = sum(amounts) / len(amounts)
            metrics_logger.log_value(("gamekeeper", "role", role), mean, window=window)
        total = sum(returns.values())
        metrics_logger.log_value(("gamekeeper", TEAM), total, window=window)
        metrics_logger.log_value(("gamekeeper", "episodes"), 1, reduce="lifetime_sum")


SEED: Final = "seed"
"""Key of `env_config` that gives the seed of another run, for evaluation."""
SIDES: Final = (10, 42, 64, 84, 96)
"""Sides of square pictures that RLlib has filters for. Source: get_filter_config, models/utils."""


def register(
    spec: object,
    *,
    check: str | None = "quick",
    seed: int = 0,
    name: str | None = None,
    **options: Unpack[Options],
) -> str:
    """Makes an environment known to RLlib: the name for `config.environment(...)`.

    It is audited here, once, and not in each env runner. Runner w of W plays episodes w, w + W,
    w + 2 W, ... of run `seed`, its copies taking the next one as they come to it; the seeds that
    RLlib hands out are passed over: they are `seed + w + copy`, so that neighbours play the same
    episodes, and whole-episode sampling begins with them again at each sample. A run for evaluation
    has a seed of its own: `evaluation_config={"env_config": {"seed": 1}}`.

    Args:
        spec: where the environment comes from; it must be picklable.
        name: under which it is known; None: a name is made of `spec`. A second environment of the
            same name takes the place of the first.
        check, seed, **options: as `multi_agent_env` has them: role, others, masks, flatten,
            env_kwargs.
    Raises:
        SpecError, ContractError: as `multi_agent_env` raises them.
    """
    checked(spec, check, env_kwargs=options.get("env_kwargs"))
    opened_game(spec, **options).env.close()  # what it refuses is told here
    known = name or (f"gamekeeper:{spec}" if isinstance(spec, str) else "gamekeeper")
    register_env(known, _Creator(spec, seed, options))
    return known


@dataclass(slots=True)
class _Numbers:
    """Every so many of the episodes of a run; unlike `itertools.count` it can be copied."""

    following: int
    step: int

    def __iter__(self) -> Iterator[int]:
        return self

    def __next__(self) -> int:
        number = self.following
        self.following += self.step
        return number


@dataclass(slots=True)
class _Creator:
    """Makes the copies of one env runner, which share its episodes."""

    spec: object
    seed: int
    options: Options
    shared: dict[int, Iterator[int]] = field(default_factory=dict)

    def __call__(self, context: Any) -> AgentsEnv:
        """A copy for the env runner of this context."""
        runners = max(int(context.num_workers or 0), 1)
        place = max(int(context.worker_index or 0) - 1, 0) % runners
        seed = int(context.get(SEED, self.seed))
        episodes = self.shared.setdefault(seed, _Numbers(place, runners))
        return multi_agent_env(self.spec, check=None, seed=seed, episodes=episodes, **self.options)


def policy_mapping(spec: object, **options: Unpack[Options]) -> dict[str, Any]:
    """A module for each role: `config.multi_agent(**policy_mapping(spec))`.

    Agents of one role share a module if they have the same spaces; else each has one under its own
    name. The order is that of `possible_agents`.

    Args:
        spec, **options: as `register` has them.
    Returns:
        `policies` with their spaces, and `policy_mapping_fn`.
    """
    game = opened_game(spec, **options)
    game.env.close()
    module_of = _modules(game)
    first = {module: name for name, module in reversed(module_of.items())}
    policies = {
        module: PolicySpec(
            observation_space=game.views[first[module]].observation_space,
            action_space=game.views[first[module]].action_space,
        )
        for module in dict.fromkeys(module_of.values())
    }
    return {"policies": policies, "policy_mapping_fn": Mapped(module_of, dict(game.views))}


@dataclass(frozen=True, slots=True)
class Mapped:
    """From an agent to its module; stands in checkpoints, so that a policy is read from one.

    Attributes:
        modules: by the name of each agent that may come.
        views: likewise, how it is seen.
    """

    modules: Mapping[str, str]
    views: Mapping[str, AgentView]

    def __call__(self, agent_id: str, *_: Any, **__: Any) -> str:
        """The module of an agent; of a name that nobody announced, that of its role."""
        return self.modules.get(agent_id) or role_in_name(agent_id)


def _modules(game: RLlibMultiAgentEnv) -> dict[str, str]:
    """By agent the name of its module: its role, where all of the role have the same spaces."""
    kinds: dict[str, list[Any]] = {}
    for name, one in game.views.items():
        kinds.setdefault(game.role_of[name], []).append((one.observation_space, one.action_space))
    return {
        name: role if all(kind == kinds[role][0] for kind in kinds[role]) else name
        for name in game.views
        for role in [game.role_of[name]]
    }


def modules(
    spec: object, *, model_config: Any = None, **options: Unpack[Options]
) -> MultiRLModuleSpec:
    """Networks for PPO, masked where there are masks: `config.rl_module(rl_module_spec=...)`.

    Where an agent has a mask, its module is RLlib's own `ActionMaskingTorchRLModule`, which gives
    what is masked out no probability; else it is the algorithm's default.

    Args:
        spec, **options: as `register` has them.
        model_config: RLlib's `DefaultModelConfig`, or a dictionary; None: that of the config.
    Raises:
        SpecError: RLlib's own networks don't read such observations.
    """
    mapping = policy_mapping(spec, **options)
    found = {}
    for module, policy in mapping["policies"].items():
        space = policy.observation_space
        is_masked = isinstance(space, spaces.Dict) and set(space) == {MASK, OBSERVATIONS}
        _require_readable(space[OBSERVATIONS] if is_masked else space, module)
        found[module] = RLModuleSpec(
            module_class=_masking() if is_masked else None,
            observation_space=space,
            action_space=policy.action_space,
            model_config=model_config,
        )
    return MultiRLModuleSpec(rl_module_specs=found)


def _masking() -> Any:
    from ray.rllib.examples.rl_modules.classes.action_masking_rlm import ActionMaskingTorchRLModule

    return ActionMaskingTorchRLModule


def _require_readable(space: spaces.Space[Any], module: str) -> None:
    if isinstance(space, spaces.Box) and np.issubdtype(space.dtype, np.floating):
        is_square = len(space.shape) == 3 and space.shape[0] == space.shape[1]
        if len(space.shape) == 1 or (is_square and space.shape[0] in SIDES):
            return
    raise SpecError(
        "RLlib's own networks don't read such observations",
        where=f"module {module!r}",
        expected="a Box of floats, a row of numbers or a picture",
        actual=str(space)[:200],
        fix="flatten=True in register, policy_mapping and modules; or a module of your own",
    )
