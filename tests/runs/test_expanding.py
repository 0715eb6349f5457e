"""Level `actions`: small runs keep what full runs say, and expand into them."""

import os
import shutil
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

import gamekeeper as gk
from gamekeeper.episodes.actions_level import EVERY
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.evidence import NO_STEPS, Evidence, fingerprints
from gamekeeper.errors import DivergenceError, EvidenceError, GamekeeperError, RunError
from gamekeeper.runs.expanding import expand, whole_evidence
from gamekeeper.runs.run_check import verify, with_prints
from tests.runs.plays import played

STATE = "np.array([self.turn, self.total], np.int64)"
TASKS = ("two_robot_line", "aec:two_robot_line", "tictactoe", "aec:warehouse")


def recorded(spec: str, folder: Path, **settings: Any) -> tuple[Evidence, Evidence]:
    """The same rollout in full and at level `actions`."""
    full = gk.rollout(spec, episodes=2, most_turns=150, out=folder / "full", **settings)
    small = gk.rollout(
        spec, episodes=2, most_turns=150, out=folder / "small", level="actions", **settings
    )
    return full, small


def witnesses(episode: Episode) -> list[tuple[int, bytes | None]]:
    """The turn and the digest of each row."""
    columns = (episode.steps[name].to_pylist() for name in ("turn", "digest"))
    return list(zip(*columns, strict=True))


@pytest.mark.parametrize("spec", TASKS)
def test_small_run_keeps_what_follows_from_the_full_one(spec: str, tmp_path: Path) -> None:
    """Every column that is kept, row by row, whichever way the turn was taken down."""
    full, small = recorded(spec, tmp_path)

    assert verify(tmp_path / "small").ok
    for one, whole in zip(small.episodes, full.episodes, strict=True):
        kept = whole.kept()
        assert {name: kept.steps[name].to_pylist() for name in kept.steps.schema.names} == {
            name: one.steps[name].to_pylist() for name in one.steps.schema.names
        }
        found = {turn for turn, digest in witnesses(one) if digest is not None}
        assert {turn for turn, _ in witnesses(one) if turn % EVERY == 0} <= found
        assert len(found) == sum(digest is not None for _, digest in witnesses(one))
        assert not [name for name in one.steps.schema.names if name.startswith("obs.")]


def test_small_files_leave_out_what_the_rest_tells(tmp_path: Path) -> None:
    """A reader gives every column; fingerprints of episodes are computed and make the run's."""
    small = gk.rollout("two_robot_line", episodes=3, out=tmp_path / "run", level="actions")
    stored = {
        name: set(pq.read_schema(tmp_path / "run" / f"{name}.parquet").names)
        for name in ("episodes", "agent_steps")
    }
    prints = with_prints(small)

    assert stored["episodes"] == {"episode", "seed", "since", "policies", "turns", "end"} | (
        stored["episodes"] & {"action_types", "endings"}
    )
    assert set(NO_STEPS.names) - stored["agent_steps"] == {
        "action_mask",
        "cumulative_reward",
        "info",
    }
    assert set(NO_STEPS.names) <= set(small.agent_steps.schema.names)
    assert small.episode_table["fingerprint"].null_count == 3
    assert len(set(prints["fingerprint"].to_pylist())) == 3
    assert fingerprints(small.manifest, prints)["fingerprint"] == small.fingerprint
    gk.report(tmp_path / "run", tmp_path / "page.html")
    assert "not stored" in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("spec", ["two_robot_line", "aec:warehouse"])
def test_expanded_run_has_the_fingerprint_of_the_full_one(spec: str, tmp_path: Path) -> None:
    """Both fingerprints; the manifest says what isn't restored, and nothing is timed."""
    full, _ = recorded(spec, tmp_path)

    whole = expand(tmp_path / "small", tmp_path / "whole")

    assert whole.fingerprint == full.fingerprint
    assert whole.manifest["info_fingerprint"] == full.manifest["info_fingerprint"]
    assert "timings" in whole.manifest["expanded"]["not_restored"]
    assert whole.timings is None
    assert verify(tmp_path / "whole").ok


