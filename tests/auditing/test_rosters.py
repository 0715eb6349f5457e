"""Rosters: possible agents, agents, and of whom the dictionaries speak."""

from typing import Any

import numpy as np
import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.result import AuditResult
from gamekeeper.contract import Contract
from tests.auditing.roster_games import Counting, Turning
from tests.faults.rovers import Rovers

FAMILIES = ("GK1", "GK50")


def audited(spec: object, *, contract: Contract | None = None, budget: int = 300) -> AuditResult:
    """The audit of a small game, by the checks of rosters and endings."""
    found = audit_here(spec, contract=contract, select=FAMILIES, budget=budget)
    assert [v.reason for v in found.verdicts if v.outcome == "error"] == []
    return found


def broken(spec: object, **options: Any) -> set[str]:
    """The ids of the checks that are broken."""
    return {verdict.id for verdict in audited(spec, **options).failed}


@pytest.mark.parametrize("game", [Counting, Turning])
@pytest.mark.parametrize(
    "ids", [("a", "b", "c"), (0, 1, 2), (("red", 0), ("red", 1), ("blue", 0))], ids=str
)
def test_agents_may_be_called_anything(game: Any, ids: Any) -> None:
    """Numbers and tuples name agents as well as texts do."""
    assert broken(lambda: game(ids)) == set()


@pytest.mark.parametrize("game", [Counting, Turning])
def test_one_agent_is_enough(game: Any) -> None:
    """A game for one, and one that is over after its first step, keep every promise."""
    assert broken(lambda: game(("a",), (4,))) == set()
    assert broken(lambda: game(ends=(1, 1, 1))) == set()


def test_object_alone_is_looked_at() -> None:
    """Where only an object is there, what doesn't need a second instance is still seen."""
    env = Counting()
    found = audited(env)
    assert found.failed == ()
    assert found.of("GK102").outcome == found.of("GK103").outcome == "passed"


def test_object_that_loses_possible_agents_is_found() -> None:
    """An object whose possible agents vanish is broken, with a program to be completed."""

    def bend(env: Any, out: Any) -> Any:
        env.possible_agents = [a for a in env.possible_agents if a in env.agents] or ["a"]
        return out

    verdict = audited(Counting(bend=bend)).of("GK102")
    assert verdict.outcome == "failed"
    assert "your environment" in verdict.findings[0].reproducer


def test_possible_agents_may_be_left_out() -> None:
    """An environment that can't know its agents beforehand has no such attribute."""

    class Generated(Counting):
        def __init__(self) -> None:
            super().__init__()
            self.names = self.possible_agents
            del self.possible_agents

        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            self.agents, self.tick = list(self.names), 0
            return dict.fromkeys(self.agents, 0), {a: {} for a in self.agents}

    found = audited(Generated)
    assert found.failed == ()
    assert found.of("GK101").outcome == "not_exercised"


def test_possible_agents_differ_between_instances() -> None:
    """A list of the class that every instance adds to isn't the same for all of them."""

    class Shared(Counting):
        names: list[str] = []  # noqa: RUF012  # the fault

        def __init__(self) -> None:
            super().__init__()
            self.names.append(f"late_{len(self.names)}")
            self.possible_agents = [*self.possible_agents, *self.names]
            self.ends.update(dict.fromkeys(self.names, 2))

    verdict = audited(Shared).of("GK102")
    assert verdict.outcome == "failed"
    assert "another instance" in verdict.findings[0].where


def test_a_reset_that_leaves_nobody_is_found() -> None:
    """`agents` is filled by reset, not by the constructor."""

    class Empty(Counting):
        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            super().reset()
            self.agents = []
            return {}, {}

    assert "GK103" in broken(Empty)


def test_a_key_for_all_is_a_stranger_in_flags_but_not_in_infos() -> None:
    """`__all__` in terminations is no agent; `common` in infos is a habit PettingZoo allows."""

    def all_ended(env: Any, out: Any) -> Any:
        out[2]["__all__"] = not env.agents
        return out

    def common(env: Any, out: Any) -> Any:
        out[4]["common"] = {"tick": env.tick}
        return out

    assert broken(lambda: Counting(bend=all_ended)) == {"GK105"}
    assert broken(lambda: Counting(bend=common)) == set()


@pytest.mark.parametrize(
    ("part", "id"), [(0, "GK107"), (1, "GK107"), (2, "GK107"), (3, "GK107"), (4, "GK109")]
)
def test_a_live_agent_that_is_left_out_is_found(part: int, id: str) -> None:
    """A missing entry is found in each of the five dictionaries."""

    def bend(env: Any, out: Any) -> Any:
        if "b" in env.agents and env.tick == 2:
            del out[part]["b"]
        return out

    assert broken(lambda: Counting(bend=bend)) == {id}


