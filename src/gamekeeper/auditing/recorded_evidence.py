"""Recorded evidence judged by every check that needs no rerun; nothing of it is executed."""

import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Discrete

from gamekeeper.auditing.gather import ROLLOUT
from gamekeeper.auditing.judge import Judged, judge, verdict_of
from gamekeeper.auditing.reproduce import words
from gamekeeper.auditing.result import AuditResult, spaces_text
from gamekeeper.checks.check import LOW, Check, selected
from gamekeeper.checks.probe_evidence import Fact, Kind, ProbeEvidence, ProbeRun
from gamekeeper.checks.verdict import NO_CASE, Finding, Verdict
from gamekeeper.contract import Contract
from gamekeeper.episodes.agent_spec import AgentSpec, agent_spec
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.spaces.misfit import BOUNDS, NAN, Misfit, misfits
from gamekeeper.episodes.where import Where
from gamekeeper.errors import EvidenceError, TrustError
from gamekeeper.runs.expanding import whole_evidence
from gamekeeper.runs.files.folder import MANIFEST

FULL: Final = "full"
ROWS: Final = frozenset({ROLLOUT, "spaces"})
"""Probes whose checks read rows; those of spaces play more episodes of the same kind."""
MOST_ROWS: Final = 5_000
"""Agent steps of the episodes that are judged beside another command: a second or two."""
NEEDS_RERUNS: Final = "it needs reruns: `gamekeeper audit ENV` makes them"

OUTSIDE: Final = "in every episode a policy's action is out of its space, NaN or beyond a bound"


def is_run(spec: str | PathLike[str]) -> bool:
    """Tells whether it names the folder of a run, and no environment."""
    try:
        return Path(spec, MANIFEST).is_file()
    except OSError:  # a name that is no path, such as one that is too long
        return False


def audit_run(
    path: str | PathLike[str],
    *,
    contract: Contract | str | PathLike[str] | None = None,
    select: Sequence[str] = (),
    ignore: Sequence[str] = (),
) -> AuditResult:
    """Judges the episodes of a run, each row against the spaces and the contract.

    Checks that need reruns are *not exercised*. The environment is opened only to expand a run of
    level `actions`; findings have a place and no reproducer.

    Args:
        path: folder of the run.
        contract: what is declared; None: the contract that the run was recorded under.
        select: only checks whose ids begin so; all where empty.
        ignore: but those whose ids begin so.
    Raises:
        RunError: there is no run, or it is damaged.
        EvidenceError: the run keeps no observations; no check begins like `select` or `ignore`.
        ContractError: the contract doesn't fit the agents.
    """
    begun_s = time.monotonic()
    try:
        evidence = whole_evidence(path)
    except TrustError as error:
        raise TrustError(
            error.what,
            where=error.where,
            actual=error.actual,
            fix="if you trust it: gamekeeper expand RUN OUT --allow-import, and audit OUT",
        ) from error
    level = str(evidence.manifest.get("level"))
    if level != FULL:
        raise EvidenceError(
            f"a run of level {level} can't be judged: it keeps no observations",
            where=fspath(path),
            expected="a run of level full",
            fix="record it again with --level full (level=)",
        )
    declared = evidence.contract
    if contract is not None:
        declared = contract if isinstance(contract, Contract) else Contract.load(contract)
    recorded = _recorded(evidence, declared, evidence.episodes)
    wanted = selected(tuple(select), tuple(ignore))
    verdicts = tuple(_verdict(check, declared, recorded) for check in wanted.values())
    environment = evidence.manifest.get("environment") or {}
    return AuditResult(
        environment=fspath(path),
        api=recorded.api,
        seconds=time.monotonic() - begun_s,
        steps=sum(evidence.turns_of(header) for header in evidence.headers),
        seed=int(evidence.manifest.get("seed") or 0),
        verdicts=verdicts,
        agents={name: spaces_text(spec) for name, spec in recorded.agents.items()},
        declared=declared.to_json() or None,
        source={"class": str(environment.get("name"))} if environment.get("name") else {},
    )


def failed_rows(evidence: Evidence) -> tuple[Verdict, ...]:
    """Failed verdicts, not of low severity, on the rows of a run's first episodes."""
    episodes = _first_episodes(evidence)
    recorded = _recorded(evidence, evidence.contract, episodes)
    checked = (check for check in selected().values() if _reads_rows(check) and episodes)
    verdicts = (_verdict(check, evidence.contract, recorded) for check in checked)
    return tuple(each for each in verdicts if each.outcome == "failed" and each.severity != LOW)


