"""Copies of a multi-agent environment as one TorchRL environment."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from gamekeeper.adapters.torchrl import specs
from gamekeeper.adapters.torchrl.copies import Bools, Copies
from gamekeeper.adapters.torchrl.others import Others
from gamekeeper.adapters.torchrl.seats import Seats
from gamekeeper.adapters.torchrl.waiting import Waiting
from gamekeeper.errors import ActionError, SpecError

FLAGS: Final = ("done", "terminated", "truncated")


class GameEnv(EnvBase):
    """Use `env`.

    Attributes:
        group_map: names of agents by group, in the order of their places.
    """

    def __init__(
        self,
        copies: Copies,
        seats: list[Seats],
        others: Others,
        *,
        is_batched: bool,
        state: bool | None,
        masks: bool | None,
        flatten: bool,
        device: Any,
    ) -> None:
        """Takes over the copies."""
        lead = (copies.num_envs,) if is_batched else ()
        super().__init__(device=device, batch_size=lead, allow_done_after_reset=True)
        self._copies, self._seats, self._others = copies, seats, others
        self._is_batched, self._is_flat = is_batched, flatten
        self.group_map = {each.name: [str(agent) for agent in each.agents] for each in seats}
        is_aec = copies.api == "aec"
        wants = is_aec if masks is None else masks
        self._masked = {
            each.name: bool(each.choices) and (wants or (masks is None and each.is_masked))
            for each in seats
        }
        self._next_seed: int | None = copies.run_seed
        by_agent = copies.num_envs, len(copies.agents)
        self._ended = {kind: np.zeros(by_agent, bool) for kind in FLAGS[1:]}
        self._just_ended: Bools = np.zeros(by_agent, bool)
        self._whole = {kind: np.zeros(copies.num_envs, bool) for kind in FLAGS}
        self._waiting = Waiting(copies, seats) if is_aec else None
        space = copies.state_space(is_asked=state)
        self._state_parts = None if space is None else specs.parts_of(space)
        self._make_specs(lead)

    # -- what there is

    @property
    def venv(self) -> Any:
        """The vector environment whose copies these are."""
        return self._copies.venv

    @property
    def agents(self) -> list[str]:
        """The agents of all groups."""
        return [agent for agents in self.group_map.values() for agent in agents]

    @property
    def episodes(self) -> NDArray[np.int64]:
        """[copy], the number of the episode of the run that each copy is in."""
        found: NDArray[np.int64] = self._copies.arrays["episode"].copy()
        return found

    def _make_specs(self, lead: tuple[int, ...]) -> None:
        action, seen, reward, done = (Composite(shape=lead) for _ in range(4))
        for each in self._seats:
            at = (*lead, each.size)
            shown = (
                Unbounded(shape=(*at, specs.width(each.seen)), dtype=torch.float32)
                if self._is_flat
                else specs.observed(each.seen, at)
            )
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
            seen["state"] = (
                Unbounded(shape=(*lead, specs.width(self._state_parts)), dtype=torch.float32)
                if self._is_flat
                else specs.observed(self._state_parts, lead)
            )
        self.action_spec, self.observation_spec = action.to(self.device), seen.to(self.device)
        self.reward_spec, self.done_spec = reward.to(self.device), done.to(self.device)

    # -- a run

    def _set_seed(self, seed: int | None) -> None:
        """The next reset of all copies begins the run of this seed."""
        if seed is not None:
            self._next_seed = int(seed)

    def _reset(self, tensordict: TensorDictBase | None = None, **options: Any) -> TensorDictBase:
        if options.pop("set_state", False) or options:
            raise SpecError(
                "a reset takes nothing but what is to be reset", where="reset",
                seen=", ".join(options), mend="env_kwargs of the environment",
            )  # fmt: skip
        asked = None if tensordict is None else tensordict.get("_reset", None)
        which = np.ones(self._copies.num_envs, bool)
        if asked is not None:
            which = asked.detach().cpu().numpy().reshape(self._copies.num_envs)
        if self._next_seed is not None and which.all():
            self._copies.begin(self._next_seed)
            self._next_seed = None
        elif self._next_seed is not None and not self._copies.is_begun:
            raise SpecError(
                "some copies are reset before all were", where="_reset",
                seen=str(which.tolist())[:80], mend="reset() first",
            )  # fmt: skip
        else:
            self._copies.restart(which)
        self._begun(which)
        return self._told(self._shown())

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        some = tensordict.get("_step", None)
        if some is not None and not bool(some.all()):
            raise SpecError(
                "copies are stepped together",
                where="_step",
                seen=f"{int(some.sum())} of {self._copies.num_envs} copies",
                mend="rollout(break_when_any_done=False), which resets who is done",
            )
        waits = self._copies.over.copy()
        if waits.any():  # who steps past an end is in its next episode
            self._copies.restart(waits)
            self._begun(waits)
        self._copies.step(self._joint(tensordict))
        self._note_ends()
        out = self._shown()
        rewards = self._copies.arrays["rewards"].astype(np.float32)[..., None]
        for each in self._seats:
            out[each.name]["reward"] = rewards[:, each.columns]
        return self._told(out)

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Closes every copy."""
        self._copies.close()
        self.is_closed = True

    def rand_action(self, tensordict: TensorDictBase | None = None) -> TensorDictBase:
        """Legal actions, drawn by torch's generator; masks are those in `tensordict`."""
        drawn = self.full_action_spec.rand()
        for each in self._seats:
            mask = None if tensordict is None else tensordict.get((each.name, "action_mask"), None)
            if mask is not None:
                drawn[each.name, "action"] = _legal(mask, each.choices)
        return drawn if tensordict is None else tensordict.update(drawn)

    # -- what comes out

    def _begun(self, which: Bools) -> None:
        """New episodes have begun in these copies."""
        for flags in (*self._ended.values(), *self._whole.values(), self._just_ended):
            flags[which] = False
        self._others.begin(which)
        if self._waiting is not None:
            self._waiting.clear(which)
            self._waiting.look()

    def _note_ends(self) -> None:
        arrays, over = self._copies.arrays, self._copies.over
        for kind, ended in self._ended.items():
            ended |= arrays[kind]
        self._just_ended[...] = arrays["terminated"] | arrays["truncated"]
        terminated = over & arrays["terminated"].any(axis=1)
        self._whole["done"][...], self._whole["terminated"][...] = over, terminated
        self._whole["truncated"][...] = over & ~terminated
        if self._waiting is not None:
            self._waiting.look()

    def _shown(self) -> dict[str, Any]:
        """What every copy shows, as arrays [copy, ...] in nested dictionaries."""
        arrays, over = self._copies.arrays, self._copies.over
        live = arrays["live"] & ~over[:, None]
        acting = live if self._waiting is None else self._waiting.in_turn()
        ended = {"done": self._ended["terminated"] | self._ended["truncated"], **self._ended}
        out: dict[str, Any] = {kind: flags[:, None].copy() for kind, flags in self._whole.items()}
        for each in self._seats:
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

    def _observed(self, each: Seats, there: Bools) -> Any:
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

    def _legal_now(self, each: Seats, acting: Bools) -> Bools:
        """[copy, place, action], what may be done; the first action where nobody acts."""
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

    def _told(self, out: dict[str, Any]) -> TensorDictBase:
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

    # -- what goes in

    def _joint(self, tensordict: TensorDictBase) -> Any:
        """The actions of all agents, as the vector environment takes them."""
        copies = self._copies
        actions = {
            (g, i): np.zeros_like(copies.arrays[f"action.{g}.{i}"])
            for g, group in enumerate(copies.groups)
            for i in range(len(group.acted))
        }
        for each in self._seats:
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
        self._others.act(actions)
        joint = {
            group.name: _nested({leaf.path: actions[g, i] for i, leaf in enumerate(group.acted)})
            for g, group in enumerate(copies.groups)
        }
        return joint.get("", joint)

    def _given(self, tensordict: TensorDictBase, each: Seats, part: specs.Part) -> NDArray[Any]:
        """[copy, place, ...], one tensor of a group's actions."""
        shape = (self._copies.num_envs, each.size, *(part.space.shape or ()))
        found = tensordict.get((each.name, "action", *part.key), None)
        if found is None or found.numel() != np.prod(shape):
            raise ActionError(
                "a group's actions don't fit",
                where=str((each.name, "action", *part.key)),
                expected=f"a tensor of shape {list(shape)}",
                seen="none" if found is None else str(list(found.shape)),
                mend="see env.full_action_spec",
            )
        array: NDArray[Any] = found.detach().cpu().numpy().reshape(shape)
        return array + part.space.start if hasattr(part.space, "start") else array


def _flag(shape: tuple[int, ...]) -> Any:
    return Categorical(2, shape=shape, dtype=torch.bool)


def _nested(found: dict[tuple[Any, ...], Any]) -> Any:
    """Arrays by path as nested dictionaries; of the one with no path, that one."""
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
    """One legal action each, [...]; of several parts, [..., part]."""
    drawn = [
        torch.multinomial(part.reshape(-1, n).float(), 1).reshape(mask.shape[:-1])
        for part, n in zip(mask.split(choices, -1), choices, strict=True)
    ]
    return drawn[0] if len(drawn) == 1 else torch.stack(drawn, -1)
