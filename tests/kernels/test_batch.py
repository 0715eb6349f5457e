"""Batches: copies as bytes, threads, code kept on disk."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gamekeeper.errors import ActionError, SpecError
from gamekeeper.kernels.batch import Batch, Crew, parts_of
from gamekeeper.kernels.compile_cache import key_of
from gamekeeper.kernels.scalar_rules import numba
from tests.kernels.lines import WINDY

needs_numba = pytest.mark.skipif(numba() is None, reason="Numba, the extra `fast`, isn't installed")
SHOWN = ("obs", "masks", "live", "over", "raw")


def actions_of(steps: int, envs: int) -> Any:
    """Actions from a fixed stream."""
    return np.random.default_rng(1).integers(0, 3, (steps, envs, 2))


@pytest.mark.parametrize("debug", [False, True])
@pytest.mark.parametrize("autoreset", ["same_step", "next_step"])
def test_one_copy_put_back_goes_on_as_it_did(debug: bool, autoreset: str) -> None:
    """Copy 2 plays the same again, in its own place and in another batch; the others go on."""
    batch = Batch(WINDY, 4, seed=7, debug=debug, autoreset=autoreset)
    other = Batch(WINDY, 4, seed=7, debug=debug, autoreset=autoreset)
    batch.reset()
    other.reset()
    drawn = actions_of(60, 4)
    for actions in drawn[:23]:
        batch.step(actions)
    kept, shown = batch.snapshot(2), batch.arrays.obs[2].copy()
    first = []
    for actions in drawn[23:]:
        batch.step(actions)
        first.append(batch.snapshot(2))
    for again in (batch, other):
        again.restore(kept, 2)
        assert np.array_equal(shown, again.arrays.obs[2])
        for actions, state in zip(drawn[23:], first, strict=True):
            again.step(actions)
            assert state == again.snapshot(2)


def test_whole_batch_put_back_shows_what_it_showed() -> None:
    """Observations, masks, who is live and who is over are those of the state."""
    batch = Batch(WINDY, 5, seed=7, debug=True, autoreset="next_step")
    batch.reset()
    for actions in actions_of(50, 5):
        batch.step(actions)
        now = {name: getattr(batch.arrays, name).copy() for name in SHOWN}
        ended = batch.arrays.terminated | batch.arrays.truncated
        now["obs"][ended] = 0
        batch.restore(batch.snapshot())
        for name, array in now.items():
            assert np.array_equal(array, getattr(batch.arrays, name)), name


def test_digests_are_equal_where_states_are() -> None:
    """Two batches of one run; then one copy goes another way."""
    one, two = (Batch(WINDY, 6, seed=3, debug=True) for _ in range(2))
    one.reset()
    two.reset()
    assert one.equal(two).all()
    assert np.array_equal(one.digest(), two.digest())
    actions = np.ones((6, 2), np.int64)
    one.step(actions)
    actions[4, 0] = 2
    two.step(actions)
    differ = ~one.equal(two)
    assert np.array_equal(differ, (one.digest() != two.digest()).any(1))
    assert not differ[[0, 1, 2, 3, 5]].any()


def test_snapshot_of_other_copies_is_refused() -> None:
    """Its length tells."""
    batch = Batch(WINDY, 2, debug=True)
    batch.reset()
    with pytest.raises(SpecError, match="other copies"):
        batch.restore(batch.snapshot(), 1)
    with pytest.raises(SpecError, match="no such copy"):
        batch.snapshot(2)


@pytest.mark.parametrize("debug", [False, True])
def test_illegal_action_changes_nothing(debug: bool) -> None:
    """The copy, the agent and the action are named, and nothing has happened."""
    batch = Batch(WINDY, 3, debug=debug)
    batch.reset()
    kept, actions = batch.snapshot(), np.ones((3, 2), np.int64)
    actions[2, 1] = 3
    with pytest.raises(ActionError, match="copy 2, agent 'carrier'"):
        batch.step(actions)
    assert kept == batch.snapshot()


@needs_numba
@pytest.mark.parametrize("threads", [2, 3, 5])
def test_threads_give_the_bits_of_one(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every array, for any number of threads, however small the batch."""
    monkeypatch.setattr("gamekeeper.kernels.batch.WORTH_S", 0.0)
    one, many = (Batch(WINDY, 70, seed=5, threads=k) for k in (1, threads))
    one.reset()
    many.reset()
    for actions in actions_of(60, 70):
        one.step(actions)
        many.step(actions)
        for name, array in one.arrays._asdict().items():
            assert np.array_equal(array, getattr(many.arrays, name)), name