def masked_actions(evidence: Evidence) -> dict[str, tuple[int, int]]:
    """Actions of each agent that its mask forbids, and all that had a mask, where any is forbidden.

    Those of the first episodes, with Discrete action spaces: a fault of the policies, which an
    environment need not tell.
    """
    agents = _agents(evidence, evidence.contract)
    forbidden: Counter[str] = Counter()
    masked: Counter[str] = Counter()
    for turn in (turn for each in _first_episodes(evidence) for turn in each.turns):
        for name, mask in turn.masks.items():
            space = agents[name].action_space if name in agents else None
            action = turn.actions.get(name)
            if not isinstance(space, Discrete) or action is None:
                continue  # a mask of another space may be a tuple of arrays
            flags = np.asarray(mask)
            if flags.shape != (space.n,):
                continue
            place = int(action) - int(space.start)
            masked[name] += 1
            forbidden[name] += bool(flags.any() and 0 <= place < space.n and not flags[place])
    return {name: (count, masked[name]) for name, count in forbidden.items() if count}


def outside_actions(evidence: Evidence) -> dict[str, tuple[int, int, str]]:
    """Actions of each agent out of its action space: how many, of how many, and the first place.

    Those of the first episodes: a fault of the policies. What an environment answers says nothing
    of it, so episodes with such an action aren't judged.
    """
    agents = _agents(evidence, evidence.contract)
    counts: Counter[str] = Counter()
    outside: Counter[str] = Counter()
    first: dict[str, str] = {}
    for episode in _first_episodes(evidence):
        for turn in episode.turns:
            counts.update(turn.actions.keys())
        for name, place, misfit in _outside(episode, agents):
            outside[name] += 1
            first.setdefault(name, f"{place}: {misfit.actual}, expected {misfit.expected}")
    return {name: (count, counts[name], first[name]) for name, count in outside.items()}


def _outside(
    episode: Episode, agents: Mapping[str, AgentSpec]
) -> Iterator[tuple[str, Where, Misfit]]:
    """Agent and place of an episode's actions that are NaN or beyond a bound, and what was seen."""
    for turn in episode.turns:
        for name, action in turn.actions.items():
            space = agents[name].action_space if name in agents else None
            if space is None or action is None:
                continue
            for misfit in misfits(space, action):
                if misfit.kind in (NAN, BOUNDS):
                    yield name, episode.at(turn, name, "action"), misfit
                    break


def _first_episodes(evidence: Evidence) -> list[Episode]:
    """The first whole episodes, of MOST_ROWS agent steps; none without observations."""
    episodes: list[Episode] = []
    left = MOST_ROWS
    for each in evidence.episodes if evidence.manifest.get("level") == FULL else ():
        left -= each.steps.num_rows
        if left < 0:
            break
        each.keep_turns()  # many checks read them
        episodes.append(each)
    return episodes


def _reads_rows(check: Check) -> bool:
    return ROLLOUT in check.needs and ROWS.issuperset(check.needs)


@dataclass(frozen=True, slots=True)
class _RowsAlone(ProbeEvidence):
    """Rows of a run, which has no facts; `wanted`: kinds of facts that a check has asked for."""

    wanted: list[type] = field(default_factory=list)

    def facts(self, kind: type[Kind]) -> Sequence[Fact[Kind]]:
        """Notes the kind; a run has none."""
        self.wanted.append(kind)
        return ()


def _recorded(evidence: Evidence, contract: Contract, episodes: Iterable[Episode]) -> _RowsAlone:
    """Episodes of a run in the place of those that the probe of rollouts plays."""
    agents, many = _agents(evidence, contract), list(episodes)
    fair = [each for each in many if next(_outside(each, agents), None) is None]
    none = OUTSIDE if many else "the run has no episode"
    return _RowsAlone(
        api=str((evidence.manifest.get("environment") or {}).get("api")),
        agents=agents,
        looks={ROLLOUT: tuple(ProbeRun(episodes=(each,)) for each in fair)},
        not_exercised={} if fair else {ROLLOUT: none},
    )


def _agents(evidence: Evidence, contract: Contract) -> Mapping[str, AgentSpec]:
    found = {}
    for agent in evidence.manifest.get("agents") or ():
        pair = evidence.spaces.get(agent)
        found[agent] = agent_spec(
            contract,
            agent,
            observation_space=_space(pair and pair.observation),
            action_space=_space(pair and pair.action),
        )
    return found


def _space(codec: Any) -> Any:
    return None if codec is None else codec.space


def _verdict(check: Check, contract: Contract, recorded: _RowsAlone) -> Verdict:
    if not _reads_rows(check):
        judged = Judged(check, "not_exercised", reason=NEEDS_RERUNS)
    else:
        recorded.wanted.clear()
        judged = judge(check, contract, recorded, {})
        if judged.reason.startswith(NO_CASE) and recorded.wanted:
            judged = Judged(check, "not_exercised", reason=NEEDS_RERUNS)
    findings = tuple(
        Finding(str(x.where), words(x.expected), words(x.actual), x.fix or check.fix, "")
        for x in judged.shown
    )
    return verdict_of(judged, findings)
