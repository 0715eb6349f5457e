"""A vector environment of ours as Stable-Baselines3's VecEnv."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.preprocessing import is_image_space, is_image_space_channels_first
from stable_baselines3.common.vec_env import VecEnv

from gamekeeper.adapters.requirements import checked, closed_on_error
from gamekeeper.adapters.slots import Slots, Step
from gamekeeper.errors import SpecError
from gamekeeper.interface.joint_policy import Choices

FIX_OF_MASKED: Final = (
    "MaskablePPO with **sb3.buffer(venv, masked=True), as other algorithms read no masks; or rules"
    " in which an action that the mask forbids does something, such as to wait"
)


def vec_env(
    spec: object,
    num_envs: int,
    *,
    role: str | None = None,
    others: Choices = None,
    check: str | None = "quick",
    seed: int = 0,
    env_kwargs: Mapping[str, Any] | None = None,
    **options: Any,
) -> SlotVecEnv:
    """Copies of a multi-agent environment for Stable-Baselines3: each learning agent is a slot.

    With `role=None` all agents share one policy; else one role learns, the others follow `others`.

    | | |
    |---|---|
    | kept | every agent's own end, `terminal_observation`, `TimeLimit.truncated` of each agent, action masks (`env_method("action_masks")`, as MaskablePPO asks for them), seeds: slot e * A + a plays the episodes e, e + num_envs, ... of run `seed`, the same ones as `gk.rollout` |
    | changed | an agent that ended before its copy is over shows zeros and reward 0 until that resets; who leaves without an ending counts as terminated; in an AEC environment a slot acts in its turns only. `buffer(venv)` (PPO, A2C, MaskablePPO) and `replay_buffer(venv)` (DQN, SAC and their kin) keep such steps out and credit each reward to the action that earned it. A Dict observation loses its `action_mask`; of one other part only that part is left |
    | lost | infos but for the mask; state(); who acts with whom; what an agent is paid before its first decision. Off-policy algorithms don't read masks, and a recurrent policy isn't told that an agent which had ended begins anew |
    | refused | spaces that Stable-Baselines3's networks don't take: Tuple, a Dict within a Dict or as an action, MultiDiscrete of two axes, actions of MultiBinary of two, whole numbers that don't count from 0; learners that differ in their spaces (`role=`), others without a policy (`others=`), an environment that breaks the contract (`check=None` lets it pass) |

    Args:
        spec: where the environment comes from, as `gk.make` takes it.
        num_envs: how many copies; the VecEnv has A times as many places, A agents learning.
        role: the role, or the one agent, that learns; None: everybody.
        others: policies of who doesn't learn, one for all or by agent or role.
        check: "quick": the quick audit, once for each source digest, before the first step.
        seed: of the run; `seed()` takes another one for the next reset.
        env_kwargs: handed to the environment.
        options: of `gk.vector.make`: `engine`, `workers`, `threads`.
    Raises:
        SpecError: see *refused*.
        ContractError: the audit found that the environment breaks its contract.
    """  # noqa: E501  # a row of a table is one line
    checked(spec, check, env_kwargs=env_kwargs)
    slots = Slots(
        spec, num_envs, role=role, others=others, seed=seed, env_kwargs=env_kwargs, **options
    )
    seen = slots.observation_space
    with closed_on_error(slots):
        if isinstance(seen, spaces.Dict):
            for key, part in seen.spaces.items():
                _check_space(part, f"observation_space[{key!r}]", axes=None)
                _note_cropping(part, key)
        else:
            _check_space(seen, "observation_space", axes=None)
            _note_cropping(seen, "observation")
            if isinstance(slots.group.observation_space, spaces.Dict):
                sys.stderr.write(
                    f"gamekeeper: without its action_mask the Dict observation is its other part, a"
                    f" {type(seen).__name__} (fix: MlpPolicy, or CnnPolicy for a picture, instead"
                    " of MultiInputPolicy; MaskablePPO asks the environment for masks)\n"
                )
        _check_space(slots.action_space, "action_space", axes=1)
    return SlotVecEnv(slots)


def _check_space(space: Any, where: str, *, axes: int | None) -> None:
    """Refuses a space without a network; `axes`: most axes of a MultiBinary, None: any number."""
    fault = None
    if isinstance(space, spaces.Dict | spaces.Tuple):
        fault = "values in parts stand where it takes none"
    elif isinstance(space, spaces.MultiDiscrete) and len(space.shape) > 1:
        fault = "a MultiDiscrete has more than one axis"
    elif isinstance(space, spaces.MultiBinary) and axes is not None and len(space.shape) > axes:
        fault = "a MultiBinary has more than one axis"
    elif np.any(getattr(space, "start", 0)):
        fault = "whole numbers don't count from 0"
    if fault is not None:
        raise SpecError(
            f"Stable-Baselines3 has no network for a space: {fault}",
            where=where,
            expected="Box, Discrete, MultiDiscrete, MultiBinary; to observe, also one Dict of them",
            actual=str(space)[:200],
            fix="gk.wrappers.flatten_observations(env); or count from 0, in the environment",
        )


def _note_cropping(space: Any, name: str) -> None:
    """Says on stderr which part of a picture Stable-Baselines3's own network never reads."""
    if not is_image_space(space):
        return
    height, width = space.shape[1:] if is_image_space_channels_first(space) else space.shape[:2]
    for size, lines in ((height, "rows"), (width, "columns")):
        lost = unread(size)
        if lost:
            sys.stderr.write(
                f"gamekeeper: CnnPolicy's network never reads the last {lost} of {size} {lines} of "
                f"{name!r} (fix: {size - lost} or {size - lost + 8} {lines} are read whole)\n"
            )


