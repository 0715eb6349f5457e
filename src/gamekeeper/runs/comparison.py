"""Runs compared row by row: a replay in a fresh process, or two recorded runs."""

from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from html import escape
from os import PathLike
from typing import Any, Final, TypeAlias

import pyarrow as pa

from gamekeeper.episodes.canonical import from_json
from gamekeeper.episodes.divergence import Divergence, compare_chunks
from gamekeeper.episodes.evidence import IDENTITY, Evidence, fingerprints
from gamekeeper.episodes.known_extent import ENDS_OPEN
from gamekeeper.episodes.plain_json import fields_json
from gamekeeper.episodes.row_tables import html_text
from gamekeeper.episodes.where import Where
from gamekeeper.errors import EvidenceError, PolicyError, RunError, SpecError
from gamekeeper.interface.env_source import Opened
from gamekeeper.interface.object_source import ASSUMED
from gamekeeper.rollouts.workers import run_task
from gamekeeper.runs.consent import Consent, consented, evidence_of
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recording import joint_policy_of
from gamekeeper.runs.replay_runner import (
    IN_MEMORY,
    ReplayRunner,
    cause_of,
    check_named,
    compact,
    opened_again,
)
from gamekeeper.runs.reset_chain import chain_of
from gamekeeper.runs.run_check import contradiction, with_prints
from gamekeeper.runs.standing import choices_in

# -- Replay: recorded actions from recorded seeds in a fresh process, compared row by row

PRINTS: Final = ("fingerprint", "info_fingerprint")
TASK: Final = "gamekeeper.runs.comparison:replay_task"
SILENCE_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class Replay:
    """Outcome of replaying a run.

    Attributes:
        run: the folder.
        verified: every row, info and state came out bit for bit, and so does the fingerprint.
        within_tolerance: the largest difference is within the tolerance that was given; None where
            none was given.
        fingerprint: of the recorded run.
        divergence: the first place where the replay differs by more.
        reason: the reason why the run can't be replayed; None where it can.
        cause: cause of a divergence, as far as replaying the episode a few times more shows it.
        consent: rule by which the environment was opened, and the entries of PYTHONPATH in which
            its imports were looked for; None where nothing was opened.
        versions: packages whose version is another than at the recording, and the environment's
            source if it changed: `{name: [recorded, now]}`, also where nothing came of it.
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
    consent: Consent | None = None

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper replay --json` prints."""
        return fields_json(self)

    def __str__(self) -> str:
        return self._verdict() + ("" if self.consent is None else f"\n  {self.consent}")

    def _verdict(self) -> str:
        shown = self.fingerprint or "none, as the run was never finalized"
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
        return html_text(str(self)) + f"<code>{escape(self.run)}</code>"