@pytest.mark.parametrize(("part", "id"), [(0, "GK108"), (1, "GK108"), (3, "GK108"), (4, "GK109")])
def test_a_last_step_that_is_left_out_is_found(part: int, id: str) -> None:
    """What an agent is told in the step that ends it is no less than before."""

    def bend(env: Any, out: Any) -> Any:
        for agent in [a for a in out[2] if a not in env.agents]:
            del out[part][agent]
        return out

    assert broken(lambda: Counting(bend=bend)) == {id}


@pytest.mark.parametrize("lost", [(2, 3), (0, 2, 3)])
def test_an_end_without_any_flag_is_told_once(lost: tuple[int, ...]) -> None:
    """Neither flag has an entry for an agent that leaves: it is gone without having ended.

    Nor has it an observation, where dictionaries are made for those that are left.
    """

    def bend(env: Any, out: Any) -> Any:
        gone = [a for a in out[2] if a not in env.agents] if env.agents else []
        for agent in gone:
            for part in lost:
                del out[part][agent]
        return out

    assert broken(lambda: Counting(bend=bend)) == {"GK501"}


@pytest.mark.parametrize("paid", [0.0, 0.25])
@pytest.mark.parametrize(
    ("missing", "id"), [(None, ""), (1, "GK107"), (2, "GK107"), (3, "GK107"), (4, "GK109")]
)
def test_a_late_joiner_has_its_entries(missing: int | None, id: str, paid: float) -> None:
    """An agent that joins in a step may be paid in it; it isn't ended, and has an info."""

    class Joining(Counting):
        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            super().reset()
            self.agents.remove("c")
            return dict.fromkeys(self.agents, 0), {a: {} for a in self.agents}

        def step(self, actions: Any) -> Any:
            out = super().step(actions)
            if self.tick == 2 and out[0]:
                self.agents.append("c")
                for part, value in enumerate((2, paid, False, False, {})):
                    if part != missing:
                        out[part]["c"] = value
            return out

    assert broken(Joining) == ({id} if id else set())


def test_words_of_the_gone_are_found() -> None:
    """Accounts of the dead are one finding, views of the dead another and a lesser one."""

    def paid(env: Any, out: Any) -> Any:
        return (*out[:1], {a: out[1].get(a, 0.0) for a in env.possible_agents}, *out[2:])

    class Waiting(Counting):
        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            out = super().reset()
            self.agents.remove("c")
            return tuple({a: part[a] for a in self.agents} for part in out)

        def step(self, actions: Any) -> Any:
            out = super().step(actions)
            out[1].setdefault("c", 0.0)
            return out

    def shown(env: Any, out: Any) -> Any:
        return (dict.fromkeys(env.possible_agents, env.tick), *out[1:])

    assert broken(lambda: Counting(bend=paid)) == broken(Waiting) == {"GK106"}
    found = audited(lambda: Counting(bend=shown))
    assert [(v.id, v.severity) for v in found.failed] == [("GK113", "low")]


def test_a_late_reward_is_one_entry_at_its_turn() -> None:
    """A reward of an agent that has left says nothing of other entries, nor of other turns."""

    def late(env: Any, out: Any) -> Any:
        if env.tick == 6:
            out[1]["a"] = 1.0
        return out

    found = audited(lambda: Counting(ends=(3, 9, 9), bend=late))
    assert [verdict.id for verdict in found.failed] == ["GK106"]
    assert str(found.of("GK106").findings[0].where).endswith("turn 5, rewards['a']")
    assert found.of("GK113").outcome == "passed"


@pytest.mark.parametrize(
    ("out", "seen"), [(lambda out: out[:4], "a tuple of 4"), (lambda out: out[0], "a dict")]
)
def test_a_step_of_another_form_is_found(out: Any, seen: str) -> None:
    """What isn't five dictionaries is named, and nothing is made of what is missing in it."""
    found = audited(lambda: Counting(bend=lambda env, five: out(five)))
    assert found.of("GK110").findings[0].actual == seen
    assert found.of("GK107").outcome == found.of("GK109").outcome == "not_exercised"


def test_possible_agents_in_an_array_are_told_and_stop_no_check() -> None:
    """An array has no truth: it is named as what it is, and everything else is looked at."""

    class Arrayed(Counting):
        def __init__(self) -> None:
            super().__init__()
            self.possible_agents = np.array(self.possible_agents, object)

        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            out = super().reset()
            self.agents = list(self.agents)
            return out

    found = audit_here(Arrayed, select=("GK114", "GK201", "GK211", "GK601"), budget=400)
    outcomes = {verdict.id: verdict.outcome for verdict in found.verdicts}
    assert outcomes == {"GK114": "failed", **dict.fromkeys(("GK201", "GK211", "GK601"), "passed")}


