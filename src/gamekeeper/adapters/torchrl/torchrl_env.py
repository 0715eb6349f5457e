"""Copies of a multi-agent environment as one TorchRL environment; users call `env`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from gamekeeper.adapters.requirements import checked, closed_on_error
from gamekeeper.adapters.slot_views import OtherAgents
from gamekeeper.adapters.torchrl import torchrl_specs as specs
from gamekeeper.adapters.torchrl.torchrl_agents import TorchRLAgents, Waiting, groups_of, others_of
from gamekeeper.adapters.torchrl.torchrl_copies import Bools, Copies
from gamekeeper.errors import ActionError, SpecError
from gamekeeper.interface.joint_policy import Choices
from gamekeeper.vector.vector_form import ALL

FLAGS: Final = ("done", "terminated", "truncated")


class TorchRLEnv(EnvBase):
    """Use `env`.

    Attributes:
        group_map: names of agents by group, in the order of their places.
    """

    def __init__(
        self,
        copies: Copies,
        learning: list[TorchRLAgents],
        others: OtherAgents,
        *,
        is_batched: bool,
        device: Any,
        state: bool | None = None,
        masks: bool | None = None,
        flatten: bool = False,
    ) -> None:
        """Makes the specs.

        Args:
            state: True: `state` is shown; None: where the environment declares a `state_space`.
            masks: True: every group with discrete actions has an `action_mask`; None: where the
                environment has masks, or where agents act in turn.
            flatten: observations and state are one vector of float32 each, whole numbers one-hot.
        """
        lead = (copies.num_envs,) if is_batched else ()
        super().__init__(device=device, batch_size=lead, allow_done_after_reset=True)
        self._copies, self._learning, self._others = copies, learning, others
        self._is_batched, self._is_flat = is_batched, flatten
        self.group_map = {each.name: [str(agent) for agent in each.agents] for each in learning}
        is_aec = copies.api == "aec"
        wants = is_aec if masks is None else masks
        self._masked = {
            each.name: bool(each.choices) and (wants or (masks is None and each.is_masked))
            for each in learning
        }
        self._next_seed: int | None = copies.run_seed
        by_agent = copies.num_envs, len(copies.agents)
        self._ended = {kind: np.zeros(by_agent, bool) for kind in FLAGS[1:]}
        self._just_ended: Bools = np.zeros(by_agent, bool)
        self._whole = {kind: np.zeros(copies.num_envs, bool) for kind in FLAGS}
        self._waiting = Waiting(copies, learning) if is_aec else None
        space = copies.state_space(is_asked=state)
        self._state_parts = None if space is None else specs.parts_of(space)
        self._make_specs(lead)

    # -- agents and specs

    @property
    def venv(self) -> Any:
        """Vector environment that the copies belong to."""
        return self._copies.venv

    @property
    def agents(self) -> list[str]:
        """Agents of all groups."""
        return [agent for agents in self.group_map.values() for agent in agents]

    @property
    def episodes(self) -> NDArray[np.int64]:
        """[copy], the number of the episode of the run that each copy is in."""
        return np.array(self._copies.arrays["episode"])

    def _make_specs(self, lead: tuple[int, ...]) -> None:
        action, seen, reward, done = (Composite(shape=lead) for _ in range(4))
        for each in self._learning:
            at = (*lead, each.size)
            shown = self._shown_spec(each.seen, at)
            seen[each.name] = Composite({"observation": shown, "mask": _flag(at)}, shape=at)
            if self._masked[each.name]:
                seen[each.name, "action_mask"] = _flag((*at, each.flags))
            action[each.name] = Composite({"action": specs.acted(each.done, at)}, shape=at)
            paid = Unbounded(shape=(*at, 1), dtype=torch.float32)
            reward[each.name] = Composite({"reward": paid}, shape=at)
            done[each.name] = Composite({kind: _flag((*at, 1)) for kind in FLAGS}, shape=at)
        for kind in FLAGS:
            done[kind] = _flag((*lead, 1))
        if self._state_parts is not None:
            seen["state"] = self._shown_spec(self._state_parts, lead)
        self.action_spec, self.observation_spec = action.to(self.device), seen.to(self.device)
        self.reward_spec, self.done_spec = reward.to(self.device), done.to(self.device)

    def _shown_spec(self, parts: list[specs.SpecPart], lead: tuple[int, ...]) -> Any:
        if self._is_flat:
            return Unbounded(shape=(*lead, specs.width(parts)), dtype=torch.float32)
        return specs.observed(parts, lead)

    # -- a run

    def _set_seed(self, seed: int | None) -> None:
        """Sets the seed of the run that the next reset of all copies begins."""
        if seed is not None:
            self._next_seed = int(seed)

    def _reset(self, tensordict: TensorDictBase | None = None, **options: Any) -> TensorDictBase:
        if options.pop("set_state", False) or options:
            raise SpecError(
                "a reset takes no options",
                where="reset",
                actual=", ".join(options),
                fix="hand them to the environment as env_kwargs",
            )
        asked = None if tensordict is None else tensordict.get("_reset", None)
        which = np.ones(self._copies.num_envs, bool)
        if asked is not None:
            which = asked.detach().cpu().numpy().reshape(self._copies.num_envs)
        if self._next_seed is not None and which.all():
            self._copies.begin(self._next_seed)
            self._next_seed = None
        elif self._next_seed is not None and not self._copies.is_begun:
            raise SpecError(
                "some copies are reset before all were",
                where="_reset",
                actual=str(which.tolist())[:80],
                fix="reset() first",
            )
        else:
            self._copies.restart(which)
        self._begun(which)
        return self._tensordict(self._shown())

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        some = tensordict.get("_step", None)
        if some is not None and not bool(some.all()):
            raise SpecError(
                "copies are stepped together",
                where="_step",
                actual=f"{int(some.sum())} of {self._copies.num_envs} copies",
                fix="rollout(break_when_any_done=False), which resets copies that are done",
            )
        waits = self._copies.over.copy()
        if waits.any():  # a copy that steps past an end is in its next episode
            self._copies.restart(waits)
            self._begun(waits)
        self._copies.step(self._joint(tensordict))
        self._note_ends()
        out = self._shown()
        rewards = self._copies.arrays["rewards"].astype(np.float32)[..., None]
        for each in self._learning:
            out[each.name]["reward"] = rewards[:, each.columns]
        return self._tensordict(out)

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Closes every copy."""
        self._copies.close()
        self.is_closed = True

    def rand_action(self, tensordict: TensorDictBase | None = None) -> TensorDictBase:
        """Legal actions, drawn by torch's generator; masks are those in `tensordict`."""
        drawn = self.full_action_spec.rand()
        for each in self._learning:
            mask = None if tensordict is None else tensordict.get((each.name, "action_mask"), None)
            if mask is not None:
                drawn[each.name, "action"] = _legal(mask, each.choices)
        return drawn if tensordict is None else tensordict.update(drawn)

    # -- observations

    def _begun(self, which: Bools) -> None:
        """Clears the ends of these copies, in which new episodes have begun."""
        for flags in (*self._ended.values(), *self._whole.values(), self._just_ended):
            flags[which] = False
        copies = self._copies
        self._others.begin(np.flatnonzero(which).tolist(), copies.run_seed, copies.infos)
        if self._waiting is not None:
            self._waiting.clear(which)
            self._waiting.look(self._just_ended)

    def _note_ends(self) -> None:
        arrays, over = self._copies.arrays, self._copies.over
        for kind, ended in self._ended.items():
            ended |= arrays[kind]
        self._just_ended[...] = arrays["terminated"] | arrays["truncated"]
        terminated = over & arrays["terminated"].any(axis=1)
        self._whole["done"][...], self._whole["terminated"][...] = over, terminated
        self._whole["truncated"][...] = over & ~terminated
        if self._waiting is not None:
            self._waiting.look(self._just_ended)

    def _shown(self) -> dict[str, Any]:
        """Returns all copies' observations and ends, [copy, ...] in nested dictionaries."""
        arrays, over = self._copies.arrays, self._copies.over
        live = arrays["live"] & ~over[:, None]
        acting = live if self._waiting is None else self._waiting.in_turn()
        ended = {"done": self._ended["terminated"] | self._ended["truncated"], **self._ended}
        out: dict[str, Any] = {kind: flags[:, None].copy() for kind, flags in self._whole.items()}
        for each in self._learning:
            mine = acting[:, each.columns]
            found = {kind: flags[:, each.columns][..., None] for kind, flags in ended.items()}
            found["mask"] = mine
            found["observation"] = self._observed(each, live | self._just_ended)
            if self._masked[each.name]:
                found["action_mask"] = self._legal_now(each, mine)
            out[each.name] = found
        if self._state_parts is not None:
            out["state"] = self._state()
        return out

    def _observed(self, each: TorchRLAgents, there: Bools) -> Any:
        arrays, over = self._copies.arrays, self._copies.over
        if self._waiting is None:
            found = [each.stacked(arrays, "obs", part.place) for part in each.seen]
        else:
            found, there = self._waiting.shown(each)
        if over.any():
            for part, array in zip(each.seen, found, strict=True):
                array[over] = each.stacked(arrays, "final", part.place)[over]
        if self._is_flat:
            return specs.flat(each.seen, found, there[:, each.columns])
        return _nested({part.key: array for part, array in zip(each.seen, found, strict=True)})

    def _legal_now(self, each: TorchRLAgents, acting: Bools) -> Bools:
        """[copy, place, action], legal actions; the first one for an agent that doesn't act."""
        if not each.is_masked:
            legal = np.ones((*acting.shape, each.flags), bool)
        elif self._waiting is None:
            legal = each.stacked(self._copies.arrays, "mask", -1).astype(bool)
        else:
            legal = self._waiting.masks(each)
        legal[~acting] = False
        first = 0
        for count in each.choices:
            legal[..., first] |= ~acting
            first += count
        return legal

    def _state(self) -> Any:
        state, parts = self._copies.state(), self._state_parts
        if self._is_flat and parts is not None:
            return specs.flat(parts, [state[:, None]], np.ones((len(state), 1), bool))[:, 0]
        return state

    def _tensordict(self, out: dict[str, Any]) -> TensorDictBase:
        count = self._copies.num_envs
        whole = TensorDict({}, batch_size=(count,))
        for key, value in out.items():
            if key in self.group_map:
                size = len(self.group_map[key])
                whole[key] = TensorDict(_tensors(value), batch_size=(count, size))
            else:
                whole[key] = specs.tensor(value)
        found = whole if self._is_batched else whole[0]
        return found.to(self.device)

    # -- actions

    def _joint(self, tensordict: TensorDictBase) -> Any:
        """Returns the actions of all agents, as the vector environment takes them."""
        copies = self._copies
        actions = {
            (g, i): np.zeros_like(copies.arrays[f"action.{g}.{i}"])
            for g, group in enumerate(copies.groups)
            for i in range(len(group.acted))
        }
        for each in self._learning:
            for part in each.done:
                given = self._given(tensordict, each, part)
                if self._waiting is not None:
                    self._waiting.put(actions, each, part.place, given)
                    continue
                first = 0
                for g, places in each.runs:
                    mine = slice(first, first + len(places))
                    actions[g, part.place][:, places] = given[:, mine]
                    first += len(places)
        joint = {
            group.name: _nested({leaf.path: actions[g, i] for i, leaf in enumerate(group.acted)})
            for g, group in enumerate(copies.groups)
        }
        self._others.act(joint, copies.obs, copies.infos)
        return joint.get(ALL, joint)

    def _given(
        self, tensordict: TensorDictBase, each: TorchRLAgents, part: specs.SpecPart
    ) -> NDArray[Any]:
        """[copy, place, ...], one tensor of a group's actions."""
        shape = (self._copies.num_envs, each.size, *(part.space.shape or ()))
        found = tensordict.get((each.name, "action", *part.key), None)
        if found is None or found.numel() != np.prod(shape):
            raise ActionError(
                "a group's actions don't fit",
                where=str((each.name, "action", *part.key)),
                expected=f"a tensor of shape {list(shape)}",
                actual="none" if found is None else str(list(found.shape)),
                fix="write actions as env.full_action_spec has them",
            )
        array: NDArray[Any] = found.detach().cpu().numpy().reshape(shape)
        return array + part.space.start if hasattr(part.space, "start") else array


