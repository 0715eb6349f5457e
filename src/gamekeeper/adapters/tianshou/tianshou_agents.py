"""Learning agents of all sub-environments for Tianshou, whatever their spaces.

Where roles differ in their spaces, their observations and actions are padded to one form.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.adapters.requirements import (
    closed_on_error,
    learners_of,
    policies_of_others,
    role_of,
)
from gamekeeper.adapters.slot_views import OtherAgents, bare_space, zeros
from gamekeeper.errors import SpecError
from gamekeeper.interface.joint_policy import Choices
from gamekeeper.vector.vector_factory import make
from gamekeeper.vector.vector_form import ALL, MASK, VectorGroup, changed, clear


class Forms:
    """Observations and actions of several groups in one form.

    Attributes:
        observation_space, action_space: of every agent: of the only group, or padded.
        actions: number of actions of the agent that has most; 0 where they aren't Discrete.
        has_masks: some agent can't take every action at every time.
    Raises:
        SpecError: there is more than one group, and they can't be padded; an observation is a
            Tuple; or Tianshou has no policy for an action space, or none that is masked.
    """

    def __init__(self, by_number: Mapping[int, VectorGroup]) -> None:
        groups = list(by_number.values())
        self._is_one = len(groups) == 1
        bares = [bare_space(group.observation_space) for group in groups]
        acts = [group.action_space for group in groups]
        self._names = {g: name for g, (_, name) in zip(by_number, bares, strict=True)}
        seen: list[Any] = [space for space, _ in bares]
        for group, space in zip(groups, seen, strict=True):
            check_actions(group, learns=True)
            _refuse_tuples(space)
        if not self._is_one:
            self._check(groups, seen, acts)
        numbers = [int(space.n) for space in acts if isinstance(space, spaces.Discrete)]
        self.actions = max(numbers, default=0)
        is_masked = any(group.flags for group in groups) and self.actions > 0
        self.has_masks = is_masked or len(set(numbers)) > 1
        self.action_space: Any = spaces.Discrete(self.actions) if self.actions else acts[0]
        self.observation_space: Any = seen[0] if self._is_one else _widest(seen)

    @staticmethod
    def _check(groups: list[VectorGroup], seen: list[Any], acts: list[Any]) -> None:
        flat = all(isinstance(one, spaces.Box) and len(one.shape) == 1 for one in seen)
        numbered = all(isinstance(one, spaces.Discrete) for one in acts)
        if not flat or not (numbered or all(one == acts[0] for one in acts)):
            raise SpecError(
                "roles differ in spaces that can't be padded to one",
                where="role",
                expected="flat Boxes to see, and Discrete actions or the same ones",
                actual="; ".join(
                    f"{g.name}: {s}, {a}"[:120] for g, s, a in zip(groups, seen, acts, strict=True)
                ),
                fix="name the role that learns, and give the others policies",
            )

    def bare(self, g: int, observation: Any) -> Any:
        """Returns an observation of group g without its mask."""
        if not isinstance(observation, Mapping):
            return observation
        rest = {key: part for key, part in observation.items() if key != MASK}
        name = self._names[g]
        return rest if name is None else rest[name]

    def put(self, whole: Any, where: Any, g: int, seen: Any) -> None:
        """Writes observations of group g where they belong, the rest of a row being zeros."""
        _put(whole, where, self.bare(g, seen), is_padded=not self._is_one)


def _refuse_tuples(space: Any) -> None:
    parts = space.spaces.values() if isinstance(space, spaces.Dict) else ()
    for part in parts:
        _refuse_tuples(part)
    if isinstance(space, spaces.Tuple):
        raise SpecError(
            "Tianshou has no tuples of observations",
            where="observation_space",
            actual=str(space)[:200],
            fix="gk.wrappers.flatten_observations(env), or make a Dict of them in the environment",
        )


def check_actions(group: VectorGroup, *, learns: bool) -> None:
    """Refuses actions in parts, and of agents that learn, masks of what isn't Discrete."""
    space = group.action_space
    is_numbered = isinstance(space, spaces.Discrete)
    if isinstance(space, spaces.Dict | spaces.Tuple):
        fault, fix = "Tianshou has no policy for actions in parts", "flatten them"
    elif learns and group.flags and not is_numbered:
        fault, fix = "Tianshou masks Discrete actions alone", "number the choices as one Discrete"
    else:
        return
    raise SpecError(
        fault,
        where=f"action_space of {group.agents[0]!r}",
        actual=str(space)[:200],
        expected="Discrete; without a mask also MultiDiscrete, MultiBinary or Box",
        fix=f"{fix}, in the environment",
    )


