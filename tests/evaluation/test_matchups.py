"""Who meets whom."""

from typing import Any

import pytest

from gamekeeper.errors import EvidenceError, PolicyError
from gamekeeper.evaluation.inspection import Inspection
from gamekeeper.evaluation.matchups import by_themselves, crossed, positions_of
from gamekeeper.evaluation.spec_reader import read_spec

TWO = Inspection("d", None, "parallel", {"p_0": "p", "p_1": "p", "c_0": "c"}, None, {})
FOUR = Inspection("d", None, "parallel", {f"agent_{k}": "agent" for k in range(4)}, None, {})
BOARD = Inspection("d", None, "aec", {"player_1": "player", "player_2": "player"}, None, {})


def spec(policies: dict[str, Any], **crossplay: Any) -> Any:
    """A specification with cross-play."""
    return read_spec(
        {"environments": {"e": "x"}, "policies": policies, "crossplay": crossplay or True}
    )


def test_positions_are_roles_or_two_agents_or_one_and_the_rest() -> None:
    """Whatever there is more than one of."""
    plain = spec({"a": "x"})
    assert positions_of(plain, "e", TWO) == ("p", "c")
    assert positions_of(plain, "e", BOARD) == ("player_1", "player_2")
    assert positions_of(plain, "e", FOUR) == ("agent_0", "*")


def test_positions_that_leave_somebody_out_are_refused() -> None:
    """With who it is."""
    with pytest.raises(EvidenceError, match="c_0"):
        positions_of(spec({"a": "x"}, roles=["p_0", "p_1"]), "e", TWO)
    with pytest.raises(EvidenceError, match="positions"):
        positions_of(spec({"a": "x"}, roles=["p", "q", "*"]), "e", TWO)
    for roles, fix in ((["p", "q", "*"], "take q out"), (["*"], "name one position more")):
        with pytest.raises(EvidenceError) as caught:
            positions_of(spec({"a": "x"}, roles=roles), "e", TWO)
        assert (caught.value.fix or "").startswith(fix)


def test_env_step_is_every_policy_in_every_position_with_every_partner() -> None:
    """Three policies in two positions: nine line-ups, three of them each policy by itself."""
    told = spec({"a": "x", "b": "y", "c": "z"})
    found = crossed(told, "e", TWO, ("p", "c")) + by_themselves(told, "e")
    positioned = {
        tuple(sorted((position, side.policy) for position, side in each.sides)) for each in found
    }
    assert 9 == len(found) == len(positioned)
    assert {"self", "fixed"} == {each.kind for each in found}


def test_env_step_with_partners_is_linear() -> None:
    """Ten policies with one partner: twice nine line-ups, not ninety."""
    told = spec({f"q{k}": f"m:{k}" for k in range(10)}, partners=["q0"])
    assert len(crossed(told, "e", TWO, ("p", "c"))) == 18


def test_env_step_pairs_runs_of_a_method_with_other_runs() -> None:
    """Zero-shot: run i with run j; both ways, with a sample of them if that is asked."""
    runs = {"m": [f"m:{k}" for k in range(6)], "f": "x"}
    whole = crossed(spec(runs), "e", TWO, ("p", "c"))
    kinds = [each.kind for each in whole]
    assert (kinds.count("zero-shot"), kinds.count("fixed")) == (30, 12)
    few = crossed(spec(runs, sample=1), "e", TWO, ("p", "c"))
    zero = [each for each in few if each.kind == "zero-shot"]
    met = {tuple(side.run for _, side in each.sides) for each in zero}
    assert {(i, (i + d) % 6) for i in range(6) for d in (1, -1)} == met


def test_env_step_samples_two_methods_alike_in_both_directions() -> None:
    """Whoever meets whom meets them in the other position, too."""
    told = spec({"m": [f"m:{k}" for k in range(5)], "n": [f"n:{k}" for k in range(3)]}, sample=2)
    found = crossed(told, "e", TWO, ("p", "c"))
    sides = {tuple(side for _, side in each.sides) for each in found}
    assert sides == {(b, a) for a, b in sides}
    assert {0, 1, 2, 3, 4} == {a.run for a, b in sides if (a.policy, b.policy) == ("m", "n")}


def test_env_step_of_too_many_is_refused_with_the_fix() -> None:
    """Before anything is played."""
    runs = {name: [f"{name}:{k}" for k in range(40)] for name in "ab"}
    with pytest.raises(EvidenceError, match="sample = 3"):
        crossed(spec(runs), "e", TWO, ("p", "c"))


def test_pairing_takes_each_position_from_its_policy() -> None:
    """An agent's own choice goes before its role's; the rest follows its position."""
    told = spec({"a": {"p": "a_p", "p_1": "a_p1", "c": "a_c"}, "b": "y"})
    found = {each.name: each for each in crossed(told, "e", TWO, ("p", "c"))}
    assert found["p=a c=b"].choices == {"p": "a_p", "p_1": "a_p1", "c": "y"}
    assert found["p=b c=a"].choices == {"p": "y", "c": "a_c"}
    told = spec({"a": "x", "b": "y"})
    found = {each.name: each for each in crossed(told, "e", FOUR, ("agent_0", "*"))}
    assert found["agent_0=a *=b"].choices == {"agent_0": "x", "agent": "y"}


def test_pairing_refuses_a_position_for_which_a_policy_says_nothing() -> None:
    """A table by role without the role."""
    with pytest.raises(PolicyError, match="names no policy for 'c'"):
        crossed(spec({"a": {"p": "a_p"}, "b": "y"}), "e", TWO, ("p", "c"))
