"""A seat for each learning agent of each copy, whatever its spaces: padded where they differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gamekeeper.adapters.tianshou.forms import MASK, Forms, at, each, native
from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import role as role_in_name
from gamekeeper.errors import SpecError
from gamekeeper.game.casting.cast import Cast, Choices
from gamekeeper.game.open import open_env
from gamekeeper.record.recording import cast_of
from gamekeeper.vector.form import Group
from gamekeeper.vector.front import make


@dataclass(frozen=True, slots=True)
class Crossing:
    """What one step gave; arrays are [copy, agent, ...].

    Attributes:
        rewards: what each learner was paid.
        terminated, truncated: who ended.
        after: what each is given next; of who ended, its last observation.
        over: [copy], whose episode ended.
        episode: [copy], the number of the episode that the step belongs to.
    """

    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    after: Any
    over: NDArray[np.bool_]
    episode: NDArray[np.int64]


class Seats:
    """Learning agents of many copies; the other agents follow given policies.

    Args:
        spec, num_envs, options: as `gk.vector.make` has them.
        role: only its agents learn; None: all do.
        others: policies of who doesn't learn, by agent or role; of nobody else.

    Attributes:
        venv: the vector environment.
        learners: names of the learning agents.
        acting: [copy, agent], who acts in the next step.
        obs: what each is given; [copy, agent, ...], zeros where nobody is, the last known of who
            waits. A dictionary of such arrays for Dict spaces.
        masks: [copy, agent, action] bool, what each may do; None where nothing says.
        episode: [copy], the number of the episode that each copy is in.
    Raises:
        SpecError: nobody has the role, somebody has no policy, or spaces differ too much to pad.
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
        self.venv = make(spec, num_envs, seed=seed, infos=others is not None, **options)
        self.num_envs, self.seed = num_envs, seed
        try:
            self._settle(role, others)
        except BaseException:
            self.venv.close()
            raise

    def _settle(self, role: str | None, others: Choices) -> None:
        """Who learns, who follows, and the form of what they see and do."""
        num_envs = self.num_envs
        self._contract = self.venv.seen.contract or Contract()
        columns = [(g, group.first + i, agent) for g, group in enumerate(self.venv.groups)
                   for i, agent in enumerate(group.agents)]  # fmt: skip
        mine = [one for one in columns if role in (None, self.role_of(one[2]), str(one[2]))]
        if not mine:
            known = sorted({self.role_of(agent) for *_, agent in columns})
            raise SpecError(
                f"nobody has the role {role!r}", where="role", expected=", ".join(known),
                seen=repr(role),
            )  # fmt: skip
        self.learners = [agent for *_, agent in mine]
        self._groups = [g for g, *_ in mine]
        self._columns = np.array([column for _, column, _ in mine])
        self._seat_of = np.full(len(columns), -1)
        self._seat_of[self._columns] = np.arange(len(mine))
        self._group_of = np.array([g for g, *_ in columns])
        self._casts = self._others(others, [a for *_, a in columns if a not in self.learners])
        self.forms = Forms({g: self.venv.groups[g] for g in sorted(set(self._groups))})
        self.acting = np.zeros((num_envs, len(mine)), bool)
        self.obs = self.forms.empty((num_envs, len(mine)))
        actions = self.forms.actions if self.forms.has_masks else 0
        self.masks = np.ones((*self.acting.shape, actions), bool) if actions else None
        self.episode = np.zeros(num_envs, np.int64)

    def role_of(self, agent: Any) -> str:
        """The role of an agent, by the contract, else by its name."""
        return self._contract.role_of(agent) or role_in_name(str(agent))

    def group_of(self, agent: Any) -> Group:
        """The group of a learner, which has its spaces."""
        return self.venv.groups[self.number_of(agent)]

    def number_of(self, agent: Any) -> int:
        """The number of its group."""
        return self._groups[self.learners.index(agent)]

    def _others(self, others: Choices, rest: list[Any]) -> list[Cast]:
        if bool(rest) != (others is not None):
            names = ", ".join(map(str, rest))
            raise SpecError(
                "who doesn't learn has no policy" if rest else "there is nobody else",
                where="others", expected=f"policies for {names}" if rest else "none",
                seen=repr(others)[:100],
                mend="others='random', or by role" if rest else "name the role that learns",
            )  # fmt: skip
        if not rest:
            return []
        env = open_env(self._spec, **self._env_kwargs).env
        try:
            return [cast_of(others, env, self._contract) for _ in range(self.num_envs)]
        finally:
            env.close()

    # -- a run

    def reset(self, seed: int) -> None:
        """Begins a run."""
        self.seed = seed
        self._given, self._infos = self.venv.reset(seed=seed)
        self._begin(range(self.num_envs))
        each(self.obs, lambda array: array.fill(0))
        self._look()

    def step(self, actions: NDArray[Any]) -> Crossing:
        """One step of every copy.

        Args:
            actions: [copy, agent, ...], as the agents' policies have them; of who doesn't act they
                are passed over.
        """
        episode, before = self.episode, each(self.obs, np.copy)
        given, *flags, self._infos = self.venv.step(self._joint(actions))
        self._given = given
        rewards, terminated, truncated = (self._by_seat(part) for part in flags)
        over = np.zeros(self.num_envs, bool)
        over[np.flatnonzero(self._infos.get("_final_obs", ()))] = True
        ended = terminated | truncated
        last = {(e, j): self._last(e, j, before) for e, j in np.argwhere(ended).tolist()}
        self._begin(np.flatnonzero(over))
        each(self.obs, lambda array: _zero(array, over))
        self._look()
        after = each(self.obs, np.copy)
        for (e, j), seen in last.items():
            self.forms.put(after, (e, j), self._groups[j], seen)
        return Crossing(rewards, terminated, truncated, after, over, episode)

    def close(self) -> None:
        """Closes every copy."""
        self.venv.close()

    def _begin(self, copies: Any) -> None:
        self.episode = np.array(self._infos["episode"], np.int64)
        for copy in copies if self._casts else ():
            self._casts[copy].begin(self.seed, int(self.episode[copy]))

    # -- what goes in

    def _joint(self, actions: NDArray[Any]) -> Any:
        """The actions of all agents, as the vector environment takes them."""
        is_aec = self.venv.api == "aec"
        given = {}
        for group in self.venv.groups:
            own = (self.num_envs,) if is_aec else (self.num_envs, len(group.agents))
            shape = (*own, *(group.action_space.shape or ()))
            given[group.name] = np.zeros(shape, group.action_space.dtype)
        if is_aec:
            self._put_turns(given, actions)
        else:
            self._put_ticks(given, actions)
        return given.get("", given)

    def _put_ticks(self, given: dict[str, Any], actions: NDArray[Any]) -> None:
        groups = self.venv.groups
        for j, g in enumerate(self._groups):
            place = self._columns[j] - groups[g].first
            given[groups[g].name][:, place] = native(groups[g].action_space, actions[:, j])
        for copy, cast in enumerate(self._casts):
            for group in groups:
                live, seen = self._part(self._infos["live"], group), self._part(self._given, group)
                for i, agent in enumerate(group.agents):
                    if self._seat_of[group.first + i] < 0 and live[copy, i]:
                        told = self._infos["agents"][copy].get(agent, {})
                        given[group.name][copy, i] = cast.act(agent, at(seen, (copy, i)), told)

    def _put_turns(self, given: dict[str, Any], actions: NDArray[Any]) -> None:
        turn = self._infos["turn"]
        for g, group in enumerate(self.venv.groups):
            theirs = self._group_of[turn] == g
            seats = self._seat_of[turn]
            mine = np.flatnonzero(theirs & (seats >= 0))
            array = given[group.name]
            array[mine] = native(group.action_space, actions[mine, seats[mine]])
            for copy in np.flatnonzero(theirs & (seats < 0)).tolist():
                agent = group.agents[turn[copy] - group.first]
                told = self._infos["agents"][copy].get(agent, {})
                seen = at(self._part(self._given, group), (copy,))
                array[copy] = self._casts[copy].act(agent, seen, told)

    # -- what comes out

    def _look(self) -> None:
        """Who acts next, what they are given and may do."""
        self.acting = np.zeros_like(self.acting)
        if self.masks is not None:
            self.masks = np.ones_like(self.masks)
        is_aec = self.venv.api == "aec"
        for g in sorted(set(self._groups)):
            group = self.venv.groups[g]
            if is_aec:
                turn = self._infos["turn"]
                seats = self._seat_of[turn]
                copies = np.flatnonzero((self._group_of[turn] == g) & (seats >= 0))
                where: Any = (copies, seats[copies])
                source: Any = copies
            else:
                mine = np.flatnonzero(np.array(self._groups) == g)
                places = self._columns[mine] - group.first
                live = self._part(self._infos["live"], group)[:, places]
                copies, which = np.nonzero(live)
                where, source = (copies, mine[which]), (copies, places[which])
                each(self.obs, partial(_gone, seats=mine, live=live))
            self.acting[where] = True
            seen = each(self._part(self._given, group), itemgetter(source))
            self.forms.put(self.obs, where, g, seen)
            if self.masks is not None:
                self._mask(group, where, source)

    def _mask(self, group: Group, where: Any, source: Any) -> None:
        assert self.masks is not None
        self.masks[where] = False
        count = int(getattr(group.action_space, "n", self.forms.actions))
        legal: Any = True
        if group.flags:
            legal = self._part(self._infos[MASK], group)[source] != 0
            legal = legal | ~legal.any(-1, keepdims=True)
        whole = self.masks[where]
        whole[..., :count] = legal
        self.masks[where] = whole

    def _last(self, e: int, j: int, before: Any) -> Any:
        """The last observation of a learner that ended in this step."""
        group = self.venv.groups[self._groups[j]]
        place = int(self._columns[j]) - group.first
        if "_final_obs" in self._infos and self._infos["_final_obs"][e]:
            return at(self._part(self._infos["final_obs"][e], group), (place,))
        if self.venv.api == "parallel":
            return at(self._part(self._given, group), (e, place))
        return self.forms.taken(before, (e, j), self._groups[j])

    def _by_seat(self, part: Any) -> NDArray[Any]:
        if not isinstance(part, Mapping):
            found: NDArray[Any] = part[:, self._columns]
            return found
        groups = self.venv.groups
        parts = [part[groups[g].name][:, column - groups[g].first]
                 for g, column in zip(self._groups, self._columns, strict=True)]  # fmt: skip
        return np.stack(parts, 1)

    def _part(self, whole: Any, group: Group) -> Any:
        return whole if len(self.venv.groups) == 1 else whole[group.name]


def _zero(array: NDArray[Any], copies: NDArray[np.bool_]) -> None:
    array[copies] = 0


def _gone(array: NDArray[Any], seats: NDArray[Any], live: NDArray[np.bool_]) -> None:
    part = array[:, seats]
    part[~live] = 0
    array[:, seats] = part