@pytest.mark.parametrize("copies", [1, 15, 16, 17, 4096, 100_003])
@pytest.mark.parametrize("count", [2, 3, 16])
def test_parts_cover_every_copy_once(copies: int, count: int) -> None:
    """In order, none empty, no more than there are threads."""
    bounds = parts_of(copies, count)
    assert bounds[0] == 0
    assert bounds[-1] == copies
    assert bounds == sorted(set(bounds))
    assert len(bounds) - 1 <= count


def test_error_in_a_thread_is_raised_by_the_crew() -> None:
    """And the crew works on after it."""
    crew = Crew(2)

    def job(first: int, last: int) -> int:
        if first:
            raise ValueError("in the second part")
        return last

    with pytest.raises(ValueError, match="second part"):
        crew.run(job, 64)
    done: list[tuple[int, int]] = []
    crew.run(lambda first, last: done.append((first, last)), 64)
    assert sorted(done) == [(0, 16), (16, 32), (32, 48), (48, 64)]


# -- code on disk

PROGRAM = """
    import numpy as np
    from gymnasium import spaces
    from gamekeeper.kernels.batch import Batch
    from gamekeeper.kernels.kernel import Kernel
    from gamekeeper.kernels.scalar_rules import rule

    STEP = {step}

    @rule
    def reset(s):
        s.x = 0

    @rule
    def step(s, actions, rewards, terminated, truncated):
        s.x += STEP
        rewards[0, 0] = s.x

    @rule
    def observe(s, obs):
        obs[0] = s.x

    kernel = Kernel(
        name="counter_v0", agents=("one",), observation_space=spaces.Discrete(9),
        action_space=spaces.Discrete(2), state=[("x", "i8")],
        reset=reset, step=step, observe=observe, horizon=3,
    )
    batch = Batch(kernel, 2)
    batch.reset()
    batch.step()
    print(int(batch.arrays.rewards[0, 0]))
"""


def ran(cache: Path, step: int) -> tuple[str, bool]:
    """What the program prints, and whether it had to compile; it has no file."""
    found = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(PROGRAM).format(step=step)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache), "HOME": str(cache / "no-home")},
        capture_output=True,
        text=True,
        check=True,
    )
    lines = [line for line in found.stderr.splitlines() if "compiles counter_v0" in line]
    assert len(lines) <= 1, found.stderr
    return found.stdout.strip(), bool(lines)


@needs_numba
def test_code_on_disk_is_found_again_and_told_apart(tmp_path: Path) -> None:
    """Rules of `__main__`, without a file; another constant is other code; read-only will do."""
    cache = tmp_path / "cache"
    assert ran(cache, 2) == ("2", True)
    assert ran(cache, 2) == ("2", False)
    assert ran(cache, 5) == ("5", True)
    for file in [*cache.iterdir(), cache]:
        file.chmod(file.stat().st_mode & ~0o222)
    assert ran(cache, 2) == ("2", False)


def test_key_has_what_a_rule_takes_from_elsewhere() -> None:
    """Constants of a module, arrays, tuples, defaults, code inside of code."""

    def made(source: str, **names: Any) -> str:
        scope = dict(names)
        exec(textwrap.dedent(source), scope)  # functions whose text is chosen here
        return key_of(scope["f"])

    plain = "def f(s): return s + A"
    keys = [
        made(plain, A=1),
        made(plain, A=1.0),
        made(plain, A=np.int64(1)),
        made(plain, A=(1, 2)),
        made(plain, A=(1, 3)),
        made(plain, A=np.arange(3)),
        made(plain, A=np.arange(3.0)),
        made("def f(s, a=1): return s + a"),
        made("def f(s, a=2): return s + a"),
        made("def f(s):\n    g = lambda x: x + 1\n    return g(s)"),
        made("def f(s):\n    g = lambda x: x + 2\n    return g(s)"),
    ]
    assert len(set(keys)) == len(keys)
    assert made(plain, A=np.arange(3)) == made(plain, A=np.arange(3))
