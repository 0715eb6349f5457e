from dataclasses import replace
from typing import Any

import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.compare import Changed, changes, is_other_game
from gamekeeper.auditing.result import AuditResult
from gamekeeper.checks.verdict import Verdict
from tests.cli.lines import LINE, document, said

CLEAN = "tests.faults.rovers:Rovers"
PAID = "tests.faults.rewards:PaidAfterEnd"


@pytest.fixture(autouse=True)
def _small_audits_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few checks in this process: what is tested is the comparison."""

    def audited(screen: Any, spec: str, *, env_kwargs: Any, seed: int, **_: Any) -> AuditResult:
        return audit_here(spec, env_kwargs=env_kwargs, seed=seed, select=("GK402",), budget=1_000)

    monkeypatch.setattr("gamekeeper.cli.diff.audit_with_progress", audited)
    monkeypatch.setattr("gamekeeper.runs.comparison.cause_of", lambda *_, **__: None)


def plain(**fields: Any) -> AuditResult:
    """An audit made by hand."""
    usual: dict[str, Any] = {
        "environment": "a",
        "api": "parallel",
        "seconds": 1.0,
        "steps": 10,
        "seed": 0,
        "verdicts": (),
        "agents": {"a_0": {"observation_space": "Box", "action_space": "D(3)"}},
    }
    return AuditResult(**{**usual, **fields})


def test_diff_of_one_environment_with_itself_is_equal(capfd: pytest.CaptureFixture[str]) -> None:
    """The same game; exit code 0, nothing in the lists; --kwargs are those of both."""
    code, found = document(capfd, "diff", CLEAN, CLEAN, "--kwargs", '{"count": 2}')
    assert code == 0
    assert (found["equal"], found["same_game"]) == (True, True)
    assert (found["changes"], found["divergence"]) == ([], None)
    assert found["replayed"] == {"episodes": 5, "reason": None}


def test_diff_of_two_versions_says_what_changed(capfd: pytest.CaptureFixture[str]) -> None:
    """Promises, the first row that differs, and that raise the version in the name; exit code 1."""
    code, out, _ = said(capfd, "diff", CLEAN, PAID)
    assert code == 1
    assert out.startswith("another game, by ")
    assert "passed -> failed  GK402" in out
    assert "Same seed, same actions: the first row that differs" in out
    assert "raise the version in the name" in out


def test_diff_of_a_run_and_an_environment_is_refused(
    line_run: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    """What isn't a run can't be compared with one."""
    code, _, err = said(capfd, "diff", line_run, LINE)
    assert code == 2
    assert "RunError" in err


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        ({"api": "aec"}, Changed("api", "api", "parallel", "aec")),
        (
            {"agents": {"b_0": {"observation_space": "Box", "action_space": "D(3)"}}},
            Changed("roster", "agents", ["a_0"], ["b_0"]),
        ),
        (
            {"agents": {"a_0": {"observation_space": "Box", "action_space": "D(4)"}}},
            Changed("spaces", "a_0.action_space", "D(3)", "D(4)"),
        ),
        ({"measured": {"horizon": 20}}, Changed("measured", "horizon", None, 20)),
        (
            {"declared": {"schedule": {"horizon": 5}}},
            Changed("contract", "schedule.horizon", None, 5),
        ),
        (
            {"verdicts": (Verdict("GK1", "C.", "failed", "high"),)},
            Changed("verdicts", "GK1 C.", "passed", "failed"),
        ),
    ],
)
def test_each_kind_of_change_is_named(other: dict[str, Any], expected: Changed) -> None:
    """API, roster, spaces, contract, measured form and promises."""
    before = plain(verdicts=(Verdict("GK1", "C.", "passed", "high"),))
    after = replace(before, **other)
    assert changes(before, after) == (expected,)
    assert is_other_game((expected,)) is (expected.kind not in ("contract", "verdicts"))


def test_nothing_written_otherwise_is_no_change() -> None:
    """An empty list, an empty table and what is missing are alike; a table is told by its keys."""
    pairs = [({"endings": {}, "x": []}, {}), ({"reward": {"by_agent": {}}}, {"reward": None})]
    for one, two in pairs:
        assert changes(plain(measured=one), plain(measured=two)) == ()
    (change,) = changes(plain(measured={}), plain(measured={"reward": {"by_agent": {"a": 1.0}}}))
    assert (change.where, change.a, change.b) == ("reward.by_agent.a", None, 1.0)


def test_sampling_noise_is_no_change() -> None:
    """Influence counts as changed only where the intervals have nothing in common."""

    def influenced(p: float, low: float, high: float) -> AuditResult:
        one = {"from": "a", "to": "b", "on": "reward", "lag": 0, "n": 9}
        return plain(measured={"influence": [{**one, "p": p, "low": low, "high": high}]})

    assert changes(influenced(0.5, 0.2, 0.8), influenced(0.7, 0.4, 0.9)) == ()
    (change,) = changes(influenced(0.1, 0.0, 0.2), influenced(0.9, 0.7, 1.0))
    assert change.where == "influence of a on b's reward, lag 0"
    assert (change.a, change.b) == (0.1, 0.9)


def test_equal_numbers_are_equal_whatever_their_type() -> None:
    """Nothing changes from 20 to 20.0, nor from NaN to NaN."""
    nan = float("nan")
    one, two = plain(measured={"a": [20, nan]}), plain(measured={"a": [20.0, nan]})
    assert changes(one, two) == ()
