"""`gamekeeper diagnose RUN`: the agent, and the part of it, that made a run fail."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from gamekeeper._version import __version__
from gamekeeper.cli._fan import players_of
from gamekeeper.cli._options import MOST, SILENCE_S, Accepted, Number
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.errors import GamekeeperError

if TYPE_CHECKING:
    from gamekeeper.diagnosis.diagnosis_result import Diagnosis

ORDER: Final = 90
EPISODES: Final = 2_000
EXPECTED: Final = 0.9
PART: Final = 0.7
"""Defaults of `gk.diagnose`; importing it loads numpy, help doesn't."""


def command(
    screen: Screen,
    run: Path,
    good: Path | None = None,
    failed: list[str] | None = None,
    contract: Path | None = None,
    env: str | None = None,
    policy: list[str] | None = None,
    try_: list[str] | None = None,
    expected: Annotated[float, Accepted(0.01, 1.0)] = EXPECTED,
    part: Annotated[float, Accepted(0.01, 1.0)] = PART,
    seed: int = 0,
    episodes: Annotated[int, Accepted(100, MOST)] = EPISODES,
    budget: int | None = None,
    perturbations: bool | None = None,
    workers: Annotated[int, Accepted(0, 4096)] | None = None,
    executor: str | None = None,
    out: Path | None = None,
    save_case: Path | None = None,
    shrink: Number | None = None,
    all_: bool = False,
    allow_import: bool = False,
    timeout: float = SILENCE_S,
) -> CommandResult:
    """Finds which agent, and which part of it, made a run fail.

    Plays the recorded environment and policies on new seeds: unchanged, with one thing made ideal
    (an ideal substitute, which can isolate a cause) and with one thing made worse (a perturbation,
    which shows dependence, never a cause). With --good, what differs from a run that worked is
    taken over one at a time, then in ever smaller sets; no knob is needed.

    Exit code 0: a cause is named, or the run fails no more often than chance allows. 1: a policy
    raised in new episodes. 2: no answer, or new episodes contradict the recorded ones and no
    change of them shows a cause; the reason is printed.

    Example: gamekeeper diagnose runs/warehouse-1 --failed "return < 3"

    Args:
        good (--good RUN): Run that worked: lists what differs, and finds the least set of
            differences that explains why RUN is worse (default: none).
        contract (--contract FILE): Contract of the environment (default: the one that was
            recorded).
        try_ (--try AGENT=POLICY): Policy that is tried in an agent's place, such as a checkpoint
            that worked, in the forms of --policy. Repeatable (default: the reference policy, if
            there is one, and those of others of its role, or with its spaces).
        expected (--expected SHARE): Share of episodes that succeed where nothing is wrong, from 0
            to 1.
        part (--part SHARE): Share of the gap to --expected that an ideal substitute must close to
            count as a cause, from 0 to 1.
        episodes (--episodes N): Most episodes that are played.
        perturbations (--perturbations/--no-perturbations): Play perturbations, which make one thing
            worse (default: if the run fails).
        workers (--workers N): Number of worker processes; 0 plays in this process (default: one per
            core).
        out (--out FOLDER): Folder of the episodes and counterfactuals; a second call continues
            there (default: RUN-diagnosis, with --good RUN-compared).
        save_case (--save-case FILE): Write a pytest case that plays the failure and its ideal
            substitute (default: no case).
        shrink (--shrink N): Only shorten failing episode N to the fewest turns and actions that
            still fail (default: diagnose the run).
        all_ (--all): Print everything that was played, what wasn't and why (default: the answer on
            one screen).
    """
    from gamekeeper.diagnosis.failure_causes import diagnose
    from gamekeeper.diagnosis.labels import propose
    from gamekeeper.interface.policy import parse_choices

    condition = only_condition(failed)
    folder = out or beside(run, "diagnosis" if good is None else "compared")
    opening: dict[str, Any] = {"failed": condition, "env": env, "allow_import": allow_import}
    if shrink is not None:
        return _shrunk(screen, run, shrink, folder, contract=contract, **opening)
    with (
        players_of(executor, workers_of(workers), asked=workers) as players,
        screen.progress("diagnosing") as take,
    ):
        found = diagnose(
            run,
            **opening,
            good=good,
            contract=contract,
            policies=parse_choices(policy) if policy else None,
            replace=parse_choices(try_) if try_ else None,
            expected=expected,
            part=part,
            seed=seed,
            episodes=episodes,
            budget=budget,
            perturbations=perturbations,
            workers=players,
            out=folder,
            timeout_s=timeout,
            on_message=take,
        )
    propose(run, found, by=f"gamekeeper diagnose {__version__}")
    kept = _options(contract, env, policy, try_, expected, part, seed, out, allow_import)
    screen.show(_text(found.to_json(), screen.width, run, folder if all_ else None, kept))
    _save(screen, found, run, save_case, condition)
    return CommandResult(found.to_json(), diagnosis_code(found))


