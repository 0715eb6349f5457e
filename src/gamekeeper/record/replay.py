"""Replay: recorded actions from recorded seeds in a fresh process, compared row by row."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from html import escape
from os import PathLike
from pathlib import PurePath
from typing import Any, Final

import pyarrow as pa

from gamekeeper.core.canon import from_json
from gamekeeper.core.divergence import Divergence
from gamekeeper.core.evidence import IDENTITY, Evidence, fingerprints
from gamekeeper.core.extent import ENDS_OPEN
from gamekeeper.core.side_by_side import SideBySide
from gamekeeper.errors import EvidenceError, PolicyError, SpecError, TrustError
from gamekeeper.game.open import distrust
from gamekeeper.game.opening.opened import Opened
from gamekeeper.game.policy import distrust_policy
from gamekeeper.record.bundle import load
from gamekeeper.record.cause import IN_MEMORY, cause_of
from gamekeeper.record.recording import cast_of
from gamekeeper.record.stage import Stage, check_named, compact, opened_again
from gamekeeper.run.workers import run_task

PRINTS: Final = ("fingerprint", "info_fingerprint")
TASK: Final = "gamekeeper.record.replay:replay_task"
SILENCE_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class Replay:
    """What replaying a run came to.

    Attributes:
        run: the folder.
        verified: every row, info and state came out bit for bit, and so does the fingerprint.
        within_tolerance: the largest difference is within the tolerance that was given; None where
            none was given.
        fingerprint: of the recorded run.
        divergence: the first place where the replay differs by more.
        reason: why it can't be told whether the run replays; None where it can.
        cause: of a divergence, as far as replaying the episode a few times more tells it.
        versions: packages whose version is another than at the recording, and the environment's
            source if it changed: `{name: [recorded, now]}`.
        episodes: how many were replayed.
    """

    run: str
    verified: bool
    within_tolerance: bool | None
    fingerprint: str
    divergence: Divergence | None
    reason: str | None = None
    versions: Mapping[str, list[str | None]] = field(default_factory=dict)
    episodes: int = 0
    cause: str | None = None

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper replay --json` prints."""
        return {
            "run": self.run,
            "verified": self.verified,
            "within_tolerance": self.within_tolerance,
            "fingerprint": self.fingerprint,
            "divergence": None if self.divergence is None else self.divergence.to_json(),
            "reason": self.reason,
            "versions": dict(self.versions),
            "episodes": self.episodes,
            "cause": self.cause,
        }

    def __str__(self) -> str:
        shown = self.fingerprint or "none, as the run was never sealed"
        if self.verified:
            return f"verified: fingerprint {shown}"
        if self.divergence is not None:
            lines = [f"diverged: {self.divergence}"]
            lines += [f"  cause: {self.cause}"] if self.cause else []
            lines += [
                f"  {name}: {then} at the recording, {now} now"
                for name, (then, now) in self.versions.items()
            ]
            return "\n".join(lines)
        if self.within_tolerance:
            return f"within tolerance: fingerprint {shown}"
        return f"can't tell: {self.reason}"

    def _repr_html_(self) -> str:
        verdict, *rest = map(escape, str(self).splitlines())
        told = f"<pre>{chr(10).join(rest)}</pre>" if rest else ""
        return f"<b>{verdict}</b> <code>{escape(self.run)}</code>{told}"


