"""What of a set-up isn't at its ideal, and how it gets there."""

from typing import Any

import pytest

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.open_setup import Setup, SetupTraits
from gamekeeper.diagnosis.trials import IdealSubstitute, briefly, joined, substitutes_of, weakened
from gamekeeper.errors import ContractError

CONTRACT = Contract.parse(
    """
    [schedule]
    horizon = 200
    [roles.picker]
    agents = "picker_*"
    [roles.carrier]
    agents = "carrier"
    [knobs]
    noise = { label = "perception", ideal = 0.0 }
    drift = { label = "state estimation", ideal = 0 }
    truth = { label = "state estimation", ideal = true, contains = ["noise", "drift"] }
    layout = { label = "data coverage", ideal = "seen", of = "option" }
    temperature = { label = "evaluation", ideal = 0.0, of = "policy" }
    delay = { label = "timing", ideal = 0, of = "wrapper" }
    """
)
AGENTS = ("picker_0", "picker_1", "carrier")


def named(setup: Setup, **seen: Any) -> dict[str, IdealSubstitute]:
    """The ideal substitutes by name."""
    return {one.name: one for one in substitutes_of(setup, CONTRACT, SetupTraits(AGENTS, **seen))}


def test_what_is_at_its_ideal_is_no_handle() -> None:
    """Nothing to try where nothing is wrong."""
    assert named(Setup("env", {"noise": 0.0, "truth": True})) == {}


def test_a_knob_by_agent_and_role_has_a_handle_for_each() -> None:
    """An agent's own setting goes before its role's."""
    found = named(Setup("env", {"noise": {"picker": 1.0, "picker_1": 2.0, "carrier": 0.0}}))
    assert list(found) == [
        "noise[picker] = 0.0",
        "noise[picker_1] = 0.0",
        "everything of perception at once",
    ]
    assert found["noise[picker] = 0.0"].agents == ("picker_0",)
    cured = found["noise[picker] = 0.0"].applied(
        Setup("env", {"noise": {"picker": 1.0, "picker_1": 2.0, "carrier": 0.0}})
    )
    assert cured.kwargs == {"noise": {"picker": 0.0, "picker_1": 2.0, "carrier": 0.0}}


def test_nesting_is_as_declared() -> None:
    """The true state contains what it makes up for."""
    found = named(Setup("env", {"noise": 1.0, "drift": 3, "truth": False}))
    assert found["truth = True"].contains == {"noise = 0.0", "drift = 0"}
    assert found["everything of state estimation at once"].contains >= {
        "drift = 0",
        "truth = True",
        "noise = 0.0",
    }


def test_options_policies_and_wrappers_have_handles() -> None:
    """Each knob is set where the contract says that it is."""
    setup = Setup("env", options=({"layout": "new"}, None), policies={"*": "x:y"})
    found = named(
        setup,
        settings={("carrier",): {"temperature": 1.0}},
        layers={"delay": 2},
        resettable=[("picker_0",)],
        ways=["reference"],
    )
    assert found["layout = seen"].applied(setup).options == ({"layout": "seen"}, {"layout": "seen"})
    assert found["temperature[carrier] = 0.0"].applied(setup).settings == {
        "carrier": {"temperature": 0.0}
    }
    assert found["delay = 0"].applied(setup).layers == {"delay": 0}
    assert found["resetting picker_0's memory"].applied(setup).forgets == ("picker_0",)
    assert (
        found["giving carrier the reference policy"].applied(setup).policies["carrier"]
        == "reference"
    )
    assert found["giving picker_0 the reference policy"].contains == {"resetting picker_0's memory"}


def test_agents_of_one_object_have_its_handles_together() -> None:
    """One setting and one memory for both; policies of their own for both make up for it."""
    setup, pair = Setup("env", policies={"*": "x:y"}), ("picker_0", "picker_1")
    found = named(
        setup, settings={pair: {"temperature": 1.0}}, resettable=[pair], ways=["reference"]
    )
    assert found["temperature[picker_0, picker_1] = 0.0"].agents == pair
    memory = found["resetting picker_0 and picker_1's memory"]
    assert memory.applied(setup).forgets == pair
    assert memory.name not in found["giving picker_0 the reference policy"].contains
    (everybody,) = (x for x in found.values() if x.component == "policy" and x.parts)
    assert memory.name in everybody.contains
    assert everybody.name == "giving picker_0, picker_1 and carrier the reference policy"
    singles = [x for x in found.values() if x.component == "policy" and not x.parts]
    assert briefly([*singles, everybody, memory]) == [everybody.name, everybody.name, memory.name]


def test_a_shorter_horizon_is_a_question_of_evaluation() -> None:
    """The declared protocol is its ideal substitute; a longer one is nobody's fault."""
    found = named(Setup("env", {"horizon": 20}, most_turns=10))
    cured = found["the declared horizon"].applied(Setup("env", {"horizon": 20}, most_turns=10))
    assert (cured.kwargs["horizon"], cured.most_turns) == (200, 100_000)
    assert named(Setup("env", {"horizon": 300})) == {}


def test_joined_does_all_and_contains_all() -> None:
    """A pair has the labels, agents and steps of both."""
    setup = Setup("env", {"noise": 1.0, "drift": 3})
    found = named(setup)
    pair = joined([found["noise = 0.0"], found["drift = 0"]])
    assert pair.component == "perception + state estimation"
    assert pair.applied(setup).kwargs == {"noise": 0.0, "drift": 0}
    assert weakened(found["noise = 0.0"], 0.5).applied(setup).kwargs["noise"] == 0.5


def test_contains_names_declared_knobs() -> None:
    """A misspelt knob is a contradiction, with its line."""
    with pytest.raises(ContractError, match="knob 'nois' is not declared"):
        Contract.parse('[knobs]\na = { label = "x", contains = ["nois"] }\n')
