"""A block of copies in one process: Parallel environments stepped one after the other.

Slot i of N plays the episodes i, i + N, i + 2N ... of the run, each from its own seed, so that who
steps which slots changes nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeAlias

from gamekeeper.core.seeds import episode_seed
from gamekeeper.game.door import AgentId, Game
from gamekeeper.game.faces import game_of
from gamekeeper.vector.arrays import Arrays
from gamekeeper.vector.form import Form, Group, built, getter
from gamekeeper.vector.rows import Batches, Recording, Shelf, SlotSink

Autoreset: TypeAlias = Literal["same_step", "next_step"]
AUTORESETS: Final = ("same_step", "next_step")


@dataclass(slots=True)
class Said:
    """What no array holds: infos by env and agent, as they were given.

    Attributes:
        infos: of this step, where they are asked for.
        final: of those who ended in it, where their env is over.
    """

    infos: dict[int, Mapping[AgentId, Any]] = field(default_factory=dict)
    final: dict[int, dict[AgentId, Any]] = field(default_factory=dict)


class Block:
    """Copies of one environment that one process steps. Use `ParallelBlock` or `AECBlock`."""

    def __init__(
        self,
        doors: Sequence[Any],
        arrays: Arrays,
        form: Form,
        *,
        first: int,
        slots: int,
        autoreset: Autoreset,
        wants_infos: bool = False,
        after_env: Callable[[], None] | None = None,
    ) -> None:
        """Takes hold of the copies; nothing is called yet.

        Args:
            doors: an environment, or a game around one, for each slot of this block.
            arrays: of these slots alone, by the names of `Form.plan`.
            form: of all copies.
            first: number of the first slot.
            slots: number of all slots of the run, N.
            autoreset: when a copy that is over is reset.
            wants_infos: hand out what agents are told at every step.
            after_env: called after each copy, as a sign of life.
        """
        self.doors, self.form, self.autoreset = list(doors), form, autoreset
        self._arrays, self._wants_infos = arrays, wants_infos
        self._first, self._slots, self._seed = first, slots, 0
        self._episodes = [0] * len(self.doors)
        self._options: Any = None
        self._shelf: Shelf | None = None
        self._after_env = after_env or _nothing
        self._column = {agent: place for place, agent in enumerate(form.agents)}
        self._count = len(form.agents)
        by_agent = form.api == "parallel"
        self._actions = [
            _reader(group, g, arrays, by_agent=by_agent) for g, group in enumerate(form.groups)
        ]
        self._group_of = [g for g, group in enumerate(form.groups) for _ in group.agents]

    def reset(self, seed: int, options: Any = None) -> Said:
        """Begins a run: every slot plays its first episode."""
        self._seed, self._options = seed, options
        said = Said()
        for name in ("rewards", "terminated", "truncated", "over"):
            self._arrays[name][...] = 0
        for e in range(len(self.doors)):
            self._episodes[e] = self._first + e
            self._begin(e, said)
        return said

    def record(self, recording: Recording, out: Callable[[Batches], None]) -> None:
        """Every copy's rows go to `out` from its next episode on."""
        self._shelf = recording.shelf(out)
        envs = [bare(door) for door in self.doors]
        self.doors = [game_of(env, sink=SlotSink(self._shelf)) for env in envs]

    def end_recording(self) -> None:
        """Ends the episodes in progress, as *cut*; what is on the shelf goes out."""
        if self._shelf is not None:
            for door in self.doors:
                door.end_episode()
            self._shelf.flush()

    def step(self) -> Said:
        """One step of every copy, with the actions that stand in the arrays."""
        raise NotImplementedError

    def _begin(self, e: int, said: Said) -> None:
        raise NotImplementedError

    def _reset_door(self, e: int) -> Any:
        self._arrays["cursor"][0] = e
        if self._shelf is not None:
            self.doors[e].episode = self._episodes[e] - 1  # its reset begins the next one
        seed = episode_seed(self._seed, self._episodes[e])
        arguments: dict[str, Any] = {"seed": seed}
        if self._options is not None:
            arguments["options"] = self._options
        return self.doors[e].reset(**arguments)

    def close(self) -> None:
        """Closes every copy."""
        for door in self.doors:
            door.close()


