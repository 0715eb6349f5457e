"""Whole policies in agents' places: they tell whose fault an undo undoes, and what is joint."""

from types import SimpleNamespace
from typing import Any

import pytest
from gymnasium.spaces import MultiDiscrete

import gamekeeper as gk
from gamekeeper.diagnosis.trials import POLICY, IdealSubstitute, joined
from gamekeeper.diagnosis.undo_search import ASIDE, _with_parts

DIGITS = 5


class Lock(gk.TurnEnv):
    """Two scouts say a digit each, and an opener dials both in the same turn order."""

    metadata = {"name": "lock_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode)
        self.possible_agents = ["scout_0", "scout_1", "opener"]
        self.observation_spaces = {
            agent: MultiDiscrete([DIGITS, 2] if agent != "opener" else [DIGITS, DIGITS])
            for agent in self.possible_agents
        }
        self.action_spaces = {
            agent: MultiDiscrete([DIGITS] if agent != "opener" else [DIGITS, DIGITS])
            for agent in self.possible_agents
        }

    def start(self, rng: Any, options: Any) -> None:
        """Draws two digits that aren't the middle one."""
        self.code = [int(rng.choice([0, 1, 3, 4])) for _ in range(2)]
        self.said, self.tries = [2, 2], 0

    def act(self, agent: str, action: Any) -> None:
        """Says a digit, or dials; three tries are the end."""
        if agent != "opener":
            self.said[int(agent[-1])] = int(action[0])
            return
        self.tries += 1
        is_open = [int(each) for each in action] == self.code
        for each in self.possible_agents if is_open or self.tries == 3 else ():
            self.add_reward(each, float(is_open))
            self.terminate(each, "over")

    def observe(self, agent: str) -> Any:
        """What was said for the opener, else the agent's own digit."""
        return self.said if agent == "opener" else [self.code[int(agent[-1])], self.tries % 2]


class Scout:
    """Says its digit; mirrored, by its own fault or by that of a name in a table."""

    def __init__(self, *, is_mirrored: bool = False, names: tuple[str, ...] = ()) -> None:
        self.is_mirrored, self.names = is_mirrored, names

    def __call__(self, observation: Any, agent: str, info: Any, rng: Any) -> list[int]:
        """The digit."""
        digit = int(observation[0])
        is_wrong = self.is_mirrored or agent in self.names
        return [DIGITS - 1 - digit if is_wrong else digit]


class Opener:
    """Dials what is said; some of the two digits mirrored."""

    def __init__(self, *mirrored: int) -> None:
        self.mirrored = mirrored

    def __call__(self, observation: Any, agent: str, info: Any, rng: Any) -> list[int]:
        """Both digits."""
        return [
            DIGITS - 1 - int(each) if place in self.mirrored else int(each)
            for place, each in enumerate(observation)
        ]


def answers(**policies: Any) -> dict[str, str]:
    """Answers by agent."""
    evidence = gk.rollout(Lock, policies=policies, episodes=6, seed=1)
    given: dict[str, Any] = {"env": Lock, "policies": policies, "failed": "return < 1"}
    found = gk.diagnose(evidence, **given, episodes=800, perturbations=False)
    return {agent: each.answer for agent, each in found.agents.items()}


@pytest.mark.parametrize("place", [0, 1])
def test_a_speaker_whose_peer_needs_the_same_undo_is_acquitted(place: int) -> None:
    """The opener misreads one scout; undone at that scout as well, and it isn't the scout's."""
    found = answers(scout_0=Scout(), scout_1=Scout(), opener=Opener(place))
    assert found == {"scout_0": "elsewhere", "scout_1": "elsewhere", "opener": "ambiguous"}


def test_a_speaker_that_a_peer_makes_up_for_is_named() -> None:
    """The scout says it mirrored: with the other's policy all is well."""
    found = answers(scout_0=Scout(is_mirrored=True), scout_1=Scout(), opener=Opener())
    assert found == {"scout_0": "ambiguous", "scout_1": "elsewhere", "opener": "elsewhere"}


def test_a_policy_that_goes_by_its_agents_name_acquits_nobody() -> None:
    """Both scouts mirror what is said under one name, so that a peer in its place does, too."""
    names = ("scout_0",)
    found = answers(scout_0=Scout(names=names), scout_1=Scout(names=names), opener=Opener())
    assert found["scout_0"] in ("ambiguous", "isolated")


def test_peers_that_may_have_one_fault_acquit_each_other_of_nothing() -> None:
    """The opener misreads both, or both scouts say it mirrored: their policies are alike."""
    found = answers(scout_0=Scout(), scout_1=Scout(), opener=Opener(0, 1))
    assert "elsewhere" not in (found["scout_0"], found["scout_1"])


def test_policies_that_several_agents_need_are_confirmed_beside_each_alone() -> None:
    """Where the budget has room: so that both are joint, and not one cause."""
    steps = [(("policies", agent, "", "x"),) for agent in "ab"]
    swaps = [
        IdealSubstitute(f"x for {a}", POLICY, (a,), s) for a, s in zip("ab", steps, strict=True)
    ]
    both, runner = joined(swaps, "x for both"), SimpleNamespace(left=ASIDE + 3 * 64)
    room: Any = SimpleNamespace(runner=runner, confirm=64, renewals=(), least=set())
    assert (_with_parts(room, [both]), room.least) == ([both, *swaps], {both.name})
    runner.left -= 1
    assert _with_parts(room, [both]) == [both]
    room.renewals = (both,)
    assert _with_parts(room, [both]) == []