def test_expanding_stops_at_the_first_difference(tmp_path: Path) -> None:
    """A reward that comes out otherwise is a divergence, and no run is left."""
    played(tmp_path, level="actions", policies="first-legal")
    source = tmp_path / "walks.py"
    changed = source.read_text().replace("float(actions.get(agent, 0))", "float(self.turn == 3)")
    source.write_text(changed)

    with pytest.raises(DivergenceError, match="came out otherwise") as caught:
        expand(tmp_path / "run", tmp_path / "whole", allow_import=True)

    assert (caught.value.divergence.turn, caught.value.divergence.field) == (2, "reward")
    assert not (tmp_path / "whole").exists()


def test_expanding_finds_a_witness_that_differs(tmp_path: Path) -> None:
    """An observation that comes out otherwise at the reset, though no reward shows it."""
    played(tmp_path, level="actions")
    source = tmp_path / "walks.py"
    noise = ("self.rng.normal(size=3) for", "self.rng.normal(size=3) + 1e-9 for")
    source.write_text(source.read_text().replace(*noise))

    with pytest.raises(DivergenceError) as caught:
        expand(tmp_path / "run", tmp_path / "whole", allow_import=True)

    assert (caught.value.divergence.turn, caught.value.divergence.field) == (0, "digest")


def test_witness_covers_the_state(tmp_path: Path) -> None:
    """A state that comes out otherwise is found, though agents see and are paid the same."""
    played(tmp_path, level="actions")
    assert not (tmp_path / "run" / "states.parquet").exists()
    source = tmp_path / "walks.py"
    text = source.read_text()
    assert text.count(STATE) == 1
    source.write_text(text.replace(STATE, f"{STATE} + 1"))

    with pytest.raises(DivergenceError) as caught:
        expand(tmp_path / "run", tmp_path / "whole", allow_import=True)

    divergence = caught.value.divergence
    assert (divergence.turn, divergence.agent, divergence.field) == (0, None, "digest")


def test_full_run_is_not_expanded(tmp_path: Path) -> None:
    """There is nothing to expand."""
    gk.rollout("two_robot_line", episodes=1, out=tmp_path / "run")
    with pytest.raises(EvidenceError, match="nothing to expand"):
        expand(tmp_path / "run", tmp_path / "whole")


def test_refused_folder_keeps_what_lies_in_it(tmp_path: Path) -> None:
    """A folder that holds something is refused, and nothing in it is touched."""
    gk.rollout("two_robot_line", episodes=1, out=tmp_path / "run", level="actions")
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "notes.txt").write_text("mine")

    with pytest.raises(RunError, match="isn't empty"):
        expand(tmp_path / "run", tmp_path / "taken")
    with pytest.raises(GamekeeperError, match="nowhere"):
        expand(tmp_path / "run", tmp_path / "new", env="gamekeeper.nowhere:make")

    assert sorted(path.name for path in tmp_path.iterdir()) == ["run", "taken"]
    assert (tmp_path / "taken" / "notes.txt").read_text() == "mine"


def test_expanded_run_gets_its_name_once_it_is_whole(tmp_path: Path) -> None:
    """What a killed process leaves isn't at OUT: `recover` would make a shorter run of it."""
    gk.rollout("two_robot_line", episodes=3, out=tmp_path / "small", level="actions")
    whole = tmp_path / "new" / "whole"
    seen: list[bool] = []

    expand(tmp_path / "small", whole, on_message=lambda _: seen.append(whole.exists()))

    assert seen
    assert not any(seen)
    assert [path.name for path in whole.parent.iterdir()] == ["whole"]
    with pytest.raises(RunError, match="a run is there already"):
        expand(tmp_path / "small", whole, on_message=lambda _: seen.append(True))
    assert not any(seen)


def test_expanding_keeps_a_file_and_fills_an_empty_folder(tmp_path: Path) -> None:
    """A file that has the name is refused; an empty folder, also behind a link, is filled."""
    gk.rollout("two_robot_line", episodes=1, out=tmp_path / "small", level="actions")
    (tmp_path / "file").write_text("mine")
    (tmp_path / "empty").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "empty")

    with pytest.raises(RunError, match="making the folder"):
        expand(tmp_path / "small", tmp_path / "file")
    expand(tmp_path / "small", tmp_path / "link")

    assert (tmp_path / "file").read_text() == "mine"
    assert verify(tmp_path / "empty").ok


