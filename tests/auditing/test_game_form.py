"""Each field of the measured form, on small games of known form and on hand-made facts."""

from dataclasses import replace
from functools import partial
from typing import Any

import pytest
from pettingzoo import ParallelEnv

from gamekeeper.auditing.branches import BranchStep, DecisionInput, EpisodeSteps
from gamekeeper.auditing.gather import gather, session_of
from gamekeeper.auditing.measure import form, roles, roster_changes, trials
from gamekeeper.auditing.measure.advice import FormAdvice, RoundSigns, advice
from gamekeeper.auditing.measured_form import _conflicts, measured
from gamekeeper.auditing.probes import game_form
from gamekeeper.checks.facts.form_facts import (
    AgentEnding,
    DrawnPriority,
    EpisodeShape,
    MoveLook,
    MoveTrial,
)
from gamekeeper.checks.facts.surface_facts import TimeLimits
from gamekeeper.checks.probe_evidence import Fact, ProbeEvidence, ProbeRun
from gamekeeper.contract import Contract
from gamekeeper.episodes.where import Where
from gamekeeper.interface.opening import open_env
from gamekeeper.reporting.measured_text import measured_text
from tests.auditing.form_games import Beds, Duel, Ladle, Latch, Mail, Seats
from tests.faults.rovers import Rovers


def form_of(spec: Any, budget: int = 2_000) -> dict[str, Any]:
    """The measurement from the probe of the form alone; half of the budget are its steps."""
    session = session_of(open_env(spec), None, spec=spec, kwargs={}, seed=0, budget=budget)
    found = gather(session, {"form"}, died={}, on_probe=lambda *_: None)
    assert found.broken == {}
    return measured(Contract(), found.gathered())


def test_a_mask_that_a_move_opens_makes_it_aec() -> None:
    """Legality decides where nothing is observed, and two turns of an episode show it."""
    found = form_of(Latch)
    assert (found["advice"], found["because"], found["legality"]) == ("aec", ["legality"], True)
    assert "opener's move at turn" in found["why"]
    assert "taker's mask at turn" in found["why"]
    assert (found["stages"], found["observe"]) == ([["opener"], ["taker"]], "after turn")
    assert "each role has one agent" in found["not_measured"]["symmetric"]
    assert {(row["from"], row["on"], row["lag"]) for row in found["influence"] if row["p"]} >= {
        ("opener", "mask", 0),
        ("opener", "reward", 0),
    }


def test_ends_of_agents_shift_no_comparison() -> None:
    """The None step of an agent that a move ended is passed over; the others are compared."""
    found = form_of(Duel, 1_000)
    assert (found["observe"], found["legality"]) == ("after turn", True)
    assert any(r["p"] for r in found["influence"] if r["from"] != r["to"] and r["on"] == "mask")


def test_a_move_counts_once_in_its_round() -> None:
    """Rewards are looked at in each turn of a round; one that changed makes the move one that did.

    So a share is of replaced moves, as the table says.
    """
    turns_of = [MoveLook("b", "reward", 0, k == 1, False, k) for k in range(3)]
    (row,) = trials.influence([Fact(Where("form", 0, 0), trial(*turns_of))])
    assert (row["n"], row["p"]) == (1, 1.0)


def test_agents_that_only_a_reset_names_are_measured() -> None:
    """An environment without possible_agents has the same form as with them."""

    class Unnamed(ParallelEnv[Any, Any, Any]):
        metadata = Rovers.metadata

        def __init__(self) -> None:
            self.rovers, self.agents = Rovers(), []
            self.observation_space = self.rovers.observation_space
            self.action_space = self.rovers.action_space

        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            given, self.agents = self.rovers.reset(seed, options), self.rovers.agents
            return given

        def step(self, actions: Any) -> Any:
            given, self.agents = self.rovers.step(actions), self.rovers.agents
            return given

    found, whole = form_of(Unnamed), form_of(Rovers)
    assert found["errors"] == []
    assert (found["advice"], found["because"]) == (whole["advice"], whole["because"])


def test_a_race_that_none_observes_makes_it_aec() -> None:
    """The order decides rewards, and first comes first: names aren't interchangeable."""
    found = form_of(Seats)
    assert (found["advice"], found["because"]) == ("aec", ["reward"])
    assert (found["order"], found["observe"], found["conflicts"]) == (
        "fixed",
        "after tick",
        "ordered",
    )
    assert found["symmetric"]["guest"]["seems"] is False


