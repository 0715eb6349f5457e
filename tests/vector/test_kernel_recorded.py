"""Recorded batches: the rows and fingerprints of copies that are played one at a time."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.errors import OrderError
from gamekeeper.kernels import blake2b
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.vector import kernel_buffer, make
from tests.vector import rulebooks
from tests.vector.test_vector import legal

HERE = rulebooks.__file__
PLAIN = {"debug": True}
NAMES = ("windy", "camp", "ring", "glide")
CONTRACT = """
name = "any_v0"
[rewards.fee]
kind = "individual"
[rewards.own]
kind = "individual"
[rewards.nobody]
kind = "individual"
[infos.mood]
volatile = true
[infos.at]
volatile = true
"""


def recorded(engine: str, name: str, path: Path, *, seed: int = 5, **options: Any) -> Any:
    """Sixty steps under legal actions."""
    kept = {key: options.pop(key) for key in ("level", "contract") if key in options}
    many = make(f"{HERE}:{name}", 4, engine=engine, env_kwargs=PLAIN, **options)
    venv = gk.record(many, path, **kept)
    venv.action_space.seed(seed)
    _, infos = venv.reset(seed=seed)
    for step in range(60):
        infos = venv.step(legal(infos, venv.action_space.sample(), step))[-1]
    venv.close()
    return gk.load(path)


def check_same(one: Any, two: Any) -> None:
    """Every column of every stream but times, and what types actions were of."""
    assert one.fingerprint == two.fingerprint
    assert one.manifest["info_fingerprint"] == two.manifest["info_fingerprint"]
    assert {k for k in one.manifest if one.manifest[k] != two.manifest[k]} <= {"checksums"}
    for stream in ("episodes", "agent_steps", "states"):
        left, right = one.tables.table(stream), two.tables.table(stream)
        if left is None:
            assert right is None
            continue
        assert sorted(left.schema.names) == sorted(right.schema.names)
        for column in set(left.schema.names) - {"action_types"}:
            assert left.schema.field(column).equals(right.schema.field(column), check_metadata=True)
            assert repr(left[column].to_pylist()) == repr(right[column].to_pylist()), column


@pytest.mark.parametrize("level", ["full", "digest"])
@pytest.mark.parametrize("autoreset", ["same_step", "next_step"])
@pytest.mark.parametrize("name", NAMES)
def test_recorded_batch_has_the_rows_of_single_copies(
    name: str, autoreset: Any, level: str, tmp_path: Path
) -> None:
    """Rows, states, endings, fingerprints; with the last episodes cut."""
    options: dict[str, Any] = {"autoreset": autoreset, "level": level}
    one = recorded("serial", name, tmp_path / "serial", **options)
    two = recorded("kernel", name, tmp_path / "kernel", **options)
    check_same(one, two)


@pytest.mark.parametrize("name", NAMES)
def test_terms_and_volatile_infos_are_those_of_the_contract(name: str, tmp_path: Path) -> None:
    """Terms that the rules pay and some that they don't; infos without what may differ."""
    contract = tmp_path / "contract.toml"
    contract.write_text(CONTRACT)
    found = [
        recorded(engine, name, tmp_path / engine, contract=contract)
        for engine in ("serial", "kernel")
    ]
    check_same(*found)


@pytest.mark.parametrize("name", NAMES)
def test_short_buffers_leave_no_trace(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However often rows become columns, and whoever waits for whom."""
    one = recorded("kernel", name, tmp_path / "long", seed=8)
    monkeypatch.setattr(kernel_buffer, "MOST_ROWS", 20)
    two = recorded("kernel", name, tmp_path / "short", seed=8)
    check_same(one, two)


def first_legal(observation: Any, agent: Any, info: Any, rng: Any) -> Any:
    """The first action that is legal."""
    mask = info.get("action_mask")
    if mask is None:
        return np.full(2, 0.25, np.float32)
    if isinstance(mask, tuple):
        return np.array([part.argmax() for part in mask])
    return int(mask.argmax())


@pytest.mark.parametrize("name", NAMES)
def test_recorded_batch_is_a_rollout(name: str, tmp_path: Path) -> None:
    """What `gk.rollout` records of the same episode, one episode after the other."""
    path = tmp_path / "many"
    venv = gk.record(make(f"{HERE}:{name}", 3, engine="kernel", env_kwargs=PLAIN), path)
    _, infos = venv.reset(seed=4)
    space = venv.action_space.sample()
    for _ in range(90):
        infos = venv.step(firsts(infos.get("action_mask"), space))[-1]
    venv.close()
    many, alone = (
        gk.load(path),
        gk.rollout(f"{HERE}:{name}", policies=first_legal, episodes=5, seed=4, env_kwargs=PLAIN),
    )
    for column in ("fingerprint", "info_fingerprint", "seed", "turns", "end", "endings"):
        assert (
            many.episode_table[column].to_pylist()[:5] == alone.episode_table[column].to_pylist()
        ), column
    assert many.episode_table["seed"][2].as_py() == episode_seed(4, 2)
    types = many.episode_table["action_types"].to_pylist()[:5]
    assert types == alone.episode_table["action_types"].to_pylist()
    assert gk.replay(path, allow_import=True).verified


def firsts(mask: Any, space: Any) -> Any:
    """The first legal actions of all copies."""
    if mask is None:
        return np.full_like(space, 0.25)
    if isinstance(mask, dict):
        return {name: firsts(mask[name], space[name]) for name in mask}
    if mask.shape[:-1] != space.shape:  # parts of a MultiDiscrete
        return np.stack([mask[..., :2].argmax(-1), mask[..., 2:].argmax(-1)], -1)
    return mask.argmax(-1)


def test_recorded_copies_have_one_run(tmp_path: Path) -> None:
    """A second reset would number episodes twice."""
    venv = gk.record(make(f"{HERE}:windy", 2, engine="kernel", env_kwargs=PLAIN), tmp_path / "a")
    venv.reset(seed=1)
    with pytest.raises(OrderError, match="second time"):
        venv.reset(seed=2)
    venv.close()
    assert gk.load(tmp_path / "a").episode_table["end"].to_pylist() == ["cut", "cut"]


@pytest.mark.parametrize("size", [16, 32])
def test_compiled_hash_is_that_of_hashlib(size: int) -> None:
    """Empty messages, whole blocks, one byte more, long ones beside short ones."""
    rng = np.random.default_rng(0)
    sizes = np.concatenate(([0, 1, 127, 128, 129, 256, 257, 0], rng.integers(0, 400, 200)))
    bounds = np.concatenate(([0], np.cumsum(sizes))).astype(np.int64)
    data = rng.integers(0, 256, bounds[-1]).astype(np.uint8)
    whole = blake2b.digests(data, bounds, size)
    for k in range(len(sizes)):
        alone = blake2b.digests(data[bounds[k] : bounds[k + 1]], np.array([0, sizes[k]]), size)
        assert whole[k].tobytes() == alone.tobytes()
