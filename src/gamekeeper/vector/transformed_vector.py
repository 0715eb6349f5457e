"""A vector environment whose arrays are changed for all sub-environments at once."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gamekeeper.errors import SpecError
from gamekeeper.vector.agents_as_envs import AgentsAsEnvs
from gamekeeper.vector.final_rows import FinalObs
from gamekeeper.vector.vector_environment import VectorEnv, batched
from gamekeeper.vector.vector_form import ALL, Space, VectorGroup, changed, clear, leaves

Columns: TypeAlias = "slice | NDArray[np.intp]"
"""Agents of the rows of observations: all of them, [agent]; of AEC environments, [env]."""
Flags: TypeAlias = NDArray[np.bool_]
EVERYBODY: slice = slice(None)


class BatchTransform:
    """Changes what agents are shown, do and are paid, in arrays; as it stands, nothing.

    Arrays belong to one group of agents, number g. Observations are [env, agent, ...], of an AEC
    environment [env, ...], of the agents in `columns`. Arrays that come in aren't written into.

    Attributes:
        remembers: decisions are handed to it, in `decided`.
        reads: there it is also handed the observations; else None.
        reuses: what it shows may be overwritten by the next step.
        shows: observations are changed, where a method of it changes any.
        lead: by group, axes of observations before their own.
    """

    remembers = reads = reuses = False
    shows = True
    lead: Sequence[tuple[int, ...]] = ()

    def bind(self, venv: Any) -> None:
        """Takes the vector environment that is wrapped."""

    def observation_space(self, group: VectorGroup) -> Space:
        """Space of what an agent of the group is shown."""
        return group.observation_space

    def begin(self) -> None:
        """Begins a run."""

    def actions(self, g: int, actions: Any) -> Any:
        """Actions that the sub-environments are given."""
        return actions

    def decided(self, g: int, seen: Any, deciding: Flags, columns: Columns) -> None:
        """Remembers decisions, once they are taken; `deciding`: rows of `seen` that are any."""

    def rewards(self, g: int, rewards: Any, acted: Flags | None) -> Any:
        """Rewards [env, agent]; `acted` [env, agent], if it remembers: who made the step."""
        return rewards

    def observations(self, g: int, seen: Any, columns: Columns, lead: tuple[int, ...]) -> Any:
        """Observations [*lead, ...] as agents are shown them."""
        return seen

    def final(self, g: int, seen: Any, envs: NDArray[np.intp], agents: int) -> Any:
        """Last observations [env, agent, ...] of these, whose episodes aren't forgotten yet."""
        return self.observations(g, seen, EVERYBODY, (len(envs), agents))

    def forget(self, envs: Flags) -> None:
        """Begins new episodes in these sub-environments."""

    def shown(self, g: int, seen: Any, there: Flags | None, columns: Columns) -> Any:
        """Observations likewise; rows that aren't `there` are blanked afterwards, None: all are."""
        return self.observations(g, seen, columns, self.lead[g])

    def overrides(self, *names: str) -> bool:
        """Tells whether one of these methods does anything."""
        return any(getattr(type(self), name) is not getattr(BatchTransform, name) for name in names)


