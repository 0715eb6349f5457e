"""Replay: recorded actions from recorded seeds in a fresh process, compared row by row."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import Any, Final

from gamekeeper.core.canon import from_json
from gamekeeper.core.divergence import ENDS_OPEN, Comparison, Divergence, compare
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.trace import Trace
from gamekeeper.errors import PolicyError, SpecError, TrustError
from gamekeeper.game.faces import game_of
from gamekeeper.game.open import distrust, open_env, reopen
from gamekeeper.game.opened import Opened
from gamekeeper.game.policy import distrust_policy
from gamekeeper.record.bundle import load
from gamekeeper.record.recording import cast_of
from gamekeeper.run.memory import MemorySink
from gamekeeper.run.rerun import replay_trace
from gamekeeper.run.workers import run_task

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
        }

    def __str__(self) -> str:
        if self.verified:
            return f"verified: fingerprint {self.fingerprint}"
        if self.divergence is not None:
            lines = [f"diverged: {self.divergence}"]
            lines += [f"  {name}: {a} at the recording, {b} now" for name, (a, b) in self.versions.items()]
            return "\n".join(lines)
        if self.within_tolerance:
            return f"within tolerance: fingerprint {self.fingerprint}"
        return f"can't tell: {self.reason}"


def replay(
    path: str | PathLike[str],
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
        tolerance: numbers that differ by no more, absolutely or relative to the larger one, count as equal.
        policies: also choose anew: the recorded policies decide in place of the recorded actions.
        env: open this in place of the environment that the evidence names.
        allow_import: open what the evidence names even where it is a file or a module outside the
            installed packages, and run policies that it names.
        timeout_s: longest time without a turn.
        on_message: called with `{"episode", "episodes"}` as they are done.
    Raises:
        TrustError: the evidence names code that nobody allowed to run.
        BundleError: there is no bundle, or it is damaged.
    """
    evidence = load(path)
    run, fingerprint = str(path), evidence.fingerprint
    _check_trust(evidence, env=env, policies=policies, allow_import=allow_import)
    reason = _untellable(evidence, env)
    if reason is not None:
        return Replay(run, False, None, fingerprint, None, reason)
    arguments = {"path": run, "tolerance": tolerance, "policies": policies, "env": env}
    outcome = run_task(TASK, arguments, silence_s=timeout_s, on_message=on_message)
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    if not isinstance(outcome.value, dict):
        return Replay(run, False, None, fingerprint, None, f"the replay {outcome.status}: {outcome.error}")
    value = outcome.value
    divergence = None if value["divergence"] is None else Divergence(**value["divergence"])
    return Replay(**{**value, "divergence": divergence})


def _check_trust(evidence: Evidence, *, env: str | None, policies: bool, allow_import: bool) -> None:
    if allow_import:
        return
    reason = None if env is not None else distrust(evidence.manifest["environment"])
    if reason is None and policies:
        # a name without a colon is a built-in's or the environment's own
        names = {n for trace in evidence.traces for n in _policies(trace).values() if ":" in n}
        reason = next(filter(None, map(distrust_policy, sorted(names))), None)
    if reason is not None:
        raise TrustError(
            "replaying this run would execute code that its evidence names",
            where=str(evidence.path),
            seen=reason,
            mend="if you trust it, say --allow-import; or name the environment yourself with --env",
        )


def _untellable(evidence: Evidence, env: str | None) -> str | None:
    """Why a run can't be replayed at all, known before anything runs."""
    kind = evidence.manifest["environment"].get("kind")
    if env is None and kind in ("object", "factory"):
        return f"the environment was {kind} in memory; name it with --env"
    headers = evidence.episodes.to_pylist()
    if not headers:
        return "the run has no episodes"
    unseeded = [header["episode"] for header in headers if header["since"] is None or header["since"] < 0]
    if unseeded:
        return f"episode {unseeded[0]} was reset without a seed, and none was given before it"
    return None


def _policies(trace: Trace) -> dict[str, str]:
    text = trace.header.get("policies")
    return {} if text is None else {agent: entry["policy"] for agent, entry in json.loads(text).items()}


# -- in the fresh process


def replay_task(
    report: Callable[..., None], *, path: str, tolerance: float | None, policies: bool, env: str | None
) -> dict[str, Any]:
    """Replays the bundle at `path` in this process; see `replay`."""
    evidence = load(path)
    try:
        opened = _open(evidence, env)
    except SpecError as error:
        return Replay(path, False, None, evidence.fingerprint, None, str(error)).to_json()
    return replay_evidence(
        evidence, opened, tolerance=tolerance, policies=policies, report=report
    ).to_json()


