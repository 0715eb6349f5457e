"""Endings: flags, who leaves with them, horizons and declared endings."""

from typing import Any

import numpy as np
import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.contract import Contract
from tests.auditing.roster_games import Counting, Turning
from tests.auditing.test_rosters import audited, broken
from tests.faults.endings import LimitTerminates

AT_20 = Contract.from_json({"schedule": {"horizon": 20}})


def test_everybody_may_end_in_one_step_or_never() -> None:
    """Games that end for all at once, by both flags, or not at all within an episode, are legal."""

    def both(env: Any, out: Any) -> Any:
        return *out[:3], dict(out[2]), out[4]

    assert broken(lambda: Counting(ends=(4, 4, 4))) == set()
    assert broken(lambda: Counting(ends=(4, 4, 4), bend=both)) == set()
    assert broken(lambda: Counting(ends=(900, 900, 900), limit=900)) == set()


def test_both_ways_of_leaving_silently_are_told_apart() -> None:
    """One that vanishes while others stay leaves silently; all over one's end is another."""

    def vanishes(env: Any, out: Any) -> Any:
        return *out[:2], dict.fromkeys(out[2], False), *out[3:]

    def all_go(env: Any, out: Any) -> Any:
        env.agents = [] if any(out[2].values()) else env.agents
        return out

    assert broken(lambda: Counting(bend=vanishes)) == {"GK501"}
    assert broken(lambda: Counting(bend=all_go)) == {"GK502"}


def test_a_last_agent_that_vanishes_left_silently() -> None:
    """An empty roster after nobody ended is as silent as one agent's leaving."""

    def vanish(env: Any, out: Any) -> Any:
        env.agents = [] if env.tick == 2 else env.agents
        return out

    assert broken(lambda: Counting(bend=vanish)) == {"GK501"}


@pytest.mark.parametrize("flag", [1, None, "yes", np.array([True])], ids=repr)
def test_flags_of_other_types_are_found_and_read(flag: Any) -> None:
    """A flag that is no bool is named once; where it is true, nobody is said to have vanished."""

    def bend(env: Any, out: Any) -> Any:
        return *out[:2], {a: flag if ended else False for a, ended in out[2].items()}, *out[3:]

    assert broken(lambda: Counting(bend=bend)) - {"GK501"} == {"GK504"}


def test_flags_of_numpy_are_low() -> None:
    """`np.bool_` misleads hardly anybody, and PettingZoo's own test refuses it."""

    def bend(env: Any, out: Any) -> Any:
        return *out[:2], {a: np.bool_(ended) for a, ended in out[2].items()}, *out[3:]

    found = audit_here(lambda: Counting(bend=bend), select=("GK504",), budget=200).of("GK504")
    assert (found.outcome, found.severity) == ("failed", "low")


def test_flags_of_a_turn_environment_are_looked_at() -> None:
    """Numbers as flags are found in the books of an AEC environment too."""

    def bend(env: Any) -> None:
        env.truncations = dict.fromkeys(env.truncations, 0)

    assert broken(lambda: Turning(bend=bend)) == {"GK504"}


def test_one_that_stays_a_tick_longer_is_found() -> None:
    """An agent whose end is announced while it is still to act is asked for a dead one's action."""

    class Late(Counting):
        def step(self, actions: Any) -> Any:
            out = super().step(actions)
            self.agents += [a for a in out[2] if self.tick == self.ends[a]]
            return out

    assert "GK503" in broken(Late)


def test_a_horizon_is_kept_where_it_is_declared() -> None:
    """Truncation at the declared tick is right; later, earlier and termination aren't."""
    ends = (900, 900, 900)

    def told_as_termination(env: Any, out: Any) -> Any:
        ended = {a: out[2][a] or out[3][a] for a in out[2]}
        return *out[:2], ended, dict.fromkeys(ended, False), out[4]

    def audits(**options: Any) -> set[str]:
        return broken(lambda: Counting(ends=ends, **options), contract=AT_20, budget=700)

    assert audits(limit=20) == set()
    assert audits(limit=25) == {"GK507"}
    assert audits(limit=15) == {"GK507"}
    assert audits(limit=20, bend=told_as_termination) == {"GK507"}


def test_a_rule_may_end_an_episode_in_its_last_tick() -> None:
    """Terminations at the horizon are rules of the game where others are truncated there."""
    found = audited(lambda: Counting(ends=(20, 12, 900), limit=20), contract=AT_20, budget=700)
    assert found.of("GK507").outcome == "passed"


BATTERY = {"battery": {"kind": "truncation", "owner": "agent"}}
GOAL = {"goal": {"kind": "termination", "owner": "agent"}}


