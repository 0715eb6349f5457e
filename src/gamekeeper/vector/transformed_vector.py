"""A vector environment whose arrays are changed for all sub-environments at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import TracebackType
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gamekeeper.errors import SpecError
from gamekeeper.vector.agents_as_envs import AgentsAsEnvs
from gamekeeper.vector.vector_environment import VectorEnv, batched
from gamekeeper.vector.vector_form import ALL, Space, VectorGroup, leaves

Columns: TypeAlias = "slice | NDArray[np.intp]"
"""Agents of the rows of observations: all of them, [agent]; of AEC environments, [env]."""
Flags: TypeAlias = NDArray[np.bool_]
EVERYBODY: slice = slice(None)


class BatchTransform:
    """Changes what agents are shown, do and are paid, in arrays; as it stands, nothing.

    Arrays belong to one group of agents, number g. Observations are [env, agent, ...], of an AEC
    environment [env, ...], of the agents in `columns`. Arrays that come in aren't written into.

    Attributes:
        remembers: it is handed what agents decided by, in `decided`.
    """

    remembers = False

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

    def rewards(self, g: int, rewards: Any, acted: Flags) -> Any:
        """Rewards [env, agent]; `acted` [env, agent], agents that made this step."""
        return rewards

    def observations(self, g: int, seen: Any, columns: Columns, lead: int) -> Any:
        """Observations as agents are shown them, in new arrays; `lead`: axes before their own."""
        return seen

    def final(self, g: int, seen: Any, env: int) -> Any:
        """Last observations [agent, ...] in one sub-environment, whose episode isn't forgotten."""
        return self.observations(g, seen, EVERYBODY, 1)

    def forget(self, envs: Flags) -> None:
        """Begins new episodes in these sub-environments."""

    def shown(self, g: int, seen: Any, there: Flags, columns: Columns) -> Any:
        """Observations likewise; rows that aren't `there` are blanked afterwards."""
        return self.observations(g, seen, columns, there.ndim)


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
        transform.bind(venv)
        groups: list[VectorGroup] = []
        for group in venv.groups:
            space = transform.observation_space(group)
            parts = tuple(leaves(space, f"observation_space({group.agents[0]!r})"))
            groups.append(replace(group, observation_space=space, observed=parts))
        self.groups: tuple[VectorGroup, ...] = tuple(groups)
        self.observation_space = batched(self.groups, "observation_space", venv.api, venv.num_envs)
        self._is_aec = venv.api == "aec"
        self._own = {group.name: group.columns for group in self.groups}

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
        self._note(infos)
        live = self._whole(infos["live"])
        return self._shown(obs, live), infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One step of every sub-environment; see `VectorEnv.step`."""
        transform, acting, columns = self.transform, self._acting, self._columns
        inside = self._by_group(transform.actions, actions)
        seen = copied(self._seen) if transform.remembers and not self.copies else self._seen
        obs, rewards, terminated, truncated, infos = self.venv.step(inside)
        if transform.remembers:
            for g, group in enumerate(self.groups):
                rows = self._rows(acting, columns, group)
                part = seen if group.name == ALL else seen[group.name]
                transform.decided(g, part, rows, self._places(columns, group))
        own = [acting[:, group.columns] for group in self.groups]
        paid = self._by_group(lambda g, part: transform.rewards(g, part, own[g]), rewards)
        self._show_finals(infos)
        before = self._episode
        self._note(infos)
        began = self._episode != before
        if began.any():
            transform.forget(began)
        there = self._whole(infos["live"])
        if not self._is_aec:  # where last observations are shown too
            ended = self._whole(terminated) | self._whole(truncated)
            there = there | (ended & ~began[:, None])
        return self._shown(obs, there), paid, terminated, truncated, infos

    def as_gymnasium(self, *, absent: str = "refuse") -> Any:
        """See `VectorEnv.as_gymnasium`."""
        return AgentsAsEnvs(self, absent=absent)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: object, trace: TracebackType | None
    ) -> None:
        self.venv.close()

    def __repr__(self) -> str:
        return f"<{type(self.transform).__name__} of {self.venv!r}>"

    # -- who is where

    def _note(self, infos: dict[str, Any]) -> None:
        """Notes what the next step is judged by: episodes, and agents that act in it."""
        self._episode = infos["episode"].copy()
        live = self._whole(infos["live"])
        self._columns: Any = EVERYBODY
        self._acting = live.copy()
        if self._is_aec:
            self._columns = infos["turn"].astype(np.intp)
            in_turn = np.arange(live.shape[1]) == self._columns[:, None]
            self._acting = live & in_turn

    def _whole(self, tree: Any) -> Any:
        """[env, agent] of all groups."""
        if self.groups[0].name == ALL:
            return tree
        return np.concatenate([tree[group.name] for group in self.groups], 1)

    def _rows(self, flags: Any, columns: Any, group: VectorGroup) -> Any:
        """Flags [env, agent] as observations of the group have their rows."""
        own = flags[:, group.columns]
        return own.any(1) if self._is_aec else own

    def _places(self, columns: Any, group: VectorGroup) -> Any:
        """Columns within the group; any where the agent in turn isn't of it."""
        if not self._is_aec:
            return columns
        return np.clip(columns - group.first, 0, len(group.agents) - 1)

    def _by_group(self, change: Any, tree: Any) -> Any:
        if self.groups[0].name == ALL:
            return change(0, tree)
        return {group.name: change(g, tree[group.name]) for g, group in enumerate(self.groups)}

    # -- what is shown

    def _shown(self, obs: Any, there: Flags) -> Any:
        self._seen = obs
        if self._is_aec:  # what the agent in turn is given
            there = there & (np.arange(there.shape[1]) == self._columns[:, None])

        def change(g: int, part: Any) -> Any:
            group = self.groups[g]
            rows = self._rows(there, self._columns, group)
            found = self.transform.shown(g, part, rows, self._places(self._columns, group))
            if found is not part and not rows.all():
                _blank(found, ~rows)
            return found

        return self._by_group(change, obs)

    def _show_finals(self, infos: dict[str, Any]) -> None:
        finals: Any = infos.get("final_obs")
        for e in np.flatnonzero(infos.get("_final_obs", ())).tolist():

            def change(g: int, part: Any, e: int = e) -> Any:
                found = self.transform.final(g, part, e)
                absent = [agent not in infos["final_info"][e] for agent in self.groups[g].agents]
                if found is not part and any(absent):
                    _blank(found, np.array(absent))
                return found

            finals[e] = self._by_group(change, finals[e])


def _blank(tree: Any, absent: Flags) -> None:
    """Writes zeros into rows."""
    if isinstance(tree, dict | tuple):
        for part in tree.values() if isinstance(tree, dict) else tree:
            _blank(part, absent)
        return
    tree[absent] = 0


def copied(tree: Any) -> Any:
    """The same tree of new arrays."""
    if isinstance(tree, dict):
        return {key: copied(part) for key, part in tree.items()}
    if isinstance(tree, tuple):
        return tuple(copied(part) for part in tree)
    return tree.copy()