def test_sealed_moves_in_a_drawn_order_are_made_together() -> None:
    """No order of turns is a reason where nothing takes effect before all have moved."""
    found = form_of(partial(Seats, sealed=True), 4_000)
    assert found["advice"] == "parallel", found["why"]
    assert (found["order"], found["conflicts"]) == ("none", "joint rule")


@pytest.mark.parametrize(
    ("rule", "conflicts", "advised"),
    [
        ("roster", "priority", "aec"),
        ("lot", "random", "parallel"),
        ("joint", "joint rule", "parallel"),
    ],
)
def test_conflicts_of_a_tick(rule: str, conflicts: str, advised: str) -> None:
    """A roster's priority, a lot and a joint rule are told apart in a Parallel environment."""
    found = form_of(partial(Ladle, rule), 6_000)
    assert (found["conflicts"], found["advice"]) == (conflicts, advised), found["why"]


def test_a_joint_rule_is_shown_by_moves_that_take_from_each_other() -> None:
    """That no order was found to matter doesn't exclude a fixed order of the names."""
    fits = FormAdvice("parallel", (), "")
    assert _conflicts("parallel", fits, None, {"result": "none"}, is_joint=False) is None
    assert _conflicts("parallel", fits, None, {}, is_joint=True) == "joint rule"
    b_paid, a_paid = (MoveLook(target, "reward", 0, True, True, 2) for target in "ba")
    tried = (trial(b_paid), trial(a_paid, agent="b"))
    facts = [Fact(Where("form", 0, 0), each) for each in tried]
    assert (trials.contests(facts[:1]), trials.contests(facts)) == (0, 1)


def test_lags_endings_and_joining() -> None:
    """Post is paid three ticks later; a battery is no horizon; the spare joins."""
    found = form_of(Mail, 6_000)
    assert {"from": "sender", "to": "reader", "own": False, "lag": 3} in found["reward"]["pairs"]
    assert found["horizon"] == 15
    kinds = {(end["kind"], end["owner"]) for end in found["endings"]["kinds"]}
    assert kinds == {("truncation", "agent"), ("truncation", "all")}
    assert (found["may_join"], found["may_leave"]) == (["spare"], [])


def test_agents_apart_fit_either_api() -> None:
    """Who have nothing to do with each other can act at once or in turn."""
    found = form_of(Beds)
    assert found["advice"] == "either"
    assert found["not_measured"].get("horizon") is None
    assert found["horizon"] == 7


class Brittle(Ladle):
    """A tick in which both do nothing, or the first one, raises an exception."""

    def __init__(self, *, at_once: bool = False) -> None:
        super().__init__("joint")
        self.at_once = at_once

    def tick(self, actions: Any) -> None:
        """Raises it."""
        if self.at_once or not any(map(int, actions.values())):
            raise KeyError("ladle")
        super().tick(actions)


def test_an_action_that_is_only_observed_is_a_message() -> None:
    """Heard by another and without any other effect; a reward that it changes makes it a move."""
    heard = MoveLook("b", "observation", 1, True, False, 3)
    own = [MoveLook("a", on, 1, False, False, 3) for on in ("observation", "reward")]
    paid = MoveLook("b", "reward", 1, True, False, 3)
    facts = [Fact(Where("form", 0, 0), trial(heard, *own)) for _ in range(trials.FEWEST)]
    assert trials.messages(facts[:3]) is None
    assert trials.messages(facts) == {"a": {"message": True, "to": ["b"], "n": 60}}
    moved = [*facts, Fact(Where("form", 0, 1), trial(heard, paid))]
    assert trials.messages(moved) == {"a": {"message": False, "to": ["b"], "n": 61}}
    assert not form_of(Latch)["messages"]["opener"]["message"]


def test_exceptions_of_the_environment_are_said() -> None:
    """Episodes and replaced moves that an exception ended stand in the form, with the exception."""
    found = form_of(partial(Brittle, at_once=True))
    (error,) = found["errors"]
    assert (error["during"], found["advice"]) == ("an episode", None)
    assert found["deterministic"] is None
    assert "KeyError" in error["error"]
    assert {"an episode", "replaced moves"} == {
        each["during"] for each in form_of(Brittle, 1_000)["errors"]
    }
    assert form_of(partial(Ladle, "joint"), 300)["errors"] == []


