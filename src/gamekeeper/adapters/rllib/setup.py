"""What a config of RLlib takes: an environment by name, a module for each role, masks in them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Unpack

import numpy as np
from gymnasium import spaces
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.policy.policy import PolicySpec
from ray.tune.registry import register_env

from gamekeeper.adapters.checked import checked
from gamekeeper.adapters.rllib.env import AgentsEnv, multi_agent_env
from gamekeeper.adapters.rllib.game import Game, Options, opened_game
from gamekeeper.adapters.rllib.spaces import OBSERVATIONS, Sight
from gamekeeper.core.layout import role as role_in_name
from gamekeeper.errors import SpecError
from gamekeeper.vector.form import MASK

SEED: Final = "seed"
"""What `env_config` may say: the seed of another run, for evaluation."""
SIDES: Final = (10, 42, 64, 84, 96)
"""Of square pictures for which RLlib has filters. Source: get_filter_config in its models/utils."""


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
            observation_space=game.sights[first[module]].observation_space,
            action_space=game.sights[first[module]].action_space,
        )
        for module in dict.fromkeys(module_of.values())
    }
    return {"policies": policies, "policy_mapping_fn": Mapped(module_of, dict(game.sights))}


@dataclass(frozen=True, slots=True)
class Mapped:
    """From an agent to its module; stands in checkpoints, so that a policy is read from one.

    Attributes:
        modules: by the name of each agent that may come.
        sights: likewise, how it is seen.
    """

    modules: Mapping[str, str]
    sights: Mapping[str, Sight]

    def __call__(self, agent_id: str, *_: Any, **__: Any) -> str:
        """The module of an agent; of a name that nobody announced, that of its role."""
        return self.modules.get(agent_id) or role_in_name(agent_id)


def _modules(game: Game) -> dict[str, str]:
    """By agent the name of its module: its role, where all of the role have the same spaces."""
    kinds: dict[str, list[Any]] = {}
    for name, one in game.sights.items():
        kinds.setdefault(game.role_of[name], []).append((one.observation_space, one.action_space))
    return {
        name: role if all(kind == kinds[role][0] for kind in kinds[role]) else name
        for name in game.sights
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
            observation_space=space, action_space=policy.action_space, model_config=model_config,
        )  # fmt: skip
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
        "RLlib's own networks don't read such observations", where=f"module {module!r}",
        expected="a Box of floats, a row of numbers or a picture", seen=str(space)[:200],
        mend="flatten=True in register, policy_mapping and modules; or a module of your own",
    )  # fmt: skip
