"""Undos from outside: they do what they say, and a diagnosis names the one that restores."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete, Space
from pettingzoo import ParallelEnv

import gamekeeper as gk
from gamekeeper.contract import Contract
from gamekeeper.diagnosis.counterfactuals import _acted, _action_text, _place
from gamekeeper.diagnosis.experiment import Experiment
from gamekeeper.diagnosis.judgement import _labels, is_any_exchange, is_any_scale
from gamekeeper.diagnosis.open_setup import Setup
from gamekeeper.diagnosis.response_tests import ResponseTest
from gamekeeper.diagnosis.trials import IdealSubstitute, over_undos, peers_of, swaps_of, undone
from gamekeeper.diagnosis.undo_candidates import (
    action_undos,
    call_undos,
    candidates_of,
    is_either,
    is_known_range,
    is_unmoved,
    observation_undos,
    shift_undos,
)
from gamekeeper.diagnosis.undo_search import ASIDE, ROUNDS, _other_boundaries, pairs_of
from gamekeeper.diagnosis.undos import BoundaryUndo, UndonePolicies
from gamekeeper.episodes.divergence import Divergence
from gamekeeper.episodes.outcome import Outcome, failures
from gamekeeper.errors import EvidenceError
from gamekeeper.interface.joint_policy import assign
from gamekeeper.reporting.diagnosis_screen import diagnosis_screen
from gamekeeper.rollouts.interventions.fields import acted_fields, observed_fields

SIDE = 5


def test_other_boundaries_of_an_agent_are_tried_before_a_label_is_given() -> None:
    """Where one undo restores, those of the same agent's other boundaries come first."""
    mirrored, settled = BoundaryUndo(("a",), "mirror axis", (0,)), BoundaryUndo(("a",), "hold")
    first, same, other, late, strange = (
        undone(each)
        for each in (
            mirrored,
            BoundaryUndo(("a",), "exchange axes", (0, 1)),
            BoundaryUndo(("a",), "mirror field", (0,)),
            settled,
            BoundaryUndo(("b",), "hold"),
        )
    )
    rest = [strange, same, other, late]
    runner = SimpleNamespace(left=ASIDE + 64 + 10 + 2 * ROUNDS[0])
    room: Any = SimpleNamespace(runner=runner, confirm=64)
    more, left, rivals = _other_boundaries(room, {first: 1.0}, rest, 1, 10)
    assert more == [other, late]
    assert (left, rivals) == ([strange, same], [same])
    runner.left -= ROUNDS[0]
    assert _other_boundaries(room, {first: 1.0}, rest, 1, 10)[2] == [late, same]
    assert _other_boundaries(room, {first: 0.5}, rest, 1, 10)[0] == []


class Spaces:
    """An environment that has spaces and nothing else."""

    def __init__(self, seen: Space[Any], done: Space[Any]) -> None:
        self.observation_space = lambda agent: seen
        self.action_space = lambda agent: done


class Late:
    """Does what it was shown two turns ago."""

    queue: list[int]

    def reset(self, seed: int) -> None:
        """Begins anew."""
        self.queue = [0, 0]

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> int:
        """What it was shown."""
        self.queue.append(int(observation[0]))
        return self.queue[-3]


class Echo:
    """Policies of which each action is known; notes what they are shown."""

    def __init__(self, *actions: Any) -> None:
        self.actions, self.shown = list(actions), list[Any]()

    def begin(self, run_seed: int, episode: int) -> None:
        """Begins."""

    def act(self, agent: Any, observation: Any, info: Any) -> Any:
        """The next of its actions, the last one for ever."""
        self.shown.append(observation)
        return self.actions.pop(0) if len(self.actions) > 1 else self.actions[0]


def passed(
    undo: BoundaryUndo, seen: Space[Any], done: Space[Any], *turns: Any, acts: Any = (0,)
) -> Any:
    """What the policy was shown, and what was done."""
    echo = Echo(*acts)
    joint_policy = UndonePolicies(echo, undo, Spaces(seen, done), Contract())
    joint_policy.begin(0, 0)
    return echo.shown, [joint_policy.act("a", observation, {}) for observation in turns]


