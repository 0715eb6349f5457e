"""Rerun's own reader finds in a recording what the episode holds, turn by turn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.errors import EvidenceError
from tests.adapters.data_games import DAY, NIGHT, SPARE, Shift
from tests.cli.lines import document, said

pytestmark = pytest.mark.trainer
TAG = "mpe2.simple_tag_v3:parallel_env"
LINES = ("run_turn", "episode", "turn")


def exported(run: Any, out: Path, **options: Any) -> Any:
    """What the recording of a run holds, by entity: rows as dictionaries; and the export."""
    from rerun.chunk import RrdReader

    from gamekeeper.adapters.exporters.rerun import export

    told: list[str] = []
    written = export(run, out, say=told.append, **options)
    assert [f"lost: {each}" for each in written.lost] == told
    reader = RrdReader(written.path)
    assert len(reader.recordings()) == len(reader.blueprints()) == 1
    found: dict[str, list[dict[str, Any]]] = {}
    for chunk in reader.stream():
        rows = found.setdefault(chunk.entity_path, [])
        rows += [
            {k.rpartition(":")[2]: v for k, v in row.items()}
            for row in chunk.to_record_batch().to_pylist()
        ]
        assert chunk.is_static or set(chunk.timeline_names) == set(LINES)
    for rows in found.values():
        rows.sort(key=lambda row: row.get("run_turn", 0))
    return found, written


def series(found: Any, path: str) -> dict[tuple[int, int], Any]:
    """A series by episode and turn: a number, or a list where each point has several."""
    points = found.get(path, [])
    return {
        (row["episode"], row["turn"]): row["scalars"][0]
        if len(row["scalars"]) == 1
        else row["scalars"]
        for row in points
    }


def logged(found: Any, path: str) -> dict[tuple[int, int], str]:
    """The texts of a log by episode and turn."""
    return {(row["episode"], row["turn"]): row["text"][0] for row in found.get(path, [])}


@pytest.mark.parametrize("spec", ["two_robot_line", "handover", TAG])
def test_recording_holds_the_trace_as_series(spec: Any, tmp_path: Path) -> None:
    """Rewards, returns, actions, orders and observations of each agent stand at their turns."""
    evidence = gk.rollout(spec, episodes=2, seed=3)
    found, written = exported(evidence, tmp_path / "run")
    assert written.rows == evidence.agent_steps.num_rows
    for agent in written.agents:
        expected: dict[str, dict[Any, Any]] = {
            name: {} for name in ("reward", "return", "action", "order", "obs")
        }
        for episode in evidence.episodes:
            so_far = 0.0
            for turn in episode.turns:
                key = episode.episode, turn.index
                if agent in turn.rewards:
                    so_far += turn.rewards[agent]
                    expected["reward"][key] = turn.rewards[agent]
                    expected["return"][key] = so_far
                if agent in turn.actions:
                    expected["action"][key] = float(turn.actions[agent])
                if agent in turn.order:
                    expected["order"][key] = float(turn.order.index(agent))
                if agent in turn.observations:
                    value = np.asarray(turn.observations[agent], float).ravel().tolist()
                    expected["obs"][key] = value if len(value) > 1 else value[0]
        for name, points in expected.items():
            assert series(found, f"/agents/{agent}/{name}") == points, name


def test_recording_is_played_by_turns_of_the_whole_run(tmp_path: Path) -> None:
    """`run_turn` goes on where the episode before it ended; no clock is in the recording."""
    found, _ = exported(gk.rollout("two_robot_line", episodes=3), tmp_path / "run")
    rows = found["/agents/picker/reward"]
    assert [row["run_turn"] for row in rows] == sorted({row["run_turn"] for row in rows})
    firsts = [row for row in rows if row["turn"] == 0]
    assert [row["episode"] for row in firsts] == [0, 1, 2]
    assert not {"log_time", "log_tick"} & set(rows[0])


def test_recording_shows_pictures_ends_infos_and_states(tmp_path: Path) -> None:
    """Observations that are pictures are images; ends, infos and texts are logs."""
    evidence = gk.rollout(Shift, episodes=1)
    found, _ = exported(evidence, tmp_path / "run")
    turns = list(evidence.episodes[0].turns)
    images = found[f"/agents/{NIGHT}/obs/picture"]
    assert len(images) == len(turns)
    for row, turn in zip(images, turns, strict=True):
        pixels = np.array(row["buffer"][0], np.uint8)
        np.testing.assert_array_equal(pixels, turn.observations[NIGHT]["picture"].ravel())
        assert (row["format"][0]["width"], row["format"][0]["height"]) == (32, 40)
    ends = [logged(found, f"/agents/{agent}/end") for agent in (DAY, NIGHT, SPARE)]
    last = [{(0, 6): f"{agent} truncated"} for agent in (NIGHT, SPARE)]
    assert ends == [{(0, 3): f"{DAY} terminated"}, *last]
    assert logged(found, f"/agents/{DAY}/info")[0, 2] == '{"action_mask":"|i1 3","tick":2}'
    assert logged(found, f"/agents/{NIGHT}/obs/word")[0, 4] == "tick4"
    assert series(found, f"/agents/{DAY}/mask")[0, 1] == [1, 1, 1]
    assert series(found, "/state")[0, 5] == [5.0, 10.0]
    assert logged(found, "/episodes")[0, 6] == "episode 0: ended after 6 turns"
    assert evidence.fingerprint in str(found["/run"][0]["text"])


def test_recording_shows_terms_reasons_frames_and_tensors(tmp_path: Path) -> None:
    """What a task of ours tells more of; a long vector is a tensor."""
    pytest.importorskip("PIL", reason="frames are kept with Pillow")
    evidence = gk.rollout("warehouse", episodes=1, frames=True, out=tmp_path / "run")
    found, written = exported(tmp_path / "run", tmp_path / "run")
    turns = list(evidence.episodes[0].turns)
    paid = {(0, t.index): t.terms["picker_0"]["energy"] for t in turns if "picker_0" in t.terms}
    assert series(found, "/agents/picker_0/terms/energy") == paid
    assert "battery" in " ".join(logged(found, "/agents/picker_0/end").values())
    kept = sorted((tmp_path / "run" / "frames").iterdir())
    frames = found["/frames"]
    assert len(frames) == len(kept)
    field = "blob" if "blob" in frames[0] else "text"
    first = frames[0][field][0]
    assert (bytes(first) if field == "blob" else first.encode()) == kept[0].read_bytes()
    assert len(found["/agents/picker_0/obs"]) == sum("picker_0" in t.observations for t in turns)
    assert written.lost == ()


def test_nonconforming_values_and_failures_are_logged(tmp_path: Path) -> None:
    """What isn't of its space has no point; it stands in a log as it was."""
    found, _ = exported(
        gk.rollout(lambda: Shift(nonconforming="observation"), episodes=1), tmp_path / "run"
    )
    assert "<f8" in logged(found, f"/agents/{DAY}/nonconforming")[0, 1]
    assert (0, 1) not in series(found, f"/agents/{DAY}/obs")


