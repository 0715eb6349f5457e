"""The tests of a new task: PettingZoo's own, one for each stand-in rule, and replay."""

from __future__ import annotations

from typing import Final

from gamekeeper.report.scaffold.plan import EndingPlan, Plan, TermPlan
from gamekeeper.report.scaffold.stand_in import (
    FIRST_TERM,
    arrival,
    fault_turn,
    faults,
)

AEC_ROUND: Final = """    paid: dict[str, dict[str, float]] = {}
    for _ in range(len(env.agents)):
        agent = env.agent_selection
        if env.endings or not env.agents:
            break
        env.step((EFFORT if agent in workers else NOOP)[role_of(agent)])
        for each, terms in env.terms.items():
            paid.setdefault(each, {}).update(terms)
    return paid"""
PARALLEL_ROUND: Final = """    agents = env.agents
    deeds = {each: EFFORT if each in workers else NOOP for each in agents}
    env.step({each: deed[role_of(each)] for each, deed in deeds.items()})
    return {agent: dict(terms) for agent, terms in env.terms.items()}"""


def promises_text(plan: Plan) -> str:
    """`tests/test_promises.py`: what holds whatever the rules are, and stays as it is."""
    is_aec = plan.api == "aec"
    tests = "api_test, seed_test" if is_aec else "parallel_api_test, parallel_seed_test"
    api_test, seed_test = tests.split(", ")
    name = plan.class_name
    return f'''"""What holds whatever the rules are: PettingZoo's promises, the contract, replay."""

from pathlib import Path

import gamekeeper as gk
import pytest
from pettingzoo.test import {tests}

from {plan.name} import env as module
from {plan.name}.env import {name}

SPEC = f"{{Path(module.__file__)}}:{name}"


def test_pettingzoo_has_nothing_to_object_to() -> None:
    """PettingZoo's own tests pass."""
    {api_test}({name}(), num_cycles=100)
    {seed_test}({name}, num_cycles=50)


def test_contract_fits() -> None:
    """The contract declares the environment's own API, and a role and a noop for every agent."""
    env = {name}()
    contract = gk.Contract.load(Path(module.__file__).with_name("{plan.name}.toml"))
    assert gk.draft_contract({name}).api == contract.api
    assert None not in {{contract.role_of(agent) for agent in env.possible_agents}}
    assert gk.rollout({name}, policies="noop", episodes=1, contract=contract).fingerprint


@pytest.mark.parametrize("policy", ["random", *getattr({name}, "policies", ())])
def test_same_seeds_give_the_same_evidence(policy: str) -> None:
    """The same seed and the same policies give the same rollout, bit for bit."""
    first, second = (gk.rollout(SPEC, policies=policy, episodes=3, seed=7) for _ in range(2))
    assert first.fingerprint == second.fingerprint


def test_evidence_replays(tmp_path: Path) -> None:
    """What was recorded replays in a fresh process, bit for bit."""
    gk.rollout(SPEC, episodes=3, seed=1, out=tmp_path / "run")
    replay = gk.replay(tmp_path / "run", env=SPEC)
    assert replay.verified, replay
'''


def rules_text(plan: Plan) -> str:
    """`tests/test_rules.py`: a test for each stand-in rule, replaced with it."""
    number = FIRST_TERM + len(plan.terms)
    parts = [_tools(plan), _first_rules(plan), _turns(plan)]
    parts += [_term(plan, term, at) for at, term in enumerate(plan.terms, start=FIRST_TERM)]
    end = arrival(plan)
    if end is not None:
        parts.append(_arrival(plan, end, number))
        number += 1
    parts += [_fault(plan, fault, at) for at, fault in enumerate(faults(plan), start=number)]
    parts.append(_horizon(plan, number + len(faults(plan))))
    return "\n\n".join(part.strip("\n") + "\n" for part in parts)


def _tools(plan: Plan) -> str:
    """What the tests of rules share."""
    name = plan.class_name
    argument, told, drawn = "", "", "return env"
    if faults(plan):
        argument, told = "fault: str | None = None", ", in which this fault is drawn"
        drawn = "if env.fault == fault:\n            return env"
    return f'''"""A test for each rule; a rule that is replaced takes its test with it."""

from collections.abc import Collection

import pytest

from {plan.name}.env import EFFORT, FURTHEST, NOOP, {name}, role_of


def begun({argument}) -> {name}:
    """An episode that has begun, with no limit near{told}."""
    env = {name}(horizon=1_000)
    for seed in range(1_000):
        env.reset(seed=seed)
        {drawn}
    raise AssertionError("no such episode")


def agents_of(role: str) -> list[str]:
    """The agents of a role."""
    return [agent for agent in {name}().possible_agents if role_of(agent) == role]


def go_round(env: {name}, workers: Collection[str]) -> dict[str, dict[str, float]]:
    """A round in which some make an effort and the others do nothing; what it paid, by term."""
{AEC_ROUND if plan.api == "aec" else PARALLEL_ROUND}


def until_paid(env: {name}, worker: str, term: str) -> dict[str, float]:
    """One agent works until it is there; what everybody was paid of a term then."""
    for _ in range(FURTHEST):
        paid = go_round(env, [worker])
        if env.to_go[worker] == 0:
            return {{agent: terms[term] for agent, terms in paid.items() if term in terms}}
    raise AssertionError("it never arrived")


def until_ended(env: {name}, workers: Collection[str]) -> dict[str, str]:
    """Rounds until the first agent has ended; who has, and why."""
    for _ in range(1_000):
        go_round(env, workers)
        if env.endings:
            return dict(env.endings)
    raise AssertionError("nobody ended")
'''


