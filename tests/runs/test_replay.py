import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gamekeeper.episodes.canonical import to_json
from gamekeeper.errors import SpecError
from gamekeeper.interface.opening import open_env
from gamekeeper.runs.comparison import replay, replay_evidence
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recording import record, rollout
from tests.runs.plays import played, replayed, step_through, write_env
from tests.runs.walks import Turns, Walk

REWARD = ("float(actions.get(agent, 0))", "float(actions.get(agent, 0)) + (self.turn == 3)")


def test_replay_verifies_in_a_fresh_process(tmp_path: Path) -> None:
    """A run of an environment in a file verifies in a process that shares nothing with this one."""
    evidence = played(tmp_path)

    result = replay(tmp_path / "run", allow_import=True)

    assert result.verified, str(result)
    assert (evidence.fingerprint, 2, None) == (result.fingerprint, result.episodes, result.reason)
    assert str(result).splitlines() == [
        f"verified: fingerprint {evidence.fingerprint}",
        "  environment opened because you allowed it with --allow-import",
    ]


def test_replay_names_the_source_that_changed(tmp_path: Path) -> None:
    """A fresh process that diverges says where, both values, what changed, and the cause."""
    played(tmp_path, episodes=1)
    write_env(tmp_path, ("self.rng.normal(size=3) for", "self.rng.normal(size=3) * 2 for"))

    result = replay(tmp_path / "run", allow_import=True)

    place = result.divergence
    assert place is not None
    assert (place.episode, place.turn, place.agent, place.field) == (0, 0, "a", "obs")
    assert np.array_equal(place.recorded * 2, place.replayed), "values cross as they were"
    assert (result.verified, result.within_tolerance) == (False, None)
    assert list(result.versions) == ["source"]
    assert "changed since the recording (its source)" in str(result.cause)
    document = json.loads(json.dumps(result.to_json()))["divergence"]
    assert {"$": "ndarray", "dtype": "<f8", "shape": [3]}.items() <= document["recorded"].items()


@pytest.mark.parametrize(
    ("edit", "turn", "agent", "field"),
    [
        (REWARD, 2, "a", "reward"),
        (
            ("observations = self.see()", "observations = self.see(); self.rng.normal()"),
            2,
            "a",
            "obs",
        ),
        (("self.turn >= self.turns", "self.turn >= 3"), 3, "a", "terminated"),
        (('{"turn": self.turn}', '{"turn": self.turn + (self.turn > 1)}'), 2, "a", "info"),
        (("[self.turn, self.total]", "[self.turn, 0]"), 1, None, "state"),
        (
            ("self.agents = []\n        return", "self.agents = ['a']\n        return"),
            5,
            "a",
            "live",
        ),
        (
            ("        self.turn += 1\n", "        self.turn += 1\n        assert self.turn < 2\n"),
            1,
            "a",
            "raised",
        ),
        (
            ("self.turn, self.total = 0", "raise OSError; self.turn, self.total = 0"),
            0,
            None,
            "raised",
        ),
    ],
)
def test_replay_finds_the_first_divergence(
    tmp_path: Path, edit: tuple[str, str], turn: int, agent: str | None, field: str
) -> None:
    """Whatever an edited environment does otherwise is named by its turn, agent and field."""
    played(tmp_path, episodes=1, seed=3)

    found = replayed(tmp_path / "run", edit).divergence

    assert found is not None
    assert (0, turn, agent, field) == (found.episode, found.turn, found.agent, found.field)
    assert to_json(found.recorded) != to_json(found.replayed)


def test_replay_passes_over_what_is_within_tolerance(tmp_path: Path) -> None:
    """Numbers within the tolerance are passed over, beyond it they are the divergence."""
    noise = ("self.rng.normal(size=3) for", "self.rng.normal(size=3) + 1e-9 for")
    played(tmp_path)

    within = replayed(tmp_path / "run", noise, tolerance=1e-6)
    beyond = replayed(tmp_path / "run", noise, tolerance=1e-12)

    assert (within.within_tolerance, within.verified, within.divergence) == (True, False, None)
    assert beyond.within_tolerance is False
    assert beyond.divergence is not None
    assert beyond.divergence.field == "obs"


def test_replay_runs_on_from_the_last_seed(tmp_path: Path) -> None:
    """Episodes without a seed replay as long as one before them had one."""
    write_env(tmp_path)
    env = record(Walk(), tmp_path / "run")
    for seed in (7, None, None, 8):
        step_through(env, seed=seed)
    env.close()

    assert load(tmp_path / "run").episode_table["since"].to_pylist() == [0, 0, 0, 3]
    assert replayed(tmp_path / "run").verified