def _options(
    contract: Path | None,
    env: str | None,
    policy: list[str] | None,
    try_: list[str] | None,
    expected: float,
    part: float,
    seed: int,
    out: Path | None,
    allow_import: bool,
) -> dict[str, Any]:
    """Options that the lines to paste keep, by their names; None for those at their defaults."""
    return {
        "--contract": contract,
        "--env": env,
        "--policy": policy,
        "--try": try_,
        "--expected": expected if expected != EXPECTED else None,
        "--part": part if part != PART else None,
        "--seed": seed or None,
        "--out": out,
        "--allow-import": allow_import,
    }


def workers_of(workers: int | None) -> int:
    """Number of worker processes: as asked, or one per core."""
    return (os.cpu_count() or 1) if workers is None else workers


def _text(
    document: dict[str, Any], width: int, run: Path, folder: Path | None, options: dict[str, Any]
) -> str:
    """The answer on one screen; everything, with the place of recordings, where there is one.

    Below it the recorded actions of `run` that are out of their space.
    """
    from gamekeeper.reporting.diagnosis_screen import diagnosis_screen
    from gamekeeper.reporting.diagnosis_text import diagnosis_text

    if folder is None:
        return diagnosis_screen(document, width=width, options=options) + outside_space(run, width)
    runs = f"\n\nRecordings  {folder / 'runs'}" if document["runs"] else ""
    return diagnosis_text(document, width=width) + runs + outside_space(run, width)


def outside_space(run: Path, width: int) -> str:
    """Recorded actions that are NaN or out of their space, by agent; empty where there are none."""
    from gamekeeper.auditing.recorded_evidence import outside_actions
    from gamekeeper.reporting.audit_text import outside_text
    from gamekeeper.runs.load_run import load

    text = outside_text(outside_actions(load(run)), width=width, of_audit=False)
    return f"\n\n{text}" if text else ""


def only_condition(conditions: list[str] | None) -> str | None:
    """The one condition of a failed episode that was given, if any."""
    if conditions and len(conditions) > 1:
        raise GamekeeperError(
            "an episode fails by one condition",
            where="--failed",
            expected="one",
            actual=" and ".join(map(repr, conditions)),
            fix='give the conditions of several agents in the contract: [failure] team = "...", '
            'picker = "..."',
        )
    return conditions[0] if conditions else None


def beside(run: Path, word: str) -> Path:
    """The folder beside a run that has its name and a word."""
    named = run if run.name else run.absolute()  # `.` has none
    return named.with_name(f"{named.name}-{word}")


def diagnosis_code(found: Diagnosis) -> int:
    """Returns 0: a cause is named, or nothing fails. 1: a policy raised. 2: no answer."""
    if found.raised:
        return 1
    answers = [*found.agents.values(), *([found.team] if found.team else [])]
    is_failing = any(each.success[2] < found.expected for each in answers)
    if found.differences is not None:
        return 0 if found.differences.least else 2
    if found.contradictions:  # what evidence alone says is no cause then
        return 0 if found.has_shown_cause else 2
    return 2 if is_failing and not found.has_cause else 0


def _save(screen: Screen, found: Any, run: Path, path: Path | None, failed: str | None) -> None:
    if path is None:
        return
    from gamekeeper.diagnosis.counterfactuals import case_text

    path.write_text(case_text(found, run, failed=failed), encoding="utf-8")
    screen.note(f"case written to {path}")


def _shrunk(
    screen: Screen, run: Path, episode: int, folder: Path, *, contract: Path | None, **options: Any
) -> CommandResult:
    from gamekeeper.contract import Contract
    from gamekeeper.diagnosis.shortest_failure import shrunk

    out = folder / f"shrunk-{episode}"
    declared = None if contract is None else Contract.load(contract)
    with screen.progress("shrinking") as take:
        found = shrunk(run, episode, contract=declared, out=out, on_message=take, **options)
    left, before = found.turns
    acts, acts_before = found.acts
    screen.show(
        f"Shrunk  episode {episode} of {run}, which still fails for {found.scope}\n"
        f"  turns    {left} of {before}\n  actions  {acts} of {acts_before} that aren't noops\n"
        f"  tried    {found.tries} reruns"
        + ("" if found.is_least else ", then stopped; a shorter failure may exist")
        + f"\n  evidence {out}"
    )
    return CommandResult({"run": str(run), **found.to_json(), "shortest_run": str(out)}, 0)