def _flag(shape: tuple[int, ...]) -> Any:
    return Categorical(2, shape=shape, dtype=torch.bool)


def _nested(found: dict[tuple[Any, ...], Any]) -> Any:
    """Returns arrays by path as nested dictionaries; a single one without a path as it is."""
    if list(found) == [()]:
        return found[()]
    whole: dict[Any, Any] = {}
    for path, array in found.items():
        inner = whole
        for key in path[:-1]:
            inner = inner.setdefault(key, {})
        inner[path[-1]] = array
    return whole


def _tensors(tree: dict[Any, Any]) -> dict[Any, Any]:
    return {
        key: _tensors(part) if isinstance(part, dict) else specs.tensor(part)
        for key, part in tree.items()
    }


def _legal(mask: Any, choices: tuple[int, ...]) -> Any:
    """Draws one legal action each, [...]; of several parts, [..., part]."""
    drawn = [
        torch.multinomial(part.reshape(-1, n).float(), 1).reshape(mask.shape[:-1])
        for part, n in zip(mask.split(choices, -1), choices, strict=True)
    ]
    return drawn[0] if len(drawn) == 1 else torch.stack(drawn, -1)


TENSORS: Final = ("state", "masks", "flatten")
"""Options of a `TorchRLEnv`; the rest are the vector environment's."""


