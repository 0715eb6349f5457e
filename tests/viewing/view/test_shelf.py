"""What is served of runs: an index that tells what changed, episodes as the player reads them."""

import json
import shutil
import threading
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.diagnosis.labels import label, labels
from gamekeeper.errors import GamekeeperError, RunError
from gamekeeper.reporting.page.episode_list import packed_of
from gamekeeper.runs.files.notes import NOTES
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recording import rollout
from gamekeeper.viewing import viewer_runs as book
from gamekeeper.viewing.admission import json_answer
from gamekeeper.viewing.viewer import ServedRuns, Viewer
from tests.viewing.view.visiting import Visitor


@pytest.fixture
def copy(line: Path, tmp_path: Path, eager: None) -> Path:
    """A run of its own, looked at anew at every request."""
    return Path(shutil.copytree(line, tmp_path / "copy"))


def test_index_lists_every_episode_with_returns_by_agent(visitor: Visitor, line: Path) -> None:
    """As the evidence has them, agent by agent."""
    found = visitor.get("/index.json").document
    evidence = load(line)
    assert [run["key"] for run in found["runs"]] == ["a"]
    assert found["runs"][0]["status"] == "finalized"
    assert [each["episode"] for each in found["episodes"]] == [0, 1, 2, 3]
    for entry, episode in zip(found["episodes"], evidence.episodes, strict=True):
        assert (entry["seed"], entry["end"], entry["packed"]) == (episode.seed, "ended", True)
        for agent, total in entry["returns"].items():
            paid = sum(turn.rewards.get(agent, 0.0) for turn in episode.turns)
            assert total == pytest.approx(paid)


def test_index_since_a_version_is_what_changed(copy: Path) -> None:
    """Nothing; then the one episode that was labelled, and from before, or from elsewhere, all."""
    shelf = ServedRuns([copy])
    first = shelf.index("")
    assert shelf.index(first["version"])["episodes"] == []
    label(copy, "control", episode=2, by="me")
    second = shelf.index(first["version"])
    assert second["version"] != first["version"]
    assert [(each["episode"], each["labels"]) for each in second["episodes"]] == [(2, ["control"])]
    for other in ("", "x", "x-1", f"{first['version']}-1", "-", "a-²", first["version"][::-1]):
        assert len(shelf.index(other)["episodes"]) == 4


def test_episode_is_what_the_player_reads(visitor: Visitor, line: Path) -> None:
    """Every one of them, the same as a report's, also when it is asked for again."""
    evidence = load(line)
    for number in (0, 3, 0, 1):
        expected = json_answer(packed_of(evidence, number, run="a")).body
        assert visitor.get(f"/episode/a/{number}").body == expected


def test_label_shows_in_an_episode_that_was_seen_already(copy: Path) -> None:
    """What was kept of it doesn't count any more."""
    shelf = ServedRuns([copy])
    before = shelf.episode("a", 1)
    label(copy, "timing", episode=1, turn=2, why="late", by="me")
    after = shelf.episode("a", 1)
    assert before is not None
    assert after is not None
    assert "label" not in [mark["kind"] for mark in json.loads(before.body)["marks"]]
    assert "timing: late" in [mark["text"] for mark in json.loads(after.body)["marks"]]


def test_run_that_was_recorded_anew_is_read_anew(copy: Path) -> None:
    """Under the same path, with the same number of episodes."""
    shelf = ServedRuns([copy])
    first, before = shelf.index(""), shelf.episode("a", 0)
    shutil.rmtree(copy)
    rollout("two_robot_line", episodes=4, seed=9, out=copy)
    after = shelf.episode("a", 0)
    assert before is not None
    assert after is not None
    assert before.body != after.body
    assert len(shelf.index(first["version"])["episodes"]) == 4


def test_two_runs_have_a_letter_each(line: Path, tmp_path: Path) -> None:
    """Both in one index; a third letter is nobody's."""
    rollout("tictactoe", episodes=1, out=tmp_path / "board")
    with Viewer([line, tmp_path / "board"]) as view:
        visitor = Visitor(view)
        found = visitor.get("/index.json").document
        assert [(run["key"], run["name"]) for run in found["runs"]] == [
            ("a", "line"),
            ("b", "board"),
        ]
        assert [each["run"] for each in found["episodes"]] == ["a"] * 4 + ["b"]
        assert visitor.get("/episode/b/0").document["run"] == "b"
        assert visitor.get("/episode/c/0").status == 404


