import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.checks.verdict import Finding, Verdict
from gamekeeper.testing import NOTES, contract_test, settle

pytest_plugins = ["pytester"]

PAID = "tests.faults.rewards import PaidAfterEnd"
SMALL = "quick=True, select=('GK402', 'GK501')"


def verdict(outcome: Any, **fields: Any) -> Verdict:
    """A verdict of one check."""
    return Verdict("GK402", "The dead are paid nothing.", outcome, "high", **fields)


@pytest.fixture
def apart(pytester: pytest.Pytester) -> pytest.Pytester:
    """A folder in which pytest runs with the plug-in alone."""
    pytester.makeini("[pytest]\naddopts = -p no:hypothesispytest -p no:cacheprovider\n")
    return pytester


def run(apart: pytest.Pytester, *arguments: str) -> pytest.RunResult:
    """Pytest in this process, with the plug-in."""
    return apart.runpytest_inprocess("-p", "gamekeeper.testing", *arguments)


def test_contract_test_has_a_test_for_each_check(apart: pytest.Pytester) -> None:
    """Broken fails with the program, kept passes; each test is called after its check."""
    apart.makepyfile(
        f"""
        from gamekeeper.testing import contract_test
        from {PAID} as make
        TestContract = contract_test(make, {SMALL})
        """
    )
    result = run(apart, "-v")
    result.assert_outcomes(failed=1, passed=1)
    result.stdout.fnmatch_lines(
        ["*test_promise?GK402-rewards_stop_at_the_end? FAILED*", "*actual: 0.5*", "SEED = *"]
    )


def test_environments_are_audited_once_in_a_session(apart: pytest.Pytester) -> None:
    """Two classes of one environment share one audit."""
    apart.makepyfile(
        f"""
        from gamekeeper.testing import contract_test
        from {PAID} as original
        built = []
        def make():
            built.append(1)
            return original()
        counts = []
        TestOne = contract_test(make, {SMALL})
        def test_between():
            counts.append(len(built))
        TestTwo = contract_test(make, {SMALL})
        def test_after():
            assert counts == [len(built)]
        """
    )
    run(apart).assert_outcomes(failed=2, passed=4)


def test_waivers_are_expected_failures(apart: pytest.Pytester) -> None:
    """Waived is an xfail with the reason; a waiver that nothing needs is told at the end."""
    Path(apart.path, "rovers.toml").write_text(
        '[waivers]\nGK402 = "late on purpose"\nGK501 = "old"\n'
    )
    apart.makepyfile(
        f"""
        from gamekeeper.testing import contract_test
        from {PAID} as make
        TestContract = contract_test(make, contract="rovers.toml", {SMALL})
        """
    )
    result = run(apart, "-rx")
    result.assert_outcomes(xfailed=1, passed=1)
    result.stdout.fnmatch_lines(
        ["*gamekeeper: waivers*", "GK501: its waiver isn't needed any more (old)"]
    )
    result.stdout.fnmatch_lines(["*late on purpose*"])


def test_command_line_names_environments(apart: pytest.Pytester) -> None:
    """--gamekeeper collects a test for each check, and nothing else of the folder."""
    apart.makepyfile("def test_of_the_folder(): pass")
    apart.makepyfile(rovers=f"from {PAID} as make")
    line = ["--gamekeeper", "rovers.py:make", "--gamekeeper-quick"]
    result = run(apart, *line, "--gamekeeper-select", "GK402", "-v")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ["*collected 1 item", "rovers.py:make::GK402-rewards_stop_at_the_end FAILED*"]
    )


def test_paths_on_the_command_line_are_collected_too(apart: pytest.Pytester) -> None:
    """With paths the tests of the environments stand beside them; -k chooses among all."""
    path = apart.makepyfile("def test_of_the_folder(): pass")
    line = ["--gamekeeper", "nothing_here:make", "--gamekeeper-select", "GK402"]
    run(apart, str(path), *line, "-k", "folder").assert_outcomes(passed=1, deselected=1)


def test_environment_that_cannot_be_opened_fails_once(apart: pytest.Pytester) -> None:
    """The first test says what is wrong, the others are skipped."""
    line = ["--gamekeeper", "nothing_here:make", "--gamekeeper-select", "GK4"]
    result = run(apart, *line)
    outcomes = result.parseoutcomes()
    assert outcomes["failed"] == 1
    assert outcomes["skipped"] > 3
    result.stdout.fnmatch_lines(["*SpecError: there is no module nothing_here*"])


def test_unknown_checks_are_an_error_of_collection(apart: pytest.Pytester) -> None:
    """A slip in --gamekeeper-select doesn't run nothing silently."""
    line = ["--gamekeeper", "nothing_here:make", "--gamekeeper-select", "XX"]
    result = run(apart, *line)
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*no check is called 'XX'*"])


def test_contract_test_refuses_unknown_checks() -> None:
    """A slip in `select` is found when the file is read."""
    with pytest.raises(ValueError, match="no check is called"):
        contract_test("warehouse", select=("XX",))


@pytest.mark.parametrize(
    ("outcome", "exception", "words"),
    [
        ("failed", pytest.fail.Exception, "GK402 (high): The dead are paid nothing."),
        ("error", pytest.fail.Exception, "a fault of the check"),
        ("not_exercised", pytest.skip.Exception, "not exercised: no episode ended"),
        ("not_applicable", pytest.skip.Exception, "not applicable: no episode ended"),
        ("waived", pytest.xfail.Exception, "no episode ended"),
    ],
)
def test_each_outcome_has_its_manner(
    outcome: str, exception: type[BaseException], words: str, pytestconfig: pytest.Config
) -> None:
    """Broken and faulty fail, what wasn't seen is skipped, waived is expected."""
    with pytest.raises(exception) as caught:
        settle(verdict(outcome, reason="no episode ended"), pytestconfig)
    assert words in str(caught.value)


def test_failure_tells_every_finding(pytestconfig: pytest.Config) -> None:
    """Each place is told, and the program of the first one."""
    found = tuple(Finding(f"turn {k}", "0", "1", "pay 0", f"PLAY = {k}") for k in range(2))
    with pytest.raises(pytest.fail.Exception) as caught:
        settle(verdict("failed", findings=found), pytestconfig)
    text = str(caught.value)
    assert "where: turn 1" in text
    assert "PLAY = 0" in text
    assert "PLAY = 1" not in text


def test_kept_promise_is_silent(pytestconfig: pytest.Config) -> None:
    """Nothing is noted of what is simply kept."""
    before = list(pytestconfig.stash.get(NOTES, []))
    settle(verdict("passed"), pytestconfig)
    assert pytestconfig.stash.get(NOTES, []) == before


def test_plugin_is_light() -> None:
    """Where gamekeeper is installed every session of pytest loads the plug-in."""
    code = textwrap.dedent(
        """
        import sys, gamekeeper.testing
        print([name for name in ("numpy", "gymnasium", "pettingzoo") if name in sys.modules])
        """
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr
