"""What was learnt, as a policy of ours: for rollouts, evidence, evaluation."""

from __future__ import annotations

from hashlib import blake2b
from typing import Any

import numpy as np
import torch
from tianshou.data import Batch, to_numpy

from gamekeeper.adapters.tianshou.forms import MASK
from gamekeeper.adapters.tianshou.vector_env import AgentsVectorEnv
from gamekeeper.errors import PolicyError


def policy(
    algorithm: Any, env: AgentsVectorEnv, *, deterministic: bool = True, version: str | None = None
) -> LearntPolicy:
    """A policy for `gk.rollout` and wherever else one is taken.

    Args:
        algorithm: an algorithm or a policy of Tianshou's.
        env: the environment it learnt in: it knows what observations were made of.
        deterministic: takes the likeliest action; else one is drawn.
        version: kept with the evidence; None: the digest of the weights.
    """
    found = getattr(algorithm, "policy", algorithm)
    return LearntPolicy(found, env, deterministic, version or _digest(found))


class LearntPolicy:
    """Use `policy`.

    Attributes:
        version: kept with the evidence.
    """

    def __init__(self, found: Any, env: AgentsVectorEnv, deterministic: bool, version: str) -> None:
        """Takes over a policy."""
        self._policy, self._env = found, env
        self._deterministic, self.version = deterministic, version

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        """The action of one agent.

        Raises:
            PolicyError: it isn't among those that learnt.
        """
        seats, forms = self._env.seats, self._env.seats.forms
        names = [str(learner) for learner in seats.learners]
        if str(agent) not in names:
            raise PolicyError(
                f"{agent!r} didn't learn", where="policy", expected=", ".join(names),
                mend="give it another policy",
            )  # fmt: skip
        place = names.index(str(agent))
        learner = seats.learners[place]
        group: Any = seats.group_of(learner)
        obs = forms.empty((1,))
        forms.put(obs, (0,), seats.number_of(learner), observation)
        rows: Any = Batch(obs) if isinstance(obs, dict) else obs
        if forms.has_masks:
            rows = Batch(obs=rows, mask=self._mask(group, observation, info))
        mine = self._policy
        if self._env.is_multi:
            mine = mine.policies[str(self._env.named[place])]
        with torch.no_grad():
            act = to_numpy(self._chosen(mine, rows, rng))
        act = np.asarray(mine.map_action(act))[0]
        return int(act) + int(group.action_space.start) if forms.actions else act

    def _chosen(self, mine: Any, rows: Any, rng: Any) -> Any:
        # `out.act` is left aside where there is a distribution: whether Tianshou draws it hangs on
        # `deterministic_eval`, and on whether its trainer was learning as it was last asked.
        given = Batch(obs=rows, info=Batch())
        if self._deterministic:
            out = mine(given)
            return out.act if out.get("dist") is None else out.dist.mode
        with torch.random.fork_rng(devices=range(torch.cuda.device_count())):  # a trainer's draws
            torch.manual_seed(int(rng.integers(2**31)))
            out = mine(given)
            return out.act if out.get("dist") is None else out.dist.sample()

    def _mask(self, group: Any, observation: Any, info: Any) -> Any:
        flags = np.zeros((1, self._env.seats.forms.actions), bool)
        given = observation.get(MASK) if isinstance(observation, dict) else None
        given = info.get(MASK) if given is None else given
        flags[0, : group.action_space.n] = True if given is None else np.asarray(given) != 0
        return flags


def _digest(found: Any) -> str:
    digest = blake2b(digest_size=8)
    for name, value in sorted(found.state_dict().items()):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(value.detach().cpu().numpy()).tobytes())
    return digest.hexdigest()
