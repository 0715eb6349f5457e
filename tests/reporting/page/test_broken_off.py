"""What was broken off is never shown as if it were whole: killed recorders, steps that raised."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.errors import EnvError
from gamekeeper.reporting.page.episode_figures import failed_text, failing, figures_of
from gamekeeper.reporting.page.episode_list import packed_of
from gamekeeper.runs.run_check import recover
from gamekeeper.viewing.report_file import report
from gamekeeper.viewing.viewer_pages import front_page
from gamekeeper.viewing.viewer_runs import ServedRun
from tests.reporting.page.games import recorded
from tests.runs.test_recover import torn

STOPPED = "Episode 1 is unfinished: its recording stopped after 3 steps."


def test_page_of_a_killed_run_says_so_before_and_after_it_is_recovered(tmp_path: Path) -> None:
    """The report, the served page, the summary and a notebook say it; the torn episode is first."""
    run = tmp_path / "run"
    torn(run)
    for told in ("or its recorder was killed", "its recorder was killed; what came after"):
        page = report(run, tmp_path / "page.html").read_text(encoding="utf-8")
        served = front_page([ServedRun("a", run).edition()]).body.decode()
        for text in (page, served):
            assert told in text.split("<nav")[0]
            assert STOPPED in text.split("<nav")[0]
        data = json.loads(page.split('id="gk-data">')[1].split("</script>")[0])
        assert (data["episodes"][0]["episode"], data["episodes"][0]["turns"]) == (1, 3)
        evidence = gk.load(run)
        assert told in str(evidence)
        assert told in evidence._repr_html_()
        ended = evidence.episode_table["turns"][0].as_py()
        assert evidence.summary.turns == ended + 3
        recover(run)


def test_page_of_a_whole_run_has_no_alert(tmp_path: Path) -> None:
    """Nothing is said where nothing is wrong."""
    recorded(tmp_path / "run", episodes=1)
    page = report(tmp_path / "run", tmp_path / "page.html").read_text(encoding="utf-8")
    assert 'class="alert"' not in page.split("<nav")[0]


def test_torn_episode_is_marked_at_its_last_turn(tmp_path: Path) -> None:
    """Where a recovered run was killed is a mark to jump to, and nobody says that it failed."""
    torn(tmp_path / "run")
    evidence = recover(tmp_path / "run")
    marks = packed_of(evidence, 1)["marks"]
    last = packed_of(evidence, 1)["rows"]["turn"][-1]
    assert [(mark["turn"], mark["kind"]) for mark in marks] == [(last, "error")]
    assert failing(evidence, figures_of(evidence))[0][1] is None


@pytest.mark.parametrize("at", [1, 4, 6])
def test_error_is_marked_at_the_turn_whose_step_raised(tmp_path: Path, at: int) -> None:
    """The k-th step is turn k - 1, also where it is the last; the error names the same one."""
    with pytest.raises(EnvError, match=f"episode 0, turn {at - 1}"):
        recorded(tmp_path / "run", episodes=1, raises_at=at)
    marks = packed_of(gk.load(tmp_path / "run"), 0)["marks"]
    assert [mark["turn"] for mark in marks if mark["kind"] == "error"] == [at - 1]


def test_failed_episodes_are_counted_among_all() -> None:
    """One of two that raised is 1 of 2, though nothing declares when the other one failed."""
    evidence = recorded(episodes=2, failure=None)
    figures = figures_of(evidence)
    headers = (figures.headers[0], {**figures.headers[1], "error": "ValueError: no"})
    failed, _ = failing(evidence, replace(figures, headers=headers))
    assert failed_text(failed) == "1 of 2 episodes failed; of 1 it isn't known"
    assert failed_text([False, True, True]) == "2 of 3 episodes failed"
    assert failed_text([None]) == "not known of any episode"
