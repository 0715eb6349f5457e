"""`gk.audit`: an environment that can be named runs in a process of its own."""

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from tempfile import mkstemp
from threading import Event, Timer
from typing import Any, Final

from gamekeeper.auditing.audit import BUDGET, QUICK, AuditAttempt, OnProbe, audit_here
from gamekeeper.auditing.gather import DIED, INTERRUPTED, MOST_DEATHS, TIME_UP
from gamekeeper.auditing.recorded_evidence import audit_run, is_run
from gamekeeper.auditing.result import AuditResult
from gamekeeper.checks.check import selected
from gamekeeper.checks.verdict import Verdict
from gamekeeper.contract import Contract
from gamekeeper.errors import EnvError, GamekeeperError
from gamekeeper.rollouts.worker_process import place
from gamekeeper.rollouts.workers import run_task
from gamekeeper.runs.worker_errors import error_of
from gamekeeper.terminal import say as say_on_stderr

TASK: Final = "gamekeeper.auditing.audit_process:audit_task"
SILENCE_S: Final = 120.0
"""A probe is given up after so long; its checks are not exercised, and it is named as hung."""
LATE_S: Final = 10.0
"""An audit is interrupted so long after the time that it was given: its environment hangs."""
HASH_SEED: Final = 0
"""PYTHONHASHSEED of the process, so that the same audit lists sets in the same order again."""


class AuditInterruptedError(KeyboardInterrupt):
    """An audit was interrupted by Ctrl-C; its `result` is what was known by then."""

    def __init__(self, result: AuditResult) -> None:
        super().__init__("the audit was interrupted")
        self.result = result


def audit(
    spec: object,
    *,
    contract: Contract | str | PathLike[str] | None = None,
    budget: int = BUDGET,
    quick: bool = False,
    seed: int = 0,
    select: Sequence[str] = (),
    ignore: Sequence[str] = (),
    env_kwargs: Mapping[str, Any] | None = None,
    seconds: float | None = None,
    silence_s: float = SILENCE_S,
    memory_bytes: int | None = None,
    on_probe: OnProbe | None = None,
    say: Callable[[str], None] = say_on_stderr,
) -> AuditResult:
    """Audits an environment against PettingZoo's contract, and its own where it has one.

    The folder of a run is judged as it was recorded, and nothing is played: see
    `gamekeeper.auditing.recorded_evidence.audit_run`.

    What is named by text runs in a process of its own, so that a crash or a hang is a finding; what
    is handed over as an object or a factory runs here. Verdicts repeat with the same seed and
    budget. What that process prints goes to a file, which the result names.

    Args:
        spec: where the environment comes from, or a run; of an object, what needs a second instance
            is *not exercised*.
        contract: what is declared; None: what lies beside the environment, if anything.
        budget: environment steps of the checks; the measured form has half as many on top, 5,000 at
            most.
        quick: a budget of 3,000 steps.
        seed: of the episodes; play k is reset with `seed + 1 + k`.
        select: only checks whose ids begin so; all where empty.
        ignore: but those whose ids begin so.
        env_kwargs: handed to the factory.
        seconds: wall time after which the audit ends with what it knows by then; None: no limit.
        silence_s: a probe that gives no sign of life for so long is given up.
        memory_bytes: bound of the process's memory.
        on_probe: called with a probe's name, its place and their number.
        say: takes a line on how much the environment's process printed and the file that holds it,
            also where the audit raises; by default it goes to standard error.
    Raises:
        SpecError: nothing can be opened under that name.
        ContractError: the contract doesn't fit the environment.
        EvidenceError: no check begins like `select` or `ignore`.
        EnvError: the environment's process ended again and again.
        AuditInterruptedError: by Ctrl-C, with what was known by then; an environment that runs here
            raises a plain KeyboardInterrupt.
    """
    if isinstance(spec, str | PathLike) and is_run(spec):
        return audit_run(spec, contract=contract, select=select, ignore=ignore)
    asked: dict[str, Any] = {
        "budget": QUICK if quick else budget,
        "seed": seed,
        "select": list(select),
        "ignore": list(ignore),
        "env_kwargs": dict(env_kwargs or {}),
        "seconds": seconds,
        "begun_s": time.monotonic(),
    }
    if not isinstance(spec, str):
        return audit_here(spec, contract=contract, attempt=AuditAttempt(on_probe=on_probe), **asked)
    asked["contract"] = _env_step(contract)
    try:
        with collected_prints(say) as prints:
            asked["prints"] = str(prints)
            result = _audited(spec, asked, silence_s, memory_bytes, on_probe)
    except AuditInterruptedError as interrupted:
        interrupted.result = _with_prints(interrupted.result, prints)
        raise
    return _with_prints(result, prints)


@contextmanager
def collected_prints(say: Callable[[str], None]) -> Iterator[Path]:
    """Yields a new file; says afterwards how much the environment printed there, and where it is.

    What Gamekeeper itself says there, in each of its processes, is said once and isn't counted. A
    file without a print of the environment's is removed.
    """
    file, name = mkstemp(prefix="gamekeeper-", suffix=".txt")
    os.close(file)
    path = Path(name)
    try:
        yield path
    finally:
        size, said = 0, dict[bytes, None]()
        with path.open("rb") as printed:
            for line in printed:
                if line.startswith(b"gamekeeper: "):
                    said[line] = None
                else:
                    size += len(line)
        for line in said:
            say(line.decode(errors="replace").rstrip())
        if size:
            say(f"note: the environment printed {size:,} bytes, which are in {path}")
        else:
            path.unlink()