def test_recording_says_what_it_lacks_and_replaces_an_earlier_one(tmp_path: Path) -> None:
    """Digests hold no observations; an earlier file is replaced; no agent is left out silently."""
    gk.rollout("two_robot_line", episodes=1, level="digest", out=tmp_path / "run")
    found, written = exported(tmp_path / "run", tmp_path / "run", agents=["carrier"])
    assert "digest" in written.lost[0]
    assert not [path for path in found if "picker" in path or path.endswith("/obs")]
    (tmp_path / "run.rrd").write_text("earlier")
    exported(tmp_path / "run", tmp_path / "run")
    assert (tmp_path / "run.rrd").read_bytes()[:4] == b"RRF2"
    with pytest.raises(EvidenceError, match="no agent called"):
        exported(tmp_path / "run", tmp_path / "other", agents=["wolf"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run", "run.rrd"]


def test_rerun_is_as_strict_as_before(tmp_path: Path) -> None:
    """Its strict mode is one for the process: an export gives it back as it was."""
    import rerun

    exported(gk.rollout("two_robot_line", episodes=1), tmp_path / "run")
    assert rerun.strict_mode() is False


def test_command_writes_a_recording(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """`export RUN --to rerun`, over an earlier file too."""
    gk.rollout("two_robot_line", episodes=1, out=tmp_path / "demo")
    line = ["export", tmp_path / "demo", "--to", "rerun", "--out", tmp_path / "demo.rrd"]
    code, found = document(capfd, *line)
    assert (code, found["to"], found["agents"]) == (0, "rerun", ["picker", "carrier"])
    assert (tmp_path / "demo.rrd").stat().st_size > 0
    assert said(capfd, *line)[0] == 0
