"""A kernel as a PettingZoo environment: one copy as a ParallelEnv or an AECEnv.

Books, errors, seeds and copies are those of `TickEnv` and `TurnEnv`; the rules are the kernel's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, ClassVar, Final, TypeAlias

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.contract import Ending, RewardTerm
from gamekeeper.interface.authoring import Authored, Snapshot
from gamekeeper.interface.tick_env import TickEnv
from gamekeeper.interface.turn_env import TurnEnv
from gamekeeper.kernels.array_views import leaves, tables_of
from gamekeeper.kernels.driver import ENDED, JOINED, PAID, SIGN_BITS, Single, single_of
from gamekeeper.kernels.kernel import MASK, Kernel
from gamekeeper.kernels.kernel_arrays import Arrays, arrays_of, bound, mapped
from gamekeeper.kernels.rule_parts import HORIZON, UNNAMED
from gamekeeper.randomness.stream import Stream

SIGN: Final = 1 << 63
SIGNS: Final = (1 << SIGN_BITS) - 1
NAMES: Final = {HORIZON: "horizon"}


class KernelRules(Authored):
    """Part that both APIs share: the kernel's state is the environment's state.

    Args:
        render_mode: one of metadata["render_modes"], or None.
        debug: the rules run as plain Python, for breakpoints in them.
    Attributes:
        memory: the state and the arrays of the one copy.
    """

    copy: ClassVar[Any] = False  # each observation is a new copy, of its space's type
    snapshot_without: ClassVar[Iterable[str]] = ("kernel", "single", "_tables", "number_of")

    def __init__(
        self, kernel: Kernel, *, render_mode: str | None = None, debug: bool = False
    ) -> None:
        super().__init__(render_mode=render_mode, horizon=kernel.horizon)
        self.kernel, self._tables = kernel, tables_of(kernel)
        self.single: Single = single_of(kernel, is_plain=debug)
        if kernel.metadata or "name" not in self.metadata:
            metadata = {"name": kernel.name, "render_modes": [], **kernel.metadata}
            self.metadata = metadata  # type: ignore[misc]  # each kernel has its own
        self.possible_agents = list(kernel.agents)
        self.number_of = {agent: i for i, agent in enumerate(self.possible_agents)}
        self.observation_spaces = {a: kernel.observation_of(a) for a in kernel.agents}
        self.action_spaces = {a: kernel.action_of(a) for a in kernel.agents}
        if kernel.state_space is not None:
            self.state_space: Any = kernel.state_space
        self.memory = copy_arrays_of(kernel)

    @property
    def tables(self) -> NDArray[Any]:
        """The rules' tables, an array of one record; others may be laid in their place."""
        return self._tables

    @tables.setter
    def tables(self, tables: NDArray[Any]) -> None:
        self._tables, self.memory.ties = tables, None

    def tied(self) -> Ties:
        """Functions that are called at a step, looked up anew."""
        self.memory.ties = Ties(self.kernel, self.single, self._tables, self.memory)
        return self.memory.ties

    def restore(self, snapshot: Snapshot) -> None:
        """Goes on from a snapshot, in the memory that is tied already."""
        own = self.memory
        super().restore(snapshot)
        own.take(self.memory)
        self.memory = own

    def __setstate__(self, state: Any) -> None:
        """A memory comes out of a pickle as bytes; whose they are the kernel knows."""
        for part in state if isinstance(state, tuple) else (state,):
            for name, value in (part or {}).items():
                object.__setattr__(self, name, value)
        if isinstance(self.memory, bytes):
            held, self.memory = self.memory, copy_arrays_of(self.kernel)
            self.memory.take(held)

    def known_sections(self) -> dict[str, Any]:
        """The kernel's terms, endings and horizon; of which kind they are, its rules alone know."""
        endings = dict.fromkeys(self.kernel.endings, Ending())
        if self.kernel.horizon is not None:
            endings[NAMES[HORIZON]] = Ending(kind="truncation", owner="all")
        terms = dict.fromkeys(self.kernel.terms, RewardTerm())
        return {**super().known_sections(), "rewards": terms, "endings": endings}

    # -- episodes

    def starting_agents(self) -> Iterable[Any]:
        """Agents that are live as the rules begin: they are asked first."""
        rng, memory = self.rng, self.memory
        seed = rng.seed - 2 * SIGN if rng.seed >= SIGN else rng.seed
        (memory.ties or self.tied()).start(seed, rng.episode)
        live = memory.arrays.live[0].tolist()
        return [agent for agent, is_live in zip(self.possible_agents, live, strict=True) if is_live]

    def start(self, rng: Stream, options: dict[str, Any]) -> None:
        """The first state is there already."""
        rng.draws, self._seed = int(self.memory.records["draws"][0]), rng.seed

    def _take_stream(self) -> None:
        """Hands the rules another stream, which somebody has put in the place of the episode's."""
        records, seed = self.memory.records, self.rng.seed
        records["seed"][0] = seed - 2 * SIGN if seed >= SIGN else seed
        records["draws"][0], records["block"][0] = self.rng.draws, -1
        self._seed = seed

    def stepped(self) -> None:
        """Plays the action in the arrays, and tells the books what came of it."""
        memory = self.memory
        if self.rng.seed != self._seed:
            self._take_stream()
        found = (memory.ties or self.tied()).play()
        self.rng.draws = found >> SIGN_BITS
        if not found & SIGNS:
            return
        agents, records, arrays = self.possible_agents, memory.records, memory.arrays
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
                        self.add_reward(agent, amount, name)
        if found & ENDED:
            self.end_agents(records["ending"][0].tolist())
        if found & (ENDED | JOINED):
            arrays.live[0] = records["live"][0]

    def end_agents(self, endings: list[int]) -> None:
        """Ends agents as the rules did, each for its reason."""
        arrays, agents = self.memory.arrays, self.possible_agents
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
        """Observation of an agent now."""
        return (self.memory.ties or self.tied()).obs[agent]()

    def info(self, agent: Any) -> dict[str, Any]:
        """Info of an agent by the rules."""
        info: dict[str, Any] = (self.memory.ties or self.tied()).infos[agent]()
        return info

    def state(self) -> Any:
        """The whole state, as the kernel's `overview` gives it."""
        if self.kernel.state_space is None:
            return super().state()  # type: ignore[misc]  # TickEnv and TurnEnv have it
        (self.memory.ties or self.tied()).overview()
        return self.memory.arrays.state[0].copy()

    def render(self) -> Any:
        """Returns None: a kernel has no picture of its own."""


