"""The process engine: copies shared out to workers, arrays in memory that all of them see.

Only what no array holds crosses as messages. Waiting is waiting for a message: nobody spins. A
worker's death or hang is named with the copy that it was stepping.
"""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any, Final

from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import from_json, to_json
from gamekeeper.episodes.exception_text import said_by
from gamekeeper.errors import SpecError
from gamekeeper.interface.construction import foreign_traceback
from gamekeeper.interface.opening import open_env
from gamekeeper.interface.slim import slim
from gamekeeper.rollouts.interrupts import HeldInterrupt
from gamekeeper.rollouts.worker_process import WorkerProcess
from gamekeeper.vector.serial_engine import block_of, failure
from gamekeeper.vector.sub_env_block import Autoreset, StepOutputs, SubEnvBlock
from gamekeeper.vector.vector_form import (
    SharedMemory,
    VectorForm,
    arrays_in,
    attached,
    form_of,
    part,
    size_of,
)
from gamekeeper.vector.vector_rows import Batches, Recording, from_text, to_text

TASK: Final = "gamekeeper.vector.process_engine:block_task"
TICK_S: Final = 0.1
"""Seconds between looks for an interrupt while a worker is silent."""
START_S: Final = 120.0
"""Seconds that building a worker's sub-environments may take without a sign of life."""
_OF_A_STEP: Final = ("obs.", "mask.", "live", "rewards", "terminated", "truncated", "ended")
"""Arrays that are zeros for copies that are gone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SubEnvs:
    """The sub-environments of a run, as every worker builds its share of them.

    Attributes:
        wants_infos: infos are handed out at every step.
    """

    spec: object
    kwargs: Mapping[str, Any]
    contract: Contract | None
    num_envs: int
    autoreset: Autoreset
    wants_infos: bool

    def to_json(self) -> dict[str, Any]:
        """Plain data, where `spec` is a text."""
        contract = None if self.contract is None else self.contract.to_json()
        plain = {field.name: getattr(self, field.name) for field in fields(self)}
        return {**plain, "kwargs": to_json(dict(self.kwargs)), "contract": contract}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> SubEnvs:
        """From plain data."""
        kwargs: Any = from_json(data["kwargs"])
        declared = data["contract"]
        contract = None if declared is None else Contract.from_json(declared)
        return cls(**{**data, "kwargs": kwargs, "contract": contract})


@dataclass(slots=True)
class _Worker:
    """One worker and the copies that it steps."""

    process: WorkerProcess
    first: int
    last: int
    is_gone: bool = False
    unanswered: int = 0
    """Number of unanswered messages; after Ctrl-C in the middle more than 0."""


class ProcessEngine:
    """Steps copies in processes of their own."""

    def __init__(
        self, envs: SubEnvs, form: VectorForm, *, workers: int, timeout_s: float, goes_on: bool
    ) -> None:
        """Starts the workers, and waits until each has built its copies.

        Raises:
            SpecError: the environment can't be named in another process.
            EnvError: a copy can't be built there.
        """
        if not isinstance(envs.spec, str):
            raise SpecError(
                "another process can't build what is in memory here",
                where="spec",
                expected="a text: module:factory, file.py:factory, or an id",
                actual=repr(envs.spec)[:200],
                fix="name the factory, or use engine='serial'",
            )
        self._form, plan = form, form.plan(envs.num_envs)
        self._shared = SharedMemory(size_of(plan))
        self.arrays = arrays_in(self._shared.memory, plan)
        self.failed: dict[int, str] = {}
        self._timeout_s, self._goes_on = timeout_s, goes_on
        self._workers: list[_Worker] = []
        self._out: Callable[[Batches], None] = lambda batches: None
        common = {"envs": envs.to_json(), "plan": plan, "fd": self._shared.fd}
        try:
            for first, last in _shares(envs.num_envs, min(workers, envs.num_envs)):
                with HeldInterrupt():  # a process that nobody knows of would stay
                    self._workers.append(self._started(first, last, common))
                    self._workers[-1].unanswered = 1
            self._gather(START_S)
        except BaseException:
            self.close()
            raise

    def _started(self, first: int, last: int, common: Mapping[str, Any]) -> _Worker:
        order = {
            "task": TASK,
            "arguments": {"first": first, "last": last, **common},
            "memory_bytes": None,
        }
        process = WorkerProcess(order, dict(os.environ), pass_fds=(self._shared.fd,))
        return _Worker(process, first, last)

    def reset(self, seed: int, options: Any) -> StepOutputs:
        """Begins a run in every worker."""
        self._tell({"do": "reset", "seed": seed, "options": to_json(options)})
        return self._gather(self._timeout_s)

    def step(self) -> StepOutputs:
        """One step of every copy."""
        self._tell({"do": "step"})
        return self._gather(self._timeout_s)

    def record(self, recording: Recording, out: Callable[[Batches], None]) -> None:
        """Every copy's rows go to `out` from its next episode on."""
        self._out = out
        self._tell({"do": "record", "recording": recording.to_json()})
        self._gather(self._timeout_s)

    def end_recording(self) -> None:
        """Ends the episodes in progress; the rest of the rows goes out."""
        self._tell({"do": "end_recording"})
        self._gather(self._timeout_s)

    def _tell(self, message: Mapping[str, Any]) -> None:
        """Tells every worker, once all have answered what an interrupt left unanswered."""
        self._gather(self._timeout_s)
        with HeldInterrupt():  # every worker gets the message, or none
            for worker in self._workers:
                if not worker.is_gone:
                    worker.unanswered += 1
                    worker.process.send(message)

    def _gather(self, timeout_s: float) -> StepOutputs:
        outputs = StepOutputs()
        for worker in self._workers:
            answer = None
            while worker.unanswered and not worker.is_gone:
                answer = self._answer(worker, timeout_s)
            if answer is None:
                continue
            for e, text in answer.get("infos", {}).items():
                outputs.infos[worker.first + int(e)] = _infos(text)
            for e, text in answer.get("final", {}).items():
                outputs.final[worker.first + int(e)] = _infos(text)
        return outputs

    def _answer(self, worker: _Worker, timeout_s: float) -> dict[str, Any] | None:
        """Answer of a worker; None where it is gone and the others go on."""
        last_s = time.monotonic()
        while True:
            has_ended = worker.process.has_ended()
            with HeldInterrupt():  # messages that were taken are dealt with, rows above all
                messages = worker.process.messages(0.0 if has_ended else TICK_S)
                last_s = time.monotonic() if messages else last_s
                answer = self._taken(worker, messages)
            if answer is not None or worker.is_gone:
                return answer
            if has_ended:
                code = worker.process.end()
                how = f"killed by signal {-code}" if code < 0 else f"exit code {code}"
                self._lose(worker, f"its process died: {how}", worker.process.dumped() or "")
                return None
            if time.monotonic() - last_s > timeout_s:
                stacks = worker.process.dump() or ""
                self._lose(worker, f"it gave no sign of life for {timeout_s:g} s", stacks)
                return None

    def _taken(self, worker: _Worker, messages: list[tuple[str, Any]]) -> dict[str, Any] | None:
        """The answer among messages, if it has come; rows go where they are recorded."""
        answer = None
        for kind, content in messages:
            if kind == "raised" or (kind == "report" and "error" in content):
                self._lose(worker, content["error"], content["traceback"])
                return None
            if kind == "report" and "rows" in content:
                self._out(from_text(content["rows"]))
            elif kind == "report":
                worker.unanswered -= 1
                answer = dict(content)
        return answer

    def _lose(self, worker: _Worker, how: str, traceback: str) -> None:
        """A worker is gone: that ends it all, or its copies alone.

        Raises:
            EnvError, ActionError: nobody asked to go on, or nobody is left; see `failure`.
        """
        e = worker.first + int(self.arrays["cursor"][worker.first])
        worker.is_gone = True
        worker.process.end()
        text = f"copy {e}: {how}"
        error = failure(
            self._form,
            self.arrays,
            e,
            text,
            traceback,
            where=f"env {e}, in the worker of envs {worker.first} to {worker.last - 1}",
            fix="step it alone to see more, or make with on_failure='go_on'",
        )
        self.failed |= dict.fromkeys(range(worker.first, worker.last), text)
        for name, array in part(self.arrays, slice(worker.first, worker.last)).items():
            if name.startswith(_OF_A_STEP):
                array[...] = 0
        if not self._goes_on or all(each.is_gone for each in self._workers):
            self.close()
            raise error

    def close(self) -> None:
        """Ends every worker; its copies are closed there first, unless Ctrl-C comes meanwhile."""
        try:
            for worker in self._workers:
                if not worker.is_gone:
                    worker.process.send({"do": "close"})
            for worker in self._workers:
                deadline = time.monotonic() + (0.0 if worker.is_gone else 5.0)
                while not worker.process.has_ended() and time.monotonic() < deadline:
                    worker.process.messages(0.01)
        finally:
            with HeldInterrupt():
                for worker in self._workers:
                    worker.is_gone = True
                    with worker.process:
                        pass
                self._workers = []
                self._shared.close()


