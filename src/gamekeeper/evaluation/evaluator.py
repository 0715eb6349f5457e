"""The front of evaluation: a specification in, results with their intervals and claims out."""

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import pyarrow as pa

from gamekeeper.episodes.plain_json import finite
from gamekeeper.errors import RunError
from gamekeeper.evaluation.comparisons import comparisons_of
from gamekeeper.evaluation.continuation import RESULT, document_in, settle_plan
from gamekeeper.evaluation.crossplay import CrossplayTable, crossplay_of
from gamekeeper.evaluation.episode_rows import NOT_FINITE, SUCCESS, Sheet, sheets_of
from gamekeeper.evaluation.estimates import Judge
from gamekeeper.evaluation.evaluation import Evaluation, marl_eval_of
from gamekeeper.evaluation.execution import SILENCE_S, EvaluationRun, InProcessExecutor
from gamekeeper.evaluation.inspection import Inspection
from gamekeeper.evaluation.matchups import SELF, Match, matches_of
from gamekeeper.evaluation.notes import claims_of, notes_of
from gamekeeper.evaluation.rankings import csv_of, payoffs_of, ranking_of
from gamekeeper.evaluation.results import Ground, curves_of, ground_of, overall_of, results_of
from gamekeeper.evaluation.spec import Spec, plain_of
from gamekeeper.evaluation.stopping import Stopping
from gamekeeper.evaluation.suites import (
    check_pins,
    command_of,
    fingerprint_of,
    refuse_copies,
    refuse_role_names,
    refuse_unpinned,
    spec_of,
)
from gamekeeper.evaluation.worker_tasks import EPISODES, folder_names
from gamekeeper.rollouts.executors import executor_of
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.executors.task import Executor, Limits


