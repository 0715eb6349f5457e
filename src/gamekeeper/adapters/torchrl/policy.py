"""An actor of TorchRL as a policy: for `gk.rollout`, `gk.evaluate` and evidence that names it."""

from __future__ import annotations

from hashlib import blake2b
from typing import Any

import numpy as np
import torch
from torchrl.envs.utils import ExplorationType, set_exploration_type

from gamekeeper.adapters.torchrl import specs
from gamekeeper.adapters.torchrl.game_env import GameEnv
from gamekeeper.adapters.torchrl.seats import Seats
from gamekeeper.errors import PolicyError
from gamekeeper.vector.form import MASK, getter, leaves


def policy(
    actor: Any, env: GameEnv, *, deterministic: bool = True, version: str | None = None
) -> ActorPolicy:
    """A policy of an actor whose agents each act on their own observation.

    Args:
        actor: reads `observation` (and `action_mask`) of a group, writes its `action`.
        env: what it was trained in; only its groups and specs are used.
        deterministic: takes the likeliest action; else one is drawn.
        version: kept with the evidence; None: the digest of its weights.
    Raises:
        PolicyError: when it is asked to play an agent that is in none of the groups.
    """
    return ActorPolicy(actor, env, deterministic, version or _digest(actor))


class ActorPolicy:
    """Use `policy`."""

    def __init__(self, actor: Any, env: GameEnv, deterministic: bool, version: str) -> None:
        """Takes over the actor; nothing of the environment is stepped."""
        self.actor, self.version, self._deterministic = actor, version, deterministic
        self._seats = {str(agent): each for each in env._seats for agent in each.agents}
        self._flat = env._is_flat
        self._blank = env.fake_tensordict().exclude("next").to("cpu")
        self._is_batched, self._groups = env._is_batched, env._copies.groups
        if self._is_batched:
            self._blank = self._blank[:1]

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        """The action of one agent."""
        each = self._seats.get(str(agent))
        if each is None:
            raise PolicyError(
                f"the actor plays nobody called {agent!r}", where="policy",
                expected=", ".join(self._seats), mend="give that agent another policy",
            )  # fmt: skip
        place = [str(a) for a in each.agents].index(str(agent))
        given = self._blank.clone()
        row = given[0] if self._is_batched else given
        self._show(row[each.name], each, place, observation, info)
        kind = ExplorationType.DETERMINISTIC if self._deterministic else ExplorationType.RANDOM
        with torch.no_grad(), set_exploration_type(kind), torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(rng.integers(2**31)))
            acted = self.actor(given)
        action = (acted[0] if self._is_batched else acted)[each.name, "action"]
        return self._action(each, action, place)

    def _show(self, own: Any, each: Seats, place: int, observation: Any, info: Any) -> None:
        space = self._groups[each.runs[0][0]].observation_space
        paths = [leaf.path for leaf in leaves(space, "observation_space")]
        arrays = [np.asarray(getter(paths[part.place])(observation)) for part in each.seen]
        if self._flat:
            one = [array[None, None] for array in arrays]
            own["observation"][place] = torch.from_numpy(
                specs.flat(each.seen, one, np.ones((1, 1), bool))[0, 0]
            )
        else:
            for part, array in zip(each.seen, arrays, strict=True):
                own.get(("observation", *part.key))[place] = specs.tensor(array.copy())
        own["mask"][place] = True
        if "action_mask" in own.keys():  # noqa: SIM118  # a TensorDict
            told = observation.get(MASK) if isinstance(observation, dict) else None
            legal = info.get(MASK) if told is None else told
            own["action_mask"][place] = True if legal is None else torch.as_tensor(legal).bool()

    def _action(self, each: Seats, action: Any, place: int) -> Any:
        if [part.key for part in each.done] != [()]:
            raise PolicyError(
                "actions of several tensors aren't played by an actor", where="policy",
                expected="Discrete, MultiDiscrete, MultiBinary or Box actions",
            )  # fmt: skip
        (part,) = each.done
        found = action[place].cpu().numpy() + getattr(part.space, "start", 0)
        return found.item() if found.ndim == 0 else found.astype(part.space.dtype)


def _digest(actor: Any) -> str:
    digest = blake2b(digest_size=8)
    for name, value in sorted(actor.state_dict().items()):
        if isinstance(value, torch.Tensor):
            digest.update(name.encode())
            digest.update(np.ascontiguousarray(value.detach().cpu().numpy()).tobytes())
    return digest.hexdigest()