def _infos(text: str) -> dict[Any, Any]:
    found: Any = from_json(text)
    return dict(found)


def _shares(count: int, workers: int) -> list[tuple[int, int]]:
    """Slots from first to before last, shared out as evenly as they can be."""
    bounds = [count * w // workers for w in range(workers + 1)]
    return list(pairwise(bounds))


# -- in a worker


def block_task(
    report: Any, *, envs: Mapping[str, Any], plan: list[Any], fd: int, first: int, last: int
) -> None:
    """Builds copies `first` to before `last`, and steps them at each message that asks for it."""
    memory = attached(fd, size_of(plan))
    os.close(fd)
    arrays = part(arrays_in(memory, plan), slice(first, last))
    copies = SubEnvs.from_json(envs)
    opened = open_env(copies.spec, **copies.kwargs)
    assert opened.make is not None
    stepped = [slim(opened.env)]
    for _ in range(last - first - 1):
        stepped.append(slim(opened.make()))
        report()
    out = opened.env.reset(seed=0)
    infos = out[1] if opened.api == "parallel" else opened.env.infos
    block = block_of(
        stepped,
        arrays,
        form_of(opened.env, opened.api, copies.contract, infos),
        first=first,
        slots=copies.num_envs,
        autoreset=copies.autoreset,
        wants_infos=copies.wants_infos,
        after_env=report,
    )
    gc.collect()
    gc.freeze()  # what is there stays: collections of what steps leave needn't look through it
    report(ready=True)
    while True:
        message = report.order()
        if message["do"] == "close":
            block.close()
            return
        _obey(report, block, message, copies.wants_infos)


def _obey(report: Any, block: SubEnvBlock, message: Mapping[str, Any], wants_infos: bool) -> None:
    try:
        if message["do"] == "reset":
            options: Any = from_json(message["options"])
            outputs = block.reset(message["seed"], options)
        elif message["do"] == "record":
            outputs = StepOutputs()
            recording = Recording.from_json(message["recording"])
            block.record(recording, lambda batches: report(rows=to_text(batches)))
        elif message["do"] == "end_recording":
            outputs = StepOutputs()
            block.end_recording()
        else:
            outputs = block.step()
    except Exception as error:  # the environment's; the process stays, its parent decides
        report(error=said_by(error), traceback=foreign_traceback(error))
        return
    final = {str(e): to_json(infos) for e, infos in outputs.final.items()}
    infos = {str(e): to_json(given) for e, given in outputs.infos.items()} if wants_infos else {}
    report(final=final, infos=infos)
