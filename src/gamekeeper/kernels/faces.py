"""The faces of a kernel towards PettingZoo: one copy as a ParallelEnv or an AECEnv.

Books, errors, seeds and copies are those of `TickEnv` and `TurnEnv`; the rules are the kernel's.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.core.stream import Stream
from gamekeeper.game.authoring.authored import Authored
from gamekeeper.game.tick_env import TickEnv
from gamekeeper.game.turn_env import TurnEnv
from gamekeeper.kernels.arrays import Arrays, arrays_of
from gamekeeper.kernels.kernel import MASK, Kernel
from gamekeeper.kernels.parts import HORIZON, UNNAMED
from gamekeeper.kernels.places import tables_of
from gamekeeper.kernels.single import ENDED, JOINED, PAID, Single, single_of

SIGN: Final = 1 << 63
NAMES: Final = {HORIZON: "horizon"}


class Bench:
    """One copy's record and arrays; copied and pickled, its parts still belong together."""

    __slots__ = ("arrays", "records")

    def __init__(self, records: NDArray[Any], arrays: Arrays) -> None:
        """Takes what `arrays_of` made for one record."""
        self.records, self.arrays = records, arrays

    def __reduce__(self) -> tuple[Any, ...]:
        return _bench, (self.records, self.arrays._replace(raw=None))

    def __deepcopy__(self, memo: dict[int, Any]) -> Bench:
        return _bench(self.records.copy(), _copied(self.arrays._replace(raw=None)))


def _bench(records: NDArray[Any], arrays: Arrays) -> Bench:
    return Bench(records, arrays._replace(raw=records.view(np.uint8).reshape(1, -1)))


