"""A vector environment as Gymnasium's: every agent of every copy is one of its environments."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector import VectorEnv as GymnasiumVectorEnv
from gymnasium.vector.utils import batch_space

from gamekeeper.errors import SpecError
from gamekeeper.vector.form import ALL


class AgentsAsEnvs(GymnasiumVectorEnv[Any, Any, Any]):
    """Sub-environment e * A + a is agent a of copy e.

    Kept: seeds, both autoreset modes, terminations and truncations of each agent, final
    observations, masks. Changed: an agent that has ended before its copy is over gets zeros and
    reward 0 until that resets, neither terminated nor truncated again; `infos["live"]` says so, and
    what it does meanwhile is passed over. Lost: nothing; who acts with whom is no business of
    Gymnasium's.
    """

    def __init__(self, venv: Any) -> None:
        """Takes over a vector environment.

        Raises:
            SpecError: its agents differ in their spaces, or act in turn.
        """
        groups = venv.groups
        if len(groups) != 1 or groups[0].name != ALL or venv.api != "parallel":
            raise SpecError(
                "not every agent is a sub-environment of one kind",
                where="as_gymnasium",
                expected="a Parallel environment whose agents share their spaces",
                seen=f"{venv.api}, roles {[group.name for group in groups]}",
                mend="step the vector environment itself, or its roles one by one",
            )
        self.venv = venv
        self.count = len(groups[0].agents)
        self.num_envs = venv.num_envs * self.count
        self.single_observation_space = groups[0].observation_space
        self.single_action_space = groups[0].action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        mode = AutoresetMode.SAME_STEP if venv.autoreset == "same_step" else AutoresetMode.NEXT_STEP
        self.metadata = {**venv.metadata, "autoreset_mode": mode}

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begins the run of this seed."""
        if isinstance(seed, list):
            raise SpecError(
                "one seed names a run, from which every episode has its own",
                where="seed",
                expected="a whole number or None",
                seen=repr(seed)[:80],
            )
        obs, infos = self.venv.reset(seed=seed, options=options)
        return self._flat(obs), self._infos(infos)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One step of every agent of every copy."""
        shaped = _mapped(actions, lambda a: np.asarray(a).reshape(-1, self.count, *a.shape[1:]))
        obs, rewards, terminated, truncated, infos = self.venv.step(shaped)
        flags = (part.reshape(-1) for part in (rewards, terminated, truncated))
        return self._flat(obs), *flags, self._infos(infos)

    def close(self, **kwargs: Any) -> None:
        """Closes every copy."""
        self.venv.close()
        self.closed = True

    def _flat(self, tree: Any) -> Any:
        return _mapped(tree, lambda array: array.reshape(self.num_envs, *array.shape[2:]))

    def _infos(self, infos: dict[str, Any]) -> dict[str, Any]:
        found: dict[str, Any] = {
            key: self._flat(infos[key]) for key in ("live", "action_mask") if key in infos
        }
        if "final_obs" not in infos:
            return found
        is_final = infos["_final_obs"]
        finals = np.empty(self.num_envs, object)
        told = np.empty(self.num_envs, object)
        agents = self.venv.groups[0].agents
        for e in np.flatnonzero(is_final):
            for a, agent in enumerate(agents):
                place = e * self.count + a
                finals[place] = _mapped(infos["final_obs"][e], lambda array, a=a: array[a])
                told[place] = infos["final_info"][e].get(agent, {})
        found |= {"final_obs": finals, "final_info": told}
        found["_final_obs"] = found["_final_info"] = np.repeat(is_final, self.count)
        return found


def _mapped(tree: Any, change: Any) -> Any:
    """The same tree with every array changed."""
    if isinstance(tree, dict):
        return {key: _mapped(part, change) for key, part in tree.items()}
    if isinstance(tree, tuple):
        return tuple(_mapped(part, change) for part in tree)
    return change(tree)