def replay(
    path: str | PathLike[str] | Evidence,
    *,
    tolerance: float | None = None,
    policies: bool = False,
    env: str | None = None,
    allow_import: bool = False,
    timeout_s: float | None = SILENCE_S,
    on_message: Callable[[dict[str, Any]], None] | None = None,
) -> Replay:
    """Plays a recorded run again in a fresh process and compares every row.

    Args:
        path: the folder of a run, or evidence that was loaded from one.
        tolerance: numbers that differ by no more, absolutely or relative to the larger one, count
            as equal.
        policies: also choose anew: the recorded policies decide in place of the recorded actions.
        env: its name (a text, as a process of its own opens it): opened in place of the
            environment that the evidence names.
        allow_import: open what the evidence names even where it is a file or a module outside the
            installed packages, and run policies that it names.
        timeout_s: longest time without a turn.
        on_message: called with `{"episode", "episodes"}` as they are done.
    Raises:
        TrustError: the evidence names code that nobody allowed to run.
        BundleError: there is no bundle, or it is damaged.
        EvidenceError: the evidence is in memory alone.
        SpecError: `env` is an environment or a factory in place of its name.
    """
    check_named(env)
    path = _folder_of(path) if isinstance(path, Evidence) else path
    evidence = load(path)
    run, fingerprint = str(path), evidence.fingerprint
    reason = _untellable(evidence, env=env, policies=policies)
    if reason is not None:  # before anybody is asked to trust what can't be replayed anyway
        return Replay(run, False, None, fingerprint, None, reason)
    _check_trust(evidence, env=env, policies=policies, allow_import=allow_import)
    arguments = {"path": run, "tolerance": tolerance, "policies": policies, "env": env}
    outcome = run_task(TASK, arguments, silence_s=timeout_s, on_message=on_message)
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    if not isinstance(outcome.value, dict):
        told = f"the replay {outcome.status}: {outcome.error}"
        return Replay(run, False, None, fingerprint, None, told)
    replayed = _received(outcome.value)
    where = replayed.divergence
    if where is None or where.turn is None:
        return replayed
    if policies and where.field == "action":
        return replace(replayed, cause="the policies chose otherwise, given the same observations")
    cause = cause_of(evidence, where, env=env, changed=replayed.versions, timeout_s=timeout_s)
    return replace(replayed, cause=cause)


def _received(value: Mapping[str, Any]) -> Replay:
    """A replay that crossed from a worker as JSON, its values as they were."""
    where = value["divergence"]
    if where is None:
        return Replay(**value)
    values = {side: from_json(compact(where[side])) for side in ("recorded", "replayed")}
    return Replay(**{**value, "divergence": Divergence(**{**where, **values})})


def _folder_of(evidence: Evidence) -> PurePath:
    """The folder of a run that was loaded; what is in memory alone can't be handed to a process."""
    if evidence.path is None:
        raise EvidenceError(
            "the evidence is in memory alone, and a replay runs in a process of its own",
            where="gk.replay",
            mend="record with out='runs/...' and replay that folder",
        )
    return evidence.path


def _check_trust(
    evidence: Evidence, *, env: str | None, policies: bool, allow_import: bool
) -> None:
    if allow_import:
        return
    reason = None if env is not None else distrust(_identity(evidence))
    mend = "if you trust it, say --allow-import; or name the environment yourself with --env"
    if reason is None and policies:
        mend = "if you trust it, say --allow-import"
        names = {name for names in _all_policies(evidence) for name in names.values()}
        reason = next(filter(None, map(distrust_policy, sorted(names))), None)
    if reason is not None:
        raise TrustError(
            "replaying this run would execute code that its evidence names",
            where=str(evidence.path),
            seen=reason,
            mend=mend,
        )


def _identity(evidence: Evidence) -> Mapping[str, Any]:
    identity = evidence.manifest.get("environment")
    return identity if isinstance(identity, Mapping) else {}


def _untellable(evidence: Evidence, *, env: str | None, policies: bool) -> str | None:
    """Why a run can't be replayed at all, known before anything runs."""
    kind = _identity(evidence).get("kind")
    if env is None and kind in IN_MEMORY:
        thing = "an object" if kind == "object" else "a callable"
        return f"the environment was {thing} in memory; name it with --env"
    headers = evidence.episodes.to_pylist()
    if not headers:
        return "the run has no episodes"
    for header in headers:
        if header["since"] is None or header["since"] < 0:
            return (
                f"episode {header['episode']} was reset without a seed, and none was given before"
            )
    if policies and (evidence.manifest.get("seed") is None or not all(_all_policies(evidence))):
        return "the run doesn't name its policies and their seed, so they can't choose again"
    return None


def _all_policies(evidence: Evidence) -> list[dict[str, str]]:
    """The policies of each episode by agent; none where the evidence doesn't name them."""
    return [_policies(header.get("policies")) for header in evidence.episodes.to_pylist()]


def _policies(text: str | None) -> dict[str, str]:
    try:
        named = {} if text is None else json.loads(text)
        return {agent: str(entry["policy"]) for agent, entry in named.items()}
    except (ValueError, TypeError, KeyError, AttributeError):  # nothing that a recorder wrote
        return {}


