"""What `to_parallel` refuses, and that nothing has changed then."""

from typing import Any

import numpy as np
import pytest
from pettingzoo.classic import tictactoe_v3

from gamekeeper.contract import Contract, Schedule
from gamekeeper.errors import ActionError, ContractError, OrderError, SpecError
from gamekeeper.interface.conversion import to_parallel
from gamekeeper.interface.to_parallel import ToParallel
from tests.interface.relays import TurnRelay
from tests.interface.ticking import Round, Turns

QUIET = Round((), (), 0, 0)
ZEROS = (("agent_0", 0), ("agent_1", 0), ("agent_2", 0))


@pytest.mark.parametrize(
    ("actions", "said"),
    [
        (ZEROS[:2], "no action of 'agent_2'"),
        ((*ZEROS, ("agent_7", 0)), "an action of 'agent_7'"),
        ((*ZEROS[:2], ("nobody", 0)), "no action of 'agent_2'; an action of 'nobody'"),
        ((*ZEROS[:2], ("agent_2", 4)), "'agent_2' did what is not in its action space"),
        ((*ZEROS[:2], ("agent_2", None)), "'agent_2' did what is not in its action space"),
    ],
)
def test_actions_that_are_refused_change_nothing(actions: Any, said: str) -> None:
    """No turn of the tick has been played when one action of it is wrong."""
    env = to_parallel(Turns(3, [QUIET] * 3))
    env.reset()
    with pytest.raises(ActionError, match=said):
        env.step(dict(actions))
    assert env.env.done == {}
    env.step({agent: np.int64(action) for agent, action in ZEROS})
    assert env.env.time == 1


def test_calls_in_the_wrong_order_are_refused() -> None:
    """A step before the reset."""
    with pytest.raises(OrderError, match="step\\(\\) came before reset"):
        to_parallel(Turns(3, [QUIET])).step({})


def test_environment_that_is_no_tick_game_is_refused() -> None:
    """With the reason and three ways to fix it."""
    with pytest.raises(SpecError, match="tictactoe_v3 can't be opened as parallel") as caught:
        to_parallel(tictactoe_v3.raw_env())
    for way in ("open it as aec", "order='as declared'", "style='turn'"):
        assert way in caught.value.fix
    for options in ({"order": "any"}, {"style": "round"}):
        with pytest.raises(SpecError, match="no such conversion"):
            to_parallel(Turns(3, [QUIET]), **options)  # type: ignore[arg-type]
    with pytest.raises(SpecError, match="only a PettingZoo environment"):
        to_parallel(3)


def test_contract_can_declare_that_rounds_are_ticks() -> None:
    """Observations that show what was after the tick are declared in its schedule."""

    class Declared(TurnRelay):
        contract = Contract(schedule=Schedule(observe="after tick"))

    class Undeclared(TurnRelay):
        contract = Contract(schedule=Schedule(observe="after turn"))

    assert isinstance(to_parallel(Declared()), ToParallel)
    with pytest.raises(SpecError):
        to_parallel(Undeclared())


class Again(TurnRelay):
    """The first runner has every second turn."""

    def next_agent(self, agent: str) -> str:
        first, second, third = self.possible_agents
        return first if agent != first else (second if self.turns % 4 == 1 else third)


def test_round_in_which_somebody_comes_twice_is_refused() -> None:
    """An action can't be played twice, and none may be dropped."""
    env = to_parallel(Again(), order="as declared")
    env.reset(seed=0)
    with pytest.raises(ContractError, match="a round of turns isn't a tick") as caught:
        env.step(dict.fromkeys(env.agents, 0))
    assert "another turn of 'runner_0'" in caught.value.actual


class Stuck(Turns):
    """Never lets go of those who have ended."""

    def _was_dead_step(self, action: Any) -> None:
        """Does nothing."""


def test_agent_that_never_leaves_is_refused() -> None:
    """In place of a loop without an end."""
    env = to_parallel(Stuck(2, [Round((), ((0, True),), 0, 0), QUIET]))
    env.reset()
    with pytest.raises(ContractError, match="'agent_0' ended and doesn't leave"):
        env.step(dict.fromkeys(env.agents, 0))


class Slow(Turns):
    """Lets those who ended wait until they would be in turn."""

    def _deads_step_first(self) -> None:  # type: ignore[override]
        """Does nothing."""

    def _end_round(self) -> None:
        super()._end_round()
        if self.time == 2 and self.generous:
            self.rewards["agent_1"] = 1.0

    generous = False


def test_end_is_told_once_although_the_agent_lingers() -> None:
    """It is told as it happens, the agent can act no more, and what is paid later is refused."""
    env = to_parallel(Slow(2, [Round((), ((1, True),), 0, 0), QUIET, QUIET]))
    env.reset()
    *_, terminations, _, _ = env.step(dict.fromkeys(env.agents, 0))
    assert terminations == {"agent_0": False, "agent_1": True}
    assert (env.agents, env.env.agents) == (["agent_0"], ["agent_0", "agent_1"])
    assert env.step({"agent_0": 0})[2] == {"agent_0": False}
    env.env.generous = True
    env.reset()
    env.step(dict.fromkeys(env.agents, 0))
    with pytest.raises(ContractError, match="'agent_1' was paid when it could no longer be told"):
        env.step({"agent_0": 0})
