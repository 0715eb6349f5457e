"""A vector environment of ours as Stable-Baselines3's VecEnv."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from gamekeeper.adapters.checked import checked
from gamekeeper.adapters.slots import Slots
from gamekeeper.errors import SpecError
from gamekeeper.game.casting.cast import Choices


def vec_env(
    spec: object,
    num_envs: int,
    *,
    role: str | None = None,
    others: Choices = None,
    check: str | None = "quick",
    seed: int = 0,
    engine: str = "serial",
    workers: int = 2,
    env_kwargs: Mapping[str, Any] | None = None,
) -> SlotVecEnv:
    """Copies of a multi-agent environment for Stable-Baselines3: each learning agent is a slot.

    With `role=None` all agents share one policy; else one role learns, the others follow `others`.

    | | |
    |---|---|
    | kept | every agent's own end, `terminal_observation`, `TimeLimit.truncated` of each agent, action masks (`env_method("action_masks")`, as MaskablePPO asks for them), seeds: slot e * A + a plays the episodes e, e + num_envs, ... of run `seed`, the same ones as `gk.rollout` |
    | changed | an agent that ended before its copy is over shows zeros and reward 0 until that resets; who leaves without an ending counts as terminated; in an AEC environment a slot acts in its turns only, and the `terminal_observation` of who ends while its copy goes on is what it was shown before its last turn. `buffer(venv)` keeps such steps out of on-policy training and credits each reward to the action that earned it. A Dict observation loses its `action_mask`; of one other part only that part is left |
    | lost | infos but for the mask; state(); who acts with whom. Off-policy buffers (DQN, SAC) also store the steps of slots that didn't act, and a recurrent policy isn't told that an agent which had ended begins anew |
    | refused | learners that differ in their spaces (`role=`), others without a policy (`others=`), an environment that breaks the contract (`check=None` lets it pass) |

    Args:
        spec: where the environment comes from, as `gk.make` takes it.
        num_envs: how many copies; the VecEnv has A times as many places, A agents learning.
        role: the role, or the one agent, that learns; None: everybody.
        others: policies of who doesn't learn, one for all or by agent or role.
        check: "quick": the quick audit, once for each source digest, before the first step.
        seed: of the run; `seed()` takes another one for the next reset.
        engine: `serial`, `process` or `kernel`, as in `gk.vector.make`.
        workers: processes of the `process` engine.
        env_kwargs: handed to the environment.
    Raises:
        SpecError: see *refused*.
        ContractError: the audit found that the environment breaks its contract.
    """  # noqa: E501  # a row of a table is one line
    checked(spec, check, env_kwargs=env_kwargs)
    slots = Slots(
        spec, num_envs, role=role, others=others, seed=seed, engine=engine,
        env_kwargs=env_kwargs, **({"workers": workers} if engine == "process" else {}),
    )  # fmt: skip
    return SlotVecEnv(slots)


class SlotVecEnv(VecEnv):
    """Use `vec_env`.

    Attributes:
        slots: the learning agents of all copies.
    """

    def __init__(self, slots: Slots) -> None:
        """Takes over the slots."""
        self.slots = slots
        self.render_mode = None
        self._next_seed: int | None = None
        self._actions: Any = None
        self._nothing: list[dict[str, Any]] = [{} for _ in range(slots.count)]
        super().__init__(slots.count, slots.observation_space, slots.action_space)

    def reset(self) -> Any:
        """Begins a run, of the seed that `seed()` was given last."""
        seed, self._next_seed = self._next_seed, None
        self._begun_s = time.monotonic()
        self.reset_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        return self.slots.reset(seed)

    def step_async(self, actions: Any) -> None:
        """Keeps the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> Any:
        """One step of every copy: observations, rewards, dones, infos of every slot."""
        done = self.slots.step(self._actions)
        dones = done.terminated | done.truncated
        infos = self._infos()
        for slot, final in done.final.items():
            infos[slot] = {
                "terminal_observation": final,
                "TimeLimit.truncated": bool(done.truncated[slot] and not done.terminated[slot]),
                "episode": {
                    "r": done.returns[slot], "l": done.lengths[slot],
                    "t": round(time.monotonic() - self._begun_s, 6),
                },
            }  # fmt: skip
        return done.obs, done.rewards.astype(np.float32), dones, infos

    def _infos(self) -> list[dict[str, Any]]:
        """An empty info for each slot; those of the last step, unless somebody wrote into one."""
        if any(self._nothing):
            self._nothing = [{} for _ in self._nothing]
        return self._nothing.copy()

    def close(self) -> None:
        """Closes every copy."""
        self.slots.close()

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """The seed of the run that the next reset begins."""
        self._next_seed = seed
        return [seed] * self.num_envs

    def action_masks(self) -> Any:
        """Which actions each slot may take, [slot, action] of bool; all where it doesn't act."""
        return self.slots.masks.astype(bool)

    def has_attr(self, name: str) -> bool:
        """Whether a slot has such an attribute."""
        if name == "action_masks":
            return self.slots.masks.size > 0
        return name in ("agent", "role", "render_mode")

    def get_attr(self, name: str, indices: Any = None) -> list[Any]:
        """`agent` and `role` of slots, `render_mode`."""
        learners, slots = self.slots.learners, self._indices(indices)
        if name == "render_mode":
            return [None for _ in slots]
        if name in ("agent", "role"):
            agents = [learners[slot % len(learners)] for slot in slots]
            return agents if name == "agent" else [self.slots.role_of(agent) for agent in agents]
        raise AttributeError(
            f"slots have no attribute {name!r}: they are agents of copies, not environments; "
            "known are agent, role, render_mode"
        )

    def set_attr(self, name: str, value: Any, indices: Any = None) -> None:
        """Refused: what would be set in one slot would change its neighbours' environment.

        Raises:
            SpecError: always.
        """
        raise SpecError(
            "slots are agents of shared environments, so nothing is set in one",
            where=f"set_attr({name!r})",
            mend="hand it over as env_kwargs",
        )

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        """`action_masks` of slots; there are no other methods."""
        if method_name == "action_masks":
            masks = self.action_masks()
            return list(masks if indices is None else masks[self._indices(indices)])
        raise AttributeError(
            f"slots have no method {method_name!r}: agents of copies; known is action_masks"
        )

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Episodes are told as a Monitor tells them, so that one counts as there."""
        from stable_baselines3.common.monitor import Monitor

        return [wrapper_class is Monitor for _ in self._indices(indices)]

    def get_images(self) -> Sequence[Any]:
        """No pictures: `gk.record(..., frames=True)` takes them."""
        return [None] * self.num_envs

    def _indices(self, indices: int | Iterable[int] | None) -> list[int]:
        return list(self._get_indices(indices))
