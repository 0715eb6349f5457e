"""`gk.audit`: whether an environment keeps its contract, and what breaks it."""

import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from os import PathLike
from typing import Any, Final

from gamekeeper.auditing.confirm import confirmed, confirming_workers
from gamekeeper.auditing.gather import INTERRUPTED, TIME_UP, Gathering, gather, session_of
from gamekeeper.auditing.judge import Judged, judge
from gamekeeper.auditing.measured_form import PROBES, measured
from gamekeeper.auditing.reproduce import Reproduction, draft_of
from gamekeeper.auditing.result import AuditResult, spaces_text
from gamekeeper.auditing.snippet import home
from gamekeeper.auditing.source import installed_modules, place_of, source_of
from gamekeeper.checks.check import Check, selected
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.contract import Contract
from gamekeeper.errors import EvidenceError
from gamekeeper.heartbeat import Wait
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.opening import Opened, open_env
from gamekeeper.rollouts.warm_worker import WarmWorker

BUDGET: Final = 20_000
"""Environment steps of an audit, unless told."""
QUICK: Final = 3_000
"""Environment steps of a quick audit."""
SHRINKING: Final = 0.25
"""Part of the budget that may be spent on top of it to shrink findings."""

PROBING: Final = 0.7
"""Part of the seconds after which the probes end; findings are shrunk for half the rest."""

OnProbe = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class AuditAttempt:
    """One try at an audit, as a process reports it.

    Attributes:
        died: probes in which the process of an earlier try ended, and what was said of it.
        on_probe: called with a probe's name, its place and their number.
        beat: called at every step, as a sign of life.
        keeps_partial: Ctrl-C ends the probes, and isn't raised.
    """

    died: Mapping[str, str] = field(default_factory=dict)
    on_probe: OnProbe | None = None
    beat: Callable[[], None] | None = None
    keeps_partial: bool = False


def audit_here(
    spec: object,
    *,
    contract: Contract | str | PathLike[str] | None = None,
    budget: int = BUDGET,
    seed: int = 0,
    select: Sequence[str] = (),
    ignore: Sequence[str] = (),
    env_kwargs: Mapping[str, Any] | None = None,
    seconds: float | None = None,
    begun_s: float | None = None,
    attempt: AuditAttempt = AuditAttempt(),
) -> AuditResult:
    """Audits in this process; see `gamekeeper.auditing.audit_process.audit`.

    `begun_s` is the time of the monotonic clock at which the audit began, where that was before
    this process did.
    """
    begun_s = time.monotonic() if begun_s is None else begun_s
    if budget < 1:
        raise _no_budget(budget)
    wanted = selected(tuple(select), tuple(ignore))
    kwargs, loaded = dict(env_kwargs or {}), set(sys.modules)
    opened = open_env(spec, **kwargs)
    workers: dict[int, WarmWorker] = {}
    try:
        declared = declared_contract(contract, opened)
        session = session_of(
            opened, declared, spec=spec, kwargs=kwargs, seed=seed, budget=budget, beat=attempt.beat
        )
        session.workers = workers
        gathering = gather(
            session,
            needed(wanted, is_all=not select),
            died=attempt.died,
            on_probe=attempt.on_probe or _nothing,
            until_s=None if seconds is None else begun_s + seconds * PROBING,
            keeps_partial=attempt.keeps_partial,
        )
        reproduction = Reproduction(
            gathering,
            declared or Contract(),
            home(opened.spec, opened.identity, kwargs),
            0 if gathering.stopped else int(budget * SHRINKING),
            None if seconds is None else begun_s + seconds * (1 + PROBING) / 2,
            place_of(source_of(opened.env)),
        )
        until_s = None if seconds is None else begun_s + seconds
        until_s = 0.0 if gathering.stopped == INTERRUPTED else until_s
        asked: dict[str, Any] = {"begun_s": begun_s, "seed": seed, "is_all": not select}
        modules = installed_modules(opened.env, loaded)
        judged = partial(_judged, wanted, opened, reproduction, modules=modules, **asked)
        try:
            return judged(until_s=until_s)
        except KeyboardInterrupt:
            if not attempt.keeps_partial:
                raise
        gathering.stopped, reproduction.steps_left = INTERRUPTED, 0
        return judged(until_s=0.0)
    finally:
        _close(opened, workers.values())


def _close(opened: Opened, workers: Iterable[WarmWorker]) -> None:
    for each in workers:
        each.close()
    if opened.make is not None:
        with suppress(Exception, SystemExit):  # one that raises is a finding of a check's
            opened.env.close()


def _no_budget(budget: int) -> EvidenceError:
    return EvidenceError(
        "the audit has no env step to play",
        where="budget",
        expected="1 step at least",
        actual=str(budget),
        fix="raise --budget (budget=)",
    )


def needed(wanted: Mapping[str, Check], *, is_all: bool) -> set[str]:
    """The probes that these checks read; where all are asked, also those of the measured form."""
    return {name for each in wanted.values() for name in each.needs} | set(PROBES if is_all else ())


def _judged(
    wanted: Mapping[str, Check],
    opened: Opened,
    reproduction: Reproduction,
    *,
    begun_s: float,
    seed: int,
    is_all: bool,
    until_s: float | None,
    modules: Sequence[str],
) -> AuditResult:
    gathering: Gathering = reproduction.gathering
    evidence = gathering.gathered()
    judging_s = time.perf_counter()
    wait = Wait()  # of hundreds of agents it takes minutes, and no env step shows life
    try:
        judged = [_in_time(each, reproduction, evidence, until_s) for each in wanted.values()]
        form = measured(reproduction.contract, evidence) if is_all else {}
    finally:
        wait.end()
    shrinking_s = time.perf_counter()
    beat = gathering.session.meter.beat or _nothing
    is_failed = any(each.outcome == "failed" for each in judged)
    with confirming_workers(
        modules, is_wanted=is_failed and bool(reproduction.home.make)
    ) as workers:
        drafts = [draft_of(each, reproduction) for each in judged]
        confirming_s = time.perf_counter()
        verdicts = confirmed(drafts, beat=beat, until_s=until_s, workers=workers)
    timings = {
        **gathering.seconds,
        "judging": shrinking_s - judging_s,
        "shrinking": confirming_s - shrinking_s,
        "confirming": time.perf_counter() - confirming_s,
    }
    return AuditResult(
        environment=opened.spec,
        api=opened.api,
        seconds=time.monotonic() - begun_s,
        steps=gathering.session.meter.steps,
        seed=seed,
        verdicts=verdicts,
        measured=form,
        timings=timings,
        agents={name: spaces_text(spec) for name, spec in gathering.session.agents.items()},
        declared=reproduction.contract.to_json() or None,
        source=source_of(opened.env),
        stopped=gathering.stopped,
    )


def _in_time(
    check: Check, reproduction: Reproduction, evidence: ProbeEvidence, until_s: float | None
) -> Judged:
    """The check's outcome; once the time is over, that of a check that wasn't run."""
    is_interrupted = reproduction.gathering.stopped == INTERRUPTED
    if until_s is not None and not is_interrupted and time.monotonic() > until_s:
        reproduction.gathering.stopped = TIME_UP
        return Judged(check, "not_exercised", reason=TIME_UP)
    return judge(check, reproduction.contract, evidence, reproduction.gathering.broken)


def _nothing(*args: Any) -> None:
    """Ignores progress."""
