"""Summaries say what each agent got and did, by hand-counted runs."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Discrete

from gamekeeper.contract import Contract
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.summary import AgentSummary, Summary
from gamekeeper.interface.recorded_env import capture_of, recorded_of
from gamekeeper.rollouts.memory import MemorySink
from tests.episodes.buffers import IDENTITY, Given

NOOP = Contract.from_json({"roles": {"a": {"agents": "a_*", "noop": 0}}})


class Paying(Given):
    """Pays and ends as its script says: per tick, by agent, reward and flag."""

    def __init__(self, script: list[dict[str, tuple[Any, str]]], **settings: Any) -> None:
        names = ["a_0", "a_1", "b_0"]
        spaces = dict.fromkeys(names, Discrete(9))
        super().__init__({n: [0] for n in names}, spaces, actions=Discrete(5), **settings)
        self.script = script

    def step(self, actions: Any) -> Any:
        plan = self.script[self.tick % len(self.script)]
        self.tick += 1
        agents = self.agents
        flags = {a: plan.get(a, (0.0, ""))[1] for a in agents}
        if "raise" in flags.values():
            raise ValueError("as the script says")
        self.agents = [a for a in agents if not flags[a]]
        return (
            dict.fromkeys(agents, np.int64(0)),
            {a: plan.get(a, (0.0, ""))[0] for a in agents},
            {a: flags[a] == "terminated" for a in agents},
            {a: flags[a] == "truncated" for a in agents},
            {a: {} for a in agents},
        )


def evidence_of(
    script: list[dict[str, tuple[Any, str]]],
    ticks: int,
    *,
    actions: dict[str, list[Any]] | None = None,
    contract: Contract | None = None,
    endings: dict[str, Any] | None = None,
) -> Evidence:
    """One episode; what agents do is 0 unless told."""
    env = Paying(script)
    if endings is not None:
        env.endings = endings
    sink = MemorySink()
    wrapped: Any = recorded_of(capture_of(env, sink=sink))
    wrapped.reset(seed=1)
    for tick in range(ticks):
        if not wrapped.agents:
            break
        acts = {a: (actions or {}).get(a, [np.int64(0)]) for a in wrapped.agents}
        try:
            wrapped.step({a: given[tick % len(given)] for a, given in acts.items()})
        except ValueError:
            continue
    wrapped._capture.end_episode()
    return sink.evidence(IDENTITY, contract=contract)


def test_returns_lengths_and_endings_are_each_agents_own() -> None:
    """The one that ends first has fewer turns; the others are cut."""
    script = [{"a_0": (1.5, "")}, {"a_0": (1.0, "terminated"), "a_1": (0.5, "truncated")}, {}]
    summary = evidence_of(script, 4).summary
    found = {name: (a.return_mean, a.length_mean, a.endings) for name, a in summary.agents.items()}
    assert found == {
        "a_0": (2.5, 2.0, {"terminated": 1}),
        "a_1": (0.5, 2.0, {"truncated": 1}),
        "b_0": (0.0, 4.0, {"cut": 1}),
    }
    assert summary.turns == 4
    assert summary.agent_steps == 8


def test_shares_are_parts_of_a_sum_without_a_negative_return() -> None:
    """Where one return is negative the worst agent would have the largest share: then all are None.

    So they are where the sum is 0, or isn't finite.
    """
    assert shares({"a_0": 3.0, "a_1": 1.0}) == [0.75, 0.25, 0.0]
    for pays in (
        {"a_0": -3.0, "a_1": -1.0},
        {"a_0": 3.0, "a_1": -1.0},
        {},
        {"a_0": np.inf},
        {"a_0": float("nan")},
    ):
        assert shares(pays) == [None] * 3


def shares(pays: dict[str, float]) -> list[float | None]:
    """The shares after one tick that pays this."""
    agents = evidence_of([{a: (pay, "") for a, pay in pays.items()}], 1).summary.agents
    return [agent.share for agent in agents.values()]


def test_idle_is_the_part_of_the_declared_noop() -> None:
    """Of whole numbers of any type; None for roles that declare none."""
    acts = {"a_0": [np.int64(0), np.int64(2)], "a_1": [0, np.int64(0), 1, 0]}
    summary = evidence_of([{}], 4, actions=acts, contract=NOOP).summary
    assert [agent.idle for agent in summary.agents.values()] == [0.5, 0.75, None]
    without = evidence_of([{}], 4, actions=acts).summary
    assert [agent.idle for agent in without.agents.values()] == [None] * 3


def test_decision_that_raised_is_counted_once() -> None:
    """It stands again at the next turn."""
    summary = evidence_of([{}, {"a_0": (0.0, "raise")}, {}], 2).summary
    assert [agent.length_mean for agent in summary.agents.values()] == [1.0] * 3


def test_reasons_of_the_rules_come_before_flags() -> None:
    """Only where they are texts."""
    endings = {"a_0": "met", "a_1": ["no", "text"], "nobody": "x"}
    evidence = evidence_of(
        [dict.fromkeys(("a_0", "a_1", "b_0"), (0.0, "terminated"))], 1, endings=endings
    )
    found = [agent.endings for agent in evidence.summary.agents.values()]
    assert found == [{"met": 1}, {"terminated": 1}, {"terminated": 1}]
    assert evidence.episode(0).endings == {"a_0": "met"}


@pytest.mark.parametrize("ticks", [0, 3])
def test_texts_have_a_line_for_each_agent(ticks: int) -> None:
    """Aligned text, an escaped HTML table, plain JSON."""
    summary = evidence_of([{}], ticks).summary
    assert [len(str(summary).splitlines()), len(summary.rows())] == [4, 4]
    assert set(summary.to_json()) == {"episodes", "turns", "agent_steps", "seconds", "agents"}
    strange = Summary(1, 1, 1, 0.0, {"<b>": AgentSummary(1.0, 1.0, None, None, {"a&b": 1})})
    assert "&lt;b&gt;" in strange.to_html()
    assert "a&amp;b 1" in strange.to_html()