def shape(
    *rounds: str, endings: tuple[AgentEnding, ...] = (), live: dict[int, int] | None = None
) -> EpisodeShape:
    """An episode that is over, of agents a, b, c with names of one letter."""
    return EpisodeShape(
        rounds=tuple(map(tuple, rounds)),
        first=("a", "b", "c"),
        endings=endings,
        joined=(),
        left=(),
        live=live or {},
        fares={},
        is_over=True,
    )


def ended(kind: str, step: int, agents: str) -> tuple[AgentEnding, ...]:
    """Agents that end in one step, which is a round."""
    return tuple(AgentEnding(agent, step, step, kind) for agent in agents)


def trial(*looks: MoveLook, agent: str = "a", is_moved: bool = False) -> MoveTrial:
    """A replaced move of the first of three agents."""
    return MoveTrial(agent, 0, 0, None, ("a", "b", "c"), looks, 1, is_moved)


def test_the_order_of_turns() -> None:
    """Fixed, rotating, by the state where a move changes it, else random."""
    fixed, other = shape("abc", "abc"), shape("bac", "abc")
    assert form.order_of_turns([fixed], []) == "fixed"
    assert form.order_of_turns([shape("abc", "bca", "cab")], []) == "rotating"
    assert form.order_of_turns([other], [trial()]) == "random"
    assert form.order_of_turns([other], [trial(is_moved=True)]) == "state"
    assert form.order_of_turns([fixed, shape("cba", "cba")], []) == "random"
    assert form.order_of_turns([shape("a", "a")], []) is None


def test_stages_are_roles_in_blocks() -> None:
    """Roles that act apart in every round are stages; those that mix share one."""
    names = {"a": ["a"], "b": ["b"], "c": ["c"]}
    assert form.stages([shape("abc", "bac", "abc")], names, "random") == [["a", "b"], ["c"]]
    assert form.stages([shape("abc", "abc", "abc")], names, "fixed") == [["a"], ["b"], ["c"]]
    assert form.stages([shape("abc", "abc", "abc")], names, "none") == [["a", "b", "c"]]
    assert form.stages([shape("abc")], names, "fixed") is None


def test_one_agents_limit_is_no_horizon() -> None:
    """Only where all that are left are truncated, twice at one length."""
    whole = shape("abc", "abc", endings=ended("truncation", 1, "abc"), live={1: 3})
    one = shape("abc", "abc", endings=ended("truncation", 1, "a"), live={1: 3})
    assert roster_changes.horizon([whole, whole]) == 2
    assert roster_changes.horizon([whole]) is None
    assert roster_changes.horizon([one, one]) is None
    longer = shape("abc", "abc", "abc", endings=ended("termination", 2, "abc"), live={2: 3})
    assert roster_changes.horizon([whole, whole, longer]) is None


def test_a_limit_that_is_missed_by_one_tick_is_said() -> None:
    """Where episodes are cut a tick before or after a limit that has a name, both are shown."""
    cut = shape("abc", "abc", endings=ended("truncation", 1, "abc"), live={1: 3})
    limits = TimeLimits({"max_steps": 3, "length": 30})
    facts = tuple(Fact(Where("form", 0), each) for each in (cut, cut, limits))
    evidence = ProbeEvidence("parallel", looks={"form": (ProbeRun((), (), facts),)})
    found = measured(Contract(), evidence)
    assert (found["horizon"], found["near_limits"]) == (2, {"max_steps": 3})
    text = measured_text({"measured": found, "api": "parallel"}, width=120)
    assert "2, though max_steps is 3" in text


def test_an_agent_that_joins_in_the_last_step_ends_with_all() -> None:
    """It counts as live in the step in which it came and all were truncated."""
    given = {"a": DecisionInput(b"", b"", None)}
    step = BranchStep(given, {"a": 0}, {}, dict.fromkeys("ab", "truncation"), ("a", "b"))
    found = game_form.shape(EpisodeSteps(0, ("a",), [step], [0]), is_over=True, api="aec")
    assert (found.live, found.joined) == ({0: 2}, (("b", 0),))
    assert roster_changes.kinds_of_endings([found, found]) == [
        {"kind": "truncation", "owner": "all", "seen": 2}
    ]


