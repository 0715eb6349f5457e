"""BenchMARL: a task of its experiments, over the TorchRL environment."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from gymnasium import spaces
from torchrl.data import Composite

from gamekeeper.errors import SpecError, not_installed

try:
    from benchmarl.environments.common import TaskClass
except ImportError as error:
    raise not_installed(error, "BenchMARL", "benchmarl", "gamekeeper.adapters.benchmarl") from error

from gamekeeper.adapters.requirements import checked, learners_of
from gamekeeper.adapters.torchrl import env as torchrl_env
from gamekeeper.contract import Contract
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.joint_policy import Choices
from gamekeeper.interface.opening import open_env


def task(
    spec: str,
    *,
    role: str | None = None,
    others: Choices = None,
    state: bool | None = None,
    max_steps: int | None = None,
    check: str | None = "quick",
    env_kwargs: Mapping[str, Any] | None = None,
    **options: Any,
) -> GamekeeperTask:
    """A multi-agent environment as a task: `Experiment(task=task("warehouse"), ...)`.

    | | |
    |---|---|
    | kept | groups by role, roles with different spaces; every agent's own end, and truncation apart from termination, for every group's loss; masks; `state()` for centralised critics and mixers; seeds: BenchMARL's seed is that of the run, of which copy i plays the episodes i, i + num_envs, ...; the return of each agent over its episodes (`collection/<group>/<agent>/episode_return`) |
    | changed | BenchMARL's losses take every agent's place in every step. Where nobody acts there (it has ended, hasn't joined, it is another one's turn) one action is legal, the first, so that a policy learns nothing there; the critic still sees the place. In an AEC environment a step is one turn, and so is a discount. Observations and state are one vector of float32 each, whole numbers one-hot. A copy is done when all its agents are |
    | lost | infos but for the mask, frames. For off-policy algorithms, that nobody acted somewhere: their random first actions are drawn legal, their losses count such places |
    | refused | agents whose actions are discrete beside others' continuous ones, actions that are neither Discrete nor vectors (`Box` of one axis), continuous actions of agents that act in turn, what is named by no text (an experiment is saved), an environment without a horizon (`max_steps=`) or one that breaks its contract (`check=None` lets it pass) |

    Args:
        spec: where the environment comes from; a text.
        role: role, or the one agent, that learns; the rest follow `others`. None: all agents.
        others: policies of who doesn't learn, one for all or by agent or role; texts.
        state: whether critics see `state()`; None: where the environment declares a `state_space`.
        max_steps: of an evaluation episode; None: the contract's horizon.
        check: "quick": the quick audit, once for each source digest.
        env_kwargs: handed to the environment.
        options: of `gk.vector.make`: `engine`, `workers`, `threads`.
    Raises:
        SpecError: see *refused*.
        ContractError: the audit found that the environment breaks its contract.
    """  # noqa: E501  # a row of a table is one line
    if not isinstance(spec, str):
        raise SpecError(
            "an experiment needs an environment that is named by a text, which is saved with it",
            where="spec",
            expected="a text",
            actual=repr(spec)[:200],
            fix="name the factory: module:factory or file.py:factory",
        )
    checked(spec, check, env_kwargs=env_kwargs)
    opened = open_env(spec, **dict(env_kwargs or {}))
    try:
        contract = declared_contract(None, opened) or Contract()
        agents = list(opened.env.possible_agents)
        if others is not None:
            agents = learners_of(agents, role, contract)
        kinds = {agent: opened.env.action_space(agent) for agent in agents}
        count = len(opened.env.possible_agents)
    finally:
        opened.env.close()
    is_discrete = _are_discrete(kinds, is_aec=opened.api == "aec")
    if max_steps is None and contract.schedule.horizon is not None:
        max_steps = contract.schedule.horizon * (count if opened.api == "aec" else 1)
    if max_steps is None:
        raise SpecError(
            "the length of an evaluation episode isn't known",
            where="max_steps",
            expected="a contract with a horizon, or max_steps=",
            fix="give max_steps=, in env steps",
        )
    config = {
        "spec": spec,
        "role": role,
        "others": others,
        "state": state,
        "env_kwargs": dict(env_kwargs or {}),
        "max_steps": int(max_steps),
        "is_discrete": is_discrete,
        **options,
    }
    return GamekeeperTask(re.sub(r"[^A-Za-z0-9_.-]+", "_", spec), config)


def _are_discrete(kinds: Mapping[Any, Any], *, is_aec: bool) -> bool:
    discrete = [isinstance(space, spaces.Discrete) for space in kinds.values()]
    if all(discrete):
        return True
    vectors = [isinstance(s, spaces.Box) and len(s.shape) == 1 for s in kinds.values()]
    if all(vectors) and not is_aec:
        return False
    raise SpecError(
        "BenchMARL has no algorithm for such actions",
        where="action_space",
        expected="Discrete for all agents, or Box of one axis for all, who then act at once",
        actual=", ".join(f"{agent}: {space}" for agent, space in kinds.items())[:400],
        fix="take gamekeeper.adapters.torchrl, with a loss of your own",
    )


class GamekeeperTask(TaskClass):
    """Use `task`."""

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], Any]:
        """Returns a function that makes copies for a collector or an evaluation."""
        options = {key: part for key, part in self.config.items() if key != "max_steps"}
        return partial(
            torchrl_env,
            options.pop("spec"),
            num_envs,
            check=None,
            masks=options.pop("is_discrete"),
            flatten=True,
            seed=0 if seed is None else seed,
            device=device,
            **options,
        )

    def supports_continuous_actions(self) -> bool:
        """True if all actions are vectors."""
        return not self.config["is_discrete"]

    def supports_discrete_actions(self) -> bool:
        """True if all actions are numbers."""
        return bool(self.config["is_discrete"])

    def max_steps(self, env: Any) -> int:
        """Steps of an evaluation episode, of AEC environments turns."""
        return int(self.config["max_steps"])

    def has_render(self, env: Any) -> bool:
        """Returns False: `gk.record(..., frames=True)` takes frames."""
        return False

    def group_map(self, env: Any) -> dict[str, list[str]]:
        """Agents by group."""
        self._agents: dict[str, list[str]] = dict(env.group_map)
        return self._agents

    def observation_spec(self, env: Any) -> Any:
        """Spec of each group's observations."""
        return self._only(env, "observation")

    def action_mask_spec(self, env: Any) -> Any:
        """Spec of each group's action masks; None where actions are vectors."""
        return self._only(env, "action_mask") if self.config["is_discrete"] else None

    def info_spec(self, env: Any) -> None:
        """Returns no spec: there are no infos."""

    def state_spec(self, env: Any) -> Any:
        """Spec of the state; None where the environment has no `state()`."""
        whole = env.full_observation_spec_unbatched
        found = dict(whole.items()).get("state")
        return None if found is None else Composite({"state": found.clone()})

    def action_spec(self, env: Any) -> Any:
        """Spec of each group's actions."""
        return env.full_action_spec_unbatched

    def _only(self, env: Any, key: str) -> Any:
        whole = env.full_observation_spec_unbatched
        return Composite(
            {
                group: Composite({key: whole[group, key].clone()}, shape=whole[group].shape)
                for group in env.group_map
            }
        )

    @staticmethod
    def env_name() -> str:
        """Name of the library that the tasks come from."""
        return "gamekeeper"

    def log_info(self, batch: Any) -> dict[str, float]:
        """The mean return of each agent over the episodes that ended in a batch."""
        after, found = batch["next"], {}
        over = after["done"][..., 0]
        for group, agents in self._agents.items() if bool(over.any()) else ():
            paid = after[group, "episode_reward"][over].mean(dim=0).flatten().tolist()
            for agent, mean in zip(agents, paid, strict=True):
                found[f"collection/{group}/{agent}/episode_return"] = float(mean)
        return found