def test_infos_that_are_none_are_told_once() -> None:
    """What isn't a dictionary has no entries that could be missing."""

    class Bare(Counting):
        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            return super().reset()[0], None

    found = audited(Bare)
    assert found.of("GK110").findings[0].actual == "infos: NoneType"
    assert found.of("GK109").outcome != "failed"


def test_a_reset_of_another_form_is_found() -> None:
    """Observations alone are the form of before PettingZoo had infos at reset."""

    class Old(Counting):
        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            return super().reset()[0]

    assert "GK110" in broken(Old)


@pytest.mark.parametrize("book", ["rewards", "terminations", "truncations", "infos"])
def test_books_in_turns_speak_of_the_living(book: str) -> None:
    """A book of an AEC environment that forgets a live agent, or keeps a dead one, is found."""

    def forgets(env: Any) -> None:
        if len(env.agents) == 2:
            getattr(env, book).pop(next(a for a in env.agents if a != env.agent_selection), None)

    def keeps(env: Any) -> None:
        getattr(env, book).setdefault("a", {} if book == "infos" else False)

    expected = "GK109" if book == "infos" else "GK107"
    assert expected in broken(lambda: Turning(ends=(3, 9, 9), bend=forgets))
    assert "GK106" in broken(lambda: Turning(ends=(3, 9, 9), bend=keeps))


def test_leaving_and_coming_back_may_be_declared() -> None:
    """Who is declared free to leave and join comes back; else that it leaves is told, and once."""

    class Resting(Counting):
        def step(self, actions: Any) -> Any:
            out = super().step(actions)
            if self.tick == 2:
                self.agents.remove("c")
            if self.tick == 4 and "c" not in self.agents and out[0]:
                self.agents.append("c")
                for part, value in zip(out, (4, 0.0, False, False, {}), strict=True):
                    part["c"] = value
            return out

    roles = {"a": {}, "b": {}, "c": {"may_leave": True, "may_join": True}}
    free = Contract.from_json({"roles": roles})
    assert broken(Resting, contract=free) == set()
    assert broken(Resting) == {"GK501"}


def test_a_finalized_count_is_low() -> None:
    """num_agents that doesn't follow the roster is a nuisance, found once somebody has ended."""

    class Fixed(Rovers):
        num_agents = 3  # type: ignore[assignment]

    found = audited(Fixed, budget=800)
    assert [(v.id, v.severity) for v in found.failed] == [("GK111", "low")]


def test_a_set_is_no_roster() -> None:
    """A set of agents has no order that another process would know."""

    class Loose(Counting):
        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            out = super().reset()
            self.agents = set(self.agents)  # type: ignore[assignment]
            return out

        def step(self, actions: Any) -> Any:
            self.agents = sorted(self.agents)
            out = super().step(actions)
            self.agents = set(self.agents)  # type: ignore[assignment]
            return out

    assert "GK114" in broken(Loose)


def test_a_fault_is_shown_where_no_action_can_name_its_agent() -> None:
    """Programs find agents by their place; agents that no file can name are a fault themselves."""
    spec = "tests.auditing.roster_games:MadeAnew"
    found = audit_here(spec, select=("GK110", "GK221", "GK607", "GK902"), budget=300)
    assert {each.id for each in found.failed} == {"GK110", "GK902"}


def test_reset_that_ends_the_program_is_told_where_agents_are_not_listed() -> None:
    """Agents are asked for before any probe plays, if need be of a reset."""

    class Leaves(Counting):
        def __init__(self) -> None:
            super().__init__()
            del self.possible_agents

        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            raise SystemExit

    assert "SystemExit" in str(audit_here(Leaves, budget=200).verdicts)


def test_flags_of_agents_that_are_not_in_the_game_are_no_flags_of_an_episode() -> None:
    """Of a possible agent that sits out GK106 tells; the reset's flags are of those that play."""

    class SitsOut(Turning):
        def reset(self, seed: int | None = None, options: Any = None) -> None:
            super().reset()
            self.agents.remove("c")
            self.terminations["c"] = True

    found = audit_here(SitsOut, select=("GK106", "GK506"), budget=300)
    assert [each.id for each in found.failed] == ["GK106"]


def test_program_of_an_empty_roster_looks_right_after_a_reset() -> None:
    """Whatever was played before: at the end of an episode nobody is there in any environment."""

    class Empty(Counting):
        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            super().reset()
            self.agents = []
            return {}, {}

    found = audit_here(Empty, select=("GK103",), budget=300).of("GK103").findings
    assert "env.reset(seed=SEED)\nassert list(env.agents)" in found[0].reproducer