def _open(evidence: Evidence, env: str | None) -> Opened:
    identity = evidence.manifest["environment"]
    if env is None:
        return reopen(identity)
    kwargs = from_json(json.dumps(identity.get("kwargs") or {}))
    return open_env(env, api=identity.get("api"), **kwargs)


def _differing_versions(then: Mapping[str, Any], now: Mapping[str, Any]) -> dict[str, list[str | None]]:
    one, two = (
        {**(each.get("versions") or {}), "source": each.get("source_digest")} for each in (then, now)
    )
    names = sorted(one.keys() | two.keys())
    return {name: [one.get(name), two.get(name)] for name in names if one.get(name) != two.get(name)}


def replay_evidence(
    evidence: Evidence,
    opened: Opened,
    *,
    tolerance: float | None = None,
    policies: bool = False,
    report: Callable[..., None] = lambda **fields: None,
) -> Replay:
    """Replays `evidence` in an environment that is already open, and closes it."""
    run, fingerprint = str(evidence.path or ""), evidence.fingerprint
    contract = evidence.contract
    volatile = contract.volatile_infos()
    sink = MemorySink(terms=tuple(evidence.manifest.get("terms") or ()), volatile=volatile)
    game = game_of(opened.env, sink=sink, state=evidence.states is not None)
    versions = _differing_versions(evidence.manifest["environment"], opened.identity)
    agents = {str(agent): agent for agent in getattr(opened.env, "possible_agents", ())}
    results: list[Comparison] = []
    prints: list[str] = []
    total = evidence.episodes.num_rows
    try:
        for trace in evidence.traces:
            cast = _cast(trace, opened, evidence) if policies else None
            game.episode = trace.episode - 1
            replay_trace(
                trace, game, agents=agents, cast=cast,
                run_seed=evidence.manifest.get("seed"), after_turn=report,
            )  # fmt: skip
            again = next(sink.evidence(opened.identity, contract=contract).traces)
            results.append(compare(trace, again, tolerance=tolerance, volatile=volatile))
            prints.append(again.header["fingerprint"])
            report(episode=trace.episode + 1, episodes=total)
            if results[-1].divergence is not None:
                break
    finally:
        game.close()
    divergence = results[-1].divergence if results else None
    exact = all(result.is_exact for result in results) and divergence is None
    if exact:
        divergence = _header(evidence, opened, sink, prints)
    return Replay(
        run=run,
        verified=exact and divergence is None,
        within_tolerance=None if tolerance is None else divergence is None,
        fingerprint=fingerprint,
        divergence=divergence,
        versions={} if exact and divergence is None else versions,
        episodes=len(results),
    )


def _cast(trace: Trace, opened: Opened, evidence: Evidence) -> Any:
    names = _policies(trace)
    if not names or evidence.manifest.get("seed") is None:
        raise PolicyError(
            "the run doesn't name its policies and their seed, so they can't choose again",
            mend="replay without --policies: recorded actions are played as they are",
        )
    return cast_of(names, opened.env, evidence.contract)


def _header(
    evidence: Evidence, opened: Opened, sink: MemorySink, prints: list[str]
) -> Divergence | None:
    """What differs of the run as a whole when every row is the same: environment, arguments, spaces."""
    if evidence.manifest.get("status") == "open":
        return None
    again = sink.evidence(opened.identity, contract=evidence.contract).manifest
    for name in ("name", "api", "kwargs"):
        one, two = evidence.manifest["environment"].get(name), opened.identity.get(name)
        if one != two:
            return Divergence(0, None, None, f"environment.{name}", one, two)
    for agent, pair in evidence.manifest["spaces"].items():
        if again["spaces"].get(agent) != pair:
            return Divergence(0, None, agent, "spaces", pair, again["spaces"].get(agent))
    recorded = evidence.episodes["fingerprint"].to_pylist()
    torn = [end in ENDS_OPEN for end in evidence.episodes["end"].to_pylist()]
    for episode, (one, two) in enumerate(zip(recorded, prints, strict=True)):
        if one is not None and one != two and not torn[episode]:
            return Divergence(episode, None, None, "fingerprint", one, two)
    return None