@pytest.mark.parametrize(
    ("way", "places", "amount", "shown"),
    [
        ("exchange fields", (0, 2), 0, [3.0, 2.0, 1.0]),
        ("mirror field", (1,), 0, [1.0, 8.0, 3.0]),
        ("turn fields", (0, 1), 1, [8.0, 1.0, 3.0]),
        ("rescale fields", (), 2.0, [2.0, 4.0, 6.0]),
        ("normalize fields", (), 0.0, [0.1, 0.2, 0.3]),
    ],
)
def test_observations_are_shown_otherwise(
    way: Any, places: tuple[int, ...], amount: float, shown: list[float]
) -> None:
    """Bounds are 0 and 10; a value may leave them, and what was given stays as it was."""
    seen, given = Box(0.0, 10.0, (3,), np.float64), np.array([1.0, 2.0, 3.0])
    found, _ = passed(BoundaryUndo(("a",), way, places, amount), seen, Discrete(2), given)
    assert found[0].tolist() == pytest.approx(shown)
    assert given.tolist() == [1.0, 2.0, 3.0]
    untouched, _ = passed(BoundaryUndo(("b",), way, places, amount), seen, Discrete(2), given)
    assert untouched[0] is given


@pytest.mark.parametrize(
    ("way", "places", "amount", "space", "action", "done"),
    [
        ("exchange actions", (0, 1, 3), 0, Discrete(5), 3, 1),
        ("mirror axis", (0,), 0, Discrete(5), 4, 0),
        ("shift actions", (0,), 1, Discrete(5), 4, 0),
        ("exchange axes", (0, 1), 0, MultiDiscrete([3, 3]), np.array([0, 2]), [2, 0]),
        ("rescale axes", (), 10.0, Box(-1.0, 1.0, (2,)), np.array([0.05, -0.5]), [0.5, -1.0]),
    ],
)
def test_actions_are_carried_out_otherwise(
    way: Any, places: tuple[int, ...], amount: float, space: Space[Any], action: Any, done: Any
) -> None:
    """They stay in their space."""
    undo = BoundaryUndo(("a",), way, places, amount)
    _, (found,) = passed(undo, Box(0, 1), space, np.zeros(1), acts=(action,))
    assert np.asarray(found).tolist() == pytest.approx(done)
    assert space.contains(np.asarray(found, space.dtype) if np.ndim(found) else found)


def test_calls_are_made_otherwise() -> None:
    """A lag is settled by further calls, choices are held, of draws the commonest is taken.

    The policy itself is asked once a turn whatever is undone: its memory goes on as ever.
    """
    spaces = Spaces(Box(0, 9, (1,)), Discrete(9))
    for way, amount, expected in (
        ("settle", 2.0, [5, 6, 7, 8]),
        ("hold", 2.0, [0, 0, 5, 5]),
        ("commonest", 3.0, [0, 0, 5, 6]),
    ):
        late = Late()
        inner = assign({"a": late}, possible_agents=["a"], action_space=spaces.action_space)
        joint_policy = UndonePolicies(
            inner, BoundaryUndo(("a",), way, (), amount), spaces, Contract()
        )
        joint_policy.begin(0, 0)
        assert [joint_policy.act("a", np.array([x]), {}) for x in (5, 6, 7, 8)] == expected, way
        assert late.queue == [0, 0, 5, 6, 7, 8]


def test_an_undo_that_shows_values_which_never_occur_shows_nothing() -> None:
    """A clock of 0 to 1 is mirrored below 0; of an error both signs were recorded."""
    fields = acted_fields(Box(-5.0, 5.0, (2,)))
    known = [np.array([error, clock]) for error in (-2.0, 0.5, 2.0) for clock in (0.2, 0.6, 1.0)]
    clock, error = (BoundaryUndo(("a",), "mirror field", (place,)) for place in (1, 0))
    assert not is_known_range(clock, fields, known[:3], known)
    assert is_known_range(error, fields, known[:3], known)
    assert is_known_range(clock, fields, (), known)


def test_one_field_exchanged_for_different_others_has_no_label() -> None:
    """It is only not shown as it is; one exchange alone, or two of other fields, keep theirs."""
    one, two, three = (
        undone(BoundaryUndo(("a",), "exchange fields", places))
        for places in ((1, 9), (7, 9), (2, 3))
    )
    assert is_any_exchange([one, two])
    assert _labels([one, two]) == ()
    assert _labels([one, three]) == ("perception",)


