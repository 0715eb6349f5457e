"""Episodes whose reset had no seed: played again by themselves, from what they began with."""

import random
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gamekeeper.errors import EvidenceError
from gamekeeper.interface.opening import open_env
from gamekeeper.interface.openings import Opening
from gamekeeper.randomness.stream import Stream
from gamekeeper.runs.comparison import untellable
from gamekeeper.runs.expanding import check_task, first_divergence, play_whole
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recording import record
from gamekeeper.runs.replay_runner import ReplayRunner
from gamekeeper.runs.reset_chain import chain_of
from gamekeeper.runs.run_check import with_prints
from tests.runs.plays import write_env

DRAWS = "return {agent: self.rng.normal(size=3) for agent in self.agents}"
MADE = "self.rng = np.random.default_rng(seed)"
KINDS = {
    "generator": ("return {agent: self.rng.normal(size=3) for agent in self.agents}", MADE),
    "random_state": (DRAWS, "self.rng = np.random.RandomState(seed)"),
    "random": (
        "return {a: np.array([self.rng.random()] * 3) for a in self.agents}",
        "import random; self.rng = random.Random(seed)",
    ),
    "stream": (
        "return {a: np.array([self.rng.uniform()] * 3) for a in self.agents}",
        "from gamekeeper.randomness.stream import Stream; self.rng = {'held': [Stream(seed)]}"
        "; self.rng = self.rng['held'][0]",
    ),
    "global": ("return {a: np.random.normal(size=3) for a in self.agents}", "np.random.seed(seed)"),
}


def trained(env: Any, resets: int, *, seed: int | None = 3) -> None:
    """Episodes of which the first reset alone has a seed, as trainers play them."""
    rng = np.random.default_rng(0)
    for episode in range(resets):
        env.reset(seed=seed if episode == 0 else None)
        while env.agents:
            env.step({agent: int(rng.integers(3)) for agent in env.agents})
    env.close()


def recorded(folder: Path, *edits: tuple[str, str], level: str = "actions", **options: Any) -> Path:
    """A run of Walk, of which the last episodes stay, played with unseeded resets."""
    path = write_env(folder, *edits)
    options = {"keep": "last 2", "check": False, **options}
    env = record(open_env(f"{path}:Walk").env, folder / "run", level=level, **options)
    trained(env, 7)
    return folder / "run"


def comes_out_again(run: Path, number: int) -> bool:
    """One episode played by itself in a fresh environment; whether its fingerprint comes out."""
    evidence = load(run)
    runner = ReplayRunner(evidence, open_env(f"{run.parent / 'walks.py'}:Walk"))
    again = runner.play(evidence.header(number))
    runner.close()
    recorded = with_prints(evidence).select(["episode", "fingerprint"]).to_pylist()
    return {"episode": number, "fingerprint": again["fingerprint"]} in recorded


@pytest.mark.parametrize("kind", list(KINDS))
def test_unseeded_episode_comes_out_again_by_itself(kind: str, tmp_path: Path) -> None:
    """The states of generators are taken down at its reset, of whatever kind they are."""
    draws, made = KINDS[kind]
    run = recorded(tmp_path, (MADE, made), (DRAWS, draws))
    headers = {each["episode"]: each for each in load(run).headers}

    assert (headers[6]["seed"], headers[6]["since"]) == (None, 0)
    assert untellable(load(run), env=str(tmp_path / "walks.py"), policies=False) is None
    assert comes_out_again(run, 6)
    assert comes_out_again(run, 5)


def test_expanded_run_has_the_fingerprint_of_a_full_one_and_the_same_openings(
    tmp_path: Path,
) -> None:
    """Expanding hands on what an episode began with, so that a diagnosis can play it again."""
    run = recorded(tmp_path)
    shutil.move(run, tmp_path / "small")
    whole = recorded(tmp_path, level="full")
    small = load(tmp_path / "small")
    play_whole(
        small, str(tmp_path / "whole"), env=f"{tmp_path / 'walks.py'}:Walk", report=lambda **_: None
    )

    expanded = load(tmp_path / "whole")
    assert first_divergence(small, expanded) is None
    assert load(whole).episode_table["fingerprint"] == expanded.episode_table["fingerprint"]
    assert load(whole).episode_table["opening"] == expanded.episode_table["opening"]


