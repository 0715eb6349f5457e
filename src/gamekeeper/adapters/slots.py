"""What trainers with a fixed number of places see: a slot for each learning agent of each copy.

A slot is one agent's stream of decisions, whatever the API: in a Parallel environment it acts in
every step in which it lives, in an AEC environment when its turn comes. `acted` tells which slots
did; rewards of the others are what the world paid them meanwhile, and belong to what they did last.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import role as role_in_name
from gamekeeper.errors import SpecError
from gamekeeper.game.casting.cast import Cast, Choices
from gamekeeper.game.open import open_env
from gamekeeper.record.recording import cast_of
from gamekeeper.vector.front import make

MASK: Final = "action_mask"


@dataclass(frozen=True, slots=True)
class Step:
    """What one step gave each slot; arrays are [slot, ...].

    Attributes:
        obs: what each slot is given next; zeros where nobody is, the last known of who waits.
        rewards: what each was paid in this step.
        terminated, truncated: who ended in it.
        final: by slot that ended, its last observation.
        lengths, returns: by slot that ended, its own decisions and their sum in the episode.
    """

    obs: Any
    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    final: Mapping[int, Any]
    lengths: Mapping[int, int]
    returns: Mapping[int, float]


class Slots:
    """Learning agents of many copies, each in a slot; the other agents follow given policies.

    Slot e * A + a is learner a of copy e.

    Args:
        spec, num_envs, options: as `gk.vector.make` has them.
        role: only its agents learn; None: all do.
        others: policies of who doesn't learn, by agent or role; of nobody else.

    Attributes:
        venv: the vector environment.
        learners: names of the learning agents, A of them.
        acted: [slot], who acted in the last step.
        acting: [slot], who acts in the next one.
        masks: [slot, action], what each may do; ones where it doesn't matter.
    Raises:
        SpecError: the learners differ in their spaces, or somebody has no policy.
    """

    def __init__(
        self,
        spec: object,
        num_envs: int,
        *,
        role: str | None = None,
        others: Choices = None,
        seed: int = 0,
        **options: Any,
    ) -> None:
        self._spec, self._env_kwargs = spec, dict(options.get("env_kwargs") or {})
        needs_infos = others is not None
        self.venv = make(spec, num_envs, seed=seed, infos=needs_infos, **options)
        self.seed = seed
        self._contract = self.venv.seen.contract or Contract()
        group, columns = self._learning(role)
        self.group = group
        self.learners: list[Any] = [group.agents[c - group.first] for c in columns]
        self._columns = np.array(columns)
        self.count = num_envs * len(columns)
        self.observation_space, self._key = bare_space(group.observation_space)
        self.action_space: spaces.Space[Any] = group.action_space
        self._casts = self._others(others, num_envs)
        flags = group.flags
        self.masks: NDArray[np.int8] = np.ones((self.count, flags), np.int8)
        self.acted = np.zeros(self.count, bool)
        self.acting = np.zeros(self.count, bool)
        self._place_of = np.full(self._agents_count(), -1)
        self._place_of[columns] = np.arange(len(columns))
        self._lengths = np.zeros(self.count, np.int64)
        self._returns = np.zeros(self.count)
        self._seen: Any = None
        self._infos: dict[str, Any] = {}

    # -- who learns

    def _learning(self, role: str | None) -> tuple[Any, list[int]]:
        groups = self.venv.groups
        found: list[tuple[Any, int]] = []
        for group in groups:
            for place, agent in enumerate(group.agents):
                if role is None or self.role_of(agent) == role or str(agent) == role:
                    found.append((group, group.first + place))
        if not found:
            known = sorted({str(self.role_of(a)) for group in groups for a in group.agents})
            raise SpecError(
                f"nobody has the role {role!r}", where="role", expected=", ".join(known),
                seen=repr(role),
            )  # fmt: skip
        if len({group.name for group, _ in found}) > 1:
            raise SpecError(
                "one policy can't be shared by agents that differ in their spaces",
                where="role",
                expected="agents with one observation space and one action space",
                seen=", ".join(group.name for group in groups),
                mend="name the role that learns, and give the others policies",
            )
        return found[0][0], [column for _, column in found]

    def role_of(self, agent: Any) -> str:
        """The role of an agent, by the contract, else by its name."""
        return self._contract.role_of(agent) or role_in_name(str(agent))

    def _agents_count(self) -> int:
        return sum(len(group.agents) for group in self.venv.groups)

    def _others(self, others: Choices, num_envs: int) -> list[Cast]:
        rest = [a for g in self.venv.groups for a in g.agents if a not in set(self.learners)]
        if not rest:
            if others:
                raise SpecError(
                    "there are policies for others, and everybody learns",
                    where="others", mend="name the role that learns",
                )  # fmt: skip
            return []
        if others is None:
            raise SpecError(
                "who doesn't learn has no policy",
                where="others",
                expected=f"policies for {', '.join(map(str, rest))}",
                seen="none",
                mend="others='random', or others={'role': 'module:callable'}",
            )
        env = open_env(self._spec, **self._env_kwargs).env
        try:
            return [cast_of(others, env, self._contract) for _ in range(num_envs)]
        finally:
            env.close()

    # -- a run

    def reset(self, seed: int | None = None) -> Any:
        """Begins a run: what each slot is given."""
        if seed is not None:
            self.seed = seed
        self._obs, self._infos = self.venv.reset(seed=self.seed)
        self._lengths[...] = 0
        self._returns[...] = 0.0
        self.acted[...] = False
        self._seen = None
        self._begin_casts(range(self.venv.num_envs))
        self._look()
        return self._seen

    def step(self, actions: Any) -> Step:
        """One step of every copy; actions of slots that don't act are passed over."""
        self.acted[...] = self.acting
        out = self.venv.step(self._joint(np.asarray(actions)))
        self._obs, rewards, terminated, truncated, self._infos = out
        rewards, terminated, truncated = (
            self._by_slot(part) for part in (rewards, terminated, truncated)
        )
        self._lengths += self.acted
        self._returns += rewards
        ended = np.flatnonzero(terminated | truncated)
        before = self._seen
        over = np.flatnonzero(self._infos.get("_final_obs", ()))
        final = {int(slot): self._final(int(slot), before) for slot in ended}
        self._begin_casts(over)
        self._look(terminated | truncated, over)
        lengths = {int(slot): int(self._lengths[slot]) for slot in ended}
        returns = {int(slot): float(self._returns[slot]) for slot in ended}
        self._lengths[ended] = 0
        self._returns[ended] = 0.0
        return Step(self._seen, rewards, terminated, truncated, final, lengths, returns)

    def close(self) -> None:
        """Closes every copy."""
        self.venv.close()

    # -- what goes in

    def _joint(self, actions: Any) -> Any:
        """The actions of all agents, as the vector environment takes them."""
        e = self.venv.num_envs
        own = actions.reshape(e, len(self.learners), *actions.shape[1:])
        if self.venv.api == "aec":
            return self._in_turn(own)
        places = self._columns - self.group.first
        if len(places) == self._agents_count():
            return own
        given = {}
        for group in self.venv.groups:
            shape = (e, len(group.agents), *(group.action_space.shape or ()))
            array = np.zeros(shape, group.action_space.dtype)
            if group.name == self.group.name:
                array[:, places] = own
            given[group.name] = array
        for copy, cast in enumerate(self._casts):
            for group in self.venv.groups:
                for place, agent in enumerate(group.agents):
                    if self._place_of[group.first + place] < 0 and self._lives(group, copy, place):
                        told = self._infos["agents"][copy].get(agent, {})
                        seen = self._observation(group, copy, place)
                        given[group.name][copy, place] = cast.act(agent, seen, told)
        return given.get("", given)

    def _in_turn(self, own: Any) -> Any:
        """Of turns: the action of whoever's turn it is in each copy."""
        turn = self._infos["turn"]
        places = self._place_of[turn]
        group = self.venv.groups[0]
        array = np.zeros((len(turn), *(group.action_space.shape or ())), group.action_space.dtype)
        learns = places >= 0
        array[learns] = own[np.flatnonzero(learns), places[learns]]
        for copy in np.flatnonzero(~learns).tolist():
            agent = group.agents[turn[copy]]
            told = self._infos["agents"][copy].get(agent, {})
            array[copy] = self._casts[copy].act(agent, _at(self._obs, (copy,)), told)
        return array

    def _begin_casts(self, copies: Any) -> None:
        for copy in copies if self._casts else ():
            self._casts[copy].begin(self.seed, int(self._infos["episode"][copy]))

    # -- what comes out

    def _look(self, ended: Any = None, over: Any = ()) -> None:
        """What each slot is given next, who acts, and what they may do."""
        a, e = len(self.learners), self.venv.num_envs
        if self.venv.api == "parallel":
            live = self._by_group(self._infos["live"])[:, self._columns - self.group.first]
            self.acting[...] = live.reshape(-1)
            obs = self._whole_obs()
            self._seen = _map(obs, lambda array: self._own_rows(array, self.acting))
            if self.masks.size:
                masks = self._by_group(self._infos[MASK])[:, self._columns - self.group.first]
                self.masks[...] = np.where(self.acting[:, None], masks.reshape(self.count, -1), 1)
            return
        obs = self._bare(self._obs)
        if self._seen is None:
            self._seen = _map(
                obs, lambda array: np.zeros((self.count, *array.shape[1:]), array.dtype)
            )
        else:
            self._seen = _map(self._seen, np.copy)
        for copy in over:
            _fill(self._seen, slice(copy * a, copy * a + a), 0)
        places = self._place_of[self._infos["turn"]]
        learns = np.flatnonzero(places >= 0)
        slots = learns * a + places[learns]
        self.acting[...] = False
        self.acting[slots] = True
        _put(self._seen, slots, _map(obs, lambda array: array[learns]))
        if self.masks.size:
            self.masks[...] = 1
            self.masks[slots] = self._infos[MASK][learns]
        assert self.count == a * e

    def _own_rows(self, array: Any, acting: Any) -> Any:
        rows = array[:, self._columns - self.group.first].reshape(self.count, *array.shape[2:])
        rows[~acting] = 0
        return rows

    def _whole_obs(self) -> Any:
        return self._bare(self._by_group(self._obs))

    def _final(self, slot: int, before: Any) -> Any:
        """The last observation of a slot that ended in this step."""
        e, a = divmod(slot, len(self.learners))
        is_over = "_final_obs" in self._infos and bool(self._infos["_final_obs"][e])
        place = int(self._columns[a]) - self.group.first
        if is_over:
            whole = self._infos["final_obs"][e]
            return self._bare(_at(self._by_group(whole), (place,)))
        if self.venv.api == "parallel":
            return _map(self._whole_obs(), lambda array: array[e, place].copy())
        return _map(before, lambda array: array[slot].copy())

    def _by_slot(self, part: Any) -> Any:
        if self.venv.api == "aec" or len(self.venv.groups) == 1:
            return part[:, self._columns].reshape(self.count)
        return part[self.group.name][:, self._columns - self.group.first].reshape(self.count)

    def _by_group(self, part: Any) -> Any:
        return part if len(self.venv.groups) == 1 else part[self.group.name]

    def _bare(self, obs: Any) -> Any:
        if not isinstance(obs, dict):
            return obs
        rest = {key: part for key, part in obs.items() if key != MASK}
        return rest if self._key is None else rest[self._key]

    def _lives(self, group: Any, copy: int, place: int) -> bool:
        live = self._infos["live"]
        part = live if len(self.venv.groups) == 1 else live[group.name]
        return bool(part[copy, place])

    def _observation(self, group: Any, copy: int, place: int) -> Any:
        part = self._obs if len(self.venv.groups) == 1 else self._obs[group.name]
        return _at(part, (copy, place))


def bare_space(space: spaces.Space[Any]) -> tuple[spaces.Space[Any], str | None]:
    """An observation space without the mask in it; of a Dict with one other part, that part."""
    if not isinstance(space, spaces.Dict):
        return space, None
    rest = {key: part for key, part in space.spaces.items() if key != MASK}
    if len(rest) == 1 and MASK in space.spaces:
        (key,) = rest
        return rest[key], key
    return spaces.Dict(rest), None


def _map(tree: Any, change: Any) -> Any:
    if isinstance(tree, dict):
        return {key: _map(part, change) for key, part in tree.items()}
    return change(tree)


def _at(tree: Any, index: tuple[int, ...]) -> Any:
    if isinstance(tree, dict):
        return {key: _at(part, index) for key, part in tree.items()}
    value = tree[index]
    return value.copy() if isinstance(value, np.ndarray) else value


def _fill(tree: Any, where: Any, value: Any) -> None:
    for part in tree.values() if isinstance(tree, dict) else (tree,):
        part[where] = value


def _put(tree: Any, where: Any, values: Any) -> None:
    if isinstance(tree, dict):
        for key, part in tree.items():
            part[where] = values[key]
    else:
        tree[where] = values