def _widest(seen: list[spaces.Box]) -> spaces.Box:
    width = max(space.shape[0] for space in seen)
    low, high = np.zeros(width), np.zeros(width)
    for space in seen:
        low[: space.shape[0]] = np.minimum(low[: space.shape[0]], space.low)
        high[: space.shape[0]] = np.maximum(high[: space.shape[0]], space.high)
    dtype: Any = np.result_type(*(space.dtype for space in seen))
    return spaces.Box(low.astype(dtype), high.astype(dtype), dtype=dtype)


def _put(whole: Any, where: Any, seen: Any, *, is_padded: bool) -> None:
    if isinstance(whole, Mapping):
        for key, part in whole.items():
            _put(part, where, seen[key], is_padded=is_padded)
        return
    rows = np.zeros_like(whole[where])
    rows[(..., slice(np.shape(seen)[-1])) if is_padded else ...] = seen
    whole[where] = rows


def native(space: Any, actions: NDArray[Any]) -> Any:
    """A policy's actions, counted from 0, as the environment counts them."""
    if isinstance(space, spaces.Discrete):
        return np.clip(actions, 0, space.n - 1) + space.start
    return actions + space.start if isinstance(space, spaces.MultiDiscrete) else actions


@dataclass(frozen=True, slots=True)
class EnvStep:
    """Outcome of one step; arrays are [env, agent, ...].

    Attributes:
        rewards: of each learner.
        terminated, truncated: learners that ended.
        after: next observations; of a learner that ended, its last one.
        over: [env], sub-environments whose episode ended.
        episode: [env], the number of the episode that the step belongs to.
    """

    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    after: Any
    over: NDArray[np.bool_]
    episode: NDArray[np.int64]