def test_an_undo_is_data_and_says_what_it_does() -> None:
    """Workers are handed it as JSON; people read it in words."""
    undo = BoundaryUndo(("light",), "exchange fields", (0, 1), names=("field 0", "field 1"))
    assert str(undo) == "exchanging fields 0 and 1 of light's observation"
    setup = Setup("env", undos=(undo,))
    assert Setup.from_json(setup.to_json()).undos == (undo,)
    assert undone(undo).labels == ("perception",)
    assert undone(BoundaryUndo(("a",), "commonest", amount=9.0)).labels == ()


def test_response_tests_leave_out_what_they_contradict() -> None:
    """No exchange of fields that are both ignored, no settling of a lag that isn't there."""
    fields = acted_fields(Box(-1.0, 1.0, (3,)))
    tried = [
        undo for _, undo in observation_undos(("a",), fields, frozenset({"field 1", "field 2"}))
    ]
    exchanged = {undo.places for undo in tried if undo.way == "exchange fields"}
    assert exchanged == {(0, 1), (0, 2)}
    assert {undo.places for undo in tried if undo.way == "mirror field"} == {(0,)}
    assert {undo.way for _, undo in call_undos(("a",), [0, 0], 0.0)} == {"hold"}
    ways = [(undo.way, undo.amount) for _, undo in call_undos(("a",), [0, 3], 0.2)]
    assert ways[:2] == [("settle", 3.0), ("commonest", 9.0)]
    values = {u.places for _, u in action_undos(("a",), acted_fields(Discrete(3, start=1)))}
    assert {(0, 1, 2), (0, 1, 3), (0, 2, 3)} <= values


def test_parts_of_a_dict_are_exchanged_as_wholes_and_pixels_need_bounds_of_pixels() -> None:
    """Two entries of one shape; a factor of 255 only where bounds don't contradict it."""
    two = Box(-3.0, 3.0, (2,), np.float32)
    space = Dict({"goal": two, "place": two, "power": Discrete(3)})
    fields = observed_fields(Contract(), "a", space)
    tried = [undo for _, undo in observation_undos(("a",), fields, frozenset())]
    whole = next(undo for undo in tried if len(undo.places) == 4)
    assert str(whole) == "exchanging fields goal and place of a's observation"
    given = {"goal": np.float32([1, 2]), "place": np.float32([-1, 0]), "power": 1}
    (shown,), _ = passed(whole, space, Discrete(2), given)
    assert [shown[key].tolist() for key in ("goal", "place")] == [[-1, 0], [1, 2]]
    unlike = acted_fields(MultiDiscrete([6, 3, 6]))  # neighbours whose bounds differ, with no turn
    ways = [(undo.way, undo.places) for _, undo in observation_undos(("a",), unlike, frozenset())]
    exchanged = [places for way, places in ways if way == "exchange fields"]
    assert exchanged == [(0, 1), (0, 2), (1, 2)]
    assert "turn fields" not in {way for way, _ in ways}
    factors = [
        {undo.amount for _, undo in observation_undos(("a",), acted_fields(box), frozenset())}
        for box in (two, Box(0.0, 1.0, (2,)), Box(0.0, 255.0, (2,)))
    ]
    assert [255.0 in each for each in factors] == [False, True, False]
    enlarged = undone(BoundaryUndo(("a",), "rescale fields", amount=10.0))
    assert (enlarged.labels, enlarged.shown) == (
        (),
        "a's gain, from what is observed to what is done",
    )


def test_constants_are_added_by_parts_of_the_recorded_span_and_have_no_label() -> None:
    """To fields that are reacted to, of whole numbers 1 and 2 within bounds, and to axes."""
    space = Dict({"far": Box(-5.0, 5.0, (1,)), "near": Discrete(4)})
    fields = observed_fields(Contract(), "a", space)
    own = [{"far": np.float32([x]), "near": 3 * (x > 1)} for x in np.linspace(0, 2, 21)]
    axes = acted_fields(Box(-1.0, 1.0, (1,)))
    tried = [undo for _, undo in shift_undos(("a",), fields, frozenset(), axes, own)]
    by_field = [[one.amount for one in tried if one.names == (each.name,)] for each in fields]
    factors = [0.5, 2.0, 0.1, 10.0]
    shifts = [0.36, -0.36, 0.63, -0.63, 0.18, -0.18, 1.1, -1.1]
    assert by_field == [[*shifts, *factors], [1, -1, 2, -2, 1, -1]]
    assert len(tried) == 26
    deaf = frozenset(each.name for each in fields)
    assert len(list(shift_undos(("a",), fields, deaf, axes, own))) == 8
    (shown,), _ = passed(tried[12], space, Discrete(2), {"far": np.float32([4]), "near": 3})
    assert shown["near"] == 3
    (shown,), _ = passed(tried[9], space, Discrete(2), {"far": np.float32([4]), "near": 3})
    assert (shown["far"].item(), shown["near"]) == (8, 3)
    assert str(tried[9]) == "multiplying field far of a's observation by 2"
    assert undone(tried[9]).labels == ()
    assert undone(tried[9]).shown == "a constant factor in what a observes, aims at or does"
    assert str(tried[0]) == "adding 0.36 to field far of a's observation"
    assert undone(tried[0]).labels == ()
    assert undone(tried[0]).shown == "a constant offset in what a observes, aims at or does"


