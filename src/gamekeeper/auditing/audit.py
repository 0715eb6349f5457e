"""`gk.audit`: whether an environment keeps its contract, and what breaks it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from os import PathLike
from typing import Any, Final

from gamekeeper.auditing.gather import Gathering, gather, lab_of
from gamekeeper.auditing.judge import judge
from gamekeeper.auditing.measured import PROBES, measured
from gamekeeper.auditing.reproduce import Reproduction, verdict_of
from gamekeeper.auditing.result import AuditResult
from gamekeeper.auditing.snippet import home
from gamekeeper.auditing.source import source_of
from gamekeeper.checks.check import Check, selected
from gamekeeper.contract import Contract
from gamekeeper.episodes.agent_spec import AgentSpec
from gamekeeper.errors import EvidenceError
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.opening import Opened, open_env

BUDGET: Final = 20_000
"""Environment steps of an audit, unless told."""
QUICK: Final = 3_000
"""Environment steps of a quick audit."""
SHRINKING: Final = 0.25
"""Part of the budget that may be spent on top of it to shrink findings."""

OnProbe = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class AuditAttempt:
    """One try at an audit, as a process reports it.

    Attributes:
        died: probes in which the process of an earlier try ended, and what was said of it.
        on_probe: called with a probe's name, its place and their number.
        beat: called at every step, as a sign of life.
    """

    died: Mapping[str, str] = field(default_factory=dict)
    on_probe: OnProbe | None = None
    beat: Callable[[], None] | None = None


def audit_here(
    spec: object,
    *,
    contract: Contract | str | PathLike[str] | None = None,
    budget: int = BUDGET,
    seed: int = 0,
    select: Sequence[str] = (),
    ignore: Sequence[str] = (),
    env_kwargs: Mapping[str, Any] | None = None,
    attempt: AuditAttempt = AuditAttempt(),
) -> AuditResult:
    """Audits in this process; see `gamekeeper.auditing.audit_process.audit`."""
    begun_s = time.monotonic()
    if budget < 1:
        raise EvidenceError(
            "nothing can be seen",
            where="budget",
            expected="1 step at least",
            actual=str(budget),
            fix="raise --budget (budget=)",
        )
    wanted = selected(tuple(select), tuple(ignore))
    kwargs = dict(env_kwargs or {})
    opened = open_env(spec, **kwargs)
    try:
        declared = declared_contract(contract, opened)
        lab = lab_of(
            opened, declared, spec=spec, kwargs=kwargs, seed=seed, budget=budget, beat=attempt.beat
        )
        needs = needed(wanted, is_all=not select)
        on_probe = attempt.on_probe or _nothing
        gathering = gather(lab, needs, died=attempt.died, on_probe=on_probe)
        bench = Reproduction(
            gathering,
            declared or Contract(),
            home(opened.spec, opened.identity, kwargs),
            int(budget * SHRINKING),
        )
        return _judged(wanted, opened, bench, begun_s=begun_s, seed=seed, is_all=not select)
    finally:
        if opened.make is not None:
            with suppress(Exception):  # one that raises is a finding of a check's
                opened.env.close()


def needed(wanted: Mapping[str, Check], *, is_all: bool) -> set[str]:
    """The probes that these checks read; where all are asked, also those of the measured form."""
    return {name for each in wanted.values() for name in each.needs} | set(PROBES if is_all else ())


def _judged(
    wanted: Mapping[str, Check],
    opened: Opened,
    bench: Reproduction,
    *,
    begun_s: float,
    seed: int,
    is_all: bool,
) -> AuditResult:
    gathering: Gathering = bench.gathering
    evidence = gathering.gathered()
    judging_s = time.perf_counter()
    judged = [judge(each, bench.contract, evidence, gathering.broken) for each in wanted.values()]
    form = measured(bench.contract, evidence) if is_all else {}
    shrinking_s = time.perf_counter()
    verdicts = tuple(verdict_of(each, bench) for each in judged)
    timings = {
        **gathering.seconds,
        "judging": shrinking_s - judging_s,
        "shrinking": time.perf_counter() - shrinking_s,
    }
    return AuditResult(
        environment=opened.spec,
        api=opened.api,
        seconds=time.monotonic() - begun_s,
        steps=gathering.lab.meter.steps,
        seed=seed,
        verdicts=verdicts,
        measured=form,
        timings=timings,
        agents={name: _spaces(spec) for name, spec in gathering.lab.agents.items()},
        declared=bench.contract.to_json() or None,
        source=source_of(opened.env),
    )


def _spaces(spec: AgentSpec) -> dict[str, str]:
    """The spaces in words; what the environment didn't tell before the first reset is empty."""
    spaces = {"observation_space": spec.observation_space, "action_space": spec.action_space}
    return {name: "" if space is None else str(space) for name, space in spaces.items()}


def _nothing(name: str, place: int, count: int) -> None:
    """Ignores progress."""