class Masks:
    """Part of a kernel's environments that have a `mask`."""

    def mask(self, agent: Any) -> Any:
        """Mask of an agent's actions, 0 or 1 each."""
        row = (self.memory.ties or self.tied()).masks[agent]()  # type: ignore[attr-defined]  # KernelRules has it
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
        ties = self.memory.ties or self.tied()
        if ties.put is not None:
            for i, agent in enumerate(self.possible_agents):
                ties.put[i] = actions.get(agent, 0)
        else:
            for agent, action in actions.items():
                array, i = ties.doing[agent]
                array[0, i] = action
        self.stepped()


class KernelTurns(KernelRules, TurnEnv):
    """A kernel in which agents take turns, as an AECEnv."""

    def first_agent(self) -> Any:
        """Agent of the first turn, by the rules."""
        return self.possible_agents[int(self.memory.records["turn"][0])]

    def next_agent(self, agent: Any) -> Any:
        """Agent that acts next, by the rules."""
        return self.possible_agents[int(self.memory.records["turn"][0])]

    def act(self, agent: Any, action: Any) -> None:
        """One acts."""
        self.memory.arrays.actions[0] = action
        self.stepped()


class MaskedTicks(Masks, KernelTicks):
    """As `KernelTicks`, of a kernel with a `mask`."""


class MaskedTurns(Masks, KernelTurns):
    """As `KernelTurns`, of a kernel with a `mask`."""


def kernel_env(kernel: Kernel, *, debug: bool = False) -> Any:
    """One copy of a kernel as an AECEnv or ParallelEnv; pictures need a class on one of these."""
    kinds = (KernelTurns, MaskedTurns) if kernel.api == "aec" else (KernelTicks, MaskedTicks)
    return kinds[kernel.mask is not None](kernel, debug=debug)


__all__ = ["MASK", "KernelTicks", "KernelTurns", "MaskedTicks", "MaskedTurns", "kernel_env"]


Read: TypeAlias = Callable[[], Any]
"""Returns a new copy of what an agent is given now."""