def _with_prints(result: AuditResult, prints: Path) -> AuditResult:
    return replace(result, prints=str(prints)) if prints.exists() else result


def _audited(
    spec: str,
    asked: Mapping[str, Any],
    silence_s: float,
    memory_bytes: int | None,
    on_probe: OnProbe | None,
) -> AuditResult:
    """Tries until the process lives to the end; see `audit`."""
    died: dict[str, str] = {}
    value = None
    while value is None and len(died) <= MOST_DEATHS + 1:
        value = _tried(spec, asked, died, silence_s, memory_bytes, on_probe)
    if value is not None and (value.stopped != DIED or value.failed):
        return value
    raise EnvError(
        DIED,
        where=spec,
        actual="; ".join(f"{probe}: {said}" for probe, said in died.items()),
        fix="play it with `gamekeeper rollout`, which keeps what it did until it ended",
    )


def _tried(
    spec: str,
    asked: Mapping[str, Any],
    died: dict[str, str],
    silence_s: float,
    memory_bytes: int | None,
    on_probe: OnProbe | None,
) -> AuditResult | None:
    """One try in a process of its own; None where it died in a probe, which `died` then names."""
    current = ""

    def take(message: dict[str, Any]) -> None:
        nonlocal current
        current = message["probe"]
        if on_probe is not None:
            on_probe(current, message["place"], message["count"])

    with _ended_late(asked) as late:
        outcome = run_task(
            TASK,
            {"spec": spec, "died": dict(died), **asked},
            silence_s=silence_s,
            memory_bytes=memory_bytes,
            on_message=take,
            hash_seed=HASH_SEED,
            stop=late,
        )
    result = None
    if isinstance(outcome.value, dict):
        if outcome.value["error"] is not None:
            raise error_of(outcome.value["error"])
        result = AuditResult.from_json(outcome.value["audit"])
    if outcome.status == "interrupted":
        result = result or _nothing_known(spec, asked, outcome.seconds)
        if not late.is_set():
            raise AuditInterruptedError(result)
        return _without_time(result)
    if result is not None:
        return result
    if outcome.status == "raised" or not current or current in died:
        raise EnvError(
            f"the environment's process {outcome.status}: {outcome.error}",
            where=current or spec,
            actual=outcome.traceback or "",
            fix="see the traceback: the process ended, or ran out of time or memory",
        )
    where = place(outcome.traceback) if outcome.status == "died" else None
    died[current] = f"{outcome.status}: {outcome.error}{f' in {where}' if where else ''}"
    return None


@contextmanager
def _ended_late(asked: Mapping[str, Any]) -> Iterator[Event]:
    """Yields what is set where an audit goes on long after its time, as in a call that hangs."""
    late = Event()
    if asked["seconds"] is None:
        yield late
        return
    left_s = asked["begun_s"] + asked["seconds"] + LATE_S - time.monotonic()
    timer = Timer(max(left_s, LATE_S), late.set)  # a later try has to judge what is known
    timer.daemon = True
    timer.start()
    try:
        yield late
    finally:
        timer.cancel()


def _without_time(result: AuditResult) -> AuditResult:
    """The audit that was interrupted as its time was over, which is its reason then."""
    reason = f"{TIME_UP}, and its environment hadn't answered {LATE_S:g} s later"
    verdicts = (
        replace(each, reason=reason) if each.reason == INTERRUPTED else each
        for each in result.verdicts
    )
    return replace(result, verdicts=tuple(verdicts), stopped=reason)


def _nothing_known(spec: str, asked: Mapping[str, Any], seconds: float) -> AuditResult:
    """The audit that was interrupted before its process could answer: nothing was exercised."""
    checks = selected(tuple(asked["select"]), tuple(asked["ignore"]))
    verdicts = (
        Verdict(each.id, each.claim, "not_exercised", each.severity, reason=INTERRUPTED)
        for each in checks.values()
    )
    return AuditResult(
        environment=spec,
        api="",
        seconds=seconds,
        steps=0,
        seed=asked["seed"],
        verdicts=tuple(verdicts),
        stopped=INTERRUPTED,
    )


def _env_step(contract: Contract | str | PathLike[str] | None) -> Any:
    """A contract as it crosses to another process."""
    if contract is None or isinstance(contract, str):
        return contract
    return contract.to_json() if isinstance(contract, Contract) else fspath(contract)


def audit_task(
    report: Callable[..., None],
    *,
    spec: str,
    contract: Any,
    died: Mapping[str, str],
    prints: str | None,
    **options: Any,
) -> dict[str, Any]:
    """Audits in this process, which was started for it."""
    if prints is not None:
        file = os.open(prints, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        for stream in (1, 2):
            os.dup2(file, stream)

    def on_probe(name: str, place: int, count: int) -> None:
        report(probe=name, place=place, count=count)

    declared = Contract.from_json(contract) if isinstance(contract, dict) else contract
    try:
        attempt = AuditAttempt(died, on_probe, beat=report, keeps_partial=True)
        found = audit_here(spec, contract=declared, attempt=attempt, **options)
    except GamekeeperError as error:
        return {"error": error.to_json(), "audit": None}
    return {"error": None, "audit": found.to_json()}