def test_an_observed_number_of_a_thing_is_shifted_in_a_circle_and_has_no_label() -> None:
    """An index that is one off: the last one goes on at the first, which no constant does."""
    space = Dict({"table": Discrete(3, start=1), "far": Discrete(50)})
    fields = observed_fields(Contract(), "a", space)
    own = [{"table": 1 + at % 3, "far": at} for at in range(9)]
    tried = [undo for _, undo in shift_undos(("a",), fields, frozenset(), (), own)]
    circles = [undo for undo in tried if undo.way == "shift values"]
    assert [(each.names, each.amount) for each in circles] == [
        (("field table",), 1),
        (("field table",), -1),
    ]
    shown, _ = passed(circles[1], space, Discrete(2), *own[:3])
    assert [each["table"] for each in shown] == [3, 1, 2]
    assert str(circles[1]) == "shifting values of field table of a's observation by -1"
    assert undone(circles[1]).labels == ()


def test_numbers_of_one_vector_are_multiplied_together() -> None:
    """Velocities in other units are two numbers; a factor of one of them makes up for nothing."""
    space = Dict({"all": Box(-2.0, 2.0, (4,)), "aim": Box(-9.0, 9.0, (3,))})
    fields = observed_fields(Contract(), "a", space)
    assert len(fields) == 7
    own = [{"all": np.full(4, x, np.float32), "aim": np.ones(3)} for x in (0.1, 0.2)]
    tried = [undo for _, undo in shift_undos(("a",), fields, frozenset(), (), own)]
    together = [undo for undo in tried if len(undo.places) > 1 and undo.amount == 0.1]
    pairs = [fields[undo.places[0]].part.path == ("all",) for undo in together]
    assert (len(together), sum(pairs)) == (7, 4)
    (speed,) = (undo for undo in together if undo.names == (fields[-2].name, fields[-1].name))
    (shown,), _ = passed(speed, space, Discrete(2), own[0])
    assert [shown["aim"].tolist(), shown["all"][2:].tolist()] in (
        [[1, 1, 1], pytest.approx([0.01, 0.01])],
        [[1, 0.1, 0.1], pytest.approx([0.1, 0.1])],
    )
    assert str(speed).startswith("multiplying fields ")
    assert undone(speed).labels == ()


def test_mirrored_values_leave_open_which_boundary_misreads_them() -> None:
    """Of other values only one pair is exchanged: a mirror of four or more could be at either."""

    def is_open(way: Any, seen: Space[Any], done: Space[Any]) -> bool:
        named: Any = SimpleNamespace(env=Spaces(seen, done), contract=Contract())
        return is_either(named, BoundaryUndo(("a",), way, (0,)))

    few, many, real = Discrete(3), Discrete(6), Box(-1.0, 1.0, (1,))
    assert is_open("mirror axis", Discrete(5), many)
    assert not is_open("mirror axis", few, many)
    assert not is_open("mirror axis", Discrete(5), few)
    assert not is_open("mirror axis", real, many)
    assert is_open("mirror field", Discrete(5), many)
    assert not is_open("mirror field", Discrete(7), many)  # more values than it has actions
    assert not is_open("mirror field", real, many)


