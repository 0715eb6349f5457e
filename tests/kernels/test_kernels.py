"""Kernels: rules draw as Streams do, and run the same compiled and as plain Python."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.errors import SpecError
from gamekeeper.kernels import copy_steps, draws
from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.compile_cache import key_of
from gamekeeper.kernels.scalar_rules import Copy, as_python, numba
from gamekeeper.randomness.seeds import EpisodeSeeds, episode_seed
from gamekeeper.randomness.stream import Stream
from tests.kernels import lines
from tests.kernels.lines import WINDY

SEEDS = st.integers(0, 2**64 - 1)
ENVS = 5


@given(SEEDS, st.integers(0, 2**32 - 1))
def test_episode_seed_is_that_of_the_core(run: int, episode: int) -> None:
    """Compiled copies begin their episodes from the seeds that rollouts take."""
    seeds, seed_of = EpisodeSeeds(run), as_python(copy_steps.episode_seed)
    assert seed_of(seeds.pool, seeds.constant, episode) == episode_seed(run, episode)


@given(st.integers(0, 2**31 - 1), st.lists(st.integers(1, 2**31 - 1), max_size=12))
def test_draws_are_those_of_a_stream(seed: int, bounds: list[int]) -> None:
    """The same numbers in the same order, whatever is drawn before them."""
    record = np.zeros(1, np.dtype(list(draws.FIELDS), align=True))
    s = Copy(record.reshape(()))
    s.seed, s.block = seed, -1
    stream = Stream(seed)
    integers, uniform, normal = map(as_python, (draws.integers, draws.uniform, draws.normal))
    for bound in bounds:
        assert integers(s, bound) == stream.integers(bound)
        assert uniform(s, -1.0, 3.0) == stream.uniform(-1.0, 3.0)
        assert normal(s) == stream.normal()
    assert s.draws == stream.draws


class Run(Batch):
    """A batch of copies that tells all at each step."""

    def __init__(self, *, is_plain: bool, is_next: bool = False) -> None:
        autoreset = "next_step" if is_next else "same_step"
        super().__init__(WINDY, ENVS, seed=7, autoreset=autoreset, debug=is_plain)
        self.reset()

    def told(self, actions: Any) -> dict[str, Any]:
        """One step of every copy; copies of all arrays, and the state's bytes."""
        self.step(actions)
        arrays = self.arrays._asdict()
        return {**{name: array.copy() for name, array in arrays.items()}, "state": self.snapshot()}


def actions_of(steps: int) -> Any:
    """Actions from a fixed stream."""
    return np.random.default_rng(1).integers(0, 3, (steps, ENVS, 2))


def test_copies_end_agent_by_agent_and_begin_anew() -> None:
    """An agent's own end, the end of all, the last observations, the next episode's number."""
    run = Run(is_plain=True)
    fallen = over = 0
    for actions in actions_of(120):
        before = run.records["number"].copy()
        seen = run.told(actions)
        ended = seen["terminated"] | seen["truncated"]
        begun = run.records["number"] != before
        assert (run.records["number"][begun] == before[begun] + ENVS).all()
        assert (run.records["time"][begun] == 0).all()
        assert np.array_equal(seen["rewards"], seen["terms"].sum(-1))
        quiet = ~seen["live"] & ~ended & ~begun[:, None]
        assert not seen["obs"][quiet].any()
        assert not seen["masks"][~seen["live"] & ~begun[:, None]].any()
        fallen += int((ended.any(1) & ~begun).sum())
        over += int(begun.sum())
    assert fallen > 0
    assert over > 5


def test_next_step_resets_in_the_step_after() -> None:
    """A copy that is over takes no action in the next step, which shows its new episode."""
    run = Run(is_plain=True, is_next=True)
    was_over = np.zeros(ENVS, bool)
    overs = 0
    for actions in actions_of(120):
        seen = run.told(actions)
        assert (run.records["time"][was_over] == 0).all()
        assert not seen["rewards"][was_over].any()
        was_over = seen["over"].copy()
        overs += int(was_over.sum())
    assert overs > 3


@pytest.mark.skipif(numba() is None, reason="Numba, the extra `fast`, isn't installed")
@pytest.mark.parametrize("is_next", [False, True])
def test_compiled_rules_give_the_bits_of_plain_ones(is_next: bool) -> None:
    """Every array and every byte of state, step by step."""
    plain, compiled = (Run(is_plain=p, is_next=is_next) for p in (True, False))
    for actions in actions_of(200):
        one, two = plain.told(actions), compiled.told(actions)
        assert one.pop("state") == two.pop("state")
        for name, array in one.items():
            assert np.array_equal(array, two[name]), name


def test_state_is_bytes() -> None:
    """Put back, a copy goes on as it did."""
    run = Run(is_plain=True)
    kept = run.snapshot()
    first = [run.told(actions)["state"] for actions in actions_of(10)]
    run.restore(kept)
    again = [run.told(actions)["state"] for actions in actions_of(10)]

    assert first == again


def test_key_changes_with_code_and_with_what_it_calls() -> None:
    """Compiled code is found again, and isn't taken for other rules."""
    assert key_of(lines.step) == key_of(lines.step)
    assert len({key_of(each) for each in (lines.step, lines.reset, lines.observe)}) == 3


def test_field_that_every_kernel_has_is_refused() -> None:
    """The state's own names are taken."""
    with pytest.raises(SpecError, match="every kernel has"):
        replace(WINDY, state=[("time", "i4")])