class ParallelBlock(Block):
    """Copies of a Parallel environment."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """See `Block`."""
        super().__init__(*arguments, **options)
        self._put_obs = self._writers("obs")
        self._put_final = self._writers("final")
        self._mask_rows = self._masks_by_agent()
        self._envs = [bare(door) for door in self.doors]
        self._zeroed = [name for name in self._arrays if name.startswith(("obs.", "mask."))]

    def _writers(self, kind: str) -> list[list[tuple[AgentId, Callable[[Any], None]]]]:
        """For each slot, how an observation of each agent gets into its arrays."""
        return [
            [
                (agent, _writer(group, self._arrays, kind, g, e, a))
                for g, group in enumerate(self.form.groups)
                for a, agent in enumerate(group.agents)
            ]
            for e in range(len(self.doors))
        ]

    def _masks_by_agent(self) -> list[list[tuple[AgentId, Any, Any]]]:
        found: list[list[tuple[AgentId, Any, Any]]] = []
        for e in range(len(self.doors)):
            rows: list[tuple[AgentId, Any, Any]] = []
            for g, group in enumerate(self.form.groups):
                if group.flags:
                    mask = self._arrays[f"mask.{g}"]
                    rows += [
                        (agent, self.form.masks[agent], mask[e, a])
                        for a, agent in enumerate(group.agents)
                    ]
            found.append(rows)
        return found

    def _begin(self, e: int, said: Said) -> None:
        observations, infos = self._reset_door(e)
        self._clear(e)
        self._give(e, observations, infos, self._put_obs[e], self._envs[e].agents)
        if self._wants_infos:
            said.infos[e] = infos

    def step(self) -> Said:
        """One tick of every copy; a copy that is over begins anew, when `autoreset` says so."""
        said, arrays = Said(), self._arrays
        rewards, over = arrays["rewards"], arrays["over"]
        flags = arrays["terminated"], arrays["truncated"]
        paid: list[float] = []
        actions = self._tables()
        fresh = over.tolist()
        for flag in flags:
            flag[...] = False
        cursor, agents = arrays["cursor"], self.form.agents
        for e, env in enumerate(self._envs):
            cursor[0] = e
            if fresh[e]:  # next_step: this step resets, and no action is taken
                over[e] = False
                self._episodes[e] += self._slots
                self._begin(e, said)
                paid.extend([0.0] * self._count)
                continue
            live = env.agents
            row = actions[e]
            if len(live) == self._count:
                acted = dict(zip(agents, row, strict=True))
            else:
                acted = {agent: row[self._column[agent]] for agent in live}
            out = self.doors[e].step(acted)
            self._take(e, env, out, paid, said)
            self._after_env()
        rewards.flat[:] = paid
        return said

    def _take(self, e: int, env: Any, out: Any, paid: list[float], said: Said) -> None:
        """Puts what a tick gave into the arrays; `out` is what the environment returned."""
        observations, rewards, terms, truncs, infos = out
        live = env.agents
        ended = True in terms.values() or True in truncs.values()
        if len(rewards) == self._count and not ended:
            paid.extend([rewards[agent] for agent in self.form.agents])
        else:
            paid.extend([rewards.get(agent, 0.0) for agent in self.form.agents])
        if ended:
            self._note_ends(e, terms, truncs)
        is_over = not live or (ended and all(terms.get(a) or truncs.get(a) for a in live))
        if self._wants_infos:
            said.infos[e] = infos
        if is_over:
            said.final[e] = dict(infos)
            self._over(e, observations, infos, said)
            return
        if len(observations) != self._count or len(live) != self._count:
            self._clear(e)
        self._give(e, observations, infos, self._put_obs[e], live)

    def _note_ends(self, e: int, terms: Any, truncs: Any) -> None:
        column = self._column
        for name, flags in (("terminated", terms), ("truncated", truncs)):
            row = self._arrays[name][e]
            for agent, flag in flags.items():
                if flag:
                    row[column[agent]] = True

    def _over(self, e: int, observations: Any, infos: Any, said: Said) -> None:
        """The episode is over: its last observations, and in `same_step` the next one's first."""
        for g in range(len(self.form.groups)):
            for i in range(len(self.form.groups[g].observed)):
                self._arrays[f"final.{g}.{i}"][e] = 0
        for agent, put in self._put_final[e]:
            if agent in observations:
                put(observations[agent])
        self._arrays["over"][e] = self.autoreset == "next_step"
        self._clear(e)
        if self.autoreset == "same_step":
            self._episodes[e] += self._slots
            self._begin(e, said)
        else:
            self._give(e, observations, infos, self._put_obs[e], ())

    def _clear(self, e: int) -> None:
        for name in self._zeroed:
            self._arrays[name][e] = 0

    def _give(self, e: int, observations: Any, infos: Any, puts: Any, live: Any) -> None:
        if len(observations) == self._count:
            for agent, put in puts:
                put(observations[agent])
        else:
            for agent, put in puts:
                if agent in observations:
                    put(observations[agent])
        row = self._arrays["live"][e]
        if len(live) == self._count:
            row[...] = True
        else:
            row[...] = False
            for agent in live:
                row[self._column[agent]] = True
        for agent, find, flags in self._mask_rows[e]:
            mask = find(observations.get(agent), infos.get(agent))
            if mask is not None:
                put_mask(flags, mask)

    def _tables(self) -> list[list[Any]]:
        """The actions of each copy, agent by agent, as the spaces have them."""
        parts = [read() for read in self._actions]
        if len(parts) == 1:
            return parts[0]
        return [[action for part in row for action in part] for row in zip(*parts, strict=True)]