def test_the_owner_of_endings() -> None:
    """All that end as one own it together; two of several that fall on one step don't."""
    whole = shape("abc", endings=ended("termination", 0, "abc"), live={0: 3})
    assert roster_changes.kinds_of_endings([whole]) is None
    assert roster_changes.kinds_of_endings([whole, whole]) == [
        {"kind": "termination", "owner": "all", "seen": 2}
    ]
    alone = shape(
        "abc",
        "bc",
        endings=ended("termination", 0, "a") + ended("termination", 1, "bc"),
        live={0: 3, 1: 2},
    )
    assert roster_changes.kinds_of_endings([alone, alone]) == [
        {"kind": "termination", "owner": "agent", "seen": 4}
    ]


def test_priority_needs_one_way_whatever_is_drawn() -> None:
    """Effects along the roster are a priority, effects that turn with the draw a lot."""
    first = DrawnPriority(("a_0", "a_1"), 0, ((True, False),) * 4)
    lot = DrawnPriority(("a_0", "a_1"), 0, ((True, False), (False, True)))
    agents = ("a_0", "a_1")

    def decided(ahead: int, back: int, *facts: DrawnPriority) -> str | None:
        looks = [("a_0", "a_1")] * ahead + [("a_1", "a_0")] * back
        found = []
        for number, (one, two) in enumerate(looks):
            for agent in (one, two):
                look = MoveLook(two, "reward", 0, agent == one, False, 0)
                tried = MoveTrial(agent, number, number, None, agents, (look,), 1, False)
                found.append(Fact(Where("form", 0, number), tried))
        return roles.priority(facts, found, agents)[0]

    assert decided(roles.ALIKE, 0, first, first) == "roster"
    assert decided(roles.ALIKE, 0, first) == "unclear"
    assert decided(1, 0, first, first) == "unclear"
    assert decided(roles.ALIKE, 1, first, first) is None
    assert decided(0, 0) is None
    assert decided(3, 3, first, lot, lot) == "random"
    assert decided(3, 3, *[first] * 9, lot) == "noisy"
    assert decided(3, 3, first, first) is None


def signs(**given: Any) -> RoundSigns:
    """Signs of a game in turns in which enough was looked at and nothing found."""
    blank = {reason: trials.Within(looks=100, hits=0) for reason in ("state", "legality", "reward")}
    return RoundSigns(
        **{
            "api": "aec",
            "within": blank,
            "hits": 5,
            "looks": 300,
            "most_in_a_round": 3,
            "priority": None,
            "dictionary": None,
            "unsettled": False,
            **given,
        }
    )


def test_advice_follows_from_the_signs() -> None:
    """One pure function: aec with its reasons, parallel, either, or nothing to say."""
    assert advice(signs()).api == "parallel"
    assert advice(signs(hits=0)).api == "either"
    assert advice(signs(looks=5, unsettled=True)).api is None
    assert "differs by itself" in advice(signs(looks=5, unsettled=True)).why
    assert advice(signs(api="parallel", priority="roster")).because == ("reward",)
    assert advice(signs(api="parallel", dictionary="outcome")).api == "aec"
    assert advice(signs(api="parallel", priority="unclear")).api is None
    assert advice(signs(api="parallel", priority="random")).api == "parallel"


def test_a_payment_after_other_draws_is_no_sign_of_order() -> None:
    """A move that draws more random numbers changes what is drawn for a later agent's payment."""
    early = trial(MoveLook("b", "reward", 0, True, True, 1))
    for moved, hits in ((early, 1), (replace(early, is_shifted=True), 0)):
        within = trials.within_rounds([Fact(Where("form", 0, 0), moved)])
        assert within["reward"].hits == hits


def test_a_payment_at_the_end_of_a_round_is_no_sign_of_order() -> None:
    """Only what is paid before all have moved, or goes one way alone, shows that order decides."""
    late = MoveLook("b", "reward", 0, True, False, 2)
    early = MoveLook("b", "reward", 0, True, True, 1)
    facts = [Fact(Where("form", 0, 0), trial(look)) for look in (late, early)]
    assert trials.within_rounds(facts[:1])["reward"].hits == 0
    found = trials.within_rounds(facts[1:])["reward"]
    assert (found.hits, found.shown.turns if found.shown else None) == (1, (0, 1))