def test_recorded_environment_of_the_user_expands(tmp_path: Path) -> None:
    """A loop of the user's, which leaves out an observation and cuts an episode."""
    runs = {}
    for level in ("full", "actions"):
        env = gk.record(gk.make("aec:two_robot_line"), tmp_path / level, level=level)
        for seed in (1, 2):
            env.reset(seed=seed)
            for turn in range(5):
                _, _, terminated, truncated, _ = env.last(observe=turn != 2)
                env.step(None if terminated or truncated else 0)
                if not env.agents:
                    break
        env.close()
        runs[level] = gk.load(tmp_path / level)
    whole = expand(tmp_path / "actions", tmp_path / "whole", env="aec:two_robot_line")
    assert whole.fingerprint == runs["full"].fingerprint


def test_whole_evidence_is_kept_in_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A small run is expanded once; a full one is what it is."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    full, small = recorded("two_robot_line", tmp_path)
    assert whole_evidence(full) is full
    whole = whole_evidence(small)
    assert whole.fingerprint == full.fingerprint
    again = whole_evidence(tmp_path / "small")
    assert (again.root, again.name) == (whole.root, str(tmp_path / "small"))
    assert gk.attribute(tmp_path / "small", episodes=0).run == str(tmp_path / "small")


def test_interrupted_expansion_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a killed process left half written in the cache is never taken for the whole run."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    full, small = recorded("two_robot_line", tmp_path)
    place = whole_evidence(small).path
    assert place is not None
    shutil.rmtree(place)
    env = gk.record(gk.make("two_robot_line"), tmp_path / "open")
    env.reset(seed=1)
    shutil.copytree(tmp_path / "open", place)
    env.close()

    assert gk.load(place).manifest["status"] == "open"
    assert whole_evidence(small).fingerprint == full.fingerprint


def test_expansion_is_kept_whatever_the_umask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second look takes the kept expansion also where a user's files are open to the group."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    before = os.umask(0o002)
    try:
        _, small = recorded("two_robot_line", tmp_path)
        first = whole_evidence(small)
        again = whole_evidence(small)
    finally:
        os.umask(before)
    assert (first.root, first.path) == (again.root, again.path)


def test_workers_record_the_same_small_run(tmp_path: Path) -> None:
    """The fingerprint doesn't depend on which process played an episode."""
    one = gk.rollout("tictactoe", episodes=3, out=tmp_path / "one", level="actions")
    two = gk.rollout("tictactoe", episodes=3, out=tmp_path / "two", level="actions", workers=2)
    assert one.fingerprint == two.fingerprint
    assert one.fingerprint.startswith("actions:")


def test_first_finished_episode_is_checked(tmp_path: Path) -> None:
    """The manifest says what came out, and evidence shows it with the line that expands."""
    run = tmp_path / "a small run"
    small = gk.rollout("two_robot_line", episodes=2, out=run, level="actions")
    assert small.manifest["checked"] == {"episode": 0, "outcome": "passed", "why": None}
    assert f"gamekeeper expand '{run}' OUT" in str(small)
    assert f"gamekeeper report '{run}' --expand" in str(small)


def test_check_says_at_once_what_does_not_come_out_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An environment that no seed determines needs another level."""
    edit = ("np.random.default_rng(seed)", "np.random.default_rng()")
    small = played(tmp_path, edit, level="actions")
    assert small.manifest["checked"]["outcome"] == "diverged"
    assert "level full is needed" in capsys.readouterr().err


def test_recorded_object_says_that_it_is_not_checked(tmp_path: Path) -> None:
    """An object can't be made a second time."""
    env = gk.record(gk.make("two_robot_line"), tmp_path / "run", level="actions")
    env.reset(seed=1)
    env.close()
    assert gk.load(tmp_path / "run").manifest["checked"]["outcome"] == "not checked"
    assert "not checked" in str(gk.load(tmp_path / "run"))
