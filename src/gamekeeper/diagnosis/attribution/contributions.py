"""The front of attribution: a recorded run in, every agent's part out."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.attribution.agent_measures import (
    ACROSS,
    MOST_EXACT,
    AgentPart,
    Attribution,
    Harm,
    Laziness,
    Measured,
    Own,
    everyone,
    harms,
    influence,
    laziness,
    mean_terms,
    measured,
    own_rewards,
    penalties,
    shapley_exact,
    shapley_of_orders,
    wanted,
)
from gamekeeper.diagnosis.attribution.attribution_work import SILENCE_S, ContributionData, gather
from gamekeeper.diagnosis.attribution.message_influence import talk
from gamekeeper.diagnosis.attribution.replacement_runs import (
    Baseline,
    ReplacementRunner,
    ReplacementTask,
)
from gamekeeper.diagnosis.experiment import fresh_seed
from gamekeeper.diagnosis.open_setup import (
    OpenSetup,
    Setup,
    check_agents,
    check_last,
    consent_to,
    contract_of,
    evidence_to_play,
    other_policies,
    setup_of,
)
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.opposition import opponents_in
from gamekeeper.episodes.outcome import outcome_of
from gamekeeper.errors import EvidenceError
from gamekeeper.rollouts.executors.task import Executor

FRESH: Final = 50
"""Fresh episodes that are played unless told otherwise; of fewer no interval is claimed."""
ACTION_EPISODES: Final = 50
"""Episodes that are looked into action by action unless told otherwise."""
MOST_PLAYERS: Final = 24
"""Agents whose part in whole episodes is asked for; of larger teams they are drawn."""
NOTES: Final = "attribution.jsonl"
CAN_BE_PLAYED: Final = ("ended", "cut")
RIVALS: Final = "agents compete, so that they have no return in common"


def attribute(
    run: str | PathLike[str] | Evidence,
    *,
    contract: Contract | str | PathLike[str] | None = None,
    baseline: Baseline = "noop",
    episodes: int | None = None,
    action_episodes: int = ACTION_EPISODES,
    budget: int | None = None,
    env: object | None = None,
    policies: Mapping[str, Any] | None = None,
    seed: int = 0,
    workers: int | Executor = 0,
    out: str | PathLike[str] | None = None,
    allow_import: bool = False,
    timeout_s: float | None = SILENCE_S,
    on_message: Callable[[dict[str, Any]], None] | None = None,
) -> Attribution:
    """Measures each agent's part in its team, and its influence on the others.

    Rewards are never averaged over agents. Agents are replaced by a baseline in fresh episodes, in
    which the others react; single actions are replaced in episodes in which the others do what
    they did. Where the run names no policies, nobody can react, and only the latter is done.

    Args:
        run: the folder of a run, or evidence.
        contract: in place of the one of the recording.
        baseline: what takes an agent's place: `noop` (`random` where none is declared), `random`,
            or `reference` (the environment's own policy of that name).
        episodes: fresh ones in which agents are replaced; None: 50. Of fewer no interval is given.
        action_episodes: episodes that are played again with actions of one agent replaced:
            recorded ones first, then fresh ones.
        budget: most env steps that are taken, an episode that began is finished; None: as many as
            those episodes take. `not_tested` names what it didn't reach.
        env: opened in place of what the evidence names, with the recorded arguments.
        policies: in place of the recorded ones, by agent, role or under `*`.
        seed: of all draws; equal seeds give equal answers.
        workers: processes that play; 0: this one; or an executor that plays.
        out: a folder for what was played; a second call goes on there.
        allow_import: run code that the evidence names.
        timeout_s: longest time without a turn in a worker.
        on_message: called with `{"episode", "episodes"}` as they are played.
    Raises:
        TrustError: the evidence names code that nobody allowed to run.
        SpecError: the environment can't be opened.
        PolicyError: a policy or the baseline can't be found.
        EnvError: the environment raised, or a worker hung or died.
        EvidenceError: the last episode comes out otherwise when it is played by itself, and agents
            would be replaced in fresh ones.
        RunError: there is no run, or another attribution lies in `out`.
    """
    evidence = evidence_to_play(run, env=env, allow_import=allow_import)
    declared = contract_of(evidence, contract)
    evidence = replace(evidence, manifest={**evidence.manifest, "contract": declared.to_json()})
    setup = _setup(evidence, env=env, policies=policies)
    run_episodes = [t for t in evidence.episodes if t.header.get("end") in CAN_BE_PLAYED]
    there = _players(run_episodes, evidence)
    players = _asked(there, seed)
    rivals = opponents_in(evidence.agent_steps, there)
    closed = (FRESH if episodes is None else episodes) if setup.policies and not rivals else 0
    task = ReplacementTask(
        setup=setup,
        contract=declared,
        players=players,
        others=tuple(name for name in there if name not in players),
        baseline={
            name: "random" if baseline == "noop" and declared.noop_of(name) is None else baseline
            for name in players
        },
        seed=seed,
        run_seed=fresh_seed(evidence.fingerprint, seed, "attribute"),
    )
    with consent_to(evidence, setup, env=env, policies=policies, allow_import=allow_import):
        _check_named(env, evidence, setup, declared)
        with ReplacementRunner(task) as runner:
            if closed and env is None:
                check_last(evidence, runner.opened)
            recorded = list(map(runner.script_of, run_episodes[:action_episodes]))
            roles = {name: runner.role_of(name) for name in players}
            head = {"run": evidence.fingerprint, **runner.identity}
        fresh = min(max(action_episodes - len(recorded), 0), closed)
        found = gather(
            task,
            recorded,
            closed=closed,
            fresh=fresh,
            workers=workers,
            silence_s=timeout_s,
            on_message=on_message,
            budget=budget,
            notes=None if out is None else Path(out) / NOTES,
            head=head,
        )
    return _attributed(evidence, task, found, roles, baseline, budget, rivals)


def _check_named(env: object, evidence: Evidence, setup: Setup, declared: Contract) -> None:
    """Checks an environment that was named, before policies are looked up by its agents."""
    if env is None:
        return
    with OpenSetup(setup, declared) as open_setup:
        check_agents(evidence, open_setup)


def _setup(evidence: Evidence, **given: Any) -> Setup:
    """As it was recorded; without policies where the run names none."""
    try:
        return setup_of(evidence, **given)
    except EvidenceError as error:
        if error.where != "policies":
            raise
    return replace(setup_of(evidence, **{**given, "policies": {"*": "random"}}), policies={})


def _players(episodes: Sequence[Episode], evidence: Evidence) -> tuple[str, ...]:
    """Those who are there from the start of an episode and decide something."""
    there: set[str] = set()
    for episode in episodes:
        first = next(iter(episode.turns), None)
        there |= set() if first is None else first.live
    acted = {name for name, of in evidence.summary.agents.items() if of.length_mean > 0}
    return tuple(n for n in evidence.summary.agents if n in there and n in acted)


def _asked(there: tuple[str, ...], seed: int) -> tuple[str, ...]:
    """All of them, or so many as can be played for, drawn."""
    drawn = np.random.default_rng([13, seed]).permutation(len(there))[:MOST_PLAYERS]
    return tuple(there[k] for k in sorted(drawn.tolist()))


# -- from what was played to the answer


def _attributed(
    evidence: Evidence,
    task: ReplacementTask,
    found: ContributionData,
    roles: Mapping[str, str | None],
    baseline: str,
    budget: int | None,
    rivals: str | None,
) -> Attribution:
    rng = np.random.default_rng([12, task.seed])
    shapley, differences = _closed(task, found, rng)
    method: Any = "exact" if len(task.players) <= MOST_EXACT else "sampled"
    sure = [each for each in found.scans if each["noise"] is None]
    whole = everyone(len(task.players))
    agents, harm = {}, harms(differences, shapley)
    owns = own_rewards(evidence.summary, map(outcome_of, evidence.episodes))
    for name, own in _with_terms(owns, found, evidence.episode_table.num_rows).items():
        peers = [peer for peer in task.players if roles.get(peer) == roles.get(name)]
        mine = harm.get(name, Harm(None, "nothing was played in its place"))
        lazy = _laziness(name, peers, differences, shapley, task)
        if rivals is not None:
            mine, lazy = Harm(None, RIVALS), Laziness(None, RIVALS)
            own = replace(own, share=None)
        if mine.is_harmful:
            lazy = Laziness(False, "it does harm, which is more than too little", lazy.fair)
        agents[name] = AgentPart(
            own=own,
            difference=differences.get(name),
            turn_all=None if rivals else _at_turns(sure, "all", name, task, rng),
            turn_one=None if rivals else _at_turns(sure, "one", name, task, rng),
            shapley=shapley.get(name),
            laziness=lazy,
            harm=mine,
        )
    return Attribution(
        run=None if evidence.path is None else evidence.name,
        episodes=sum(each["run"] == "recorded" for each in found.scans),
        fresh=len(found.closed),
        reused=found.reused,
        steps=sum(found.steps.values()),
        budget=budget,
        recorded=evidence.episode_table.num_rows,
        replayed=len(found.scans),
        loop="closed" if task.is_closed else "open",
        policies=other_policies(evidence, task.setup),
        baseline=baseline,
        method=method if shapley else None,
        everyone=_mean([values[whole] for values in found.closed.values()]),
        nobody=_mean([values[0] for values in found.closed.values()]),
        agents=agents,
        influence=tuple(influence(found.scans)),
        messages=tuple(talk(found.said, found.listened, rng=rng)),
        penalties=tuple(penalties(found.scans)),
        not_tested=(*_not_tested(task, found, evidence), *_untold(agents, found, task, rivals)),
        rivals=rivals,
    )


def _with_terms(owns: Mapping[str, Own], found: ContributionData, episodes: int) -> dict[str, Own]:
    """Agents' own rewards with terms from infos, where every recorded episode has them there."""
    told = [scan["terms"] for scan in found.scans if scan["run"] == "recorded" and scan["terms"]]
    if len(told) < episodes or any(own.terms for own in owns.values()):
        return dict(owns)
    means = mean_terms(told)
    return {name: replace(own, terms=means.get(name, {})) for name, own in owns.items()}


def _closed(
    task: ReplacementTask, found: ContributionData, rng: np.random.Generator
) -> tuple[dict[str, Measured], dict[str, Measured]]:
    """Shapley values and difference rewards, by player."""
    count = len(task.players)
    if not found.closed or not count:
        return {}, {}
    if count <= MOST_EXACT:
        table = [[each[mask] for each in found.closed.values()] for mask in range(1 << count)]
        values = shapley_exact(np.array(table))
    else:
        rows = []
        for number, each in found.closed.items():
            _, drawn = wanted(count, rng=np.random.default_rng([task.seed, number]))
            rows.append(shapley_of_orders(drawn, each))
        values = np.array(rows).T
    whole = everyone(count)
    lost: list[NDArray[np.float64]] = [
        np.array([each[whole] - each[whole & ~(1 << k)] for each in found.closed.values()])
        for k in range(count)
    ]
    brought = np.mean([each[whole] - each[0] for each in found.closed.values()])
    unit = abs(float(brought)) / count or 1.0
    shapley, differences = {}, {}
    for k, name in enumerate(task.players):
        given: dict[str, Any] = {"baseline": task.baseline[name], "rng": rng, "unit": unit}
        one, two = measured(values[k], **given), measured(lost[k], **given)
        if one is not None and two is not None:
            shapley[name], differences[name] = one, two
    return shapley, differences


def _at_turns(
    scans: Sequence[Mapping[str, Any]], which: str, name: str, task: ReplacementTask, rng: Any
) -> Measured | None:
    values = np.array([each[which][name] for each in scans if name in each[which]])
    nothing = "first-legal" if task.contract.noop_of(name) is None else "noop"
    return measured(values, baseline=nothing, rng=rng)


def _laziness(
    name: str,
    peers: list[str],
    differences: Mapping[str, Measured],
    shapley: Mapping[str, Measured],
    task: ReplacementTask,
) -> Laziness:
    if not task.is_closed:
        return Laziness(None, "the run names no policies, so nobody can react")
    if name in task.others:
        return Laziness(None, f"it isn't among the {len(task.players)} that were drawn")
    if name not in task.players:
        return Laziness(None, "it joins late, on the side of the one it follows")
    baseline = task.baseline[name]
    if baseline == "random" and task.contract.noop_of(name) is None:
        return Laziness(
            None,
            "no noop is declared, so random actions were played in its place, "
            "which isn't doing nothing (declare roles.ROLE.noop to have it tested)",
        )
    if len(peers) > 1:
        return laziness(name, peers, differences, shapley, baseline=baseline)
    if any(each.high is not None and each.high < 0 for each in shapley.values()):
        why = "no other agent has its role, and some agent surely takes from the team's return"
        return Laziness(None, why)
    every = list(task.players)
    return laziness(name, every, differences, shapley, baseline=baseline, part=ACROSS)


def _not_tested(
    task: ReplacementTask, found: ContributionData, evidence: Evidence
) -> list[dict[str, str]]:
    notes = []
    if not task.is_closed:
        why = "the run names no policies, so nobody can react: only single actions were replaced"
        notes.append({"what": "difference rewards of episodes, Shapley values", "why": why})
    if task.others:
        why = f"only {len(task.players)} were drawn; the others played their policies throughout"
        notes.append({"what": f"{len(task.others)} agents in whole episodes", "why": why})
    roles = task.contract.roles.items()  # those whose whole observation is a message
    deaf = [name for name, role in roles if "observation" in (role.messages or ())]
    if deaf:
        why = "all that it observes is declared a message; name the part, as observation[-3:]"
        notes.append({"what": f"listening of {', '.join(deaf)}", "why": why})
    for what in found.not_played:
        notes.append({"what": what, "why": "the budget of env steps was reached (--budget)"})
    noisy = sum(each["noise"] is not None for each in found.scans)
    if noisy:
        why = f"in {noisy} of {len(found.scans)} episodes the same actions came out otherwise"
        notes.append({"what": "single actions", "why": why})
    ends = evidence.episode_table["end"].to_pylist()
    broken = sum(end not in CAN_BE_PLAYED for end in ends)
    beyond = len(ends) - broken - sum(each["run"] == "recorded" for each in found.scans)
    beyond = 0 if found.not_played else beyond
    for count, why in ((broken, "they broke off"), (beyond, "they are beyond --action-episodes")):
        if count:
            notes.append({"what": f"replaced actions in {count} recorded episodes", "why": why})
    if not any(term.payee == ("earner",) for term in task.contract.rewards.values()):
        why = 'the contract has no reward that its causer alone is paid (payee = "earner")'
        notes.append({"what": "penalties caused by another agent", "why": why})
    untold = [set(each["untold"]) for each in found.scans if each["untold"] is not None]
    if untold:
        never = sorted(set.intersection(*untold))
        why = f"{', '.join(never)}: never in infos" if never else "in infos, but not what was paid"
        notes.append({"what": "rewards and penalties by declared term", "why": why})
    if not (found.said or found.listened or deaf):
        why = "the contract names no message field that is a part of an observation or an action"
        notes.append({"what": "effects of messages", "why": why})
    return notes


def _untold(
    agents: Mapping[str, AgentPart],
    found: ContributionData,
    task: ReplacementTask,
    rivals: str | None,
) -> Iterator[dict[str, str]]:
    """Notes on what agents that were replaced don't show: laziness, or anything at all."""
    if rivals is not None:
        yield {"what": "parts of a team's return, laziness, harm", "why": f"{RIVALS}: {rivals}"}
        return
    open_ones: dict[tuple[str, str], list[str]] = {}
    for name, part in agents.items() if task.is_closed else ():
        if name in task.players and part.laziness.is_lazy is None:
            open_ones.setdefault(("laziness", part.laziness.why), []).append(name)
        has_interval = part.difference is not None and part.difference.high is not None
        if part.harm.is_harmful is None and has_interval:
            open_ones.setdefault(("harm", part.harm.why), []).append(name)
    for (what, why), names in open_ones.items():
        yield {"what": f"{what} of {', '.join(names)}", "why": why}
    totals = {round(value, 9) for values in found.closed.values() for value in values.values()}
    if (
        len(found.closed) > 1
        and len(totals) == 1
        and any(part.own.value for part in agents.values())
    ):
        why = (
            "the sum of all agents' returns was the same in every episode: where agents compete, a "
            "team's return says nothing of any of them"
        )
        yield {"what": "parts of the team's return", "why": why}


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None