def unread(size: int) -> int:
    """Number of pixels at the end of a picture's axis that no stride of `NatureCNN` reaches.

    Source: NatureCNN in stable_baselines3/common/torch_layers.py: kernels of 8, 4 and 3, strides of
    4, 2 and 1; below 36 pixels the network can't be built.
    """
    first = (size - 8) // 4 + 1
    second = (first - 4) // 2 + 1
    return size - (4 * (2 * second + 1) + 8) if second >= 3 else 0


class EmptyInfo(dict[str, Any]):
    """Info of every slot that hasn't ended: one for thousands of them, so it stays empty."""

    def update(self, *args: Any, **kwargs: Any) -> None:
        """Refused: what is written here would stand in the infos of all other slots too.

        Raises:
            SpecError: always.
        """
        raise SpecError(
            "slots that haven't ended share one info, so nothing is written into it",
            where="infos[slot]",
            actual=f"{args} {kwargs}",
            fix="put another dictionary in its place: infos[slot] = {...}",
        )

    __setitem__ = setdefault = __ior__ = update  # type: ignore[assignment]  # refused too


NO_INFO: Final[dict[str, Any]] = EmptyInfo()


class SlotVecEnv(VecEnv):
    """Use `vec_env`.

    Attributes:
        slots: the learning agents of all sub-environments.
    """

    def __init__(self, slots: Slots) -> None:
        self.slots = slots
        slots.venv.fix_of_masked = FIX_OF_MASKED
        self.render_mode = None
        self._next_seed: int | None = None
        self._is_noted = False
        self._actions: Any = None
        super().__init__(slots.count, slots.observation_space, slots.action_space)

    def reset(self) -> Any:
        """Begins a run, of the seed last given to `seed()`."""
        seed, self._next_seed = self._next_seed, None
        self._begun_s = time.monotonic()
        self.reset_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        return self.slots.reset(seed)

    def step_async(self, actions: Any) -> None:
        """Keeps the actions for `step_wait`; those of a MultiBinary space come as floats."""
        self._actions = np.asarray(actions).astype(self.action_space.dtype)

    def step_wait(self) -> Any:
        """Steps every sub-environment; returns observations, rewards, dones, infos of slots."""
        done = self.slots.step(self._actions)
        if not (self.slots.have_all_acted or self._is_noted or self.slots.is_watched):
            self._is_noted = True
            sys.stderr.write(
                "gamekeeper: slots of agents that wait or have ended are steps too, and a learner"
                " without the adapter's buffer learns from them (fix: **sb3.buffer(venv), of"
                " off-policy algorithms **sb3.replay_buffer(venv); to evaluate none is needed)\n"
            )
        infos = [NO_INFO] * self.num_envs
        if done.final:
            self._tell_ends(infos, done)
        return done.obs, done.rewards.astype(np.float32), done.ended, infos

    def _tell_ends(self, infos: list[dict[str, Any]], done: Step) -> None:
        """Puts infos of their own in the places of slots that ended."""
        passed_s = round(time.monotonic() - self._begun_s, 6)
        are_cut = (done.truncated & ~done.terminated)[list(done.final)].tolist()
        for (slot, final), is_cut in zip(done.final.items(), are_cut, strict=True):
            infos[slot] = {
                "terminal_observation": final,
                "TimeLimit.truncated": is_cut,
                "episode": {"r": done.returns[slot], "l": done.lengths[slot], "t": passed_s},
            }

    def close(self) -> None:
        """Closes every sub-environment."""
        self.slots.close()

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Sets the seed of the run that the next reset begins."""
        self._next_seed = seed
        return [seed] * self.num_envs

    def action_masks(self) -> Any:
        """Actions that each slot may take, [slot, action] of bool; all where it doesn't act."""
        return self.slots.masks.astype(bool)

    def has_attr(self, name: str) -> bool:
        """True if a slot has such an attribute."""
        if name == "action_masks":
            return self.slots.masks.size > 0
        return name in ("agent", "role", "render_mode")

    def get_attr(self, name: str, indices: Any = None) -> list[Any]:
        """Returns `agent` or `role` of slots, or `render_mode`."""
        learners = self.slots.learners
        agents = [learners[slot % len(learners)] for slot in self._get_indices(indices)]
        if name == "render_mode":
            return [None for _ in agents]
        if name in ("agent", "role"):
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
            "slots are agents of shared environments, so no attribute is set in one",
            where=f"set_attr({name!r})",
            fix="hand it over as env_kwargs",
        )

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        """Returns `action_masks` of slots; there are no other methods."""
        if method_name == "action_masks":
            masks = self.action_masks()
            return list(masks if indices is None else masks[list(self._get_indices(indices))])
        raise AttributeError(
            f"slots have no method {method_name!r}: agents of copies; known is action_masks"
        )

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """True for a Monitor: infos tell an episode's end as one would."""
        from stable_baselines3.common.monitor import Monitor

        return [wrapper_class is Monitor for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[Any]:
        """Returns no pictures: `gk.record(..., frames=True)` takes them."""
        return [None] * self.num_envs