def _copied(value: Any) -> Any:
    if isinstance(value, tuple):
        parts = [_copied(part) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return None if value is None else value.copy()


class KernelRules(Authored):
    """What both faces do: the kernel's state is the environment's, its arrays what agents see.

    Args:
        kernel: whose rules.
        render_mode: one of metadata["render_modes"], or None.
        debug: the rules run as plain Python, for breakpoints in them.

    Attributes:
        kernel: whose rules.
        bench: the state and the arrays of the one copy.
    """

    snapshot_without = ("kernel", "single", "tables", "number_of")

    def __init__(
        self, kernel: Kernel, *, render_mode: str | None = None, debug: bool = False
    ) -> None:
        super().__init__(render_mode=render_mode, horizon=kernel.horizon)
        self.kernel, self.tables = kernel, tables_of(kernel)
        self.single: Single = single_of(kernel, is_plain=debug)
        if kernel.metadata or "name" not in self.metadata:
            self.metadata = {"name": kernel.name, "render_modes": [], **kernel.metadata}
        self.possible_agents = list(kernel.agents)
        self.number_of = {agent: i for i, agent in enumerate(self.possible_agents)}
        self.observation_spaces = {a: kernel.observation_of(a) for a in kernel.agents}
        self.action_spaces = {a: kernel.action_of(a) for a in kernel.agents}
        if kernel.state_space is not None:
            self.state_space: Any = kernel.state_space
        records = np.zeros(1, kernel.dtype)
        self.bench = Bench(records, arrays_of(kernel, records))

    # -- episodes

    def starting_agents(self) -> Iterable[Any]:
        """Who lives as the rules begin: they are asked first."""
        rng, bench = self.rng, self.bench
        seed = rng.seed - 2 * SIGN if rng.seed >= SIGN else rng.seed
        self.single.start(bench.records, self.tables, bench.arrays, seed, rng.episode)
        live = bench.arrays.live[0].tolist()
        return [agent for agent, is_live in zip(self.possible_agents, live, strict=True) if is_live]

    def start(self, rng: Stream, options: dict[str, Any]) -> None:
        """The first state is there already."""
        rng.draws = int(self.bench.records["draws"][0])

    def crossed(self) -> None:
        """Plays the action in the arrays, and tells the books what came of it."""
        bench, agents = self.bench, self.possible_agents
        records, arrays = bench.records, bench.arrays
        found = self.single.play(records, self.tables, arrays)
        self.rng.draws = int(records["draws"][0])
        if not found:
            return
        if found & JOINED:
            live, was = records["live"][0].tolist(), arrays.live[0].tolist()
            for agent, is_live, was_live in zip(agents, live, was, strict=True):
                if is_live and not was_live:
                    self.join(agent)
        if found & PAID:
            names = self.kernel.terms
            for agent, paid in zip(agents, arrays.terms[0].tolist(), strict=True):
                for name, amount in zip(names, paid, strict=True):
                    if amount:
                        self.pay(agent, amount, name)
        if found & ENDED:
            self.told_ends(records["ending"][0].tolist())
        if found & (ENDED | JOINED):
            arrays.live[0] = records["live"][0]

    def told_ends(self, endings: list[int]) -> None:
        """Tells the books who ended, and why."""
        arrays, agents = self.bench.arrays, self.possible_agents
        for flags, end, unnamed in (
            (arrays.terminated, self.terminate, "terminated"),
            (arrays.truncated, self.truncate, "truncated"),
        ):
            if flags.any():
                for agent, is_ended, k in zip(agents, flags[0].tolist(), endings, strict=True):
                    if is_ended:
                        end(agent, self.ending_name(k, unnamed))

    def ending_name(self, k: int, unnamed: str) -> str:
        """The name of the k-th ending, counted from 1."""
        if k in NAMES:
            return NAMES[k]
        return unnamed if k == UNNAMED else self.kernel.endings[k - 1]

    # -- what is seen

    def observe(self, agent: Any) -> Any:
        """What an agent sees now."""
        obs, i = self.seen("obs", agent)
        return shown(self.observation_spaces[agent], obs, i)

    def info(self, agent: Any) -> dict[str, Any]:
        """What the rules tell an agent beside it."""
        if not self.kernel.info:
            return {}
        record = self.told("infos", agent)
        return {name: _plain(record[name]) for name in record.dtype.names}

    def state(self) -> Any:
        """The whole state, as the kernel's `overview` gives it."""
        if self.kernel.state_space is None:
            return super().state()  # type: ignore[misc]  # TickEnv and TurnEnv have it
        space: Any = self.kernel.state_space
        out = np.zeros(space.shape, space.dtype)
        self.single.overview(self.bench.records, self.tables, out)
        return out

    def render(self) -> Any:
        """Nothing: a kernel has no picture of its own."""

    def seen(self, kind: str, agent: Any) -> tuple[Any, int]:
        """The arrays of an agent's group, and its place in them."""
        arrays, i = getattr(self.bench.arrays, kind), self.number_of[agent]
        groups = self.kernel.groups
        if len(groups) == 1:
            return arrays, i
        for g, group in enumerate(groups):
            if i < group.first + group.count:
                return arrays[g], i - group.first
        raise KeyError(agent)

    def told(self, kind: str, agent: Any) -> Any:
        """An agent's record of an array by copy and agent."""
        return getattr(self.bench.arrays, kind)[0, self.number_of[agent]]


def shown(space: spaces.Space[Any], obs: Any, i: int) -> Any:
    """An agent's own observation, out of arrays by copy and agent."""
    if isinstance(space, spaces.Dict):
        return {
            key: shown(part, getattr(obs, key), i)
            for key, part in space.spaces.items()
            if hasattr(obs, key)
        }
    value = obs[0, i]
    return value.copy() if space.shape else np.asarray(value)[()]


def _plain(value: Any) -> Any:
    return value.item() if value.ndim == 0 else value.copy()


class Masks:
    """What faces of a kernel with a `mask` do besides."""

    def mask(self, agent: Any) -> Any:
        """Which actions an agent may take, 0 or 1 each."""
        flags, i = self.seen("masks", agent)  # type: ignore[attr-defined]  # KernelRules has it
        space = self.action_spaces[agent]  # type: ignore[attr-defined]  # likewise
        row = flags[0, i].copy()
        if not isinstance(space, spaces.MultiDiscrete):
            return row
        return tuple(np.split(row, np.cumsum(space.nvec)[:-1]))

    def illegal(self, agent: Any, action: Any) -> Any:
        """A masked action is played where the rules know what becomes of it."""
        space = self.action_spaces[agent]  # type: ignore[attr-defined]  # likewise
        if self.kernel.plays_illegal and space.contains(action):  # type: ignore[attr-defined]  # likewise
            return action
        raise self._refused(agent, action)  # type: ignore[attr-defined]  # likewise


class KernelTicks(KernelRules, TickEnv):
    """A kernel in which all act at once, as a ParallelEnv."""

    def tick(self, actions: dict[Any, Any]) -> None:
        """All act."""
        arrays, groups = self.bench.arrays.actions, self.kernel.groups
        if len(groups) == 1 and not groups[0].action_space.shape:
            get = actions.get
            arrays[0] = [get(agent, 0) for agent in self.possible_agents]
        else:
            for agent, action in actions.items():
                array, i = self.seen("actions", agent)
                array[0, i] = action
        self.crossed()


class KernelTurns(KernelRules, TurnEnv):
    """A kernel in which agents take turns, as an AECEnv."""

    def first_agent(self) -> Any:
        """Who begins, as the rules have it."""
        return self.possible_agents[int(self.bench.records["turn"][0])]

    def next_agent(self, agent: Any) -> Any:
        """Who acts next, as the rules have it."""
        return self.possible_agents[int(self.bench.records["turn"][0])]

    def act(self, agent: Any, action: Any) -> None:
        """One acts."""
        self.bench.arrays.actions[0] = action
        self.crossed()

    def seen(self, kind: str, agent: Any) -> tuple[Any, int]:
        """As of ticks, once the rules were asked what the agent is given."""
        i = self.number_of[agent]
        bench = self.bench
        self.single.look(bench.records, self.tables, bench.arrays, i)
        kinds = {"obs": "final", "masks": "final_masks"}
        return getattr(bench.arrays, kinds[kind]), i

    def told(self, kind: str, agent: Any) -> Any:
        """As of ticks, likewise."""
        i = self.number_of[agent]
        self.single.look(self.bench.records, self.tables, self.bench.arrays, i)
        return self.bench.arrays.final_infos[0, i]


class MaskedTicks(Masks, KernelTicks):
    """As `KernelTicks`, of a kernel with a `mask`."""


class MaskedTurns(Masks, KernelTurns):
    """As `KernelTurns`, of a kernel with a `mask`."""


def face_of(kernel: Kernel, *, render_mode: str | None = None, debug: bool = False) -> Any:
    """One copy of a kernel as an AECEnv or ParallelEnv.

    Args:
        kernel: whose rules.
        render_mode: None; who wants pictures writes a class on one of the faces, with `render`.
        debug: plain Python, for breakpoints in the rules.
    """
    kinds = (KernelTurns, MaskedTurns) if kernel.api == "aec" else (KernelTicks, MaskedTicks)
    return kinds[kernel.mask is not None](kernel, render_mode=render_mode, debug=debug)


__all__ = ["MASK", "KernelTicks", "KernelTurns", "MaskedTicks", "MaskedTurns", "face_of"]