class TianshouAgents:
    """Learning agents of many sub-environments; the other agents follow given policies.

    Args:
        spec, num_envs, options: as for `gk.vector.make`.
        role: only its agents learn; None: all agents learn.
        others: policies of the other agents, one for all or by agent or role.

    Attributes:
        venv: the vector environment.
        learners: names of the learning agents.
        acting: [env, agent], learners that act in the next step.
        obs: observations, [env, agent, ...]; zeros where no agent is live, the last one of an agent
            that waits. A dictionary of such arrays for Dict spaces.
        masks: [env, agent, action] bool, actions that each may take; None without masks.
        episode: [env], the number of the episode that each sub-environment is in.
    Raises:
        SpecError: no agent has the role, another agent has no policy, or spaces can't be padded.
    """

    def __init__(
        self,
        spec: object,
        num_envs: int,
        *,
        seed: int = 0,
        role: str | None = None,
        others: Choices = None,
        **options: Any,
    ) -> None:
        self.venv = make(spec, num_envs, seed=seed, infos=others is not None, **options)
        self.venv.fix_of_masked = "DiscreteActorPolicy(actor=tianshou.masked(actor), ...)"
        self.num_envs, self.seed, self._is_aec = num_envs, seed, self.venv.api == "aec"
        with closed_on_error(self.venv):
            self._arrange(role)
            names = [agent for *_, agent in self._rest]
            kwargs, contract = options.get("env_kwargs"), self._contract
            policies = policies_of_others(spec, kwargs, names, others, contract, num_envs)
        groups = self.venv.groups
        self._others = OtherAgents(policies, groups, self._rest, is_aec=self._is_aec)

    def _arrange(self, role: str | None) -> None:
        """Finds the learners, their places, and the form of their observations and actions."""
        groups = self.venv.groups
        for group in groups:
            check_actions(group, learns=False)
        self._contract = self.venv.seen.contract
        whole = [
            (g, i, agent) for g, one in enumerate(groups) for i, agent in enumerate(one.agents)
        ]
        self.learners = learners_of([agent for *_, agent in whole], role, self._contract)
        mine = [(g, i) for g, i, agent in whole if agent in self.learners]
        self._rest = [(groups[g], i, a) for g, i, a in whole if a not in self.learners]
        self._groups = [g for g, _ in mine]
        self._columns = np.array([groups[g].first + i for g, i in mine])
        # by column: the learner's number (-1: it doesn't learn), and the group's
        self._learner_of = np.full(len(whole), -1)
        self._learner_of[self._columns] = np.arange(len(mine))
        self._group_of = np.array([g for g, *_ in whole])
        self.forms = Forms({g: groups[g] for g in sorted(set(self._groups))})
        self.acting = np.zeros((self.num_envs, len(mine)), bool)
        self.obs = zeros(self.forms.observation_space, self.acting.shape)
        actions = self.forms.actions if self.forms.has_masks else 0
        self.masks = np.ones((*self.acting.shape, actions), bool) if actions else None
        self.episode = np.zeros(self.num_envs, np.int64)

    def role_of(self, agent: Any) -> str:
        """Role of an agent, by the contract, else by its name."""
        return role_of(self._contract, agent)

    def number_of(self, agent: Any) -> int:
        """Number of a learner's group, which has its spaces."""
        return self._groups[self.learners.index(agent)]

    # -- a run

    def reset(self, seed: int) -> None:
        """Begins a run."""
        self.seed = seed
        self._given, self._infos = self.venv.reset(seed=seed)
        self._begin(range(self.num_envs))
        clear(self.obs, ...)
        self._look()

    def step(self, actions: NDArray[Any]) -> EnvStep:
        """Steps every sub-environment.

        Args:
            actions: [env, agent, ...], as the agents' policies have them; those of agents that
                don't act are ignored.
        """
        episode = self.episode
        self._given, *flags, self._infos = self.venv.step(self._joint(actions))
        rewards, terminated, truncated = (self._by_learner(part) for part in flags)
        over = self._infos["over"]
        self._begin(np.flatnonzero(over))
        clear(self.obs, over)
        self._look()
        after = changed(self.obs, np.copy)
        self._put_last(after, terminated | truncated)
        return EnvStep(rewards, terminated, truncated, after, over, episode)

    def close(self) -> None:
        """Closes every sub-environment."""
        self.venv.close()

    def _begin(self, envs: Any) -> None:
        self.episode = np.array(self._infos["episode"], np.int64)
        self._others.begin(envs, self.seed, self._infos)

    # -- actions

    def _joint(self, actions: NDArray[Any]) -> Any:
        """Returns the actions of all agents, as the vector environment takes them."""
        joint = {}
        for g, group in enumerate(self.venv.groups):
            space = group.action_space
            lead = (self.num_envs,) if self._is_aec else (self.num_envs, len(group.agents))
            joint[group.name] = array = zeros(space, lead)
            if self._is_aec:
                turn = self._infos["turn"]
                learner = self._learner_of[turn]
                mine = np.flatnonzero((self._group_of[turn] == g) & (learner >= 0))
                if len(mine):  # actions of a role that doesn't learn may be of another shape
                    array[mine] = native(space, actions[mine, learner[mine]])
                continue
            for j in np.flatnonzero(np.array(self._groups) == g):
                array[:, self._columns[j] - group.first] = native(space, actions[:, j])
        self._others.act(joint, self._given, self._infos)
        return joint.get(ALL, joint)

    # -- observations

    def _look(self) -> None:
        """Finds the agents that act next, with their observations and masks."""
        self.acting = np.zeros_like(self.acting)
        if self.masks is not None:
            self.masks = np.ones_like(self.masks)
        for g in sorted(set(self._groups)):
            group = self.venv.groups[g]
            # `where`: index of the agents that act, in our arrays; `source`: in the group's
            if self._is_aec:
                turn = self._infos["turn"]
                learner = self._learner_of[turn]
                envs = np.flatnonzero((self._group_of[turn] == g) & (learner >= 0))
                where: Any = (envs, learner[envs])
                source: Any = envs
            else:
                mine = np.flatnonzero(np.array(self._groups) == g)
                places = self._columns[mine] - group.first
                live = self._part(self._infos["live"], group)[:, places]
                envs, which = np.nonzero(live)
                where, source = (envs, mine[which]), (envs, places[which])
                rows, absent = np.nonzero(~live)
                clear(self.obs, (rows, mine[absent]))
            self.acting[where] = True
            seen = changed(self._part(self._given, group), itemgetter(source))
            self.forms.put(self.obs, where, g, seen)
            if self.masks is not None:
                self.masks[where] = self._legal(group, source, len(envs))

    def _legal(self, group: VectorGroup, source: Any, rows: int) -> NDArray[np.bool_]:
        """Returns padded masks of agents at an index of their group's arrays."""
        count = int(getattr(group.action_space, "n", self.forms.actions))
        legal = np.zeros((rows, self.forms.actions), bool)
        legal[:, :count] = True
        if group.flags:
            flags = self._part(self._infos[MASK], group)[source] != 0
            legal[:, :count] = flags | ~flags.any(-1, keepdims=True)
        return legal

    def _put_last(self, after: Any, ended: NDArray[np.bool_]) -> None:
        """Writes the last observations of learners that ended in this step, [env, agent]."""
        for g in sorted(set(self._groups)) if ended.any() else ():
            finals, group = self._infos["final_obs"], self.venv.groups[g]
            mine = np.flatnonzero(np.array(self._groups) == g)
            envs, which = np.nonzero(ended[:, mine])
            source = finals.rows[envs], self._columns[mine[which]] - group.first
            seen = changed(self._part(finals.tree, group), itemgetter(source))
            self.forms.put(after, (envs, mine[which]), g, seen)

    def _by_learner(self, part: Any) -> NDArray[Any]:
        if not isinstance(part, Mapping):
            return np.asarray(part[:, self._columns])
        groups = self.venv.groups
        parts = [
            part[groups[g].name][:, column - groups[g].first]
            for g, column in zip(self._groups, self._columns, strict=True)
        ]
        return np.stack(parts, 1)

    def _part(self, whole: Any, group: VectorGroup) -> Any:
        return whole if len(self.venv.groups) == 1 else whole[group.name]