def bare(door: Any) -> Any:
    """The environment itself, without the game around it."""
    return door.env if isinstance(door, Game) else door


def put_mask(flags: Any, mask: Any) -> None:
    """Puts a mask into its row; that of a MultiDiscrete space may come in parts."""
    if isinstance(mask, tuple | list) and len(mask) and hasattr(mask[0], "__len__"):
        flags[...] = [flag for part in mask for flag in part]
    else:
        flags[...] = mask


def _writer(
    group: Group, arrays: Arrays, kind: str, g: int, e: int, a: int
) -> Callable[[Any], None]:
    """How an observation gets into row `e`, `a` of its arrays."""
    if len(group.observed) == 1 and not group.observed[0].path:
        array = arrays[f"{kind}.{g}.0"]
        if array.ndim == 2:

            def put_scalar(observation: Any) -> None:
                array[e, a] = observation

            return put_scalar
        view = array[e, a]

        def put(observation: Any) -> None:
            view[...] = observation

        return put
    parts = [
        (getter(leaf.path), arrays[f"{kind}.{g}.{i}"]) for i, leaf in enumerate(group.observed)
    ]

    def put_parts(observation: Any) -> None:
        for get, array in parts:
            array[e, a] = get(observation)

    return put_parts


def _reader(group: Group, g: int, arrays: Arrays, *, by_agent: bool) -> Callable[[], list[Any]]:
    """What reads a group's actions: [env] lists by agent, or the one of the agent in turn."""
    columns = [arrays[f"action.{g}.{i}"] for i in range(len(group.acted))]
    is_plain = len(group.acted) == 1 and not group.acted[0].path
    if is_plain and not group.acted[0].shape:
        return columns[0].tolist  # whole numbers, as every Discrete space takes them
    if is_plain:
        split = (lambda rows: list(rows)) if by_agent else (lambda rows: rows)
        return lambda: [split(rows) for rows in columns[0].copy()]
    space, count = group.action_space, len(group.agents)

    def read() -> list[Any]:
        own = [column.copy() for column in columns]
        envs = range(len(own[0]))
        if not by_agent:
            return [built(space, iter([each[e] for each in own])) for e in envs]
        return [
            [built(space, iter([each[e, a] for each in own])) for a in range(count)] for e in envs
        ]

    return read


def _nothing() -> None:
    """Nobody waits for a sign of life."""