class CopyArrays:
    """One copy's record and arrays; copied and pickled, its parts still belong together.

    Attributes:
        records: the state, an array of one record.
        ties: what an environment calls, once it has asked; never copied.
    """

    __slots__ = ("arrays", "records", "ties")

    def __init__(self, records: NDArray[Any], arrays: Arrays) -> None:
        """Takes what `arrays_of` made for one record."""
        self.records, self.arrays = records, bound(arrays, records)
        self.ties: Ties | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled it is bytes: twenty arrays one by one take ten times as long."""
        return bytes, (b"".join(part.tobytes() for part in leaves(self.arrays)),)

    def __deepcopy__(self, memo: dict[int, Any]) -> CopyArrays:
        return CopyArrays(self.records.copy(), mapped(self.arrays._replace(raw=None), _copied))

    def take(self, other: CopyArrays | bytes) -> None:
        """Becomes what another memory of the same kernel is, in its own memory."""
        if isinstance(other, bytes):
            first = 0
            for mine in leaves(self.arrays):
                found = np.frombuffer(other, mine.dtype, mine.size, first)
                mine[...] = found.reshape(mine.shape)
                first += mine.nbytes
            return
        for mine, its in zip(leaves(self.arrays), leaves(other.arrays), strict=True):
            mine[...] = its


def copy_arrays_of(kernel: Kernel) -> CopyArrays:
    """A memory before its first episode."""
    records = kernel.records(1)
    return CopyArrays(records, arrays_of(kernel, records))


def _copied(array: NDArray[Any] | None) -> NDArray[Any] | None:
    return None if array is None else array.copy()


class Ties:
    """Functions that are called at each step.

    Attributes:
        start, play, overview: of `Single`, with the arrays that they work on.
        put: where the actions of all agents stand, if each is one number and they share spaces.
        doing: by agent, the array of actions of its group, and its place there.
        obs, masks, infos: by agent, a function that returns its observation, mask or info.
    """

    __slots__ = ("doing", "infos", "masks", "obs", "overview", "play", "put", "start")

    def __init__(
        self, kernel: Kernel, single: Single, tables: NDArray[Any], memory: CopyArrays
    ) -> None:
        """Looks all of it up."""
        given = single.given(memory.records, tables, memory.arrays)
        self.start, self.play = partial(single.start, *given), partial(single.play, *given)
        self.overview = partial(single.overview, *given)
        is_aec, a = kernel.api == "aec", memory.arrays
        obs, masks, infos = (
            (a.final, a.final_masks, a.final_infos) if is_aec else (a.obs, a.masks, a.infos)
        )
        self.put: Any = None
        if not is_aec and isinstance(a.actions, np.ndarray) and a.actions.ndim == 2:
            self.put = memoryview(a.actions[0])
        self.doing: dict[str, tuple[Any, int]] = {}
        self.obs: dict[str, Read] = {}
        self.masks: dict[str, Read] = {}
        self.infos: dict[str, Read] = {}
        for g, group in enumerate(kernel.groups):
            is_one = len(kernel.groups) == 1
            mine = [part if is_one else part[g] for part in (a.actions, obs, masks)]
            for k in range(group.count):
                i = group.first + k
                agent = kernel.agents[i]
                before = partial(single.show_agent, *given, i) if is_aec else None
                self.doing[agent] = mine[0], k
                self.obs[agent] = _after(before, _viewer(group.observation_space, mine[1], k))
                self.masks[agent] = _after(before, mine[2][0, k].copy)
                self.infos[agent] = _after(before, _teller(kernel, infos, i))


def _after(before: Read | None, read: Read) -> Read:
    """`read`, once the rules have shown what an agent is given (of turns)."""
    if before is None:
        return read

    def after() -> Any:
        before()
        return read()

    return after


def _viewer(space: spaces.Space[Any], obs: Any, i: int) -> Read:
    """Function that returns an agent's own observation, out of arrays by copy and agent."""
    if isinstance(space, spaces.Dict):
        parts = {
            key: _viewer(part, getattr(obs, key), i)
            for key, part in space.spaces.items()
            if hasattr(obs, key)
        }
        return lambda: {key: read() for key, read in parts.items()}
    if space.shape:
        read: Read = obs[0, i].copy
        return read
    return partial(obs[0].__getitem__, i)


def _teller(kernel: Kernel, infos: NDArray[Any], i: int) -> Read:
    """Function that returns an agent's own info."""
    if not kernel.info:
        return dict
    parts: dict[str, Read] = {}
    for name in infos.dtype.names or ():
        field = infos[name][0]
        parts[name] = field[i].copy if field.ndim > 1 else field[i : i + 1].item
    return lambda: {name: read() for name, read in parts.items()}
