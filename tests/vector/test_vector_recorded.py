"""Recorded copies: one run, the fingerprints that the episodes have one by one."""

import subprocess
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import gamekeeper as gk
from gamekeeper.errors import OrderError
from gamekeeper.vector import make
from tests.vector import worlds

HERE = worlds.__file__


def played(venv: Any, steps: int) -> None:
    """Plays the first legal action of everybody."""
    _obs, infos = venv.reset(seed=4)
    nothing = venv.action_space.sample()
    for _ in range(steps):
        _, _, _, _, infos = venv.step(choice(infos.get("action_mask"), nothing))
    venv.close()


def choice(mask: Any, nothing: Any) -> Any:
    """Zeros, or the first action that a mask allows."""
    if isinstance(nothing, dict):
        masks = mask or {}
        return {key: choice(masks.get(key), part) for key, part in nothing.items()}
    if mask is None or mask.shape[:-1] != nothing.shape:
        return np.zeros_like(nothing)
    return mask.argmax(-1)


def first(observation: Any, agent: Any, info: Any, rng: Any) -> Any:
    """The same as a policy of one agent."""
    mask = info.get("action_mask") if info else None
    if isinstance(observation, dict) and mask is None:
        mask = observation.get("action_mask")
    if agent == "cook":  # of Camp, or of LateTurns, whose cook sees a number
        is_camp = isinstance(observation, np.ndarray)
        return np.zeros(2, np.int64) if is_camp else np.zeros(1, np.float32)
    return 0 if mask is None else int(np.argmax(mask))


@pytest.mark.parametrize(
    ("spec", "options"),
    [
        ("warehouse", {}),
        (f"{HERE}:LateTurns", {}),
        ("warehouse_turns", {"engine": "process", "workers": 2}),
        (f"{HERE}:Camp", {"engine": "process", "workers": 3}),
    ],
)
def test_episodes_have_the_fingerprints_they_have_one_by_one(
    spec: str, options: dict[str, Any], tmp_path: Path
) -> None:
    """Engine, workers and timing leave no episode in the evidence."""
    kwargs = {"horizon": 9} if spec.startswith("warehouse") else {}
    venv = gk.record(make(spec, 4, env_kwargs=kwargs, **options), tmp_path / "many")
    played(venv, 100)
    many = gk.load(tmp_path / "many")
    alone = gk.rollout(spec, policies=first, episodes=6, seed=4, env_kwargs=kwargs)

    assert many.episode_table["episode"].to_pylist() == sorted(
        many.episode_table["episode"].to_pylist()
    )
    for name in ("fingerprint", "info_fingerprint", "seed", "turns", "end"):
        assert many.episode_table[name].to_pylist()[:6] == alone.episode_table[name].to_pylist()
    assert many.manifest["spaces"] == alone.manifest["spaces"]
    assert many.manifest["state_space"] == alone.manifest["state_space"]


def test_recorded_copies_replay(tmp_path: Path) -> None:
    """The evidence of many copies is evidence like any other, digests included."""
    prints = {}
    for level in ("full", "digest"):
        path = tmp_path / level
        venv = gk.record(make("two_robot_line", 3), path, level=level)
        played(venv, 25)
        prints[level] = gk.load(path).fingerprint.partition(":")[2]
        assert gk.replay(path).verified
    assert prints["full"] == prints["digest"]


STEPS: Final = """
import sys
import gamekeeper as gk
from gamekeeper.vector import make, vector_rows
vector_rows.FLUSH_TURNS = 1  # rows are written as soon as an episode is over
venv = gk.record(make(sys.argv[1], 2, engine="serial"), sys.argv[2], level="actions")
before = set(sys.modules)
_, infos = venv.reset()
nothing = venv.action_space.sample() * 0
while not infos["over"].any():
    infos = venv.step(nothing)[4]
venv.step(nothing)
print(sorted(set(sys.modules) - before))
"""


def test_recording_copies_imports_nothing_in_a_step(tmp_path: Path) -> None:
    """The step in which rows are first written doesn't wait for pandas, which Arrow imports."""
    command = [sys.executable, "-c", STEPS, f"{HERE}:Walk", str(tmp_path / "run")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_recording_begins_before_the_first_reset(tmp_path: Path) -> None:
    """Half an episode would be no evidence."""
    with make("two_robot_line", 2) as venv:
        venv.reset()
        with pytest.raises(OrderError, match="before the first reset"):
            gk.record(venv, tmp_path / "late")


def test_gymnasium_takes_agents_as_environments() -> None:
    """Every agent of every copy is a sub-environment, with its own end and final observation."""
    with make(f"{HERE}:Walk", 3) as venv, make(f"{HERE}:Walk", 3) as own:
        flat = venv.as_gymnasium(absent="zeros")
        obs, _infos = flat.reset(seed=2)
        expected, _ = own.reset(seed=2)
        assert flat.num_envs == 6
        assert np.array_equal(obs, expected.reshape(6, 2))
        flat.action_space.seed(0)
        finals = 0
        for _ in range(25):
            actions = flat.action_space.sample()
            out, plain = flat.step(actions), own.step(actions.reshape(3, 2, 2))
            for one, two in zip(out[:4], plain[:4], strict=True):
                assert np.array_equal(one, two.reshape(one.shape))
            if "final_obs" in out[4]:
                finals += 1
                for place in np.flatnonzero(out[4]["_final_obs"]):
                    e, a = divmod(place, 2)
                    assert np.array_equal(out[4]["final_obs"][place], plain[4]["final_obs"][e][a])
        assert finals > 2


@pytest.mark.parametrize("autoreset", ["same_step", "next_step"])
def test_gymnasium_wrappers_take_it(autoreset: str) -> None:
    """Gymnasium's own statistics add up each agent's return, and what it sees is in its space."""
    with make("two_robot_line", 3, autoreset=autoreset) as venv:
        flat = RecordEpisodeStatistics(venv.as_gymnasium())
        obs, infos = flat.reset(seed=1)
        flat.action_space.seed(0)
        assert flat.observation_space.contains(obs)
        returns = []
        for _ in range(80):
            obs, _, terminated, truncated, infos = flat.step(flat.action_space.sample())
            assert flat.observation_space.contains(obs)
            if (terminated | truncated).any():
                returns += infos["episode"]["r"][infos["_episode"]].tolist()
    assert len(returns) > 6
    assert set(returns) == {1.0}
