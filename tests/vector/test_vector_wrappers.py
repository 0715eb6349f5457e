"""Wrappers of whole batches give what those of one environment give, in every sub-environment."""

import importlib
import sys
from functools import partial
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.errors import SpecError
from gamekeeper.interface import wrappers as single
from gamekeeper.kernels.scaled_rows import scaling
from gamekeeper.vector import wrappers
from tests.adapters.ledger import LedgerTicks, LedgerTurns


def statistics() -> Any:
    """Statistics of one role, from a few numbers."""
    found = single.Statistics(clip=1.5)
    env = single.normalize(LedgerTicks(ends="late"), found, learning=True)
    env.reset(seed=0)
    while env.agents:
        env.step(dict.fromkeys(env.agents, np.ones(1, np.float32)))
    return found


WRAPPERS: dict[str, tuple[str, dict[str, Any]]] = {
    "agent_id": ("Box", {}),
    "agent_id of pictures": ("image", {}),
    "agent_id of Dict": ("Dict", {}),
    "agent_id of numbers": ("Discrete", {}),
    "frame_stack": ("Box", {"frames": 3}),
    "frame_stack of Dict": ("nested Dict", {"frames": 2, "padding": "zeros"}),
    "frame_stack of numbers": ("Discrete", {"frames": 3}),
    "frame_stack of pictures": ("image", {"frames": 2}),
    "flatten_observations": ("nested Dict", {}),
    "flatten_observations of numbers": ("MultiDiscrete", {}),
    "flatten_observations of pictures": ("image", {}),
    "normalize": ("Box", {"statistics": statistics()}),
    "clip_rewards": ("Box", {"low": -1.0, "high": 1.5}),
    "clip_actions": ("Box", {}),
}


def same(found: Any, expected: Any, rtol: float = 0.0) -> None:
    """Asserts that two trees of arrays are equal, form, dtype and value."""
    if isinstance(expected, dict):
        assert set(found) == set(expected)
        for key, part in expected.items():
            same(found[key], part, rtol)
    elif isinstance(expected, tuple):
        for one, two in zip(found, expected, strict=True):
            same(one, two, rtol)
    else:
        assert (found.shape, found.dtype) == (expected.shape, expected.dtype)
        np.testing.assert_allclose(found, expected, rtol=rtol, atol=rtol / 10)


def pair(name: str, kind: Any, ends: str, **options: Any) -> tuple[Any, Any]:
    """The batch inside the wrapper, and a batch of environments inside the other."""
    form, arguments = WRAPPERS[name]
    wrapper = name.partition(" ")[0]
    make = partial(kind, seen=form, mask=form != "Box", ends=ends)
    whole = gk.vector.make(make, 3, seed=4, **options)
    one_by_one = gk.vector.make(
        lambda: getattr(single, wrapper)(make(), **arguments), 3, seed=4, **options
    )
    return getattr(wrappers, wrapper)(whole, **arguments), one_by_one