def replay(
    path: str | PathLike[str] | Evidence,
    *,
    tolerance: float | None = None,
    policies: bool = False,
    env: str | None = None,
    allow_import: bool = False,
    timeout_s: float | None = SILENCE_S,
    explain: bool = True,
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
        explain: look for the cause of a divergence, which plays the episode a few times more.
        on_message: called with `{"episode", "episodes"}` as they are done.
    Raises:
        TrustError: the evidence names code that the user hasn't allowed to run.
        RunError: there is no run, or it is damaged.
        EvidenceError: the evidence is in memory alone.
        SpecError: `env` is an environment or a factory in place of its name.
    """
    check_named(env)
    if isinstance(path, Evidence):
        if path.path is None:
            raise EvidenceError(
                "the evidence is in memory alone, and a replay runs in a process of its own",
                where="gk.replay",
                fix="record with out='runs/...' and replay that folder",
            )
        path = path.path
    evidence = evidence_of(path)
    reason = untellable(evidence, env=env, policies=policies)
    if reason is not None:  # before the user is asked to trust a run that can't be replayed anyway
        return Replay(str(path), False, None, evidence.fingerprint, None, reason)
    names = [name for each in _all_policies(evidence) for name in each.values()] if policies else []
    with consented(
        evidence, doing="replaying this run", env=env, policies=names, allow_import=allow_import
    ) as consent:
        replayed = _replayed(
            evidence,
            timeout_s=timeout_s,
            on_message=on_message,
            tolerance=tolerance,
            policies=policies,
            env=env,
            explain=explain,
        )
    return replace(replayed, consent=consent)


def _replayed(
    evidence: Evidence,
    *,
    timeout_s: float | None,
    on_message: Callable[[dict[str, Any]], None] | None,
    tolerance: float | None,
    policies: bool,
    env: str | None,
    explain: bool,
) -> Replay:
    run = str(evidence.path)
    arguments = {"path": run, "tolerance": tolerance, "policies": policies, "env": env}
    outcome = run_task(TASK, arguments, silence_s=timeout_s, on_message=on_message)
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    if not isinstance(outcome.value, dict):
        reason = f"the replay {outcome.status}: {outcome.error}"
        return Replay(run, False, None, evidence.fingerprint, None, reason)
    replayed = _from_json(outcome.value)
    where = replayed.divergence
    if where is not None and env is None and _identity(evidence).get("arguments") == ASSUMED:
        return replace(replayed, divergence=None, reason=_unsure(evidence, where))
    if where is None or where.turn is None or not explain or _identity(evidence).get("imported"):
        return replayed
    if policies and where.field == "action":
        return replace(replayed, cause="the policies chose otherwise, given the same observations")
    against = contradiction(evidence)
    if against:
        return replace(replayed, cause=f"the run was changed once it was recorded: {against}")
    cause = cause_of(evidence, where, env=env, changed=replayed.versions, timeout_s=timeout_s)
    return replace(replayed, cause=cause)


def _from_json(value: Mapping[str, Any]) -> Replay:
    """The replay that a worker returned as JSON, its values as they were."""
    where = value["divergence"]
    if where is None:
        return Replay(**value)
    return Replay(**{**value, "divergence": divergence_from_json(where)})


def divergence_from_json(where: Mapping[str, Any]) -> Divergence:
    """The divergence that another process returned as JSON, its values as they were."""
    values = {side: from_json(compact(where[side])) for side in ("recorded", "replayed")}
    return Divergence(**{**where, **values})


def _identity(evidence: Evidence) -> Mapping[str, Any]:
    identity = evidence.manifest.get("environment")
    return identity if isinstance(identity, Mapping) else {}


def _exported(evidence: Evidence) -> Mapping[str, Any]:
    """Facts that an export of ours wrote beside a data set that was imported; mostly empty."""
    imported = _identity(evidence).get("imported")
    told = imported.get("recorded") if isinstance(imported, Mapping) else None
    return told if isinstance(told, Mapping) else {}


def _identity_before(evidence: Evidence, now: Mapping[str, Any]) -> Mapping[str, Any]:
    """Identity to compare `now` with; where a data set from elsewhere tells none, it is `now`."""
    identity = _identity(evidence)
    if not identity.get("imported"):
        return identity
    told = _exported(evidence).get("environment")
    return told if isinstance(told, Mapping) else now


def untellable(evidence: Evidence, *, env: str | None, policies: bool) -> str | None:
    """Reason why a run can't be replayed at all, known before anything runs."""
    kind = _identity(evidence).get("kind")
    if _exported(evidence).get("kind") == "agent":
        return "the data set holds the decisions of one agent, and no actions of the others"
    if env is None and _identity(evidence).get("imported"):
        return "an imported data set holds no environment: name it with --env"
    if env is None and kind in IN_MEMORY:
        thing = "an object" if kind == "object" else "a callable"
        add = _identity(evidence).get("lost") or "name it with --env"
        return f"the environment was {thing} in memory: {add}"
    if not evidence.episode_table.num_rows:
        return "the run has no episodes"
    known = frozenset(evidence.episode_table["episode"].to_pylist())
    for header in evidence.headers:
        try:
            chain_of(header, known)
        except EvidenceError as error:
            return error.what
    if policies and (evidence.manifest.get("seed") is None or not all(_all_policies(evidence))):
        return "the run doesn't name its policies and their seed, so they can't choose again"
    return None


def _unsure(evidence: Evidence, where: Divergence) -> str:
    """Reason where a replay of an object diverged that was perhaps built with other arguments."""
    entry = str(_identity(evidence).get("entry_point"))
    place = str(Where("", where.episode, where.turn, where.agent, where.field)).strip()
    return (
        f"it diverged at {place}, but the environment was an object whose arguments aren't known, "
        f"and {entry} was opened with its defaults; record the class, with env_kwargs"
    )


def _all_policies(evidence: Evidence) -> list[dict[str, str]]:
    """The choices of each episode; empty where the evidence doesn't name its policies."""
    return [choices_in(header.get("policies")) for header in evidence.headers]


# -- in the fresh process


def replay_task(
    report: Callable[..., None],
    *,
    path: str,
    tolerance: float | None,
    policies: bool,
    env: str | None,
) -> dict[str, Any]:
    """Replays the run at `path` in this process; see `replay`."""
    evidence = load(path)
    try:
        replayed = replay_evidence(
            evidence,
            opened_again(evidence, env),
            tolerance=tolerance,
            policies=policies,
            report=report,
        )
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
    return {
        name: [one.get(name), two.get(name)]
        for name in sorted(one.keys() | two.keys())
        if one.get(name) != two.get(name)
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
    runner = ReplayRunner(evidence, opened, after_turn=report)
    exact, divergence = True, None
    prints: list[str | None] = []
    chooser, named = None, None
    total = evidence.episode_table.num_rows
    with closing(runner):
        for header in evidence.headers:
            if policies and header.get("policies") != named:  # the same objects go on, as they did
                named = header.get("policies")
                chooser = joint_policy_of(choices_in(named), opened.env, evidence.contract)
            both, again = runner.compared(header, chooser=chooser, tolerance=tolerance)
            prints.append(again["fingerprint"])
            report(episode=len(prints), episodes=total)
            exact = exact and both.is_exact
            divergence = both.divergence or _other_extent(header, again)
            if divergence is not None:
                break
    exact = exact and divergence is None
    identity = _identity_before(evidence, opened.identity)
    if exact:
        divergence = _set_up_differently(
            (identity, evidence.manifest["spaces"]),
            (opened.identity, runner.manifest()["spaces"]),
            evidence.manifest["spaces"],
        ) or _other_fingerprint(evidence, prints)
    return Replay(
        run=str(evidence.path or ""),
        verified=exact and divergence is None,
        within_tolerance=None if tolerance is None else divergence is None,
        fingerprint=evidence.fingerprint,
        divergence=divergence,
        versions=_differing_versions(identity, opened.identity),
        episodes=len(prints),
    )


def _other_extent(header: Mapping[str, Any], again: Mapping[str, Any]) -> Divergence | None:
    """The end or the number of steps of an episode, where its replay came to another."""
    for name in ("turns", "end"):
        if header["end"] not in (None, *ENDS_OPEN) and header[name] != again[name]:
            return Divergence(header["episode"], None, None, name, header[name], again[name])
    return None


SetUp: TypeAlias = tuple[Mapping[str, Any], Mapping[str, Any]]
"""Identity of an environment, and spaces by agent."""


def _set_up_differently(one: SetUp, two: SetUp, agents: Iterable[str]) -> Divergence | None:
    """The first difference of two runs as a whole: environment, arguments, spaces of `agents`."""
    for name in IDENTITY:
        values = one[0].get(name), two[0].get(name)
        if values[0] != values[1]:
            return Divergence(0, None, None, f"environment.{name}", *values)
    for agent in agents:
        values = one[1].get(agent), two[1].get(agent)
        if values[0] != values[1]:
            return Divergence(0, None, agent, "spaces", *values)
    return None


def _other_fingerprint(evidence: Evidence, prints: list[str | None]) -> Divergence | None:
    """The first fingerprint that differs where every row is the same: seeds, options, spaces."""
    if evidence.manifest.get("status") == "open":  # has no fingerprint yet
        return None
    table = with_prints(evidence)
    recorded, ends, numbers = (table[n].to_pylist() for n in ("fingerprint", "end", "episode"))
    for place, (one, two) in enumerate(zip(recorded, prints, strict=True)):
        if ends[place] in ENDS_OPEN:  # its rows are compared; what came after them is unknown
            prints[place] = one
        elif one != two:
            return Divergence(numbers[place], None, None, "fingerprint", one, two)
    run = fingerprints(evidence.manifest, pa.table(dict.fromkeys(PRINTS, prints)))["fingerprint"]
    if run != evidence.fingerprint:
        return Divergence(0, None, None, "fingerprint", evidence.fingerprint, run)
    return None


# -- Two recorded runs side by side


def different_set_ups(a: Evidence, b: Evidence) -> tuple[Divergence, ...]:
    """All that is different before the first turn, so that turns can't be compared; maybe empty.

    Name, API and arguments of the environment; then the first episode that was reset with another
    seed, and the first one with other options.
    """
    environments = _identity(a), _identity(b)
    found = []
    for key in ("name", "api", "kwargs"):
        values = [each.get(key) for each in environments]
        if values[0] != values[1]:
            found.append(Divergence(0, None, None, f"environment.{key}", *values))
    one, two = ({header["episode"]: header for header in side.headers} for side in (a, b))
    for key in ("seed", "options"):
        for episode in sorted(one.keys() & two.keys()):
            values = [side[episode][key] for side in (one, two)]
            if values[0] != values[1]:
                found.append(Divergence(episode, None, None, key, *values))
                break
    return tuple(found)


def check_consistent(evidence: Evidence) -> None:
    """Raises where the rows of a run on disk contradict what it says of itself.

    Raises:
        RunError: they do.
    """
    against = contradiction(evidence) if evidence.path else ""
    if against:
        raise RunError(
            "the run contradicts itself",
            where=str(evidence.path),
            actual=against,
            fix=f"gamekeeper verify {evidence.path} says more; get it anew from where it was made",
        )


def check_level(a: Evidence, b: Evidence) -> None:
    """Raises where two runs don't keep the same of what happened.

    Raises:
        EvidenceError: they are of different levels.
    """
    levels = [str(each.manifest.get("level")) for each in (a, b)]
    if levels[0] != levels[1]:
        raise EvidenceError(
            "runs of different levels aren't compared",
            where=f"{a.path or 'in memory'}, {b.path or 'in memory'}",
            expected="one level",
            actual=" and ".join(levels),
            fix="gamekeeper expand RUN OUT makes a full run of one of level actions",
        )


def diff(
    a: str | PathLike[str] | Evidence,
    b: str | PathLike[str] | Evidence,
    *,
    tolerance: float | None = None,
) -> Divergence | None:
    """The first place where two runs differ, or None if they are the same.

    First the set-up is compared: the environment, its arguments, seeds and options of the resets.
    Where these differ, turns can't be compared. Then episodes are, in their order, turn by turn.
    Volatile infos are left out.

    Args:
        tolerance: numbers that differ by no more, absolutely or relative to the larger one, count
            as equal.
    Raises:
        EvidenceError: they are of different levels.
        RunError: one of them is no run, damaged, or contradicts its own fingerprint.
    """
    left, right = (each if isinstance(each, Evidence) else load(each) for each in (a, b))
    check_level(left, right)
    for side in (left, right):
        check_consistent(side)
    set_up = different_set_ups(left, right)
    if set_up:
        return set_up[0]
    volatile = left.contract.volatile_infos() | right.contract.volatile_infos()
    one, two = (
        {header["episode"]: header for header in side.episode_table.to_pylist()}
        for side in (left, right)
    )
    for episode in sorted(one.keys() | two.keys()):
        if episode not in one or episode not in two:
            values = ["present" if episode in side else "missing" for side in (one, two)]
            return Divergence(episode, None, None, "episode", *values)
        found = compare_chunks(
            left.chunks(one[episode]),
            right.chunks(two[episode]),
            known=left.extent(one[episode]),
            tolerance=tolerance,
            volatile=volatile,
        )
        if found.divergence is not None:
            return found.divergence
    sides = [(each.manifest["environment"], each.manifest["spaces"]) for each in (left, right)]
    return _set_up_differently(sides[0], sides[1], {**sides[0][1], **sides[1][1]})