@pytest.mark.parametrize("is_over", [False, True], ids=["truncates", "terminates"])
def test_another_limit_than_the_declared_one_is_found(is_over: bool) -> None:
    """Every episode over after 15 ticks breaks a horizon of 20, whatever other endings exist."""

    def bend(env: Any, out: Any) -> Any:
        ended = {a: out[2][a] or out[3][a] for a in out[2]}
        return (*out[:2], ended, dict.fromkeys(ended, False), out[4]) if is_over else out

    def audits(endings: Any, **options: Any) -> set[str]:
        contract = Contract.from_json({"schedule": {"horizon": 20}, "endings": endings})
        game = {"ends": (900, 900, 900), "limit": 15, "bend": bend, **options}
        return broken(lambda: Counting(**game), contract=contract, budget=700)

    assert audits(BATTERY) == {"GK507"}
    assert audits(GOAL if is_over else BATTERY, ends=(13, 900, 900)) == set()


def test_a_declared_and_named_ending_may_come_early_every_time() -> None:
    """A reason that the environment names and the contract declares explains an equal length."""

    def bend(env: Any, out: Any) -> Any:
        env.endings = {agent: "battery" for agent, is_late in out[3].items() if is_late}
        return out

    contract = Contract.from_json({"schedule": {"horizon": 20}, "endings": BATTERY})
    game = {"ends": (900, 900, 900), "limit": 15, "bend": bend}
    assert broken(lambda: Counting(**game), contract=contract, budget=700) == set()


def test_ticks_of_turns_are_rounds() -> None:
    """In an AEC environment the horizon counts how often an agent has acted."""
    three = Contract.from_json({"schedule": {"horizon": 3}})
    eight = Contract.from_json({"schedule": {"horizon": 8}})
    assert broken(Turning, contract=three) == {"GK507"}
    assert broken(Turning, contract=eight) == set()


def test_an_undeclared_limit_that_terminates_is_low() -> None:
    """What an attribute calls a limit terminates: a finding, of low severity and not quite sure."""
    verdict = audited(LimitTerminates, budget=900).of("GK508")
    assert (verdict.outcome, verdict.severity) == ("failed", "low")
    assert verdict.confidence < 1.0


@pytest.mark.parametrize("name", ["rounds", "max_rounds", "hand_limit"])
def test_a_last_round_terminates(name: str) -> None:
    """Games of so many rounds, or moves, end by their own rules, always at the same turn."""

    class Rounds(Counting):
        def __init__(self) -> None:
            super().__init__(ends=(6, 6, 6))
            setattr(self, name, 6)

    assert broken(Rounds) == set()


def test_a_limit_that_is_met_by_chance_stays_silent() -> None:
    """Where time is up by truncation, a termination in the same tick is a rule's."""

    class Limited(Counting):
        def __init__(self) -> None:
            super().__init__(ends=(6, 900, 900), limit=6)
            self.max_steps = 6

    assert broken(Limited) == set()


class Reasons(Counting):
    """Names why each agent has ended."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nobody has."""
        self.endings: dict[str, str] = {}
        return super().reset(seed, options)

    def step(self, actions: Any) -> Any:
        """Everybody's reason is the same."""
        out = super().step(actions)
        self.endings.update((a, "out") for a in out[2] if out[2][a])
        return out


def declared(**ending: Any) -> Contract:
    """A contract with one ending, and roles `low` (a, b) and `high` (c)."""
    roles = {"low": {"agents": ["a", "b"]}, "high": {"agents": "c"}}
    return Contract.from_json({"endings": {"out": ending}, "roles": roles})


def test_endings_reach_their_owner() -> None:
    """An ending of a role ends the role, one of all everybody, one of an agent only itself."""

    def of(owner: str, ends: tuple[int, ...]) -> set[str]:
        contract = declared(kind="termination", owner=owner)
        return broken(lambda: Reasons(ends=ends), contract=contract)

    assert of("agent", (3, 5, 7)) == set()
    assert of("low", (3, 3, 7)) == set()
    assert of("low", (3, 5, 7)) == {"GK500"}
    assert of("all", (3, 3, 7)) == {"GK500"}
    assert of("all", (3, 3, 3)) == set()


def test_endings_are_of_their_kind() -> None:
    """A termination that is declared a truncation is found; an undeclared reason isn't judged."""
    assert broken(Reasons, contract=declared(kind="truncation")) == {"GK509"}
    assert broken(Reasons, contract=declared(kind="termination")) == set()
    other = Contract.from_json({"endings": {"elsewhere": {"kind": "truncation"}}})
    assert broken(Reasons, contract=other) == set()
