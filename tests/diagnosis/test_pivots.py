"""The turn that lost a failed episode, and the agent whose action would have kept it."""

import json
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Discrete
from pettingzoo import ParallelEnv

import gamekeeper as gk
from gamekeeper.diagnosis.pivot_result import EpisodePivots
from gamekeeper.errors import EvidenceError
from gamekeeper.reporting.pivots_text import pivots_text


class Vault(ParallelEnv):
    """Two guards hold a vault for twelve ticks: it is lost once one of them lets go (action 1).

    Each tick it is lost by chance with probability `luck`.
    """

    metadata = {"name": "vault_v0"}  # noqa: RUF012  # as PettingZoo has it
    possible_agents = ["left", "right"]  # noqa: RUF012  # likewise

    def __init__(self, luck: float = 0.0) -> None:
        self.luck = luck

    def observation_space(self, agent: str) -> Discrete:
        return Discrete(20)

    def action_space(self, agent: str) -> Discrete:
        return Discrete(2)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.agents, self.time, self.lost = list(self.possible_agents), 0, False
        self.rng = np.random.default_rng(seed)
        return dict.fromkeys(self.agents, 0), {agent: {} for agent in self.agents}

    def step(self, actions: Any) -> Any:
        self.time += 1
        self.lost |= any(actions.values()) or bool(self.rng.random() < self.luck)
        live, over = self.agents, self.time == 12
        self.agents = [] if over else live
        return (
            dict.fromkeys(live, self.time),
            dict.fromkeys(live, 0.0 if self.lost or not over else 1.0),
            dict.fromkeys(live, over),
            dict.fromkeys(live, False),
            {agent: {} for agent in live},
        )


