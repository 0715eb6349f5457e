"""Laws of perturbations: nothing at strength 0, only whom it names, the same twice, as JSON."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.divergence import compare
from gamekeeper.episodes.outcome import LABELS
from gamekeeper.errors import EvidenceError, SpecError
from gamekeeper.rollouts import intervention as intervention_module
from gamekeeper.rollouts.episode_loop import perform
from gamekeeper.rollouts.intervention import Intervention, interventions
from gamekeeper.rollouts.interventions.perturbation import Perturbation
from tests.rollouts.interventions.games import (
    ACTIONS,
    CONTRACT,
    SPACES,
    Shown,
    as_aec,
    played,
    rows,
)

PERTURBATIONS = {
    name: change for name, change in interventions().items() if issubclass(change, Perturbation)
}
SEEN = [name for name, change in PERTURBATIONS.items() if change.ON == "seen"]
DONE = [name for name, change in PERTURBATIONS.items() if change.ON == "done"]


def made(name: str, *, agents: tuple[str, ...] | None = None) -> Perturbation:
    """One that is strong enough to be felt in a short episode, and leaves some to chance."""
    change = PERTURBATIONS[name]
    strengths = {"turns": change.USUAL, "deviation": change.MOST, "probability": 0.7, "part": 0.7}
    return change(agents=agents, strength=strengths[change.UNIT])


@pytest.mark.parametrize("name", PERTURBATIONS)
def test_perturbation_says_what_it_is(name: str) -> None:
    """It has one of the seven labels, a usual strength up to the greatest, and its kind."""
    change = PERTURBATIONS[name]
    assert change.label in LABELS
    assert change.kind == "perturbation"
    assert 0 < change.USUAL <= change.MOST
    assert change() == change(agents=None, strength=change.USUAL)
    assert "The strength is" in " ".join((change.__doc__ or "").split())


@pytest.mark.parametrize("strength", [-1.0, float("nan"), float("inf"), "much"])
@pytest.mark.parametrize("name", PERTURBATIONS)
def test_perturbation_refuses_strengths_out_of_range(name: str, strength: Any) -> None:
    """A strength below 0, or that is no number, is an error that names the range."""
    with pytest.raises(SpecError, match="from 0"):
        PERTURBATIONS[name](strength=strength)


@pytest.mark.parametrize("name", PERTURBATIONS)
def test_perturbation_makes_another_one(name: str) -> None:
    """A search has the same perturbation with another strength for other agents."""
    usual = PERTURBATIONS[name]()
    other = usual.at(usual.MOST, ("a_0",))
    assert (other.strength, other.agents) == (usual.MOST, ("a_0",))
    assert type(other) is type(usual)


@pytest.mark.parametrize("name", interventions())
def test_change_crosses_as_json(name: str) -> None:
    """What `to_json` says as text is read back as an equal change."""
    parameters = {
        "ReplacedAction": {"turn": 3, "agent": "a_0", "action": 1},
        "ExtraCalls": {"calls": ("state", "render")},
        "OccludedFields": {"fields": ("observation.goal",), "agents": ("a_0", "b_0")},
    }
    change = interventions()[name](**parameters.get(name, {}))
    assert Intervention.from_json(json.loads(json.dumps(change.to_json()))) == change


def test_change_of_arrays_crosses_as_json() -> None:
    """An action that is an array comes back with its dtype."""
    given = np.float32([1, 2])
    change = interventions()["ReplacedAction"](turn=0, agent="a", action=given)
    found: Any = Intervention.from_json(json.loads(json.dumps(change.to_json())))
    assert found.action.dtype == given.dtype
    assert found.action.tolist() == given.tolist()


def test_changes_of_packages_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A class that an entry point names is a change like ours, also when read back."""
    (tmp_path / "farm_changes.py").write_text(
        "from gamekeeper.rollouts.interventions.action_substitutes import Held\n"
        "class FarmHeld(Held):\n    pass\n"
    )
    folder = tmp_path / "farm-1.2.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: farm\nVersion: 1.2\n")
    (folder / "entry_points.txt").write_text(
        "[gamekeeper.interventions]\nfarm-held = farm_changes:FarmHeld\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    intervention_module._known.cache_clear()
    try:
        found = interventions()["FarmHeld"](turns=3)
        assert Intervention.from_json(found.to_json()) == found
    finally:
        intervention_module._known.cache_clear()


@pytest.mark.parametrize(
    "data", [{"change": "Sideways"}, {}, {"change": "ActionOrder", "speed": 3}]
)
def test_change_that_is_unknown_is_refused(data: dict[str, Any]) -> None:
    """A name that nobody brings, and a parameter that it hasn't, are errors."""
    with pytest.raises(EvidenceError):
        Intervention.from_json(data)


@pytest.mark.parametrize("name", PERTURBATIONS)
def test_strength_0_is_the_unchanged_rerun(name: str) -> None:
    """With strength 0 every row is the row of an episode without a change."""
    unchanged, _ = played(Shown("dict"), None)
    base, _ = played(Shown("dict"), PERTURBATIONS[name](strength=0.0))
    assert compare(unchanged.episode, base.episode).is_exact


@pytest.mark.parametrize("see", SPACES)
@pytest.mark.parametrize("name", SEEN)
def test_only_named_agents_see_otherwise(name: str, see: str) -> None:
    """Others are shown the very object that was given; the evidence keeps what was given."""
    env, was_changed = Shown(see), False
    unchanged, given = played(Shown(see), None)
    perturbed, shown = played(env, made(name, agents=("a_1",)), _told(see))
    for (agent, clean), (other, seen) in zip(given, shown, strict=True):
        assert agent == other
        assert env.observation_space(agent).contains(seen)
        if to_json(seen) != to_json(clean):
            was_changed = True
            assert agent == "a_1"
        if see == "dict":
            assert to_json(seen["action_mask"]) == to_json(clean["action_mask"])
    assert was_changed
    for clean, kept in zip(rows(unchanged), rows(perturbed), strict=True):
        assert to_json(clean[0]) == to_json(kept[0])


def _told(see: str) -> Any:
    """All that an agent sees are messages."""
    data: Any = CONTRACT.to_json()
    names = ["observation"] if see != "dict" else ["observation.sight.0", "goal"]
    for role in data["roles"].values():
        role["messages"] = names
    return type(CONTRACT).from_json(data)


@pytest.mark.parametrize("do", ACTIONS)
@pytest.mark.parametrize("name", DONE)
def test_only_named_agents_do_otherwise(name: str, do: str) -> None:
    """Others do what they did; what is done is of the space, legal, and of the same types."""
    contract = _waiting(do)
    env, was_changed = Shown(do=do), False
    unchanged, _ = played(Shown(do=do), None, contract)
    perturbed, _ = played(env, made(name, agents=("a_1",)), contract)
    masks = [turn.masks for turn in unchanged.episode.turns]
    pairs = zip(unchanged.play.actions or (), perturbed.play.actions or (), masks, strict=False)
    for clean, done, mask in pairs:
        was_changed |= list(clean) != list(done)
        for agent, action in done.items():
            assert env.action_space(agent).contains(action)
            assert type(action) is type(clean[agent])
            if to_json(action) != to_json(clean[agent]):
                was_changed = True
                assert agent == "a_1"
            if do == "discrete":
                assert mask[agent][int(action)]
    assert was_changed is (name != "ActionSaturation" or do in ("box", "dict"))


def _waiting(do: str) -> Any:
    noop: Any = {"discrete": 2, "several": [0, 0], "box": [0.0, 0.0]}
    noop["dict"] = {"move": [0.0, 0.0], "word": 0}
    data: Any = CONTRACT.to_json()
    data["roles"]["a"]["noop"] = noop[do]
    return type(CONTRACT).from_json(data)


@pytest.mark.parametrize("name", PERTURBATIONS)
def test_perturbation_is_the_same_twice(name: str) -> None:
    """Equal plays are equal, also in what was shown."""
    change = made(name)
    first, again = (played(Shown("whole", "box"), change, _told("whole")) for _ in range(2))
    assert compare(first[0].episode, again[0].episode).is_exact
    assert to_json(first[1]) == to_json(again[1])


@pytest.mark.parametrize("name", PERTURBATIONS)
def test_agents_do_not_hang_on_one_another(name: str) -> None:
    """What befalls one agent is the same whether or not others are named, too."""
    alone, all_of_them = (
        played(Shown("whole"), made(name, agents=agents), _told("whole"))
        for agents in (("a_1",), ("a_1", "b_0"))
    )
    mine = [[seen for agent, seen in found[1] if agent == "a_1"] for found in (alone, all_of_them)]
    assert to_json(mine[0]) == to_json(mine[1])
    done = [[each["a_1"] for each in found[0].play.actions or ()] for found in (alone, all_of_them)]
    assert done[0] == done[1]


@pytest.mark.parametrize("name", [name for name in PERTURBATIONS if name != "LaterPlace"])
def test_perturbation_is_the_same_in_both_apis(name: str) -> None:
    """One agent at a time, the same befalls the same agent at its own turns."""
    ticks, turns = (
        played(env, made(name, agents=("a_1",)), _told("whole"))
        for env in (Shown("whole"), as_aec(Shown("whole")))
    )
    mine = [[seen for agent, seen in found[1] if agent == "a_1"] for found in (ticks, turns)]
    assert to_json(mine[0]) == to_json(mine[1])
    done = [
        [each["a_1"] for each in found[0].play.actions or () if each.get("a_1") is not None]
        for found in (ticks, turns)
    ]
    assert done[0] == done[1]


@pytest.mark.parametrize("name", DONE)
def test_perturbation_of_deeds_works_on_paper(name: str) -> None:
    """With the recorded actions the same is done to them as with the policies that chose them."""
    base, _ = played(Shown(), None)
    closed, _ = played(Shown(), made(name))
    on_paper = perform(base.play, Shown(), change=made(name), contract=CONTRACT)
    assert closed.play.actions == on_paper.play.actions


@pytest.mark.parametrize("name", ["ObservationDropout", "MessageDrop"])
def test_greater_strength_is_more_of_the_same(name: str) -> None:
    """Turns that a weak perturbation disturbs are disturbed by a strong one, too."""
    _, given = played(Shown("whole"), None)
    struck = []
    for strength in (0.2, 0.6):
        _, shown = played(Shown("whole"), PERTURBATIONS[name](strength=strength), _told("whole"))
        pairs = zip(given, shown, strict=True)
        struck.append({n for n, (one, other) in enumerate(pairs) if to_json(one) != to_json(other)})
    assert struck[0] < struck[1]
