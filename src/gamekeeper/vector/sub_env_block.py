"""A block of copies in one process, stepped one after the other: what both APIs have in common.

Slot i of N plays the episodes i, i + N, i + 2N ... of the run, each from its own seed, so that who
steps which slots changes nothing.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeAlias

from gamekeeper.interface.capture import AgentId, Capture
from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.randomness.seeds import EpisodeSeeds
from gamekeeper.rollouts.interrupts import HeldInterrupt
from gamekeeper.vector.vector_form import Arrays, VectorForm, VectorGroup, built
from gamekeeper.vector.vector_rows import Batches, Recording, RowShelf, SlotSink

Autoreset: TypeAlias = Literal["same_step", "next_step"]
AUTORESETS: Final = ("same_step", "next_step")


@dataclass(slots=True)
class StepOutputs:
    """Outputs that no array holds: infos by env and agent, as they came.

    Attributes:
        infos: of this step, where they are asked for.
        final: of envs in which an agent ended in it: infos of the agents whose last observations
            stand in the arrays.
        read_final: the same, made as they are read; in place of `final`.
    """

    infos: dict[int, Mapping[AgentId, Any]] = field(default_factory=dict)
    final: dict[int, dict[AgentId, Any]] = field(default_factory=dict)
    read_final: Mapping[int, Mapping[AgentId, Any]] | None = None


class SubEnvBlock:
    """Copies of one environment that one process steps. Use `TickBlock` or `TurnBlock`."""

    def __init__(
        self,
        envs: Sequence[Any],
        arrays: Arrays,
        form: VectorForm,
        *,
        first: int,
        slots: int,
        autoreset: Autoreset,
        wants_infos: bool = False,
        after_env: Callable[[], None] | None = None,
    ) -> None:
        """Takes hold of the copies; nothing is called yet.

        Args:
            envs: an environment, or a capture of one, for each slot of this block.
            arrays: of these slots alone, by the names of `VectorForm.plan`.
            first: number of the first slot.
            slots: number of all slots of the run, N.
            wants_infos: infos are handed out at every step.
            after_env: called after each copy, as a sign of life.
        """
        self.envs, self.form, self.autoreset = list(envs), form, autoreset
        self._arrays, self._wants_infos = arrays, wants_infos
        self._first, self._slots, self._seeds = first, slots, EpisodeSeeds(0)
        self._episodes = [0] * len(self.envs)
        self._options: Any = None
        self._shelf: RowShelf | None = None
        self._after_env = after_env or (lambda: None)
        self._agents = form.agents
        self._column = {agent: place for place, agent in enumerate(self._agents)}
        self._count = len(self._agents)
        by_agent = form.api == "parallel"
        self._actions = [
            _reader(group, g, arrays, by_agent=by_agent) for g, group in enumerate(form.groups)
        ]
        self._group_of = [g for g, group in enumerate(form.groups) for _ in group.agents]

    def reset(self, seed: int, options: Any = None) -> StepOutputs:
        """Begins a run: every slot plays its first episode."""
        self._seeds, self._options = EpisodeSeeds(seed), options
        outputs = StepOutputs()
        for name in ("rewards", "terminated", "truncated", "over", "ended"):
            self._arrays[name][...] = 0
        for e in range(len(self.envs)):
            self._episodes[e] = self._first + e
            self._begin(e, outputs)
        self._pour()
        return outputs

    def record(self, recording: Recording, out: Callable[[Batches], None]) -> None:
        """Every copy's rows go to `out` from its next episode on."""
        self._shelf = recording.shelf(out)
        envs = [bare(env) for env in self.envs]
        self.envs = [capture_of(env, sink=SlotSink(self._shelf)) for env in envs]

    def end_recording(self) -> None:
        """Ends the episodes in progress, as *cut*; what is on the shelf goes out."""
        if self._shelf is not None:
            with HeldInterrupt():
                for env in self.envs:
                    env.end_episode()
                self._shelf.flush()

    def step(self) -> StepOutputs:
        """One step of every copy, with the actions that stand in the arrays."""
        raise NotImplementedError

    def _begin(self, e: int, outputs: StepOutputs) -> None:
        raise NotImplementedError

    def _pour(self) -> None:
        """Puts what was collected copy by copy into the arrays."""

    def _reset_env(self, e: int) -> Any:
        self._arrays["cursor"][0] = e
        self._arrays["episode"][e] = self._episodes[e]
        for g, group in enumerate(self.form.groups):
            if group.flags:  # of the episode before: no action of this one was forbidden by it
                self._arrays[f"mask.{g}"][e] = 0
        if self._shelf is not None:
            self.envs[e].episode = self._episodes[e] - 1  # its reset begins the next one
        seed = self._seeds[self._episodes[e]]
        if self._options is None:  # as who hands none over calls it
            return self.envs[e].reset(seed=seed)
        return self.envs[e].reset(seed=seed, options=self._options)

    def close(self) -> None:
        """Closes every copy."""
        for env in self.envs:
            env.close()


def bare(env: Any) -> Any:
    """The environment itself, without a capture around it."""
    return env.env if isinstance(env, Capture) else env


def put_mask(flags: Any, mask: Any) -> None:
    """Puts a mask into its row: in parts for MultiDiscrete; None: all is legal."""
    if mask is None:
        flags[...] = 1
    elif isinstance(mask, tuple | list) and len(mask) and hasattr(mask[0], "__len__"):
        flags[...] = [flag for part in mask for flag in part]
    else:
        flags[...] = mask


def _reader(
    group: VectorGroup, g: int, arrays: Arrays, *, by_agent: bool
) -> Callable[[], list[Any]]:
    """Function that reads a group's actions: [env] lists by agent, or that of the one in turn."""
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