def test_more_runs_than_letters_are_refused(line: Path) -> None:
    """With how many may be."""
    with pytest.raises(GamekeeperError, match="at most 26"):
        ServedRuns([line] * 27)


def test_what_is_no_run_is_refused_at_the_start(tmp_path: Path) -> None:
    """As every command does."""
    with pytest.raises(RunError, match="there is no run here"):
        Viewer([tmp_path])


def test_run_that_goes_away_is_said_and_stays_to_be_seen(copy: Path) -> None:
    """What was read is shown, beside the reason why there is no more; then it is back."""
    shelf = ServedRuns([copy])
    first = shelf.index("")
    copy.rename(copy.parent / "away")
    gone = shelf.index(first["version"])
    assert gone["runs"][0]["error"]["what"] == "there is no run here"
    assert gone["runs"][0]["error"]["fix"]
    assert gone["version"] != first["version"]
    assert shelf.index("")["version"] == gone["version"]
    assert len(shelf.index("")["episodes"]) == 4
    (copy.parent / "away").rename(copy)
    assert shelf.index("")["runs"][0]["error"] is None
    assert shelf.index("")["episodes"] == first["episodes"]


def test_damaged_file_is_an_answer_with_its_place(copy: Path) -> None:
    """Where rows can't be read any more, the answer names the file; other episodes aren't hurt."""
    with Viewer([copy]) as view:
        steps = copy / "agent_steps.parquet"
        steps.write_bytes(steps.read_bytes()[:100] + bytes(steps.stat().st_size - 100))
        reply = Visitor(view).get("/episode/a/0")
        assert reply.status in (200, 503)  # what was read before may still be there
        found = Visitor(view).get("/index.json").document["runs"][0]
        assert "agent_steps.parquet" in found["error"]["where"]


def test_damaged_annotations_hide_no_episode(copy: Path) -> None:
    """The labels are missing, and why is said."""
    (copy / NOTES).write_text("no JSON\n", encoding="ascii")
    shelf = ServedRuns([copy])
    found = shelf.index("")
    assert len(found["episodes"]) == 4
    assert NOTES in found["runs"][0]["error"]["what"]
    page = shelf.page("/")
    assert page.status == 200
    assert b"be read again: line 1 of annotations.jsonl is no JSON" in page.body


@pytest.mark.parametrize(("path", "other"), [("/", "report"), ("/report", ".")])
def test_pages_ask_for_episodes_by_themselves(visitor: Visitor, path: str, other: str) -> None:
    """The player's script runs, and nothing else; no episode stands in the page, a link does."""
    reply = visitor.get(path)
    text = reply.body.decode()
    assert reply.status == 200
    assert 'data-view="1"' in text
    assert f'href="{other}"' in text
    assert '<script type="application/octet-stream' not in text
    policy = reply.headers["content-security-policy"]
    assert "connect-src 'self'" in policy
    assert "unsafe" not in policy
    assert policy.count("default-src 'none'") == 1


def test_one_request_reads_a_large_run(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While it is being read again, the others get what was read before; then there is the news."""
    shelf = ServedRuns([copy])
    is_let, is_begun = threading.Event(), threading.Event()

    def slowly(run: Path) -> Any:
        is_begun.set()
        is_let.wait()
        return labels(run)

    before = shelf.index("")
    monkeypatch.setattr(book, "labels", slowly)
    label(copy, "planning", episode=0, by="me")
    reader = threading.Thread(target=shelf.index, args=("",))
    reader.start()
    assert is_begun.wait(60)
    assert shelf.index("")["version"] == before["version"]
    assert shelf.episode("a", 0) is not None
    is_let.set()
    reader.join()
    assert shelf.index(before["version"])["episodes"][0]["labels"] == ["planning"]


def test_fault_while_reading_is_said(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One of ours too; what was read stays."""
    shelf = ServedRuns([copy])
    monkeypatch.setattr(book, "labels", lambda run: 1 / 0)
    label(copy, "planning", episode=0, by="me")
    found = shelf.index("")
    assert "ZeroDivisionError" in found["runs"][0]["error"]["what"]
    assert len(found["episodes"]) == 4
