"""The kernel engine: all copies in one batch, its rules compiled."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from itertools import compress
from typing import Any, Final, TypeAlias

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.encoder import Encoder
from gamekeeper.episodes.layout import Layout
from gamekeeper.errors import ActionError, SpecError
from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.blake2b import row_digests
from gamekeeper.kernels.kernel import MASK, Kernel, KernelGroup
from gamekeeper.kernels.kernel_env import KernelRules, KernelTurns
from gamekeeper.rollouts.interrupts import HeldInterrupt
from gamekeeper.vector.kernel_buffer import KernelBuffer, TickBuffer, TurnBuffer
from gamekeeper.vector.kernel_columns import KernelColumns
from gamekeeper.vector.sub_env_block import Autoreset, StepOutputs
from gamekeeper.vector.vector_form import VectorForm, VectorGroup
from gamekeeper.vector.vector_rows import FLUSH_S, Batches, Recording, never

# -- Recording: columns from the first to the last


class KernelRecorder:
    """Steps a batch and hands out its rows as they come."""

    def __init__(
        self,
        batch: Batch,
        recording: Recording,
        out: Callable[[Batches], None],
        *,
        layout: Layout,
        is_next: bool,
        in_turn_first: bool,
    ) -> None:
        """Takes a batch that hasn't begun.

        Args:
            out: takes streams and batches, each sorted by episode.
            is_next: copies begin their next episode in the step after.
            in_turn_first: of several that end together who would be in turn has its last turn
                first.
        """
        self.is_begun = self._is_compiled = False
        self._out = out
        self._options: str | None = None
        self._buffer: KernelBuffer = (
            TurnBuffer(batch, is_next=is_next, in_turn_first=in_turn_first)
            if batch.kernel.api == "aec"
            else TickBuffer(batch, is_next=is_next)
        )
        terms, volatile = recording.terms, recording.volatile
        self._columns = KernelColumns(self._buffer, layout, terms=terms, volatile=volatile)
        self._encoder = Encoder(layout, never, level=recording.level, hasher=row_digests)
        self._flushed_s = time.monotonic()

    def begin(self, options: Any) -> None:
        """The run has begun; `options` are those of its resets."""
        self.is_begun = True
        self._options = None if options is None else to_json(options)
        self._buffer.begin()

    def step(self) -> None:
        """One step of every copy.

        Raises:
            ActionError: an action isn't legal; nothing has changed.
        """
        buffer = self._buffer
        with HeldInterrupt() if self._is_compiled else nullcontext():  # who compiles can be stopped
            buffer.step()
            if buffer.filled == buffer.slots or time.monotonic() - self._flushed_s > FLUSH_S:
                self._flush(is_last=False)
        self._is_compiled = True

    def end(self) -> None:
        """The episodes in progress end as *cut*; the rest goes out."""
        if self.is_begun:
            with HeldInterrupt():
                self._flush(is_last=True)

    def _flush(self, *, is_last: bool) -> None:
        columns = self._columns.taken(options=self._options, is_last=is_last)
        self._buffer.carry()
        self._flushed_s = time.monotonic()
        self._out(list(self._encoder.encode_columns(columns).in_order()))


FIX: Final = "engine='serial' or 'process' steps it as it is"
BATCHED: Final = ("obs", "final", "action", "mask")

Info: TypeAlias = dict[str, Any]


def kernel_of(env: Any) -> Kernel:
    """The kernel whose batch gives what `env` gives.

    Raises:
        SpecError: it has none, or says why a batch wouldn't be the same.
    """
    if not isinstance(env, KernelRules):
        raise SpecError(
            "this environment has no kernel",
            where="engine",
            expected="rules that are written as a kernel, without anything around them",
            actual=f"{type(env).__module__}.{type(env).__qualname__}",
            fix=FIX,
        )
    reason = getattr(env, "not_batched", "")
    if reason:
        raise SpecError(
            f"the kernel of this environment plays it otherwise: {reason}",
            where="engine",
            expected="an environment that is its kernel alone",
            actual=reason,
            fix=FIX,
        )
    return env.kernel


def leaves_in_turn(env: Any) -> bool:
    """True where, of several that end together, the one due next has its last turn first."""
    kind = type(env)
    return isinstance(env, KernelTurns) and kind.first_to_leave is not KernelTurns.first_to_leave


class KernelEngine:
    """Steps all copies here, in a batch."""

    def __init__(
        self,
        kernel: Kernel,
        form: VectorForm,
        *,
        num_envs: int,
        autoreset: Autoreset,
        wants_infos: bool,
        layout: Layout,
        threads: int = 1,
        debug: bool = False,
        in_turn_first: bool = False,
    ) -> None:
        """Makes the batch.

        Args:
            wants_infos: infos are handed out at every step.
            layout: the columns of its evidence.
            in_turn_first: of several that end together who would be in turn has its last turn
                first.
        Raises:
            SpecError: agents of a role don't stand together in the kernel's list.
        """
        self.failed: Mapping[int, str] = {}
        self._kernel, self._form, self._wants_infos = kernel, form, wants_infos
        self._made: dict[str, NDArray[Any]] = {}
        self._places = _places(form, kernel)
        self._infos = Infos(kernel)
        self._options: dict[str, Any] = {"autoreset": autoreset, "debug": debug}
        if threads > 1:
            self._options["threads"] = threads
        self._size, self._layout, self._in_turn_first = num_envs, layout, in_turn_first
        # masks of agents that have just ended stand in the infos
        self._has_infos = wants_infos or self._is_masked_dict()
        self._batch = self._new_batch()
        self.arrays = self._by_form()
        self._recorder: KernelRecorder | None = None

    def _new_batch(self) -> Batch:
        return Batch(
            self._kernel, self._size, infos=self._has_infos, make=self._make, **self._options
        )

    def _is_masked_dict(self) -> bool:
        spaces_ = [group.observation_space for group in self._kernel.groups]
        return self._kernel.mask is not None and any(
            isinstance(space, spaces.Dict) and MASK in space.spaces for space in spaces_
        )

    def reset(self, seed: int, options: Any) -> StepOutputs:
        """Begins a run; a kernel has no options, so they are only recorded."""
        self._batch.reset(seed)
        if self._recorder is not None:
            self._recorder.begin(options)
        return self._outputs(is_reset=True)

    def step(self) -> StepOutputs:
        """One step of every copy.

        Raises:
            ActionError: the action of a live agent isn't legal; nothing has changed.
        """
        self._judge_boxes()
        if self._recorder is None:
            self._batch.step()
        else:
            self._recorder.step()
        return self._outputs(is_reset=False)

    def _judge_boxes(self) -> None:
        """Continuous actions of the living lie within their bounds; the batch looks at others."""
        arrays, is_aec = self.arrays, self._form.api == "aec"
        for g, group in enumerate(self._form.groups):
            space = group.action_space
            if not isinstance(space, spaces.Box):
                continue
            actions = arrays[f"action.{g}.0"]
            fits = (actions >= space.low) & (actions <= space.high)  # which NaN isn't
            fits = np.all(fits.reshape(self._size, 1 if is_aec else len(group.agents), -1), -1)
            acts = ~arrays["over"][:, None]
            if not is_aec:
                acts = acts & arrays["live"][:, group.columns]
            if (acts & ~fits).any():
                e, i = np.argwhere(acts & ~fits)[0].tolist()
                agent = self._form.agents[arrays["turn"][e] if is_aec else group.first + i]
                raise ActionError(
                    "an action isn't legal",
                    where=f"copy {e}, agent {agent!r}",
                    expected=f"one of {space}",
                    actual=str(actions[e] if is_aec else actions[e, i]),
                    fix="choose an action of the space that the mask allows",
                )

    def record(self, recording: Recording, out: Callable[[Batches], None]) -> None:
        """Every copy's rows go to `out` from its next episode on."""
        if not self._has_infos:
            self._has_infos = True
            self._made.clear()
            self._batch = self._new_batch()
            self.arrays = self._by_form()
        self._recorder = KernelRecorder(
            self._batch,
            recording,
            out,
            layout=self._layout,
            is_next=self._options["autoreset"] == "next_step",
            in_turn_first=self._in_turn_first,
        )

    def end_recording(self) -> None:
        """Ends the episodes in progress; the rest of the rows goes out."""
        if self._recorder is not None:
            self._recorder.end()

    def close(self) -> None:
        """There is nothing to close."""

    # -- arrays

    def _make(self, name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        array = self._made[name] = np.zeros(shape, dtype)
        return array

    def _by_form(self) -> dict[str, NDArray[Any]]:
        """The batch's arrays by the names of the plan; roles look into those of their kind."""
        plan = self._form.plan(self._size)
        found: dict[str, NDArray[Any]] = {}
        for name, shape, dtype in plan:
            kind, _, rest = name.partition(".")
            if kind not in BATCHED:
                array = self._made.get(name)
                found[name] = np.zeros(shape, dtype) if array is None else array
                continue
            g, _, leaf = rest.partition(".")
            k, first = self._places[int(g)]
            batched = self._made.get(f"{kind}.{k}.{leaf}" if leaf else f"{kind}.{k}")
            if batched is None or batched.shape[-1:] == (0,):  # a mask in a Dict, or given by rules
                found[name] = np.zeros(shape, dtype)
            elif batched.shape == shape:
                found[name] = batched
            else:
                found[name] = batched[:, first : first + shape[1]]
        return found

    # -- after a step

    def _outputs(self, *, is_reset: bool) -> StepOutputs:
        batch, arrays, outputs = self._batch, self.arrays, StepOutputs()
        arrays["episode"][...] = batch.records["number"]
        if self._wants_infos:
            self._put_infos(outputs, is_reset=is_reset)
        self._fill_masks()
        a = batch.arrays
        if is_reset:
            arrays["ended"][...] = False
        elif a.ended.any() or a.terminated.any() or a.truncated.any():
            ended = np.flatnonzero(a.ended | (a.terminated | a.truncated).any(1))
            self._fill_finals(ended)
            masks = [flags[ended] for flags in self._masks("final_mask")]
            outputs.read_final = KernelFinals(
                self._infos, ended, a.final_infos[ended], masks, a.last[ended]
            )
        return outputs

    def _fill_masks(self) -> None:
        """Masks within observations, and none for who isn't there."""
        arrays, is_aec = self.arrays, self._form.api == "aec"
        for g, group in enumerate(self._form.groups):
            if not group.flags:
                continue
            mask, leaf = arrays[f"mask.{g}"], _leaf_of_mask(group)
            live = ~arrays["over"] if is_aec else arrays["live"][:, group.columns]
            if self._kernel.mask is None:
                mask[...] = 1 if leaf is None else arrays[f"obs.{g}.{leaf}"]
                mask[~live] = 0
                continue
            if leaf is not None:
                arrays[f"obs.{g}.{leaf}"][...] = mask
            if (
                self._has_infos
                and not is_aec
                and (arrays["terminated"] | arrays["truncated"]).any()
            ):
                mask[~live] = 0

    def _fill_finals(self, ended: NDArray[np.intp]) -> None:
        """The last observations of those who had one; of turns others' stand there from before."""
        last = self._batch.arrays.last[ended]
        for g, group in enumerate(self._form.groups):
            rows, absent = np.nonzero(~last[:, group.columns])
            leaf, (k, first) = _leaf_of_mask(group), self._places[g]
            for i in range(len(group.observed)):
                final = self.arrays[f"final.{g}.{i}"]
                if i == leaf and self._kernel.mask is not None:
                    flags = self._made[f"final_mask.{k}"]
                    final[ended] = flags[ended, first : first + len(group.agents)]
                final[ended[rows], absent] = 0

    # -- infos, as its environments give them

    def _put_infos(self, outputs: StepOutputs, *, is_reset: bool) -> None:
        a = self._batch.arrays
        if self._form.api == "aec":
            goes_on = np.flatnonzero(~a.over)
            masks = [flags[goes_on] for flags in self._masks("mask")]
            rows = self._infos.of_turns(a.infos[goes_on], masks, a.turn[goes_on])
            outputs.infos.update(zip(goes_on.tolist(), rows, strict=True))
            return
        present = a.live.copy()
        if not is_reset:
            goes_on = ~a.ended | a.over  # the others show an episode that has just begun
            present[goes_on] |= (a.terminated | a.truncated)[goes_on]
        outputs.infos.update(enumerate(self._infos.of_all(a.infos, self._masks("mask"), present)))

    def _masks(self, kind: str) -> list[NDArray[Any]]:
        """The masks of each of the kernel's groups; none where it has none."""
        if self._kernel.mask is None:
            return []
        return [self._made[f"{kind}.{k}"] for k in range(len(self._kernel.groups))]


def _leaf_of_mask(group: VectorGroup) -> int | None:
    """Leaf of the observations that holds the mask."""
    paths = [leaf.path for leaf in group.observed]
    return paths.index((MASK,)) if (MASK,) in paths else None


def _places(form: VectorForm, kernel: Kernel) -> list[tuple[int, int]]:
    """For each group of the form the kernel's group that it is in, and its first place there.

    Raises:
        SpecError: agents of a role don't stand together in the kernel's list.
    """
    if form.agents != tuple(kernel.agents):
        raise SpecError(
            "agents of a role don't stand together",
            where="engine",
            expected=f"agents in this order: {list(form.agents)}"[:300],
            actual=str(list(kernel.agents))[:300],
            fix="name the kernel's agents role by role",
        )
    found = []
    for group in form.groups:
        for k, own in enumerate(kernel.groups):
            if own.first <= group.first < own.first + own.count:
                found.append((k, group.first - own.first))
    return found


# -- infos


class Infos:
    """Builds the infos of some copies at once: a list of each field first, dictionaries last."""

    def __init__(self, kernel: Kernel) -> None:
        self._kernel, self.agents = kernel, kernel.agents
        self._groups = [
            (k, group, i) for k, group in enumerate(kernel.groups) for i in range(group.count)
        ]

    def of_all(
        self, fields: NDArray[Any], masks: list[NDArray[Any]], present: NDArray[np.bool_]
    ) -> list[dict[Any, Info]]:
        """By copy: agent to info, of those who are present.

        Args:
            fields: [copy, agent] the fields of the kernel's infos.
            masks: of each group [copy, agent, flags]; empty without masks.
            present: [copy, agent].
        """
        names = self._kernel.agents
        columns = [
            self._rows(fields[:, a], group, masks[k][:, i] if masks else None)
            for a, (k, group, i) in enumerate(self._groups)
        ]
        rows = zip(*columns, strict=True)
        if present.all():
            return [dict(zip(names, row, strict=True)) for row in rows]
        return [
            dict(compress(zip(names, row, strict=True), there))
            for row, there in zip(rows, present.tolist(), strict=True)
        ]

    def of_turns(
        self, fields: NDArray[Any], masks: list[NDArray[Any]], turn: NDArray[Any]
    ) -> list[dict[Any, Info]]:
        """By copy: the agent in turn to its info; `fields` [copy], masks [copy, flags]."""
        rows = self._rows(fields, self._kernel.groups[0], masks[0] if masks else None)
        names = self._kernel.agents
        return [{names[a]: info} for a, info in zip(turn.tolist(), rows, strict=True)]

    def _rows(
        self, fields: NDArray[Any], group: KernelGroup, flags: NDArray[Any] | None
    ) -> list[Info]:
        columns: dict[str, list[Any]] = {}
        if self._kernel.info:
            columns = {name: _listed(fields[name]) for name in fields.dtype.names or ()}
        if flags is not None:
            columns[MASK] = _mask_values(flags, group.action_space)
        if not columns:
            return [{} for _ in range(len(fields))]
        names = tuple(columns)
        return [dict(zip(names, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _listed(values: NDArray[Any]) -> list[Any]:
    """Python's numbers, or arrays that share nothing with the batch."""
    return list(values.copy()) if values.ndim > 1 else list(values.tolist())


def _mask_values(flags: NDArray[Any], space: spaces.Space[Any]) -> list[Any]:
    rows = list(flags.copy())
    if not isinstance(space, spaces.MultiDiscrete):
        return rows
    cuts = np.cumsum(space.nvec)[:-1]
    return [tuple(np.split(row, cuts)) for row in rows]


class KernelFinals(Mapping[int, Mapping[Any, Info]]):
    """Last infos of copies in which an agent ended, each made as it is read.

    Args:
        envs: [row], the copies.
        fields: [row, agent], the fields of the kernel's infos.
        masks: of each group [row, agent, flags].
        last: [row, agent], agents that have a last observation.
    """

    def __init__(
        self,
        infos: Infos,
        envs: NDArray[np.intp],
        fields: NDArray[Any],
        masks: list[NDArray[Any]],
        last: NDArray[np.bool_],
    ) -> None:
        self._infos, self._envs, self._last = infos, envs, last
        self._fields, self._masks = fields, masks

    def __getitem__(self, env: int) -> Mapping[Any, Info]:
        (rows,) = np.nonzero(self._envs == env)
        if not len(rows):
            raise KeyError(env)
        masks = [flags[rows] for flags in self._masks]
        return self._infos.of_all(self._fields[rows], masks, self._last[rows])[0]

    def __iter__(self) -> Iterator[int]:
        return iter(self._envs.tolist())

    def __len__(self) -> int:
        return len(self._envs)

    def absent(self, agents: Sequence[Any]) -> NDArray[np.bool_]:
        """Returns where these agents have no last observation, [row, agent]."""
        names = list(self._infos.agents)
        return ~self._last[:, [names.index(agent) for agent in agents]]
