"""`gamekeeper report`: a page from runs and documents, or a reason why not."""

import os
import threading
from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.runs.files.notes import read_notes
from tests.cli.lines import document, said

Capture = pytest.CaptureFixture[str]


def test_report_writes_a_page(line_run: Path, tmp_path: Path, capsys: Capture) -> None:
    """The page is where --out says, and the document names it with its size."""
    out = tmp_path / "deep" / "page.html"
    code, told = document(capsys, "report", line_run, "--out", out, "--episode", 1)
    assert code == 0
    assert told == {"run": str(line_run), "report": str(out), "size_bytes": out.stat().st_size}
    assert "gk-episode-a-1" in out.read_text(encoding="utf-8")


def test_report_takes_runs_and_a_title(
    line_run: Path, rough_run: Path, tmp_path: Path, capsys: Capture
) -> None:
    """Several runs stand beside one another under the title that was given."""
    out = tmp_path / "page.html"
    line = ("report", line_run, rough_run, "-o", out, "--title", "Two & more", "--budget", "0.1")
    code, words, _ = said(capsys, *line)
    assert (code, str(out) in words) == (0, True)
    page = out.read_text(encoding="utf-8")
    assert "<title>Two &amp; more</title>" in page
    assert "rough compared with line" in page


def test_report_expands_a_small_run(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With --expand a run of level actions is shown in full; without, no environment is run."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    run, page = tmp_path / "small", tmp_path / "page.html"
    gk.rollout("two_robot_line", episodes=1, level="actions", out=run)
    assert said(capsys, "report", run, "--out", page)[0] == 0
    assert "played again in full" not in page.read_text(encoding="utf-8")
    assert not (tmp_path / "cache").exists()
    assert said(capsys, "report", run, "--out", page, "--expand")[0] == 0
    assert "played again in full" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (["--episode", "99"], "no episode 99"),
        (["--audit", "{run}/manifest.json"], "isn't of the kind 'audit'"),
        (["--evaluation", "{run}"], "evaluation.json is missing"),
        (["--out", "{run}"], "this is a folder"),
        (["--out", "{run}/manifest.json/page.html"], "making the folder failed"),
    ],
)
def test_report_says_what_is_wrong(
    line: list[str],
    why: str,
    line_run: Path,
    tmp_path: Path,
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A wrong option is refused with exit code 2, and no page is written."""
    monkeypatch.chdir(tmp_path)
    code, _, errors = said(capsys, "report", line_run, *(w.format(run=line_run) for w in line))
    assert (code, list(tmp_path.iterdir())) == (2, [])
    assert why in errors


def test_report_takes_the_place_of_a_page_only(
    line_run: Path, tmp_path: Path, capsys: Capture
) -> None:
    """An earlier page, also behind a link; evidence, or any other file, stays as it was."""
    out, link = tmp_path / "page.html", tmp_path / "link.html"
    link.symlink_to(out)
    for _ in range(2):
        assert said(capsys, "report", line_run, "--out", link)[0] == 0
    assert link.is_symlink()
    manifest = line_run / "manifest.json"
    before = manifest.read_bytes()
    code, _, errors = said(capsys, "report", line_run, "--out", manifest)
    assert (code, "a file that isn't an HTML page" in errors) == (2, True)
    assert manifest.read_bytes() == before


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_report_goes_through_a_pipe(line_run: Path, tmp_path: Path, capsys: Capture) -> None:
    """What is no file, as /dev/null, is written to and stays what it is."""
    pipe, read = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    code, _, _ = said(capsys, "report", line_run, "--out", pipe)
    reader.join()
    assert (code, pipe.is_fifo()) == (0, True)
    assert read[0].lower().startswith(b"<!doctype html>")


@pytest.mark.parametrize("display", ["", ":0"])
def test_report_opens_its_page_where_there_is_a_display(
    line_run: Path, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, display: str
) -> None:
    """Elsewhere it names the address."""
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url: not opened.append(url))
    for name in ("WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("DISPLAY", display)
    page = tmp_path / "page.html"
    code, _, error = said(capsys, "report", line_run, "--out", page, "--open")
    assert opened == ([page.as_uri()] if display else [])
    assert code == 0
    assert (page.as_uri() in error) == (not display)


def test_report_of_no_run_is_refused(tmp_path: Path, capsys: Capture) -> None:
    """A folder that is no run is named."""
    code, told = document(capsys, "report", tmp_path)
    assert (code, told["error"]["kind"]) == (2, "RunError")


def test_report_finds_the_attribution(tmp_path: Path, capsys: Capture) -> None:
    """What `attribute` printed is kept in the run, and stands on the page."""
    run, out = tmp_path / "run", tmp_path / "page.html"
    line = ("rollout", "two_robot_line", "--policy", "reference", "--episodes", 3, "--out", run)
    said(capsys, *line)
    _, told = document(capsys, "attribute", run, "--episodes", 0, "--action-episodes", 1)
    assert [note["document"] for note in read_notes(run)] == [told]
    said(capsys, "report", run, "--out", out)
    page = out.read_text(encoding="utf-8")
    assert "Contributions of agents" in page
    assert "too few new episodes for an interval" in page
