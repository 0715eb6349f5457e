"""`gamekeeper evaluate`, and suites in the list."""

import json
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.cli.lines import SURROUNDINGS, document, said

SPEC = """
name = "lines"
[environments.line]
spec = "two_robot_line"
kwargs = { n = 5, horizon = 30 }
[seeds]
episodes = 50
[policies.reference]
policy = "reference"
[policies.mine]
policy = "mine.py:act"
"""
POLICY = "def act(observation, agent, info, rng):\n    return int(rng.integers(3))\n"


@pytest.fixture(name="path")
def _path(tmp_path: Path) -> Path:
    """A specification, and a policy beside it."""
    (tmp_path / "mine.py").write_text(POLICY)
    path = tmp_path / "lines.toml"
    path.write_text(SPEC)
    return path


def test_evaluate_says_what_was_found_and_how_far_it_goes(
    path: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Tables in 80 columns, claims in words; the second call plays nothing."""
    out = tmp_path / "e"
    code, text, notes = said(capfd, "evaluate", path, "--out", out, "--workers", "1")
    assert code == 0
    assert "100 episodes played" in notes
    assert max(map(len, text.replace(str(out), "e").splitlines())) <= 80
    for part in (
        "Returns in line",
        "Endings in line",
        "Compared on the same seeds",
        "Columns\n",
        "interquartile mean: the mean of the middle half",
        "Notes\n",
        "Supported claims",
    ):
        assert part in text
    assert "about one checkpoint each" in " ".join(text.split())
    claims = text.partition("Supported claims\n")[2].partition("\n\n")[0]
    starts = [line for line in claims.splitlines() if line[2] != " "]
    assert all(line.startswith("  line: ") for line in starts), starts
    assert (out / "episodes.parquet").is_file()
    code, found = document(capfd, "evaluate", path, "--out", out, "--workers", "1")
    assert found == json.loads((out / "evaluation.json").read_text())
    assert {
        "kind",
        "name",
        "suite",
        "seed",
        "environments",
        "policies",
        "results",
        "comparisons",
        "crossplay",
        "stopping",
        "refused",
        "claims",
        "notes",
        "episodes",
        "commands",
        "fingerprint",
    } <= found.keys()
    assert found["commands"] == [f"gamekeeper evaluate {path}"]
    assert said(capfd, "show", out)[:2] == (0, text[: text.index("\nRaw episodes")])


def test_evaluate_takes_an_environment_and_policies(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Without a file; each --policy is one that is compared, under its own or a given name."""
    code, found = document(
        capfd,
        "evaluate",
        "two_robot_line",
        "--policy",
        "random",
        "--policy",
        "still:=noop",
        "--episodes",
        "3",
        "--out",
        tmp_path / "e",
        "--workers",
        "1",
        "--kwargs",
        '{"horizon": 9}',
        "--marl-eval",
        tmp_path / "m.json",
    )
    assert code == 0
    assert list(found["policies"]) == ["random", "still"]
    assert {"two_robot_line"} == json.loads((tmp_path / "m.json").read_text()).keys()


def test_evaluate_lines_of_one_name_play_together(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """`ROLE=POLICY` means what it means to `run`: who plays whom, never what a policy is called."""
    code, found = document(
        capfd,
        "evaluate",
        "two_robot_line",
        "--policy",
        "mixed:=picker=noop",
        "--policy",
        "mixed:=carrier=random",
        "--episodes",
        "2",
        "--out",
        tmp_path / "e",
        "--workers",
        "1",
    )
    assert code == 0
    assert found["policies"]["mixed"]["choices"] == [{"picker": "noop", "carrier": "random"}]


def test_evaluate_pins_what_is_installed(
    path: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """--pin writes digests; another policy is refused then, unless one goes on all the same."""
    code, told = document(capfd, "evaluate", path, "--pin")
    assert code == 0
    assert told["environments"]["line"] in path.read_text()
    (tmp_path / "mine.py").write_text(POLICY.replace("3", "2"))
    line = ("evaluate", path, "--episodes", "2", "--out", tmp_path / "e", "--workers", "1")
    code, told = document(capfd, *line)
    assert code == 2
    assert "policy mine" in told["error"]["actual"]
    code, found = document(capfd, *line, "--unpinned")
    assert code == 0
    assert "Not the suite as it was pinned" in found["notes"][0]


def test_evaluate_exits_with_1_where_episodes_break_off_and_2_where_it_is_told_to(
    path: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A policy that raises; an interval that was refused, with --strict."""
    line = ("evaluate", path, "--episodes", "2", "--workers", "1")
    assert said(capfd, *line, "--out", tmp_path / "a")[0] == 0
    assert said(capfd, *line, "--out", tmp_path / "a", "--strict")[0] == 2
    (tmp_path / "mine.py").write_text("def act(observation, agent, info, rng):\n    1 / 0\n")
    code, text, _ = said(capfd, *line, "--out", tmp_path / "b")
    assert code == 1
    assert "Failed: mine in line, 2 episodes, the first: episode 0, turn 0:" in text
    assert "division by zero" in text
    assert any("success" in line and "failed" in line for line in text.splitlines())


@pytest.mark.parametrize("number", [0, 1])
def test_evaluate_of_an_unknown_agent_names_those_there_are_and_lines_that_work(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Each line of the fix, pasted, evaluates."""
    monkeypatch.chdir(tmp_path)
    code, found = document(
        capfd, "evaluate", "two_robot_line", "--policy", "a=random", "--kwargs", '{"n": 3}'
    )
    error = found["error"]
    assert code == 2
    assert "'a', which is no agent and no role of two_robot_line" in error["what"]
    assert error["expected"] == "an agent or a role: picker, carrier"
    lines = [shlex.split(part[part.index("gamekeeper") :]) for part in error["fix"].split("; ")]
    words = lines[number]
    assert words[:2] == ["gamekeeper", "evaluate"]
    code, found = document(capfd, *words[1:], "--episodes", "1", "--workers", "1")
    assert code == 0
    assert list(found["policies"]) == [("a", "random")[number]]
    assert found["environments"]["two_robot_line"]["kwargs"] == {"n": 3}


@pytest.mark.parametrize(
    ("words", "seen"),
    [
        (("nothing.toml",), "can't be opened"),
        (("two_robot_line",), "no policy is named to be evaluated"),
        (("two_robot_line", "--policy", "random", "--policy", "random"), "one name"),
        (("two_robot_line", "--policy", "a:=random", "--policy", "a:=noop"), "two policies for"),
        (("two_robot_line", "--policy", "picker=x:chase"), "--policy chase:=picker=x:chase"),
        (("two_robot_line", "--policy", "picker=x:chase"), "--policy picker:=x:chase"),
        (("gk-tasks-2", "--pin"), "only a file can be pinned"),
    ],
)
def test_evaluate_used_wrongly_exits_with_2(
    words: tuple[str, ...], seen: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """And says what was meant."""
    code, _, text = said(capfd, "evaluate", *words)
    assert code == 2
    assert seen in text


def test_evaluate_that_is_interrupted_goes_on_from_there(
    path: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C: 130, and what was played is kept; the result is that of a run in one go."""
    slow = "import time\ndef act(observation, agent, info, rng):\n    time.sleep(0.001)\n"
    (tmp_path / "mine.py").write_text(slow + "    return int(rng.integers(3))\n")
    out = tmp_path / "e"
    line = ["evaluate", str(path), "--episodes", "200", "--workers", "1", "--quiet"]
    begun = subprocess.Popen(
        [sys.executable, "-m", "gamekeeper", *line, "--out", str(out)],
        env=SURROUNDINGS,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
    )
    deadline_s = time.monotonic() + 60
    while not list(out.glob("parts/*.json")) and time.monotonic() < deadline_s:
        time.sleep(0.05)  # until something is there to be kept
    begun.send_signal(signal.SIGINT)
    _, error = begun.communicate(timeout=60)
    assert begun.returncode == 130, error.decode()
    assert "the same command continues" in error.decode()
    kept = len(list(out.glob("parts/*.json")))
    assert 0 < kept < 20
    code, _, notes = said(capfd, *line[:-1], "--out", out)
    assert code == 0
    assert f"{20 * (20 - kept)} episodes played, {20 * kept} were there already" in notes


def test_list_names_suites(capfd: pytest.CaptureFixture[str]) -> None:
    """With their environments and policies."""
    code, found = document(capfd, "list", "suites")
    assert code == 0
    rows = {row["name"]: row for row in found["suites"]}
    assert "warehouse" in rows["gk-tasks-1"]["about"]
    assert rows["gk-tasks-1"]["version"] == "1"