@pytest.mark.parametrize("kind", [LedgerTicks, LedgerTurns])
@pytest.mark.parametrize("name", WRAPPERS)
def test_batches_are_those_of_wrapped_environments(
    name: str, kind: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Observations, rewards, finals and spaces, whoever ends or joins, in both autoreset modes."""
    monkeypatch.setattr(wrappers, "MOVES", 3)
    for ends, autoreset, copy in (
        ("one by one", "same_step", True),
        ("late", "next_step", True),
        ("together", "same_step", False),
    ):
        found, expected = pair(name, kind, ends, autoreset=autoreset, copy=copy)
        assert found.observation_space == expected.observation_space
        seen, infos = found.reset()
        rtol = 1e-5 if name == "normalize" else 0.0
        same(seen, expected.reset()[0], rtol)
        for t in range(20):
            actions = chosen(found, infos, t)
            *one, infos = found.step(actions)
            *two, others = expected.step(actions)
            for part, other in zip(one, two, strict=True):
                same(part, other, rtol)
            assert ("final_obs" in infos) == ("final_obs" in others)
            for e in np.flatnonzero(infos.get("_final_obs", ())):
                same(infos["final_obs"][e], others["final_obs"][e], rtol)


def chosen(venv: Any, infos: Any, t: int) -> Any:
    """Legal actions, by time."""
    space = venv.action_space
    if space.dtype.kind == "f":
        return np.full(space.shape, t % 3 - 1, space.dtype)
    masks = infos["action_mask"]
    if masks.shape[-1] == 5:  # of MultiDiscrete
        return np.stack([masks[..., :3].argmax(-1), np.ones(masks.shape[:-1], int)], -1)
    return masks.argmax(-1)


def test_statistics_are_those_of_the_decisions() -> None:
    """Learnt from a batch or one by one: the same but for rounding; saved, they are equal."""
    own, other = single.Statistics(), single.Statistics()
    venv = gk.vector.make(LedgerTicks, 3, seed=4, env_kwargs={"ends": "late"})
    learning = wrappers.normalize(venv, own, learning=True)
    plain = gk.vector.make(
        lambda: single.normalize(LedgerTicks(ends="late"), other, learning=True), 3, seed=4
    )
    learning.reset(), plain.reset()
    for _ in range(20):
        for one in (learning, plain):
            one.step(np.ones(one.action_space.shape, np.float32))
    assert own.seen.keys() == other.seen.keys()
    for name, parts in own.seen.items():
        for found, expected in (
            (parts[""], other.seen[name][""]),
            (own.paid[name], other.paid[name]),
        ):
            assert found.count == pytest.approx(expected.count)
            np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-9)
            np.testing.assert_allclose(found.var, expected.var, rtol=1e-9)
    again = single.Statistics.of_json(own.to_json())
    assert again.to_json() == own.to_json()


@pytest.mark.parametrize("ends", ["one by one", "late"])
def test_statistics_are_the_same_where_arrays_are_overwritten(ends: str) -> None:
    """An agent that ends in a step decided before it, though it is no longer live then."""
    found = []
    for copy in (True, False):
        statistics = single.Statistics()
        venv = gk.vector.make(LedgerTicks, 3, seed=4, env_kwargs={"ends": ends}, copy=copy)
        with wrappers.normalize(venv, statistics, learning=True) as learning:
            learning.reset()
            for _ in range(20):
                learning.step(np.ones(learning.action_space.shape, np.float32))
        found.append(statistics.to_json())
    assert found[0] == found[1]


@pytest.mark.parametrize("are_alike", [True, False])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_numbers_are_scaled_to_the_same_bits_in_one_pass(
    are_alike: bool, dtype: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compiled or by NumPy: of many, none and not-numbers, of rows alike or each with its own."""
    rng = np.random.default_rng(0)
    for count in (0, 1, 7, 24):
        rows = rng.normal(size=(count, 3, 5)).astype(dtype) * 9
        rows[..., 0] = np.nan
        mean, factor = rng.normal(size=(2, max(count, 1), 3, 5)).astype(dtype)
        if are_alike:
            mean[:], factor[:] = mean[0], factor[0]
        found = []
        for is_loaded in (True, False):
            with monkeypatch.context() as patch:
                if is_loaded:
                    importlib.import_module("numba")
                else:
                    patch.delitem(sys.modules, "numba", raising=False)
                out = np.full(rows.shape, 77, np.float32)
                scaling(rows, mean, factor, 10.0, out, are_alike=are_alike)()
            found.append(out)
        np.testing.assert_array_equal(found[0].view(np.uint32), found[1].view(np.uint32))
        np.testing.assert_allclose(
            found[0], ((rows - mean[:count]) * factor[:count]).clip(-10, 10), rtol=1e-6
        )


def test_wrappers_go_around_kernels_and_roles() -> None:
    """Several at once, over roles of different spaces; the rest is the environment's own."""
    env = gk.vector.make("tag", 4, engine="kernel", seed=1)
    own = gk.vector.make("tag", 4, engine="kernel", seed=1)
    wrapped = wrappers.frame_stack(wrappers.agent_id(env), 2)
    (seen, _), (plain, _) = wrapped.reset(), own.reset()
    assert (wrapped.num_envs, wrapped.agents) == (4, own.agents)
    with wrapped:
        for _ in range(3):
            for name, part in seen.items():
                size = plain[name].shape[-1]
                np.testing.assert_array_equal(
                    part[..., part.shape[-1] // 2 :][..., :size], plain[name]
                )
            actions = own.action_space.sample()
            seen, plain = wrapped.step(actions)[0], own.step(actions)[0]
            assert wrapped.observation_space.contains(seen)


def test_one_environment_is_refused() -> None:
    """And a batch by the wrappers of one."""
    with pytest.raises(SpecError, match="only a vector environment"):
        wrappers.agent_id(LedgerTicks())
    with pytest.raises(SpecError, match="batches have"):
        single.agent_id(gk.vector.make("spread", 2))
