"""Expands a small run: its episodes are played again into full evidence, which is compared."""

import shutil
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.episodes.divergence import Divergence, compare_chunks
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import DivergenceError, EvidenceError, GamekeeperError, RunError
from gamekeeper.interface.env_source import Opened
from gamekeeper.interface.object_source import ASSUMED
from gamekeeper.interface.openings import GLOBALS, SameOpenings
from gamekeeper.rollouts.process_randomness import states
from gamekeeper.rollouts.workers import run_task
from gamekeeper.runs import own_runs
from gamekeeper.runs.comparison import SILENCE_S, untellable
from gamekeeper.runs.consent import consented, evidence_of
from gamekeeper.runs.files.folder import renamed_when_whole
from gamekeeper.runs.first_check import DIVERGED, NOT_CHECKED, PASSED
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recorder import RunRecorder
from gamekeeper.runs.replay_runner import ReplayRunner, check_named, opened_again
from gamekeeper.runs.worker_errors import error_in

TASK: Final = "gamekeeper.runs.expanding:expand_task"
FULL: Final = "full"
NOT_RESTORED: Final = ("volatile infos", "timings", "frames")
"""Parts of a run that playing it again can't give back."""
OWN_RULES: Final = ("own_run", "installed")
"""Rules of consent under which the expanded run counts as the user's own."""


def expand(
    run: str | PathLike[str] | Evidence,
    out: str | PathLike[str],
    *,
    env: str | None = None,
    allow_import: bool = False,
    timeout_s: float | None = SILENCE_S,
    on_message: Callable[[dict[str, Any]], None] | None = None,
) -> Evidence:
    """Plays a run of level `actions` or `digest` again into full evidence, verified on the way.

    Its rewards, flags and witnesses are compared with those of the new run; at level `actions`
    observations between witnesses aren't kept, and can't be. Where all is as it was, the
    fingerprint is the one that recording in full would have given. Volatile infos, timings and
    frames aren't restored.

    Args:
        run: the folder of the run, or evidence that was loaded from one.
        out: the folder of the full run; it doesn't exist yet, or is empty.
        env: its name, opened in place of the environment that the evidence names.
        allow_import: open what the evidence names even where it is a file or a module outside the
            installed packages.
        timeout_s: longest time without a turn.
        on_message: called with `{"episode", "episodes"}` as they are done.
    Raises:
        DivergenceError: it came out otherwise; nothing is left in `out`.
        TrustError: the evidence names code that the user hasn't allowed to run.
        EvidenceError: the run is full already, or can't be played again.
        EnvError: the environment hangs, or ended its process.
        RunError: there is no run, it is damaged, or `out` can't be written.
    """
    check_named(env)
    evidence = evidence_of(run)
    _check_small(evidence, env)
    with renamed_when_whole(Path(out)) as draft:
        _expand_into(draft, evidence, env, allow_import, timeout_s, on_message)
    return load(out)


def _expand_into(
    draft: Path,
    evidence: Evidence,
    env: str | None,
    allow_import: bool,
    timeout_s: float | None = SILENCE_S,
    on_message: Callable[[dict[str, Any]], None] | None = None,
) -> None:
    """Plays `evidence` again, recorded in full at `draft`, and compares both."""
    with consented(
        evidence, doing="expanding this run", env=env, allow_import=allow_import
    ) as consent:
        arguments = {"path": str(evidence.path), "out": str(draft), "env": env}
        outcome = run_task(TASK, arguments, silence_s=timeout_s, on_message=on_message)
    error = error_in(outcome)
    if error is not None:
        raise error
    whole = load(draft)
    if consent.rule not in OWN_RULES:
        own_runs.forget(whole.root)
    divergence = first_divergence(evidence, whole)
    if divergence is not None:
        raise _otherwise(evidence, divergence)


def whole_evidence(
    run: str | PathLike[str] | Evidence, *, env: object | None = None, allow_import: bool = False
) -> Evidence:
    """The evidence of a run; of one of level `actions` its expansion, kept in the user's cache.

    Raises:
        GamekeeperError: as `expand`.
    """
    evidence = evidence_of(run)
    if evidence.manifest.get("level") != "actions":
        return evidence
    if evidence.root is None:
        raise EvidenceError(
            "a run that isn't finalized isn't expanded",
            where=str(evidence.path or "in memory"),
            fix="gamekeeper recover RUN finalizes it; or wait until its recorder has closed it",
        )
    place = own_runs.user_folder("CACHE", ".cache", "Caches") / "expanded" / evidence.root
    kept = _kept_expansion(place)
    if kept is None:
        name = env if isinstance(env, str) else None
        try:
            with renamed_when_whole(place, mode=0o700) as draft:  # private, whatever the umask
                _expand_into(draft, evidence, name, allow_import)
        except RunError:  # where another process was first, its expansion is the same
            kept = _kept_expansion(place)
            if kept is None:
                raise
        else:
            kept = load(place)
    return replace(kept, small=evidence.path)


def _kept_expansion(place: Path) -> Evidence | None:
    """The user's own whole expansion at `place`; None where there is none, or it was damaged."""
    if not (place.exists() and own_runs.is_private(place)):
        return None
    with suppress(RunError):
        kept = load(place)
        if kept.root is not None:
            return kept
    shutil.rmtree(place)
    return None


