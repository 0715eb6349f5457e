"""The faces of a kernel towards PettingZoo: one copy as a ParallelEnv or an AECEnv.

Books, errors, seeds and copies are those of `TickEnv` and `TurnEnv`; the rules are the kernel's.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.core.stream import Stream
from gamekeeper.game.authoring.authored import Authored
from gamekeeper.game.authoring.snapshot import Snapshot
from gamekeeper.game.tick_env import TickEnv
from gamekeeper.game.turn_env import TurnEnv
from gamekeeper.kernels.bench import Ties, bench_of
from gamekeeper.kernels.kernel import MASK, Kernel
from gamekeeper.kernels.parts import HORIZON, UNNAMED
from gamekeeper.kernels.places import tables_of
from gamekeeper.kernels.single import ENDED, JOINED, PAID, SIGN_BITS, Single, single_of

SIGN: Final = 1 << 63
SIGNS: Final = (1 << SIGN_BITS) - 1
NAMES: Final = {HORIZON: "horizon"}


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

    snapshot_without: ClassVar[Iterable[str]] = ("kernel", "single", "_tables", "number_of")

    def __init__(
        self, kernel: Kernel, *, render_mode: str | None = None, debug: bool = False
    ) -> None:
        super().__init__(render_mode=render_mode, horizon=kernel.horizon)
        self.kernel, self._tables = kernel, tables_of(kernel)
        self.single: Single = single_of(kernel, is_plain=debug)
        if kernel.metadata or "name" not in self.metadata:
            self.metadata = {"name": kernel.name, "render_modes": [], **kernel.metadata}
        self.possible_agents = list(kernel.agents)
        self.number_of = {agent: i for i, agent in enumerate(self.possible_agents)}
        self.observation_spaces = {a: kernel.observation_of(a) for a in kernel.agents}
        self.action_spaces = {a: kernel.action_of(a) for a in kernel.agents}
        if kernel.state_space is not None:
            self.state_space: Any = kernel.state_space
        self.bench = bench_of(kernel)

    @property
    def tables(self) -> NDArray[Any]:
        """The rules' tables, an array of one record; others may be laid in their place."""
        return self._tables

    @tables.setter
    def tables(self, tables: NDArray[Any]) -> None:
        self._tables, self.bench.ties = tables, None

    def tied(self) -> Ties:
        """What is called at a step, looked up anew."""
        self.bench.ties = Ties(self.kernel, self.single, self._tables, self.bench)
        return self.bench.ties

    def restore(self, snapshot: Snapshot) -> None:
        """Goes on from a snapshot, in the memory that is tied already."""
        own = self.bench
        super().restore(snapshot)
        own.take(self.bench)
        self.bench = own

    def __setstate__(self, state: Any) -> None:
        """A bench comes out of a pickle as bytes; whose they are the kernel knows."""
        for part in state if isinstance(state, tuple) else (state,):
            for name, value in (part or {}).items():
                object.__setattr__(self, name, value)
        if isinstance(self.bench, bytes):
            held, self.bench = self.bench, bench_of(self.kernel)
            self.bench.take(held)

    # -- episodes

    def starting_agents(self) -> Iterable[Any]:
        """Who lives as the rules begin: they are asked first."""
        rng, bench = self.rng, self.bench
        seed = rng.seed - 2 * SIGN if rng.seed >= SIGN else rng.seed
        (bench.ties or self.tied()).start(seed, rng.episode)
        live = bench.arrays.live[0].tolist()
        return [agent for agent, is_live in zip(self.possible_agents, live, strict=True) if is_live]

    def start(self, rng: Stream, options: dict[str, Any]) -> None:
        """The first state is there already."""
        rng.draws = int(self.bench.records["draws"][0])

    def crossed(self) -> None:
        """Plays the action in the arrays, and tells the books what came of it."""
        bench = self.bench
        found = (bench.ties or self.tied()).play()
        self.rng.draws = found >> SIGN_BITS
        if not found & SIGNS:
            return
        agents, records, arrays = self.possible_agents, bench.records, bench.arrays
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
        return (self.bench.ties or self.tied()).seen[agent]()

    def info(self, agent: Any) -> dict[str, Any]:
        """What the rules tell an agent beside it."""
        told: dict[str, Any] = (self.bench.ties or self.tied()).told[agent]()
        return told

    def state(self) -> Any:
        """The whole state, as the kernel's `overview` gives it."""
        if self.kernel.state_space is None:
            return super().state()  # type: ignore[misc]  # TickEnv and TurnEnv have it
        (self.bench.ties or self.tied()).overview()
        return self.bench.arrays.state[0].copy()

    def render(self) -> Any:
        """Nothing: a kernel has no picture of its own."""


class Masks:
    """What faces of a kernel with a `mask` do besides."""

    def mask(self, agent: Any) -> Any:
        """Which actions an agent may take, 0 or 1 each."""
        row = (self.bench.ties or self.tied()).masks[agent]()  # type: ignore[attr-defined]  # KernelRules has it
        space = self.action_spaces[agent]  # type: ignore[attr-defined]  # likewise
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
        ties = self.bench.ties or self.tied()
        if ties.put is not None:
            for i, agent in enumerate(self.possible_agents):
                ties.put[i] = actions.get(agent, 0)
        else:
            for agent, action in actions.items():
                array, i = ties.doing[agent]
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