# -- in the fresh process


def replay_task(
    report: Callable[..., None],
    *,
    path: str,
    tolerance: float | None,
    policies: bool,
    env: str | None,
) -> dict[str, Any]:
    """Replays the bundle at `path` in this process; see `replay`."""
    evidence = load(path)
    try:
        replayed = replay_evidence(
            evidence, opened_again(evidence, env),
            tolerance=tolerance, policies=policies, report=report,
        )  # fmt: skip
    except (SpecError, PolicyError, EvidenceError) as error:
        return Replay(path, False, None, evidence.fingerprint, None, str(error)).to_json()
    return replace(replayed, run=path).to_json()


def _differing_versions(
    then: Mapping[str, Any], now: Mapping[str, Any]
) -> dict[str, list[str | None]]:
    one, two = (
        {**(each.get("versions") or {}), "source": each.get("source_digest")}
        for each in (then, now)
    )
    names = sorted(one.keys() | two.keys())
    return {
        name: [one.get(name), two.get(name)] for name in names if one.get(name) != two.get(name)
    }


def replay_evidence(
    evidence: Evidence,
    opened: Opened,
    *,
    tolerance: float | None = None,
    policies: bool = False,
    report: Callable[..., None] = lambda **fields: None,
) -> Replay:
    """Replays `evidence` in an environment that is already open, and closes it.

    Raises:
        EvidenceError: an action was an object that no text can build again.
        PolicyError: policies are asked for, and can't be found.
    """
    volatile = evidence.contract.volatile_infos()
    stage = Stage(evidence, opened, after_turn=report)
    exact, divergence = True, None
    prints: list[str | None] = []
    total = evidence.episodes.num_rows
    try:
        for header in evidence.headers:
            both = SideBySide(evidence.extent(header), tolerance=tolerance, volatile=volatile)
            cast = _cast(header, opened, evidence) if policies else None
            again = stage.play(header, cast=cast, look=both.look)
            both.ends()
            prints.append(again["fingerprint"])
            report(episode=header["episode"] + 1, episodes=total)
            exact, divergence = exact and both.is_exact, both.divergence
            if divergence is not None:
                break
    finally:
        stage.close()
    exact = exact and divergence is None
    if exact:
        divergence = _header(evidence, opened, stage.manifest(), prints)
    versions = _differing_versions(_identity(evidence), opened.identity)
    return Replay(
        run=str(evidence.path or ""),
        verified=exact and divergence is None,
        within_tolerance=None if tolerance is None else divergence is None,
        fingerprint=evidence.fingerprint,
        divergence=divergence,
        versions={} if exact and divergence is None else versions,
        episodes=len(prints),
    )


def _cast(header: Mapping[str, Any], opened: Opened, evidence: Evidence) -> Any:
    return cast_of(_policies(header.get("policies")), opened.env, evidence.contract)


def _header(
    evidence: Evidence, opened: Opened, again: Mapping[str, Any], prints: list[str | None]
) -> Divergence | None:
    """What differs of the run as a whole when every row is the same: environment, spaces, name."""
    for name in IDENTITY:
        one, two = _identity(evidence).get(name), opened.identity.get(name)
        if one != two:
            return Divergence(0, None, None, f"environment.{name}", one, two)
    for agent, pair in evidence.manifest["spaces"].items():
        if again["spaces"].get(agent) != pair:
            return Divergence(0, None, agent, "spaces", pair, again["spaces"].get(agent))
    if evidence.manifest.get("status") == "open":  # has no fingerprint yet
        return None
    recorded = evidence.episodes["fingerprint"].to_pylist()
    ends = evidence.episodes["end"].to_pylist()
    for episode, (one, two) in enumerate(zip(recorded, prints, strict=True)):
        if ends[episode] in ENDS_OPEN:  # its rows are compared; what came after them is unknown
            prints[episode] = one
        elif one != two:
            return Divergence(episode, None, None, "fingerprint", one, two)
    run = fingerprints(evidence.manifest, pa.table(dict.fromkeys(PRINTS, prints)))["fingerprint"]
    if run != evidence.fingerprint:
        return Divergence(0, None, None, "fingerprint", evidence.fingerprint, run)
    return None