def test_replay_says_that_no_seed_was_given(tmp_path: Path) -> None:
    """A run whose first reset had no seed can't be told, with the episode named."""
    path = write_env(tmp_path, ("if seed is not None", "if True"))
    env = record(open_env(f"{path}:Walk").env, tmp_path / "run")
    step_through(env)
    env.close()

    result = replay(tmp_path / "run", env=f"{path}:Walk")

    assert result.reason == "episode 0 was reset without a seed, and none was given before"
    assert not result.verified
    assert str(result).startswith("can't tell: episode 0")


@pytest.mark.parametrize("turns", [0, 1, 3])
def test_replay_verifies_cut_episodes(tmp_path: Path, turns: int) -> None:
    """Episodes that were reset or closed in the middle replay up to there."""
    write_env(tmp_path)
    env = record(Walk(), tmp_path / "run")
    for seed in (1, 2):
        step_through(env, seed=seed, turns=turns)
    env.close()

    assert load(tmp_path / "run").episode_table["end"].to_pylist() == ["cut", "cut"]
    assert replayed(tmp_path / "run").verified


def test_replay_verifies_a_failed_run_up_to_where_it_failed(tmp_path: Path) -> None:
    """An environment that raises again at the same place verifies; one that doesn't diverges."""
    raises = ("        self.turn += 1\n", "        self.turn += 1\n        assert self.turn < 3\n")
    path = write_env(tmp_path, raises)
    with pytest.raises(RuntimeError, match="AssertionError"):
        rollout(f"{path}:Walk", episodes=2, out=tmp_path / "run")

    assert replayed(tmp_path / "run", raises).verified
    fixed = replayed(tmp_path / "run").divergence
    assert fixed is not None
    assert (fixed.field, fixed.recorded, fixed.replayed) == ("raised", "AssertionError", None)


def test_replay_verifies_a_reset_that_failed(tmp_path: Path) -> None:
    """A run that failed in its reset verifies where the reset fails again."""
    raises = ("self.turn, self.total = 0", "raise OSError('no map'); self.turn, self.total = 0")
    path = write_env(tmp_path, raises)
    with pytest.raises(RuntimeError, match="no map"):
        rollout(f"{path}:Walk", episodes=1, out=tmp_path / "run")

    assert replayed(tmp_path / "run", raises).verified
    fixed = replayed(tmp_path / "run").divergence
    assert fixed is not None
    assert (fixed.field, fixed.recorded) == ("raised", "OSError: no map")


@pytest.mark.parametrize(
    "actions",
    [
        [1, 1, 1],
        [np.int64(1)] * 3,
        [1, np.int64(1), np.int32(1)],
        [np.int64(1), 1, True],
        [7, 1.0, np.float32(1)],
    ],
)
def test_replay_hands_over_actions_of_the_very_type(tmp_path: Path, actions: list[Any]) -> None:
    """An environment that pays by the type of an action pays the same in the replay."""
    by_type = ("float(actions.get(agent, 0))", "float(len(repr(actions[agent])))")
    path = write_env(tmp_path, by_type)
    env = record(open_env(f"{path}:Walk").env, tmp_path / "run")
    env.reset(seed=1)
    for action in actions:
        env.step({"a": action, "b": 0})
    env.close()

    result = replayed(tmp_path / "run", by_type)

    assert result.verified, str(result)


def test_replay_says_which_action_no_text_can_build(tmp_path: Path) -> None:
    """An action that was an object can't be told, with its place."""
    path = write_env(tmp_path, ("int(action)", "1"), ("float(actions.get(agent, 0))", "0.0"))
    env = record(open_env(f"{path}:Walk").env, tmp_path / "run")
    env.reset(seed=1)
    env.step({"a": object(), "b": 0})
    env.close()

    result = replay(tmp_path / "run", env=f"{path}:Walk")

    assert result.reason is not None
    assert "episode 0, turn 0, action['a']" in result.reason


def test_replay_keeps_the_order_of_actions_and_who_was_left_out(tmp_path: Path) -> None:
    """Actions in another order, without an agent, or of nobody are handed over as they were."""
    write_env(tmp_path)
    env = record(Walk(), tmp_path / "run")
    env.reset(seed=1)
    for actions in ({"b": 1, "a": 2}, {}, {"b": 1}, {"a": 1, "b": 1}):
        env.step(actions)
    env.close()

    assert load(tmp_path / "run").episode_table["turns"][0].as_py() == 4
    assert replayed(tmp_path / "run").verified


def test_replay_plays_on_past_the_last_ending(tmp_path: Path) -> None:
    """Steps of a user who didn't stop when every agent had ended are played again."""
    lingers = ("self.agents = []\n        return", "self.agents = ['a', 'b']\n        return")
    path = write_env(tmp_path, lingers)
    env = record(open_env(f"{path}:Walk").env, tmp_path / "run")
    step_through(env, seed=1, turns=8)
    env.close()

    assert load(tmp_path / "run").episode_table["turns"][0].as_py() == 8
    assert replayed(tmp_path / "run", lingers).verified