def first_divergence(small: Evidence, whole: Evidence) -> Divergence | None:
    """The first place where a run differs from its expansion; None where there is none."""
    volatile = small.contract.volatile_infos()
    for header, again in zip(small.headers, whole.headers, strict=True):
        found = compare_chunks(
            small.chunks(header), whole.chunks(again), known=small.extent(header), volatile=volatile
        )
        if found.divergence is not None:
            return found.divergence
        for field in ("seed", "options"):
            if header[field] != again[field]:
                return Divergence(header["episode"], None, None, field, header[field], again[field])
    return None


def _check_small(evidence: Evidence, env: str | None) -> None:
    """Raises where a run is full, in memory alone, or can't be played again."""
    level, where = evidence.manifest.get("level"), str(evidence.path or "in memory")
    if level == FULL or evidence.path is None:
        raise EvidenceError(
            "there is nothing to expand",
            where=where,
            expected="a run of level actions or digest, in a folder",
            actual=f"level {level}",
            fix="use the run as it is",
        )
    reason = untellable(evidence, env=env, policies=False)
    if reason is not None:
        raise EvidenceError(
            "the run can't be played again",
            where=where,
            actual=reason,
            fix="record it with level full, with a seed, and an environment that has a name",
        )


def _otherwise(evidence: Evidence, divergence: Divergence) -> DivergenceError:
    error = DivergenceError(
        "the run came out otherwise when it was played again",
        where=str(evidence.path),
        actual=str(divergence),
        fix="gamekeeper replay RUN looks for the cause; record with level full what doesn't replay",
    )
    error.divergence = divergence
    return error


# -- in the fresh process: one episode of a run that is still being recorded, or all of a run

WRITTEN_S: Final = 5.0
"""Longest time until the end of an episode that was played is on the disk."""
POLL_S: Final = 0.05


def check_task(report: Callable[..., None], *, path: str, episode: int) -> dict[str, Any]:
    """Replays an episode of a run that may still be open, and compares it."""
    evidence = _with_end(path, episode, report)
    if evidence is None:
        return {"outcome": NOT_CHECKED, "why": "its end was not written in time"}
    header = evidence.header(episode)
    reason = untellable(evidence, env=None, policies=False)
    if reason is not None:
        return {"outcome": NOT_CHECKED, "why": reason}
    try:
        runner = ReplayRunner(evidence, opened_again(evidence, None), after_turn=report)
        before = states()
        with closing(runner):
            both, _ = runner.compared(header)
    except GamekeeperError as error:
        return {"outcome": NOT_CHECKED, "why": error.what}
    after = states()
    drew = [name for name in GLOBALS if before[name] != after[name]]
    if both.divergence is not None:
        if evidence.manifest["environment"].get("arguments") == ASSUMED:
            why = f"{both.divergence}; but the environment's arguments aren't known"
            return {"outcome": NOT_CHECKED, "why": why}
        return {"outcome": DIVERGED, "why": str(both.divergence), "drew": drew}
    return {"outcome": PASSED, "why": None, "drew": drew}


def _with_end(path: str, episode: int, report: Callable[..., None]) -> Evidence | None:
    """The run, once the end of the episode is in it; None where that takes too long."""
    last_s = time.monotonic() + WRITTEN_S
    while time.monotonic() < last_s:
        evidence = load(path, check=False)
        with suppress(EvidenceError):  # its start isn't on the disk yet
            if evidence.header(episode)["end"] is not None:
                return evidence
        report()
        time.sleep(POLL_S)
    return None


class _Unframed(RunRecorder):
    """Drops frames: rendering them is part of playing again, keeping them isn't."""

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Drops a frame."""


def expand_task(
    report: Callable[..., None], *, path: str, out: str, env: str | None
) -> dict[str, Any]:
    """Plays the run at `path` again, recorded in full at `out`.

    Returns:
        `{"error": None}`, or the fields of the error that ended it.
    """
    try:
        play_whole(load(path), out, env=env, report=report)
    except GamekeeperError as error:
        return {"error": error.to_json()}
    return {"error": None}


def play_whole(
    evidence: Evidence, out: str, *, env: str | None, report: Callable[..., None]
) -> None:
    """Plays all episodes of `evidence` again, recorded in full at `out`."""
    opened = opened_again(evidence, env)
    manifest = evidence.manifest
    limit = {name: manifest[name] for name in ("most_turns",) if name in manifest}
    origin = {
        "root": evidence.root,
        "fingerprint": evidence.fingerprint,
        "not_restored": list(NOT_RESTORED),
    }
    try:
        recorder = _Unframed(
            out,
            environment=opened.identity,
            contract=evidence.contract if manifest.get("contract") else None,
            run_seed=manifest.get("seed"),
            terms=tuple(manifest.get("terms") or ()),
            volatile=evidence.contract.volatile_infos(),
            is_timed=False,
            extra={"expanded": origin, **limit},
        )
    except BaseException:
        opened.env.close()
        raise
    try:
        _play_into(recorder, evidence, opened, report)
    except BaseException:  # only what was made here goes: the recorder refuses a folder in use
        shutil.rmtree(out, ignore_errors=True)
        raise


def _play_into(
    recorder: RunRecorder, evidence: Evidence, opened: Opened, report: Callable[..., None]
) -> None:
    runner = ReplayRunner(evidence, opened, after_turn=report, sink=recorder)
    capture = runner.capture
    capture.openings = openings = SameOpenings()
    total = evidence.episode_table.num_rows
    try:
        for done, header in enumerate(evidence.headers, 1):
            capture.policies, openings.text = header["policies"], header.get("opening")
            runner.replay(evidence.episode_of(header))
            report(episode=done, episodes=total)
    finally:
        capture.end_episode()
        recorder.close()
        capture.close()
