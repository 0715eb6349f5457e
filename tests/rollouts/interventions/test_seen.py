"""What each perturbation of perception and state estimation shows, turn by turn."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, Space, Text

from gamekeeper.contract import Contract
from gamekeeper.errors import ContractError, SpecError
from gamekeeper.rollouts.interventions.delays import ObservationDelay
from gamekeeper.rollouts.interventions.message_perturbations import MessageDrop, MessageShuffle
from gamekeeper.rollouts.interventions.observation_perturbations import (
    ObservationBias,
    ObservationDrift,
    ObservationDropout,
    ObservationNoise,
    OccludedFields,
    StaleMemory,
)
from gamekeeper.rollouts.interventions.perturbation import Perturbation

MASKED = Dict({"action_mask": Box(0, 1, (2,), np.int8), "at": Discrete(100)})


class One:
    """As much of an environment as a perturbation asks."""

    def __init__(self, space: Space[Any]) -> None:
        self.space = space

    def observation_space(self, agent: Any) -> Space[Any]:
        return self.space


def shown(
    change: Perturbation, space: Space[Any], given: list[Any], contract: Contract | None = None
) -> list[Any]:
    """What one agent is shown of what it is given."""
    hooks = change.start(np.random.default_rng(0))
    hooks.declared(contract or Contract())
    hooks.before_reset(One(space))
    return [hooks.sees(turn, "a_0", each) for turn, each in enumerate(given)]


def listens(*messages: str) -> Contract:
    """A contract whose agents are told something."""
    return Contract.from_json({"roles": {"a": {"messages": list(messages)}}})


def test_noise_has_its_deviation_as_a_part_of_the_range() -> None:
    """Ranges of 20 and 0.2 give deviations of a tenth of them."""
    space = Box(np.array([-10, -0.1]), np.array([10, 0.1]), dtype=np.float64)
    seen = np.array(shown(ObservationNoise(strength=0.1), space, [np.zeros(2)] * 2000))
    assert np.allclose(seen.std(axis=0), [2, 0.02], rtol=0.1)
    assert np.abs(seen.mean(axis=0) / [2, 0.02]).max() < 0.1


def test_noise_has_the_span_seen_so_far_where_nothing_is_declared() -> None:
    """What has been seen of an unbounded number settles how much noise is much; 0 counts."""
    space = Box(-np.inf, np.inf, (2,), np.float64)
    values = [np.array([0.0, 100.0])] * 1000 + [np.array([0.0, -300.0])] * 1000
    noise = np.array(shown(ObservationNoise(strength=0.1), space, values)) - np.array(values)
    assert (noise[:, 0] == 0).all()
    assert noise[:1000, 1].std() == pytest.approx(10, rel=0.1)
    assert noise[1000:, 1].std() == pytest.approx(40, rel=0.1)


def test_noise_leaves_what_is_not_of_the_space() -> None:
    """A value of another form is shown as it is; one that isn't finite stays so."""
    space = Box(0, 1, (2,), np.float32)
    nonconforming = [np.zeros(3), None, "text"]
    given = [np.float32([np.nan, 0.5])]
    assert all(
        one is other
        for one, other in zip(
            nonconforming, shown(ObservationNoise(), space, nonconforming), strict=True
        )
    )
    assert np.isnan(shown(ObservationNoise(), space, given)[0][0])


def test_noise_never_writes_into_what_was_given() -> None:
    """Also where the memory of the array is laid out otherwise."""
    space = Box(0, 255, (2, 3), np.uint8)
    given = np.asfortranarray(np.full((2, 3), 100, np.uint8))
    seen = shown(ObservationNoise(strength=0.5), space, [given])[0]
    assert (given == 100).all()
    assert seen.shape == given.shape
    assert (seen != 100).sum() > 3


def test_bias_is_one_offset_all_the_episode() -> None:
    """Each number has its own."""
    space = Box(-10, 10, (3,), np.float64)
    given = [np.full(3, n / 100) for n in range(20)]
    offsets = np.array(shown(ObservationBias(strength=0.05), space, given)) - np.array(given)
    assert np.allclose(offsets, offsets[0])
    assert len(set(offsets[0].round(9))) == 3


def test_drift_is_a_random_walk() -> None:
    """Its steps have the deviation of the strength, and add up."""
    space = Box(-1000, 1000, (50,), np.float64)
    seen = np.array(shown(ObservationDrift(strength=0.001), space, [np.zeros(50)] * 100))
    assert np.diff(seen, axis=0).std() == pytest.approx(2, rel=0.1)
    assert seen[-1].std() == pytest.approx(20, rel=0.4)


def test_dropout_shows_what_is_nearest_to_nothing() -> None:
    """Zeros where the space has them, else its least; no text; at about so many turns."""
    space = Dict({"a": Box(2, 5, (2,), np.float32), "b": Discrete(3), "c": Text(4, min_length=0)})
    given = {"a": np.float32([3, 4]), "b": np.int64(2), "c": "word"}
    seen = shown(ObservationDropout(strength=0.25), space, [given] * 1000)
    blank = [each for each in seen if each is not given]
    assert 200 < len(blank) < 300
    assert all(each["a"].tolist() == [2, 2] for each in blank)
    assert all((each["b"], each["c"]) == (0, "") for each in blank)


def test_occlusion_hides_a_part_of_the_fields_for_good() -> None:
    """More strength hides the same fields and more; each number of an array is a field."""
    space = Box(0, 1, (8,), np.float64)
    hidden = []
    for strength in (0.01, 0.5, 1.0):
        seen = np.array(shown(OccludedFields(strength=strength), space, [np.ones(8)] * 5))
        assert (seen == seen[0]).all()
        hidden.append(set(np.flatnonzero(seen[0] == 0)))
    assert [len(each) for each in hidden] == [1, 4, 8]
    assert hidden[0] < hidden[1] < hidden[2]