class TransformedVector:
    """A vector environment seen through a transform; everything else is the environment's own."""

    def __init__(self, venv: Any, transform: BatchTransform) -> None:
        if not isinstance(venv, VectorEnv | TransformedVector):
            raise SpecError(
                "only a vector environment can be wrapped so",
                where=type(transform).__name__,
                expected="what gamekeeper.vector.make returns",
                actual=f"{type(venv).__module__}.{type(venv).__qualname__}",
                fix="wrap one environment by gamekeeper.wrappers",
            )
        self.venv: Any = venv
        self.transform = transform
        self.copies: bool = venv.copies  # these two are read at every step
        self.autoreset: str = venv.autoreset
        transform.reuses = not venv.copies
        own = (() if venv.api == "aec" else (len(group.agents),) for group in venv.groups)
        transform.lead = [(venv.num_envs, *agents) for agents in own]
        transform.bind(venv)
        self._shows = transform.shows and transform.overrides("observations", "shown")
        self._acts, self._pays = transform.overrides("actions"), transform.overrides("rewards")
        self._remembers = transform.remembers
        self._columns: Any = EVERYBODY
        self._acting: Any = None
        groups: list[VectorGroup] = []
        for group in venv.groups:
            space = transform.observation_space(group)
            parts = tuple(leaves(space, f"observation_space({group.agents[0]!r})"))
            groups.append(replace(group, observation_space=space, observed=parts))
        self.groups: tuple[VectorGroup, ...] = tuple(groups)
        self.observation_space = batched(self.groups, "observation_space", venv.api, venv.num_envs)
        self._is_aec, self._is_one = venv.api == "aec", self.groups[0].name == ALL

    def __getattr__(self, name: str) -> Any:
        if name == "venv" or name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.venv, name)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins a run; see `VectorEnv.reset`."""
        obs, infos = self.venv.reset(seed=seed, options=options)
        self.transform.begin()
        self._began = None
        self._note(infos)
        return self._shown(obs, self._live), infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One step of every sub-environment; see `VectorEnv.step`."""
        transform = self.transform
        if self._acts:
            actions = self._by_group(transform.actions, actions)
        acting, seen, columns = self._acting, None, self._columns
        if transform.reads:
            seen = self._seen if self.copies else changed(self._seen, np.copy)
        obs, rewards, terminated, truncated, infos = self.venv.step(actions)
        if self._remembers:
            self._decided(seen, acting, columns)
        if self._pays:
            rewards = self._paid(rewards, acting)
        if self._shows or self._remembers:
            obs = self._after(obs, terminated, truncated, infos)
        return obs, rewards, terminated, truncated, infos

    def _after(self, obs: Any, terminated: Any, truncated: Any, infos: dict[str, Any]) -> Any:
        """Shows what followed a step, last observations before episodes are forgotten."""
        if self._is_quiet and not ("final_obs" in infos or "failed" in infos):
            return self._shown(obs, None)
        over = infos["over"]
        over = over.copy() if np.count_nonzero(over) else None
        is_same = self.autoreset == "same_step"
        began, self._began = (over, None) if is_same else (self._began, over)
        if self._shows:
            self._show_finals(infos)
        if began is not None:
            self.transform.forget(began)
        self._note(infos)
        there = self._live
        if not self._is_aec and there is not None:  # where last observations are shown too
            ended = self._whole(terminated) | self._whole(truncated)
            there = there | (ended if began is None else ended & ~began[:, None])
        return self._shown(obs, there) if self._shows else obs

    def as_gymnasium(self, *, absent: str = "refuse") -> Any:
        """See `VectorEnv.as_gymnasium`."""
        return AgentsAsEnvs(self, absent=absent)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: object, traceback: TracebackType | None
    ) -> None:
        self.venv.close()

    def __repr__(self) -> str:
        return f"<{type(self.transform).__name__} of {self.venv!r}>"

    # -- who is where

    def _note(self, infos: dict[str, Any]) -> None:
        """Notes live agents, None where all are, and those that act in the next step."""
        live = self._whole(infos["live"])
        self._live = None if np.count_nonzero(live) == live.size else live
        if self._is_aec:
            self._columns = infos["turn"].astype(np.intp)
            self._live = self._acting = live & self._in_turn(live)
        elif self._remembers:
            self._acting = live.copy()  # which the next step may overwrite
        # all agents are live, and stay so for as long as there are no last observations of any
        self._is_quiet = self._live is None and self._began is None

    def _in_turn(self, live: Flags) -> Any:
        return np.arange(live.shape[1]) == self._columns[:, None]

    def _decided(self, seen: Any, acting: Any, columns: Any) -> None:
        for g, group in enumerate(self.groups):
            part = seen if group.name == ALL or seen is None else seen[group.name]
            rows = self._rows(acting, group)
            self.transform.decided(g, part, rows, self._places(columns, group))

    def _whole(self, tree: Any) -> Any:
        """[env, agent] of all groups."""
        if self._is_one:
            return tree
        return np.concatenate([tree[group.name] for group in self.groups], 1)

    def _rows(self, flags: Any, group: VectorGroup) -> Any:
        """Flags [env, agent] as observations of the group have their rows."""
        own = flags if self._is_one else flags[:, group.columns]
        return own.any(1) if self._is_aec else own

    def _paid(self, rewards: Any, acting: Any) -> Any:
        if self._is_one:
            return self.transform.rewards(0, rewards, acting if self._remembers else None)

        def change(g: int, part: Any) -> Any:
            own = acting[:, self.groups[g].columns] if self._remembers else None
            return self.transform.rewards(g, part, own)

        return self._by_group(change, rewards)

    def _places(self, columns: Any, group: VectorGroup) -> Any:
        """Columns within the group; any where the agent in turn isn't of it."""
        if not self._is_aec:
            return columns
        return np.clip(columns - group.first, 0, len(group.agents) - 1)

    def _by_group(self, change: Any, tree: Any) -> Any:
        if self._is_one:
            return change(0, tree)
        return {group.name: change(g, tree[group.name]) for g, group in enumerate(self.groups)}

    # -- what is shown

    def _shown(self, obs: Any, there: Flags | None) -> Any:
        """Observations as they are shown; `there`: None where all agents are."""
        self._seen = obs
        if not self._shows:
            return obs
        if there is None and self._is_one:
            return self.transform.shown(0, obs, None, self._columns)

        def change(g: int, part: Any) -> Any:
            group = self.groups[g]
            rows = None if there is None else self._rows(there, group)
            found = self.transform.shown(g, part, rows, self._places(self._columns, group))
            if rows is not None and not rows.all():
                clear(found, ~rows)
            return found

        return self._by_group(change, obs)

    def _show_finals(self, infos: dict[str, Any]) -> None:
        """Changes last observations, of all sub-environments that have any at once."""
        if "final_obs" not in infos:
            return
        finals, final_infos = infos["final_obs"], infos["final_info"]

        def change(g: int, part: Any) -> Any:
            agents = self.groups[g].agents
            found = self.transform.final(g, part, finals.envs, len(agents))
            absent = final_infos.absent(agents)
            if absent.any():
                clear(found, absent)
            return found

        infos["final_obs"] = FinalObs(len(finals), finals.envs, self._by_group(change, finals.tree))