@pytest.mark.parametrize("level", ["full", "digest"])
def test_replay_verifies_turns(tmp_path: Path, level: str) -> None:
    """An AEC run verifies at both levels."""
    played(tmp_path, env="Turns", level=level)

    assert replayed(tmp_path / "run", env="Turns").verified


@pytest.mark.parametrize("end", ["look", "step"])
def test_replay_looks_where_the_recording_looked(tmp_path: Path, end: str) -> None:
    """Turns without an observation, and a last look that no action followed, verify."""
    write_env(tmp_path)
    env = record(Turns(), tmp_path / "run")
    env.reset(seed=5)
    for turn in range(3):
        env.last(observe=turn != 1)
        env.step(1)
    if end == "look":
        env.last()
    env.close()

    steps = load(tmp_path / "run").agent_steps
    assert (end == "look") == (3 in steps["turn"].to_pylist())
    assert replayed(tmp_path / "run", env="Turns").verified


def test_replay_hands_over_options_and_arguments(tmp_path: Path) -> None:
    """Options of a reset and keyword arguments of the environment come back."""
    played(tmp_path, options={"start": 40}, env_kwargs={"turns": 3})

    assert load(tmp_path / "run").episode_table["turns"][0].as_py() == 3
    assert load(tmp_path / "run").episodes[0].state(0)[1] == 40
    assert replay(tmp_path / "run", allow_import=True).verified


def test_replay_lets_the_policies_choose_again(tmp_path: Path) -> None:
    """Recorded policies choose the same again; in another game they choose otherwise."""
    played(tmp_path)

    assert replayed(tmp_path / "run", policies=True).verified


def test_replay_says_that_policies_have_no_seed(tmp_path: Path) -> None:
    """A recording of the user's own loop names no policies that could choose again."""
    write_env(tmp_path)
    env = record(Walk(), tmp_path / "run")
    step_through(env, seed=1)
    env.close()

    result = replay(tmp_path / "run", env=f"{tmp_path}/walks.py:Walk", policies=True)

    assert result.reason is not None
    assert "doesn't name its policies" in result.reason


def test_replay_opens_the_class_of_an_object(tmp_path: Path) -> None:
    """An environment object is found again by its class, or is named."""
    env = record(Walk(), tmp_path / "run")
    step_through(env, seed=1)
    env.close()

    assert replay(tmp_path / "run").verified
    path = write_env(tmp_path)
    assert replay(tmp_path / "run", env=f"{path}:Walk").verified


@pytest.mark.parametrize("env", [Walk(), Walk, Path("walks.py:Walk")])
def test_replay_wants_a_name_for_another_environment(tmp_path: Path, env: Any) -> None:
    """An object, a factory or a path in place of its name is refused before anything is read."""
    with pytest.raises(SpecError, match="opens the environment by its name") as raised:
        replay(tmp_path / "missing", env=env)
    assert "gk.diff" in raised.value.fix


def test_replay_of_digests_names_a_divergence(tmp_path: Path) -> None:
    """Without observations a divergence is found by the digest of its row."""
    full = played(tmp_path)
    digest = played(tmp_path, out="digests", level="digest")
    noise = ("self.rng.normal(size=3) for", "self.rng.normal(size=3) + 1e-9 for")

    assert full.fingerprint.partition(":")[2] == digest.fingerprint.partition(":")[2]
    assert not [name for name in digest.agent_steps.schema.names if name.startswith("obs")]
    assert replayed(tmp_path / "digests").verified
    found = replayed(tmp_path / "digests", noise).divergence
    assert found is not None
    assert (found.episode, found.turn, found.field) == (0, 0, "digest")


def test_replay_closes_the_environment_it_was_handed(tmp_path: Path) -> None:
    """The environment of `replay_evidence` is closed, whatever came out."""
    played(tmp_path, episodes=1)
    opened = open_env(f"{tmp_path}/walks.py:Walk")
    closed: list[bool] = []
    opened.env.close = lambda: closed.append(True)

    replay_evidence(load(tmp_path / "run"), opened)

    assert closed == [True]


def test_replay_renders_where_the_recording_did(tmp_path: Path) -> None:
    """What rendering leaves in later observations is there again; without it, that would differ."""
    shaken = (
        ("render_mode = None", 'render_mode = "ansi"\n    shown = 0'),
        (
            "self.rng.normal(size=3) for agent in self.agents}",
            "self.rng.normal(size=3) + self.shown for agent in self.agents}\n"
            "\n    def render(self):\n        self.shown += 1\n        return str(self.turn)",
        ),
    )
    played(tmp_path, *shaken, frames=True)
    assert replay(tmp_path / "run", allow_import=True).verified

    shutil.rmtree(tmp_path / "run" / "frames")
    assert replay(tmp_path / "run", allow_import=True).verified