def test_a_policy_that_reacts_to_nothing_is_shown_other_fields_and_other_scales() -> None:
    """It may be waiting for what it never sees; a constant in place of another shows nothing."""
    box = Box(-1.0, 1.0, (3,), np.float64)
    chosen = SimpleNamespace(name="pilots.py:a", version="1")
    joint_policy = SimpleNamespace(chosen_for=lambda agent: chosen)
    named: Any = SimpleNamespace(
        env=Spaces(box, box), contract=Contract(), joint_policy=joint_policy
    )
    deaf = tuple(f"field {at}" for at in range(3))
    unmoved = ResponseTest(60, 0, True, 0.0, {}, 0, deaf, dict.fromkeys(deaf, 0.0), 0.0)
    ways = [(one.way, one.places) for one in candidates_of(named, {"a": unmoved}, ["a"])]
    assert {way for way, _ in ways} == {
        "hold",
        "exchange fields",
        "rescale fields",
        "normalize fields",
    }
    assert ("exchange fields", (0, 2)) in ways
    assert is_unmoved(["a"], {"a": unmoved})
    assert not is_unmoved(["a"], {"a": replace(unmoved, reactions=1)})
    assert not is_unmoved(["a"], {"a": replace(unmoved, lasting={4: 2})})
    assert not is_unmoved(["a"], {})


def test_an_undo_of_one_agent_goes_before_that_of_several_and_before_a_whole_policy() -> None:
    """What makes up for more says less."""
    one, both = (BoundaryUndo(agents, "mirror axis", (0,)) for agents in (("a",), ("a", "b")))
    assert undone(both, [one, both]).contains == {str(one)}
    policy = next(swaps_of({"a": "noop"}, Contract(), ["a", "b"]))
    memory = IdealSubstitute("memory", "memory", ("a",), (("forgets", "a", "", True),))
    lag = BoundaryUndo(("a",), "settle", amount=3.0)
    given = [policy, memory, undone(one), undone(lag)]
    contains = {each.name: each.contains for each in over_undos(given)}
    assert contains[policy.name] == {str(one), str(lag), "memory"}
    assert contains["memory"] == {str(lag)}


def test_peers_and_named_policies_are_tried_in_an_agents_place() -> None:
    """Of its role, where they have another policy; a name that nobody has is refused."""
    setup = Setup("env", policies={"picker_0": "a:b", "picker_1": "c:d", "carrier_0": "e:f"})
    agents = ["picker_0", "picker_1", "carrier_0"]
    found = {one.name: one for one in peers_of(setup, Contract(), agents)}
    assert list(found) == ["giving picker_0 picker_1's policy", "giving picker_1 picker_0's policy"]
    assert found["giving picker_0 picker_1's policy"].applied(setup).policies["picker_0"] == "c:d"
    named = [one.name for one in swaps_of({"picker": "x:y"}, Contract(), agents)]
    assert named == ["giving picker_0 the policy x:y", "giving picker_1 the policy x:y"]
    with pytest.raises(EvidenceError, match="'pickr', which is no agent and no role here"):
        list(swaps_of({"pickr": "x:y"}, Contract(), agents))