def guard(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Holds on, but for one time in fifty."""
    return int(rng.random() < 0.02)


def steady(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Always holds on."""
    return 0


class Blunder:
    """Holds on, but for one agent at one turn."""

    def __init__(self, turn: int, agent: str) -> None:
        self.turn, self.agent = turn, agent

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> int:
        return int(observation == self.turn and agent == self.agent)


def with_blunder(turn: int, agent: str) -> gk.Evidence:
    """An episode in which one agent lets go once."""
    return gk.rollout(Vault, policies=Blunder(turn, agent), episodes=1, seed=1)


@pytest.mark.parametrize(("turn", "agent"), [(5, "left"), (11, "right")])
def test_pivots_finds_a_blunder_and_its_agent(turn: int, agent: str) -> None:
    """The planted turn is the only pivot, and only its agent's action would have kept it."""
    evidence = with_blunder(turn, agent)
    found = gk.pivots(
        evidence, failed="return < 1", policies={"*": guard}, contract=gk.Contract()
    ).episodes[0]
    assert (found.question, found.by_copies, found.not_tried) == ("falls", True, ())
    assert [(turn, (agent,), "action")] == [(p.turn, p.agents, p.loss) for p in found.pivots]
    assert found.curve[0].share > 0.4
    assert found.curve[-1].share == 0.0


def test_pivots_where_nothing_is_drawn_looks_for_the_last_action() -> None:
    """With policies that draw nothing the curve is flat, and the other question is answered."""
    evidence = with_blunder(7, "left")
    policies = {"*": Blunder(7, "left")}
    found = gk.pivots(evidence, failed="return < 1", policies=policies).episodes[0]
    assert found.question == "last action"
    assert [(pivot.turn, pivot.agents) for pivot in found.pivots] == [(7, ("left",))]
    assert sum(point.n for point in found.curve) == 8 * 24  # the vault draws, to no effect


def seldom(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Lets go at the first turn, but for one time in eight."""
    return int(observation == 0 and agent == "left" and rng.random() > 0.125)


def test_pivots_of_few_continuations_that_are_alike_do_not_show_that_nothing_draws() -> None:
    """Three continuations that fail alike are asked again, as the policy draws."""
    evidence = gk.rollout(Vault, policies=seldom, episodes=1, seed=1)
    found = gk.pivots(evidence, failed="return < 1", policies={"*": seldom}, seed=0).episodes[0]
    assert found.question == "falls"
    assert [pivot.agents for pivot in found.pivots] in ([], [("left",)])


def test_pivots_tells_bad_luck_from_an_action() -> None:
    """A fall by the environment's own draw is nobody's action."""
    evidence = gk.rollout(Vault, policies=steady, episodes=1, seed=3, env_kwargs={"luck": 0.05})
    found = gk.pivots(evidence, 0, failed="return < 1", policies={"*": steady})
    assert [(each.loss, each.agents) for each in found.episodes[0].pivots] == [("draws", ())]


def test_pivots_says_what_the_budget_did_not_reach() -> None:
    """A spent budget is told, in the document and in the text."""
    evidence = with_blunder(5, "left")
    found = gk.pivots(evidence, failed="return < 1", policies={"*": guard}, budget=500)
    assert not found.episodes[0].pivots
    assert "the budget is spent" in found.episodes[0].not_tried[0]
    text = pivots_text(found.to_json(), width=80)
    assert "not tried: " in text
    assert max(map(len, text.splitlines())) <= 80


def test_pivots_text_says_the_same_of_several_episodes_once() -> None:
    """A share of the last turn alone says nothing of the first one."""

    def at(turn: int) -> dict[str, Any]:
        """A point of the curve without a success."""
        return {"turn": turn, "successes": 0, "n": 24, "share": 0.0, "low": 0.0, "high": 0.2}

    spent = ["more continuations: the budget is spent"]
    one = {"scope": "team", "turns": 9, "question": "falls", "pivots": [], "not_tried": spent}
    count = {"failed": 3, "episodes": 3}
    episodes = [{**one, "episode": k, "curve": [at(0), at(9)]} for k in range(2)]
    episodes.append({**one, "episode": 2, "curve": [at(9)]})
    document = {"failed": count, "episodes": episodes, "steps": 100, "budget": 100}
    text = pivots_text(document, width=100)
    assert text.count("continued from the first turn, the policies seldom succeed") == 1
    assert text.startswith("2 episodes failed without a pivot: 0, 1\n")
    assert "from turn 9" not in text


def test_pivots_document_can_be_read_again() -> None:
    """What a worker answers is what this process would have found."""
    policies = {"*": Blunder(7, "left")}
    each = gk.pivots(with_blunder(7, "left"), failed="return < 1", policies=policies).episodes[0]
    assert each.pivots
    assert each == EpisodePivots.from_json(json.loads(json.dumps(each.to_json())))


def test_pivots_refuses_an_episode_that_did_not_fail() -> None:
    """An episode that succeeded has no pivot to look for."""
    evidence = with_blunder(99, "left")
    with pytest.raises(EvidenceError, match="no failed episode 0"):
        gk.pivots(evidence, 0, failed="return < 1", policies={"*": steady})
    assert "None of 1 episodes failed" in pivots_text(
        gk.pivots(evidence, failed="return < 1", policies={"*": steady}).to_json(), width=80
    )


class Leaking(Vault):
    """A vault whose time of day goes on from one episode to the next."""

    day = 0

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.day += 1
        _, infos = super().reset(seed, options)
        return dict.fromkeys(self.agents, min(self.day, 3)), infos


@pytest.mark.parametrize("ask", [gk.diagnose, gk.attribute, gk.pivots])
def test_runs_whose_episodes_depend_on_those_before_are_refused(ask: Any) -> None:
    """Fresh episodes of such a run tell nothing of it, whatever is asked."""
    evidence = gk.rollout(Leaking, policies=guard, episodes=3, seed=1)
    options = {} if ask is gk.attribute else {"failed": "return < 99"}
    with pytest.raises(EvidenceError, match="played again by itself"):
        ask(evidence, policies={"*": guard}, **options)


def test_pivots_text_says_once_what_holds_of_several_episodes() -> None:
    """Episodes without a turn to name are listed by their numbers."""
    policies = {"*": Blunder(7, "left")}
    found = gk.pivots(with_blunder(7, "left"), failed="return < 1", policies=policies).to_json()
    blank = {**found["episodes"][0], "pivots": []}
    episodes = [{**blank, "episode": number} for number in (1, 4)]
    text = pivots_text({**found, "episodes": episodes}, width=90)
    assert "2 episodes failed without a pivot: 1, 4" in text
    assert text.count("no other action") == 1