@pytest.mark.parametrize("name", ["at", "observation.at"])
def test_occlusion_hides_named_fields(name: str) -> None:
    """Only what is named, and never the mask."""
    given = {"action_mask": np.ones(2, np.int8), "at": np.int64(7)}
    everything = shown(OccludedFields(strength=1.0), MASKED, [given])[0]
    named = shown(OccludedFields(strength=1.0, fields=(name,)), MASKED, [given])[0]
    for seen in (everything, named):
        assert seen["at"] == 0
        assert seen["action_mask"].tolist() == [1, 1]
    other = OccludedFields(strength=1.0, fields=("action_mask", "elsewhere"))
    assert shown(other, MASKED, [given])[0] == given


def test_occlusion_refuses_what_names_no_field() -> None:
    """When it is made, not in the middle of an episode."""
    with pytest.raises(ContractError):
        OccludedFields(fields=("the goal",))


def test_delay_shows_what_was_with_the_mask_of_now() -> None:
    """At first what came first; what an environment writes into its buffers doesn't reach back."""
    buffer: dict[str, Any] = {"action_mask": np.zeros(2, np.int8), "at": np.int64(0)}
    hooks = ObservationDelay(strength=2.0).start(np.random.default_rng(0))
    hooks.before_reset(One(MASKED))
    seen = []
    for turn in range(5):
        buffer["at"] = np.int64(turn)
        buffer["action_mask"][:] = turn % 2
        found = hooks.sees(turn, "a_0", buffer)
        seen.append((int(found["at"]), int(found["action_mask"][0])))
    assert seen == [(0, 0), (0, 1), (0, 0), (1, 1), (2, 0)]


def test_stale_memory_comes_in_bursts() -> None:
    """With certainty of one: three stale turns, a new one, three stale ones."""
    found = shown(StaleMemory(strength=1.0, turns=3), Discrete(100), list(range(9)))
    assert found == [0, 0, 0, 0, 4, 4, 4, 4, 8]
    with pytest.raises(SpecError):
        StaleMemory(turns=0)


def test_message_drop_blanks_only_messages() -> None:
    """The last three numbers are declared to be what is said."""
    given = [np.float32([1, 2, 3, 4, 5])] * 20
    space, told = Box(-9, 9, (5,), np.float32), listens("observation[-3:]")
    for seen in shown(MessageDrop(strength=1.0), space, given, told):
        assert seen.tolist() == [1, 2, 0, 0, 0]


def test_message_shuffle_says_something_else() -> None:
    """A word among others becomes another word; the rest stays."""
    space, told = Box(0, 9, (6,), np.float32), listens("observation[2:]")
    given = [np.float32([7, 8, 1, 0, 0, 0])] * 50
    seen = shown(MessageShuffle(strength=1.0), space, given, told)
    assert all(each[:2].tolist() == [7, 8] and sorted(each[2:]) == [0, 0, 0, 1] for each in seen)
    assert len({tuple(each) for each in seen}) == 4


def test_message_shuffle_of_single_values() -> None:
    """A Discrete word is any word; a single number and a text are such as were told before."""
    space = Dict({"w": Discrete(4, start=1), "x": Box(0, 99, (), np.float64), "t": Text(9)})
    given = [{"w": np.int64(1), "x": np.array(float(n)), "t": f"t{n}"} for n in range(60)]
    seen = shown(MessageShuffle(strength=1.0), space, given, listens("w", "x", "t"))
    assert {int(each["w"]) for each in seen} == {1, 2, 3, 4}
    assert all(float(each["x"]) <= n and int(each["t"][1:]) <= n for n, each in enumerate(seen))
    assert len({float(each["x"]) for each in seen}) > 10


@pytest.mark.parametrize("change", [MessageDrop, MessageShuffle])
def test_messages_need_a_declaration(change: type[Perturbation]) -> None:
    """Where no field that an agent sees is declared to carry messages, it can't be tried."""
    env: Any = One(Box(0, 1, (5,)))
    names = ("action", "observation.word", "observation[5:]", "its last three numbers")
    for contract in (Contract(), listens(), *map(listens, names)):
        assert "messages" in str(change.applies(contract, env, "a_0"))
    assert change.applies(listens("observation"), env, "a_0") is None


def test_noise_needs_numbers() -> None:
    """An agent that only reads can't be shown noise, but it can be blinded."""
    env: Any = One(Text(4))
    assert "number" in str(ObservationNoise.applies(Contract(), env, "a_0"))
    assert ObservationDropout.applies(Contract(), env, "a_0") is None
    assert "doesn't say" in str(ObservationDropout.applies(Contract(), object(), "a_0"))


def test_hidden_numbers_of_one_array_are_hidden_at_once() -> None:
    """Named slices that overlap, and the whole of an array, come to the numbers they name."""
    space = Dict({"a": Box(1, 9, (6,), np.float64)})
    given = {"a": np.full(6, 5.0)}
    some = OccludedFields(strength=1.0, fields=("a[1:3]", "a[2:4]", "a[-1]"))
    assert shown(some, space, [given])[0]["a"].tolist() == [5, 1, 1, 1, 5, 1]
    all_of_it = OccludedFields(strength=1.0, fields=("a[1:3]", "a"))
    assert shown(all_of_it, space, [given])[0]["a"].tolist() == [1] * 6