class Meeting(ParallelEnv[str, Any, int]):
    """Two agents on a line that see both places, and are paid once they meet in the middle."""

    metadata = {"name": "meeting_v0", "render_modes": []}  # noqa: RUF012  # PettingZoo's own form

    def __init__(self, render_mode: str | None = None) -> None:
        self.possible_agents = ["left_0", "right_0"]
        self.render_mode = render_mode

    def observation_space(self, agent: str) -> Space[Any]:
        """Its own place, and the middle."""
        return MultiDiscrete([2 * SIDE + 1, 2 * SIDE + 1])

    def action_space(self, agent: str) -> Space[Any]:
        """Down, stay, up."""
        return Discrete(3)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Draws the places."""
        rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.middle = int(rng.integers(2, 2 * SIDE - 1))
        self.at = {"left_0": 0, "right_0": 2 * SIDE}
        self.turn = 0
        return self._seen(), {agent: {} for agent in self.agents}

    def step(self, actions: Any) -> Any:
        """Moves both."""
        self.turn += 1
        for agent, action in actions.items():
            self.at[agent] = min(max(self.at[agent] + int(action) - 1, 0), 2 * SIDE)
        met, late = set(self.at.values()) == {self.middle}, self.turn >= 2 * SIDE
        agents, seen = self.agents, self._seen()
        each = [dict.fromkeys(agents, value) for value in (float(met), met, late and not met)]
        if met or late:
            self.agents = []
        return seen, *each, {agent: {} for agent in agents}

    def _seen(self) -> dict[str, Any]:
        return {agent: np.array([self.at[agent], self.middle]) for agent in self.possible_agents}


class Walker:
    """Walks to the middle; one of them takes one field for the other, or low for high."""

    def __init__(self, fault: str = "") -> None:
        self.fault = fault

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> int:
        """A step."""
        place, middle = observation[::-1] if self.fault == "fields" else observation
        if self.fault == "mirrored":
            place = 2 * SIDE - place
        if self.fault == "still":
            return 1
        step = int(np.sign(middle - place)) * (-1 if self.fault == "reversed" else 1)
        return 1 + (-step if self.fault == "actions" and agent == "left_0" else step)


class Strider(Walker):
    """Another policy, so that no undo is tried at both agents as at one."""


def diagnosed(fault: str, **more: Any) -> gk.Diagnosis:
    """The diagnosis of a meeting with a fault in the left one."""
    policies = more.pop("policies", None) or {"left_0": Walker(fault), "right_0": Walker()}
    evidence = gk.rollout(Meeting, policies=policies, episodes=4, seed=1)
    given = {"env": Meeting, "policies": policies, "failed": "return < 1", "perturbations": False}
    return gk.diagnose(evidence, **{**given, "episodes": 500, **more})


def test_a_fault_inside_a_policy_is_undone_from_outside_with_nothing_declared() -> None:
    """The agent and the boundary are named, and beside it the policy that restores as well."""
    found = diagnosed("mirrored", replace={"left_0": Walker()})
    left = found.agents["left_0"]
    assert found.agents["right_0"].answer == "elsewhere"
    assert (left.answer, left.labels) == ("isolated", ("perception",))
    assert "undone by mirroring field 0 of left_0's observation" in left.why
    peer = "giving left_0 right_0's policy"
    assert left.beside == ("giving left_0 the policy Walker", peer)
    assert "; so does giving left_0 the policy Walker" in left.why
    screen = diagnosis_screen(found.to_json(), width=100)
    assert "Also       giving left_0 the policy Walker" in screen
    assert found.responses["left_0"].lag == 0
    assert found.episodes <= 500


class Stuck(Walker):
    """Goes to the first middle that it ever saw: no reset clears it."""

    known: int | None = None

    def reset(self, seed: int) -> None:
        """Forgets nothing."""

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> int:
        """A step."""
        self.known = int(observation[1]) if self.known is None else self.known
        return super().__call__([observation[0], self.known], agent, info, rng)


def test_faults_of_two_agents_that_hide_each_other_are_undone_at_both() -> None:
    """Neither alone restores: both are named, each with its own part; a healthy third isn't."""
    both = {"left_0": Walker("reversed"), "right_0": Strider("reversed")}
    found = diagnosed("", policies=both, episodes=900)
    for agent, each in found.agents.items():
        assert each.answer == "ambiguous"
        assert each.labels == ("perception", "control")
        assert each.component == f"{agent}'s perception or {agent}'s control"
    assert any(" + " in name for name in found.agents["left_0"].substitutes)
    ones = [undone(BoundaryUndo((a,), "mirror axis", (place,))) for a in "ab" for place in (0, 1)]
    scaled = undone(BoundaryUndo(("a",), "rescale axes", amount=2.0))
    same, *others = pairs_of([scaled, *ones])
    assert [part.undo.places for part in same.parts if part.undo] == [(0,), (0,)]
    assert len(others) == 3
    assert same.labels == ("control",)
    setup = same.applied(Setup("env"))
    assert [undo.agents for undo in setup.undos] == [("a",), ("b",)]


def test_what_outlives_a_policys_own_reset_is_gone_with_its_object() -> None:
    """One agent is named with no label, or both together; what was handed over isn't played."""
    policies: dict[str, Any] = {"left_0": Stuck(), "right_0": Walker()}
    evidence = gk.rollout(Meeting, policies={**policies, "left_0": Stuck()}, episodes=4, seed=1)
    given: dict[str, Any] = {"env": Meeting, "failed": "return < 1", "perturbations": False}
    left = gk.diagnose(evidence, policies=policies, episodes=500, **given).agents["left_0"]
    assert (left.answer, left.labels) == ("isolated", ())
    assert left.component == "something that left_0 keeps from episode to episode"
    assert left.substitutes == ("playing each episode with a fresh object of left_0's policy",)
    both = {agent: Stuck() for agent in policies}
    found = gk.diagnose(evidence, policies=both, episodes=800, **given)
    assert {each.answer for each in found.agents.values()} == {"joint"}
    joint_policy = assign(both, possible_agents=list(both), action_space=lambda agent: Discrete(3))
    renew, before = joint_policy.renewer(["left_0"]), joint_policy.chosen_for("right_0").policy
    renew()
    assert joint_policy.chosen_for("left_0").policy is not both["left_0"]
    assert joint_policy.chosen_for("right_0").policy is before


