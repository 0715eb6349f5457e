"""There and back again: what is converted twice is what it was."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from pettingzoo.classic import rps_v2, tictactoe_v3
from pettingzoo.utils.conversions import aec_to_parallel, parallel_to_aec

from gamekeeper.interface.conversion import to_aec, to_parallel
from gamekeeper.interface.opening import open_env
from gamekeeper.interface.slim import slim
from gamekeeper.interface.to_aec import ToAEC
from gamekeeper.interface.to_parallel import ToParallel
from gamekeeper.runs.recording import rollout
from tests.interface.relays import TickRelay, TickTickets
from tests.interface.test_to_parallel import by_agent
from tests.interface.ticking import SCRIPTS, Round, Ticks, Turns, aec_rows, parallel_rows, plain
from tests.interface.toys import Pair

QUIET = Round((), (), 0, 0)


@given(st.integers(1, 6), SCRIPTS, st.integers(0, 9))
def test_parallel_environment_comes_back_as_it_was(n: int, script: list[Round], seed: int) -> None:
    """Every dictionary and the order of every roster, with deaths, joins and rosters that turn."""
    original, back = Ticks(n, script), ToParallel(ToAEC(Ticks(n, script)))
    assert repr(original.reset(seed=seed)) == repr(back.reset(seed=seed))
    while original.agents:
        assert original.agents == back.agents
        actions = {agent: len(agent) % 4 for agent in original.agents}
        for theirs, ours in zip(original.step(actions), back.step(actions), strict=True):
            assert {a: repr(theirs[a]) for a in theirs} == {a: repr(ours[a]) for a in ours}
        assert original.state().tolist() == back.state().tolist()
    assert back.agents == []


@given(st.integers(1, 6), SCRIPTS, st.integers(0, 9))
def test_aec_environment_comes_back_as_it_was(n: int, script: list[Round], seed: int) -> None:
    """Every row of everybody, although each round of the original has an order of its own."""
    back = ToAEC(ToParallel(Turns(n, script)))
    expected = plain(by_agent(aec_rows(Turns(n, script), seed)))
    assert expected == plain(by_agent(aec_rows(back, seed)))


@given(st.integers(1, 5), SCRIPTS, st.integers(0, 9))
def test_four_conversions_change_nothing(n: int, script: list[Round], seed: int) -> None:
    """Not even the order of a roster."""
    back = ToParallel(ToAEC(ToParallel(ToAEC(Ticks(n, script)))))
    expected = plain(parallel_rows(Ticks(n, script), seed))
    assert expected == plain(parallel_rows(back, seed))


def test_conversion_back_unpacks() -> None:
    """The original object comes back, also out of PettingZoo's own converters."""
    parallel, aec = Pair(), Turns(2, [QUIET])
    assert to_parallel(to_aec(parallel)) is parallel
    assert to_aec(to_parallel(aec)) is aec
    assert to_parallel(parallel_to_aec(parallel)) is parallel
    assert to_aec(aec_to_parallel(aec)) is aec


def test_relay_comes_back_as_it_was() -> None:
    """Infos, terms and reasons of our own base class survive both ways."""
    original, back = TickRelay(), ToParallel(ToAEC(TickRelay()))
    outcomes: list[Any] = []
    for env in (original, back):
        env.reset(seed=6)
        seen = []
        while env.agents:
            out = env.step(dict.fromkeys(env.agents, 1))
            seen.append((out[1:], {agent: dict(paid) for agent, paid in env.terms.items()}))
        outcomes.append((seen, env.unwrapped.endings))
    assert outcomes[0] == outcomes[1]


def test_evidence_of_a_round_trip_has_the_fingerprint_of_the_original() -> None:
    """What the door records is the same to the bit, masks, terms and reasons included."""
    makes: list[Any] = [TickRelay, TickTickets, lambda: Ticks(4, [Round((), (), 1, 1)] * 4)]
    for make in makes:
        original = rollout(make, episodes=2, seed=3)
        back = rollout(lambda make=make: ToParallel(ToAEC(make())), episodes=2, seed=3)
        assert original.agent_steps.num_rows > 0
        assert original.fingerprint == back.fingerprint


def test_evidence_of_a_slim_environment_has_the_fingerprint_of_the_shipped_one() -> None:
    """So a recording of one replays on the other."""
    for make in (tictactoe_v3.env, rps_v2.parallel_env):
        shipped = rollout(make, episodes=3, seed=5)
        assert (
            shipped.fingerprint == rollout(lambda m=make: slim(m()), episodes=3, seed=5).fingerprint
        )


def test_opening_with_another_api_converts() -> None:
    """By the same conversions, and without a warning where there is no render mode."""
    opened = open_env(lambda: Ticks(2, [QUIET]), api="aec")
    assert (type(opened.env), opened.api) == (ToAEC, "aec")
    opened = open_env(lambda: Turns(2, [QUIET]), api="parallel")
    assert (type(opened.env), opened.api) == (ToParallel, "parallel")
