import json
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.auditing.result import AuditResult
from tests.cli.lines import LINE, ROUGH, document, said


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is written stays out of the project."""
    monkeypatch.chdir(tmp_path)


def test_contract_beside_the_environment_is_found(capfd: pytest.CaptureFixture[str]) -> None:
    """The TOML beside the file is the contract; the card shows what it declares."""
    code, found = document(capfd, "contract", LINE)
    assert code == 0
    assert (found["name"], found["api"], found["declared"]) == (
        "two_robot_line_v0",
        "parallel",
        True,
    )
    assert [agent["name"] for agent in found["agents"]] == ["picker", "carrier"]
    assert found["contract"]["roles"]["picker"]["noop"] == 1


def test_draft_asks_for_what_cannot_be_seen(capfd: pytest.CaptureFixture[str]) -> None:
    """Without a contract what can be seen is drafted, and the rest is asked for by name."""
    code, found = document(capfd, "contract", ROUGH)
    assert (code, found["declared"], found["api"]) == (0, False, "parallel")
    assert "roles.arm.noop" in [question["key"] for question in found["questions"]]
    code, out, err = said(capfd, "contract", ROUGH)
    assert out.startswith("rough_v0 (Parallel)\n")
    assert "roles.arm.noop" in out
    assert "printed on import" in err
    assert "printed on import" not in out


@pytest.mark.parametrize(
    ("line", "start"),
    [(["--format", "toml"], 'name = "rough_v0"'), (["--format", "json"], '{"name": "rough_v0"')],
)
def test_format_is_chosen(line: list[str], start: str, capfd: pytest.CaptureFixture[str]) -> None:
    """The same card as TOML or JSON."""
    code, out, _ = said(capfd, "contract", ROUGH, *line)
    assert code == 0
    assert out.startswith(start)


def test_suffix_chooses_the_format(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """--out my.toml writes TOML that reads back, and is never written over."""
    code, out, err = said(capfd, "contract", ROUGH, "--out", "my.toml")
    assert (code, out) == (0, "")
    assert "written: my.toml" in err
    assert gk.Contract.load("my.toml").name == "rough_v0"
    before = (tmp_path / "my.toml").read_text()
    code, out, err = said(capfd, "contract", ROUGH, "--out", "my.toml", "--json")
    assert (code, json.loads(out)["error"]["where"]) == (2, "my.toml")
    assert (tmp_path / "my.toml").read_text() == before


def test_contract_that_does_not_fit_is_told(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A declared noop that is no action is an error with the line of the file."""
    (tmp_path / "wrong.toml").write_text('[roles.arm]\nagents = "arm"\nnoop = 9\n')
    code, _, err = said(capfd, "contract", ROUGH, "--contract", "wrong.toml")
    assert code == 2
    assert "wrong.toml, line 3" in err


def test_measured_draft_declares_nothing(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """--measure proposes answers as comments and says of itself that it does."""

    def audited(screen: Any, spec: str, **_: Any) -> AuditResult:
        measured = {"deterministic": True, "horizon": 4, "advice": "parallel", "why": "seen"}
        return AuditResult(spec, "parallel", 1.0, 3_000, 0, (), measured)

    monkeypatch.setattr("gamekeeper.cli.contract.audit_with_progress", audited)
    code, _, _ = said(capfd, "contract", ROUGH, "--measure", "--out", "my.toml")
    assert code == 0
    text = Path("my.toml").read_text()
    assert text.startswith("## A draft: values marked as measured come from 3,000 steps")
    assert "# horizon = 4                     # measured; else N" in text
    assert "# deterministic = true" in text
    drafted = gk.Contract.load("my.toml")
    assert (drafted.schedule.horizon, drafted.seeds.deterministic) == (None, None)
    code, out, _ = said(capfd, "contract", ROUGH, "--measure")
    assert "Measured (nothing is declared)" in out
    words = " ".join(out.split())
    proposed = words.partition("Measured, but not declared, so not checked (2)")[2]
    assert "schedule.horizon = 4 (else N)" in proposed.partition("Not declared")[0]
    found = document(capfd, "contract", ROUGH, "--measure")[1]
    assert found["measured"]["horizon"] == 4
    answers = {each["key"]: each["measured"] for each in found["questions"]}
    assert (answers["schedule.horizon"], answers["schedule.order"]) == ("4", None)


def test_draft_asks_little_and_says_why(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Usual values are declared, measured ones proposed; at most six questions of two roles."""

    def audited(screen: Any, spec: str, **_: Any) -> AuditResult:
        measured = {
            "stages": [["arm"]], "order": "none", "order_sensitive": "none", "horizon": 4,
            "deterministic": True, "may_join": ["arm"], "may_leave": [], "messages": {},
            "symmetric": {"arm": {"seems": True, "p": 0.5, "n": 9}}, "why": "seen",
        }  # fmt: skip
        return AuditResult(spec, "parallel", 1.0, 3_000, 0, (), measured)

    monkeypatch.setattr("gamekeeper.cli.contract.audit_with_progress", audited)
    found = document(capfd, "contract", ROUGH, "--draft")[1]
    asked = [each for each in found["questions"] if each["measured"] is None]
    assert len(asked) <= 6
    assert all(each["why"] for each in asked)
    keys = {each["key"] for each in asked}
    assert {"rewards.TERM", "endings.REASON", "failure.team"} <= keys
    assert not keys & {"why", "schedule.order", "schedule.horizon"}
    code, out, _ = said(capfd, "contract", ROUGH, "--draft")
    assert code == 0
    assert '# why = ""\n' in out  # the reason is the author's own
    assert "## Why it matters: " in out
    Path("draft.toml").write_text(out)
    drafted = gk.Contract.load("draft.toml")
    assert drafted.seeds.deterministic is True
    assert drafted.schedule.horizon is None  # measured, so not declared
    role = drafted.roles["arm"]
    assert (role.may_join, role.may_leave, role.messages) == (None, False, ())


def test_draft_of_a_base_class_knows_its_terms_and_endings(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Names that the rules say stand in the draft, to be filled in, and the kind of each ending."""
    (tmp_path / "dig.py").write_text(
        "import gamekeeper as gk\nfrom gymnasium.spaces import Discrete\n\n\n"
        "class Dig(gk.TickEnv):\n    metadata = {'name': 'dig_v0', 'render_modes': []}\n\n"
        "    def __init__(self):\n        super().__init__(horizon=9)\n"
        "        self.possible_agents = ['a_0', 'a_1']\n"
        "        self.observation_spaces = dict.fromkeys(self.possible_agents, Discrete(2))\n"
        "        self.action_spaces = dict(self.observation_spaces)\n\n"
        "    def tick(self, actions):\n"
        "        self.add_reward('a_0', 1.0, term='gold')\n        self.terminate('a_0', 'rich')\n"
    )

    def audited(screen: Any, spec: str, **_: Any) -> AuditResult:
        return AuditResult(spec, "parallel", 1.0, 3_000, 0, (), {})

    monkeypatch.setattr("gamekeeper.cli.contract.audit_with_progress", audited)
    out = said(capfd, "contract", "dig.py:Dig", "--draft")[1]
    assert "# [rewards.gold]" in out
    assert '# rich = { kind = "termination", owner = "agent" }' in out
    assert '# horizon = { kind = "truncation", owner = "all" }' in out