def _first_rules(plan: Plan) -> str:
    name = plan.class_name
    return f'''
def test_r1_ways_are_drawn() -> None:
    """R1: 1 to FURTHEST steps, by the seed."""
    env, ways = {name}(), set()
    for seed in range(50):
        env.reset(seed=seed)
        ways |= set(env.to_go.values())
        first = dict(env.to_go)
        env.reset(seed=seed)
        assert env.to_go == first
    assert ways == set(range(1, FURTHEST + 1))


@pytest.mark.parametrize("agent", {name}().possible_agents[:8])
def test_r2_an_effort_is_a_step(agent: str) -> None:
    """R2: who makes an effort is a step further, who does nothing isn't."""
    env = begun()
    before = dict(env.to_go)
    go_round(env, [agent])
    assert env.to_go == before | {{agent: before[agent] - 1}}
'''


def _turns(plan: Plan) -> str:
    if plan.api == "parallel":
        return '''
def test_r3_the_order_of_the_dictionary_changes_nothing() -> None:
    """R3: actions are carried out in the order of the roster, whatever order they are given in."""
    one, two = begun(), begun()
    while one.agents:
        deeds = {agent: EFFORT[role_of(agent)] for agent in one.agents}
        given = one.step(deeds), two.step(dict(reversed(deeds.items())))
        assert given[0][1:4] == given[1][1:4]
        assert one.state().tolist() == two.state().tolist()
        if one.endings or not any(one.to_go.values()):
            break
'''
    stages = str(plan.stages).replace("'", '"')
    sizes = [sum(len(plan.of(role)) for role in stage) for stage in plan.stages]
    rotates = plan.order == "rotating" and max(sizes) > 1
    is_same = {
        "fixed": "rounds[0] == rounds[1]",
        "rotating": "rounds[0] != rounds[1]" if rotates else "",
    }
    check = f"    assert {is_same[plan.order]}\n" if is_same.get(plan.order) else ""
    return f'''
def test_r3_each_acts_once_in_a_round() -> None:
    """R3: group after group, each agent once a round."""
    env, stages = begun(), {stages}
    rounds = []
    for _ in range(2):
        order = []
        for _ in range(len(env.possible_agents)):
            order.append(env.agent_selection)
            env.step(NOOP[role_of(order[-1])])
        groups = [next(i for i, s in enumerate(stages) if role_of(a) in s) for a in order]
        assert sorted(order) == sorted(env.possible_agents)
        assert groups == sorted(groups)
        rounds.append(order)
{check}'''


def _term(plan: Plan, term: TermPlan, number: int) -> str:
    worker = plan.of(term.earner)[0]
    others = [agent for agent in plan.of(term.payee) if agent != worker]
    expected = {
        "individual": f'{{"{worker}": 1.0}}',
        "shared": f"dict.fromkeys({_agents(term.payee)}, 1.0)",
        "zero-sum": f"dict.fromkeys({_agents(term.payee)}, -1.0) | "
        f'{{"{worker}": {float(len(others))}}}',
    }[term.kind]
    told = {
        "individual": "who arrives is paid",
        "shared": "all payees are paid the same when one arrives",
        "zero-sum": "who arrives takes it from the others",
    }[term.kind]
    return f'''
def test_r{number}_{term.name}_is_paid() -> None:
    """R{number}: {told}."""
    env = begun()
    expected = {expected}
    assert until_paid(env, "{worker}", "{term.name}") == expected
'''


def _arrival(plan: Plan, ending: EndingPlan, number: int) -> str:
    one = plan.agents[0]
    workers = f'["{one}"]' if ending.owner == "agent" else _agents(ending.owner)
    return f'''
def test_r{number}_{ending.name}_ends_who_arrived() -> None:
    """R{number}: an ending of owner {ending.owner!r}, a termination."""
    env = begun()
    workers = {workers}
    assert until_ended(env, workers) == dict.fromkeys(workers, "{ending.name}")
'''


def _fault(plan: Plan, fault: EndingPlan, number: int) -> str:
    whom = "[env.struck]" if fault.owner == "agent" else _agents(fault.owner)
    return f'''
def test_r{number}_{fault.name}_strikes() -> None:
    """R{number}: an ending of owner {fault.owner!r}, a {fault.kind}."""
    env = begun("{fault.name}")
    struck = {whom}
    assert until_ended(env, []) == dict.fromkeys(struck, "{fault.name}")
    assert env.acted[env.struck] == {fault_turn(plan)}
'''


def _horizon(plan: Plan, number: int) -> str:
    return f'''
def test_r{number}_time_is_limited() -> None:
    """R{number}: after the horizon, the contract's unless given, all are truncated."""
    env = begun()
    assert env.declared.schedule.horizon == {plan.horizon}
    env.horizon = 5
    env.reset(seed=env.rng.seed)
    assert until_ended(env, []) == dict.fromkeys(env.possible_agents, "horizon")
'''


def _agents(owner: str) -> str:
    """Python for the agents of a role, or all."""
    return "env.possible_agents" if owner == "all" else f'agents_of("{owner}")'