def test_undos_that_do_the_same_cannot_be_told_apart() -> None:
    """To take place and goal for each other, or up for down, is one on a line: no label is sure."""
    for episodes in (400, 1_000):
        left = diagnosed("fields", episodes=episodes).agents["left_0"]
        assert left.answer == "ambiguous"
    assert left.labels == ("perception", "control")


def test_a_policy_that_nothing_outside_makes_up_for_is_named_by_its_peer() -> None:
    """That of the other agent, whose spaces are equal, restores: the policy, and no label."""
    left = diagnosed("still", episodes=300).agents["left_0"]
    assert (left.answer, left.labels, left.component) == ("isolated", (), "left_0's policy")
    assert left.substitutes == ("giving left_0 right_0's policy",)
    assert [each.kind for each in left.tested if each.restores] == ["swap"]


def test_a_healthy_run_is_not_searched() -> None:
    """No undo is tried, and nobody accused."""
    found = diagnosed("")
    assert {each.answer for each in found.agents.values()} == {"healthy"}
    assert found.episodes == 88
    assert found.responses == {}


def test_counterfactuals_name_the_first_action_that_differs_the_concerned_agent_s_first() -> None:
    """Before what it led to in the same turn, and before other agents' actions."""
    was, now = (
        SimpleNamespace(play=SimpleNamespace(actions=({"a": 0, "b": 0}, {"a": last, "b": last})))
        for last in (1, 2)
    )
    found = Divergence(0, 0, "a", "obs", 0.0, 1.0)
    contract = Contract()
    acted = _acted((1, "b", "action"), (was, now), contract)
    assert acted == {"did": "1", "instead": "2", "often": None}  # of so few actions no shares
    for each, number in ((was, 4), (now, 5)):
        each.play.actions += ({"b": number},) * 8
    assert _acted((1, "b", "action"), (was, now), contract)["often"] == ["4", 0.8, 0.0]
    assert _acted((0, "a", "obs"), (was, now), contract) == {}
    assert _action_text(np.array([0.567, -1e-9], np.float32), ()) == "[0.567, 0.0]"
    assert _place(found, was, now, ("b",)) == (1, "b", "action")
    assert _place(found, was, was, ("b",)) == (0, "a", "obs")


def test_different_scales_that_restore_alike_show_no_error_of_units() -> None:
    """One factor may be the right one; of several none is, and what they hide may be elsewhere."""
    tenth, tiny = (undone(BoundaryUndo(("a",), "rescale fields", (), by)) for by in (0.1, 0.004))
    assert not is_any_scale([tenth])
    assert is_any_scale([tenth, tiny])
    assert _labels([tenth]) == ("perception",)
    assert _labels([tenth, tiny]) == ()


@pytest.mark.parametrize(
    ("condition", "agent", "is_at_cost"),
    [("a.return < 0", "b", True), ("a.return < 0", "a", False), ("return < 0", "b", False)],
)
def test_a_rival_that_plays_worse_repairs_nothing(
    condition: str, agent: str, is_at_cost: bool
) -> None:
    """Where a condition is of one agent, an undo at another one mustn't cost that one's return."""
    outcomes = {
        "unchanged": [Outcome(returns={"a": -1.0, "b": 1.0})],
        "undone": [Outcome(returns={"a": 1.0, "b": -1.0})],
    }
    runner = SimpleNamespace(of=lambda arm, seed, episodes: outcomes[arm])
    conditions = failures(Contract(), condition)
    experiment: Any = SimpleNamespace(runner=runner, conditions=conditions, contract=Contract())
    one = IdealSubstitute("undone", "perception", (agent,), ())
    assert Experiment.is_at_cost(experiment, one, 0, [0], "team") is is_at_cost