def test_resets_are_given_derived_seeds(tmp_path: Path) -> None:
    """With seed_resets each episode has a seed of its own, and the first keeps the one given."""
    run = recorded(tmp_path, seed_resets=True, keep="last 7")
    seeds = [each["seed"] for each in load(run).headers]

    assert seeds[0] == 3
    assert len(set(seeds)) == 7
    assert load(run).episode_table["opening"].null_count == 7
    assert comes_out_again(run, 4)


def test_attributes_that_were_set_are_set_again(tmp_path: Path) -> None:
    """Between episodes and within one; the run's episodes come out by themselves."""
    path = write_env(tmp_path)
    env = record(open_env(f"{path}:Walk").env, tmp_path / "run", level="actions", keep="last 9")
    for episode in range(4):
        if episode == 1:
            env.turns = 8
        env.reset(seed=episode)
        while env.agents:
            if episode == 2 and env.unwrapped.turn == 3:
                env.turns = 4
            env.step(dict.fromkeys(env.agents, 1))
    env.close()

    assert load(tmp_path / "run").episode_table["turns"].to_pylist() == [5, 8, 4, 4]
    assert [comes_out_again(tmp_path / "run", number) for number in range(4)] == [True] * 4
    opening = Opening.from_text(load(tmp_path / "run").header(2)["opening"])
    assert (dict(opening.attributes), opening.later) == ({"turns": "8"}, ((3, "turns", "4"),))


def test_state_that_survives_resets_is_noticed_by_the_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An episode that depends on those before it diverges when it is replayed by itself."""
    edit = ("self.turn, self.total = 0, (options or {})", "self.turn, self.total = 0, vars(self)")
    more = ('.get("start", 0)', '.get("total", 0)')
    pays = ("float(actions.get(agent, 0))", "float(self.total)")
    run = recorded(tmp_path, edit, more, pays)

    found = check_task(lambda **_: None, path=str(run), episode=6)
    assert found["outcome"] == "not checked"
    assert "arguments aren't known" in found["why"]
    monkeypatch.setattr("gamekeeper.runs.expanding.ASSUMED", "never")
    found = check_task(lambda **_: None, path=str(run), episode=6)

    assert found["outcome"] == "diverged"
    assert "reward" in found["why"]


def test_reset_without_seed_or_state_is_refused(tmp_path: Path) -> None:
    """The chain of unseeded resets needs its first episode, and none that was dropped."""
    header = {"episode": 5, "since": 2, "opening": None}
    assert chain_of(header, range(9)) == range(2, 5)
    with pytest.raises(EvidenceError, match="from episode 2; the run dropped 1"):
        chain_of(header, [0, 2, 4, 5])
    with pytest.raises(EvidenceError, match="none was given before"):
        chain_of({**header, "since": -1}, range(9))


def test_opening_refuses_other_generators_and_damaged_text() -> None:
    """An environment that holds other generators than it did can't be set up as it was."""
    env = type("Env", (), {})()
    env.unwrapped, env.rng = env, random.Random(0)
    opening = Opening(own=({"kind": "Stream", "state": [1, 0, 0, 5]},))
    with pytest.raises(EvidenceError, match="other random generators") as caught:
        opening.begin(env, was_reset=True)
    assert (caught.value.expected, caught.value.actual) == ("Stream", "Random")
    env.rng = Stream(4)
    opening.begin(env, was_reset=True)
    assert env.rng.state == (1, 0, 0, 5)
    with pytest.raises(EvidenceError, match="can't be read"):
        Opening.from_text("[1]")