def env(
    spec: object,
    num_envs: int | None = None,
    *,
    role: str | None = None,
    others: Choices = None,
    group_map: Any = None,
    check: str | None = "quick",
    seed: int = 0,
    device: Any = "cpu",
    env_kwargs: Mapping[str, Any] | None = None,
    **options: Any,
) -> TorchRLEnv:
    """Copies of a multi-agent environment as one `EnvBase`, agents nested in groups by role.

    For a group of A agents, batch size [num_envs, A]: `observation`, `action`, `reward`, `done`,
    `terminated`, `truncated`, `mask`, `action_mask`. For each copy, batch size [num_envs]: `done`,
    `terminated`, `truncated`, `state`.

    | | |
    |---|---|
    | kept | every agent's own end, with the last observation under `next`; truncation apart from termination, for each agent and for the copy, which is done when all its agents are; late joiners; roles with different spaces, each in its group; masks; `state()`, that of the end too; seeds: copy i plays the episodes i, i + num_envs, ... of run `seed`, the same ones as `gk.rollout` |
    | changed | who isn't there (has ended, hasn't joined) or, in an AEC environment, isn't in turn, has `mask` False and one legal action, the first, so that a masked policy learns nothing there; who has ended stays done until its copy is reset. An AEC step is one turn in each copy: who waits keeps what it was shown last, and is paid in the step in which it earned it (`advantages` credits that to its own last decision). A Dict observation loses its `action_mask`; of one other part only that part is left. Whole-number actions count from 0; rewards are float32 |
    | lost | infos but for the mask. With `engine="process"`: `state()`, and a reset of all copies in mid-episode begins another run (`gamekeeper.randomness.seeds.episode_seed(seed, n)`) in place of the next episodes |
    | refused | a group whose agents differ in their spaces, others without a policy (`others=`), stepping some copies without the others, a reset of some copies in mid-episode with `engine="process"`, an environment that breaks its contract (`check=None` lets it pass) |

    Args:
        spec: where the environment comes from, as `gk.make` takes it.
        num_envs: how many copies; None: one, and no batch dimension.
        role: the role, or the one agent, that is seen; the rest follow `others`. None: everybody.
        others: policies of who isn't seen, one for all or by agent or role.
        group_map: agents by group, or TorchRL's `MarlGroupMapType`; None: by role.
        check: "quick": the quick audit, once for each source digest, before the first step.
        seed: of the run; `set_seed` takes another one for the next reset.
        device: where tensors go.
        env_kwargs: handed to the environment.
        options: of `gk.vector.make`: `engine`, `workers`, `threads`; and of `TorchRLEnv`: `state`,
            `masks`, `flatten`.
    Raises:
        SpecError: see *refused*.
        ContractError: the audit found that the environment breaks its contract.
    """  # noqa: E501  # a row of a table is one line
    checked(spec, check, env_kwargs=env_kwargs)
    tensors = {name: options.pop(name) for name in TENSORS if name in options}
    copies = Copies(
        spec,
        1 if num_envs is None else num_envs,
        seed=seed,
        env_kwargs=env_kwargs,
        infos=others is not None,
        **options,
    )
    with closed_on_error(copies):
        learning = groups_of(copies, group_map, role)
        rest = others_of(copies, learning, others, spec, env_kwargs)
        return TorchRLEnv(
            copies, learning, rest, is_batched=num_envs is not None, device=device, **tensors
        )