def evaluate(
    spec: object,
    /,
    *,
    policies: Mapping[str, Any] | None = None,
    episodes: int | None = None,
    seed: int | None = None,
    crossplay: bool | Mapping[str, Any] | None = None,
    env_kwargs: Mapping[str, Any] | None = None,
    contract: Any = None,
    record: str | None = None,
    out: str | PathLike[str] | None = None,
    storage: str | PathLike[str] | None = None,
    workers: int = 0,
    executor: str | Executor = "local",
    unpinned: bool = False,
    marl_eval: str | PathLike[str] | None = None,
    timeout_s: float | None = SILENCE_S,
    on_message: Callable[[dict[str, Any]], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> Evaluation:
    """Policies side by side on the same seeds, with intervals that claim no more than was seen.

    Every policy plays the same episodes, with the same random streams. Figures stand for the team,
    for roles whose agents are interchangeable and for every agent. The unit is the episode for a
    checkpoint, the training run for a method of several; agents of one episode are never a sample.

    Args:
        spec: a TOML file, a suite's name or id, plain data; else what opens an environment.
        policies: by name: a policy, policies by role, or a list of a method's training runs.
        episodes: that everybody plays.
        crossplay: every policy in every position with every partner; or its section as plain data.
        env_kwargs, contract: of an environment.
        record: `digest` or `full` records a run of every pairing.
        out: a folder for the raw episodes and the results; a second call goes on there, with more
            episodes or policies if asked, and is refused if results would be lost.
        storage: a folder or URL for parts and raw episodes, in place of `out`.
        workers: processes that play; 0: this one.
        executor: `local`, `ray`, `ray:ADDRESS`, or an executor.
        unpinned: goes on where what is installed isn't what a suite pins, and says so.
        marl_eval: a file for raw scores in marl-eval's layout.
        timeout_s: longest time without a turn in a worker.
        on_message: called with `{"episode", "episodes", "turns"}` as they are played.
        on_note: called with what was stale and why, and how much was played.
    Raises:
        SpecError: the specification, or an environment, can't be read or opened; or what is
            installed isn't what a suite pins.
        PolicyError: a policy can't be found.
        EvidenceError: what is asked for is no evidence, or cross-play has too many pairings.
        RunError: something else lies in `out`, or results that would be lost, or a file can't be
            written.
        EnvError: a worker process died or hung; what was played until then is kept.
    """
    changed: dict[str, Any] = {"episodes": episodes, "seed": seed, "crossplay": crossplay}
    places: dict[str, Any] = {"record": record, "env_kwargs": env_kwargs, "contract": contract}
    whole = spec_of(spec, policies=policies, **changed, **places)
    command = command_of(spec, whole, changed)
    note = on_note or (lambda text: None)
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory()) if out is None else out
        is_here = workers == 0 and executor == "local"
        if isinstance(executor, str):
            player = InProcessExecutor() if is_here else executor_of(executor, workers or None)
            stack.enter_context(player)
        else:
            player = executor
        limits, take = Limits(silence_s=timeout_s), on_message or (lambda fields: None)
        evaluation_run = EvaluationRun(
            whole, player, is_here, Storage.at(storage or folder), limits, take
        )
        found, grounds = _evaluated(whole, evaluation_run, note, unpinned=unpinned)
        found = replace(found, commands=() if command is None else (command,))
        text = json.dumps(finite(found.to_json()), indent=1, allow_nan=False) + "\n"
        evaluation_run.storage.put(RESULT, text.encode())
        if storage is not None and out is not None:
            Storage.at(out).put(RESULT, text.encode())
            Storage.at(out).put(EPISODES, evaluation_run.storage.get(EPISODES))
        if marl_eval is not None:
            _write(Path(marl_eval), json.dumps(marl_eval_of(whole, grounds), indent=1) + "\n")
    return Evaluation.from_json(finite(found.to_json()))


def _write(path: Path, text: str) -> None:
    """Writes raw scores, over earlier ones.

    Raises:
        RunError: they can't be written there.
    """
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RunError(
            "the raw scores can't be written",
            where=str(path)[:200],
            actual=error.strerror or str(error),
            fix="name a file in a folder that you may write to; with --out, nothing is played "
            "again",
        ) from None


def inspected(
    spec: object, *, timeout_s: float | None = SILENCE_S
) -> tuple[Spec, dict[str, Inspection]]:
    """A specification, and its environments and policies as they are installed here.

    Raises:
        SpecError: it can't be read, or an environment can't be opened.
        PolicyError: a policy can't be found.
    """
    whole = spec_of(spec)
    with tempfile.TemporaryDirectory() as folder, executor_of("local", 1) as player:
        limits = Limits(silence_s=timeout_s)
        run = EvaluationRun(whole, player, False, Storage.at(folder), limits, lambda fields: None)
        return whole, run.inspections()


def load_evaluation(folder: str | PathLike[str]) -> Evaluation:
    """The evaluation that a folder keeps.

    Raises:
        RunError: there is none.
        EvidenceError: the document there is another.
    """
    return Evaluation.from_json(document_in(Storage.at(folder)))


def _evaluated(
    spec: Spec, evaluation_run: EvaluationRun, note: Callable[[str], None], *, unpinned: bool
) -> tuple[Evaluation, list[Ground]]:
    """Plays what is missing and judges everything."""
    inspections = evaluation_run.inspections()
    refuse_copies(spec, inspections)
    refuse_role_names(spec, inspections)
    strange = check_pins(spec, inspections)
    if not unpinned:
        refuse_unpinned(spec, strange)
    matches = matches_of(spec, inspections, is_here=evaluation_run.is_here)
    for text in settle_plan(spec, inspections, matches, evaluation_run.storage):
        note(text)
    stopping = None if spec.stop is None else Stopping(spec, inspections)
    episodes, played = _played(spec, evaluation_run, matches, stopping)
    note(_progress_note(played, episodes * len(matches)))
    table, merged = evaluation_run.merge(matches, episodes)
    evidence = evaluation_run.keep(matches, episodes) if spec.record else []
    figures, grounds, judge = judged_of(spec, inspections, matches, table)
    stopped = None if stopping is None else stopping.to_json(episodes)
    _keep_payoffs(figures["crossplay"], evaluation_run.storage)
    _refuse_unrepeated(judge, evidence)
    notes = notes_of(
        spec,
        episodes=episodes,
        stopping=stopped,
        comparisons=figures["comparisons"],
        crossplay=figures["crossplay"],
        failures=failures_of(table),
        unpinned=strange,
        grounds=grounds,
    )
    figures["results"] = tuple(_with_sequences(figures["results"], stopped))
    figures["comparisons"] = tuple(figures["comparisons"])
    found = Evaluation(
        name=spec.name,
        suite=_suite(spec, inspections, strange),
        seed=spec.seed,
        level=spec.level,
        environments=_environments(spec, inspections),
        policies=_policies(spec, inspections),
        stopping=stopped,
        refused=tuple(judge.refused),
        claims=tuple(claims_of(figures["comparisons"])),
        notes=tuple(notes),
        episodes=episodes,
        fingerprint=merged["fingerprint"],
        evidence=tuple(evidence),
        spec=spec.to_json(),
        **figures,
    )
    return found, grounds


def judged_of(
    spec: Spec, inspections: Mapping[str, Inspection], matches: Sequence[Match], table: pa.Table
) -> tuple[dict[str, Any], list[Ground], Judge]:
    """Figures, intervals and comparisons over raw episodes; nothing is played or opened.

    Returns:
        The figures as an `Evaluation` has them, each environment's share, and the judge, which
        knows what was refused.
    """
    judge = Judge(spec.level, spec.seed)
    sheets = {
        key: replace(sheet, failed_return=spec.environments[key[0]].failed_return)
        for key, sheet in sheets_of(table).items()
    }
    grounds = _grounds(spec, inspections, matches, sheets)
    results = [row for ground in grounds for row in results_of(spec, ground, judge)]
    tables = _tables(spec, grounds, matches, sheets, judge)
    comparisons = comparisons_of(spec, grounds, tables, judge)
    figures: dict[str, Any] = {
        "results": results,
        "comparisons": comparisons,
        "curves": curves_of(spec, results),
        "crossplay": {name: _crossed(table, comparisons) for name, table in tables.items()},
        "overall": overall_of(spec, grounds, judge),
    }
    return figures, grounds, judge


def _keep_payoffs(crossed: Mapping[str, Mapping[str, Any]], storage: Storage) -> None:
    """Writes a CSV file of each environment's payoff matrix."""
    for name, each in crossed.items():
        if each["payoffs"] is not None:
            (file,) = folder_names([("payoffs", name)])
            storage.put(f"{file}.csv", csv_of(each["payoffs"]).encode())


def _crossed(table: CrossplayTable, comparisons: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The cross-play of an environment, with its payoffs, and a ranking where there is a cycle."""
    found = crossplay_of(table)
    mine = [row for row in comparisons if row["environment"] == table.ground.name]
    return {**found, "payoffs": payoffs_of(found), "ranking": ranking_of(mine)}


def _refuse_unrepeated(judge: Judge, evidence: Sequence[Mapping[str, Any]]) -> None:
    for row in evidence:
        if row["differs"]:
            judge.refuse(
                "recorded runs",
                f"{row['differs']} episodes came out otherwise when they "
                "were recorded: the environment or a policy doesn't repeat itself",
                f"{row['pairing']} in {row['environment']}",
            )


def _played(
    spec: Spec, evaluation_run: EvaluationRun, matches: Sequence[Match], stopping: Stopping | None
) -> tuple[int, int]:
    """Number of episodes that each policy has played, and of those of all that were missing."""
    played, last = evaluation_run.play(matches, 0, spec.episodes), spec.episodes
    if stopping is None or spec.stop is None:
        return last, played
    first = 0
    alone = [match for match in matches if match.pairing.kind == SELF]
    while True:
        table, _ = evaluation_run.merge(alone, last)
        for match in alone:
            sheet = sheets_of(_since(table, match, first))[match.environment, match.pairing.name]
            side = match.pairing.side
            assert side is not None, "a policy that plays by itself has one side"
            stopping.take(match.environment, side, sheet)
        if stopping.is_enough() or last >= spec.stop.most:
            return last, played
        first, last = last, min(last + spec.stop.every, spec.stop.most)
        played += evaluation_run.play(matches, first, last)


def _progress_note(played: int, whole: int) -> str:
    """Says how many episodes were played, and how many an earlier call had left."""
    if not played:
        return f"no episode was missing: {whole:,} were there already"
    already = f", {whole - played:,} were there already" if played < whole else ""
    return f"{played:,} episode{'' if played == 1 else 's'} played{already}"


def failures_of(table: pa.Table) -> list[str]:
    """Sentences on the episodes that an exception ended, by environment, policies and exception."""
    import pyarrow.compute as pc

    failed = table.filter(pc.is_valid(table["error"]))
    columns = ["environment", "pairing", "error", "episode", "turns"]
    places: dict[tuple[str, str, str], dict[int, int]] = {}
    for row in failed.select(columns).to_pylist():
        key = (row["environment"], row["pairing"], (row["error"].splitlines() or [""])[0][:200])
        places.setdefault(key, {})[row["episode"]] = row["turns"]
    found = []
    for (environment, pairing, error), turns in places.items():
        first = min(turns)
        count = "1 episode" if len(turns) == 1 else f"{len(turns)} episodes, the first"
        where = f"{count}: episode {first}"
        if not error.startswith(NOT_FINITE):
            where += f", turn {turns[first]}"
        found.append(f"{pairing} in {environment}, {where}: {error}")
    return found


def _since(table: pa.Table, match: Match, first: int) -> pa.Table:
    """The rows of one pairing from an episode on."""
    import pyarrow.compute as pc

    is_its = pc.and_(
        pc.equal(table["environment"], match.environment),
        pc.equal(table["pairing"], match.pairing.name),
    )
    return table.filter(pc.and_(is_its, pc.greater_equal(table["episode"], first)))


def _grounds(
    spec: Spec,
    inspections: Mapping[str, Inspection],
    matches: Sequence[Match],
    sheets: Mapping[tuple[str, str], Sheet],
) -> list[Ground]:
    found = []
    for name, inspection in inspections.items():
        pairings = [match.pairing for match in matches if match.environment == name]
        mine = [(pairing, sheets[name, pairing.name]) for pairing in pairings]
        found.append(ground_of(spec, name, inspection, mine))
    return found


def _tables(
    spec: Spec,
    grounds: Sequence[Ground],
    matches: Sequence[Match],
    sheets: Mapping[tuple[str, str], Sheet],
    judge: Judge,
) -> dict[str, CrossplayTable]:
    """Cross-play by environment; of those that have any."""
    found = {}
    for ground in grounds:
        mine = [match for match in matches if match.environment == ground.name]
        positions = next((match.positions for match in mine), ())
        if spec.crossplay.enabled and positions:
            pairings = [(each.pairing, sheets[ground.name, each.pairing.name]) for each in mine]
            found[ground.name] = CrossplayTable(spec, ground, positions, pairings, judge)
    return found


def _suite(
    spec: Spec, inspections: Mapping[str, Inspection], strange: Sequence[str]
) -> dict[str, Any] | None:
    if spec.suite is None:
        return None
    suite = {"id": spec.suite[0], "version": spec.suite[1]}
    return {**suite, "fingerprint": fingerprint_of(spec, inspections), "unpinned": list(strange)}


def _environments(spec: Spec, inspections: Mapping[str, Inspection]) -> dict[str, Any]:
    return {
        name: {
            "spec": plain_of(each.spec),
            "kwargs": plain_of(dict(each.kwargs)),
            "options": plain_of(each.options),
            "digest": inspections[name].digest,
            "version": inspections[name].version,
            "api": inspections[name].api,
            "roles": list(inspections[name].role_names),
            "agents": dict(inspections[name].roles),
        }
        for name, each in spec.environments.items()
    }


def _policies(spec: Spec, inspections: Mapping[str, Inspection]) -> dict[str, Any]:
    found = {}
    for name, policy in spec.policies.items():
        by_environment = {
            e: list(inspection.policies.get(name, ())) for e, inspection in inspections.items()
        }
        found[name] = {
            "runs": max((len(each) for each in by_environment.values()), default=0),
            "digests": list(dict.fromkeys(d for each in by_environment.values() for d in each)),
            "is_method": policy.is_method,
            "version": policy.version,
            "files": list(policy.files),
            "choices": [plain_of(dict(each)) for each in policy.runs],
            "by_environment": by_environment,
        }
    return found


def _with_sequences(
    rows: Sequence[dict[str, Any]], stopped: Mapping[str, Any] | None
) -> list[dict[str, Any]]:
    """The rows, with intervals that allow for stopping where it went by their figure."""
    if stopped is None:
        return list(rows)
    known = {(s["environment"], s["policy"], s["run"]): s for s in stopped["sequences"]}
    found = []
    for row in rows:
        sequence = known.get((row["environment"], row["policy"], row["run"]))
        if sequence is not None and row["who"] == stopped["who"]:
            bounds = {key: sequence[key] for key in ("low", "high")}
            if row["metric"] == stopped["metric"] and row["mean"] is not None:
                row = {**row, "mean": {**row["mean"], **bounds, "method": sequence["method"]}}
            if stopped["metric"] == SUCCESS and row["success"]:
                row = {**row, "success": {**row["success"], **bounds}}
        found.append(row)
    return found
