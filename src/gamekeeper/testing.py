"""Contract tests under pytest: a test for each check of the audit, of any environment.

In a test file, `TestContract = contract_test(make_env)`; on the command line,
`pytest --gamekeeper my_env.py:make`. An environment is audited once in a session, when its first
test runs. A failed check fails with its finding and a program that shows it; one that was not
exercised or isn't applicable is skipped with the reason; a waived one is an expected failure with
the contract's reason.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any, Final

import pytest

from gamekeeper.errors import GamekeeperError

if TYPE_CHECKING:
    from gamekeeper.checks.verdict import Verdict
    from gamekeeper.contract import Contract

__all__ = ["contract_test"]

OPTION: Final = "--gamekeeper"
NOTES: Final = pytest.StashKey[list[str]]()
AUDITS: Final = pytest.StashKey[dict[str, Any]]()


@dataclass(frozen=True, slots=True)
class _Asked:
    """An audit that tests need, made once in a session.

    Attributes:
        spec: the environment.
        options: of `gk.audit`.
    """

    spec: object
    options: Mapping[str, Any]

    @property
    def key(self) -> str:
        """Equal for equal audits; a callable is identified by its id."""
        name = self.spec if isinstance(self.spec, str) else f"{id(self.spec)}"
        return json.dumps([name, self.options], default=repr, sort_keys=True)

    def ids(self) -> list[str]:
        """The selected checks, each with its name: `GK402-rewards_stop_at_the_end`.

        Raises:
            EvidenceError: a selected or ignored beginning of ids has no check.
        """
        from gamekeeper.checks.check import selected

        chosen = selected(tuple(self.options["select"]), tuple(self.options["ignore"]))
        return [f"{each.id}-{each.name}" for each in chosen.values()]

    def verdict(self, test: str, config: pytest.Config) -> Verdict:
        """The verdict of the check in a test's name."""
        found = config.stash.setdefault(AUDITS, {})
        if self.key not in found:
            from gamekeeper.auditing.audit_process import audit

            try:
                found[self.key] = audit(self.spec, **self.options)
            except GamekeeperError as error:
                found[self.key] = error
                raise
        if isinstance(found[self.key], GamekeeperError):  # shown in full by the first test
            pytest.skip(f"not audited: {found[self.key].what}")
        verdict: Verdict = found[self.key].of(test.partition("-")[0])
        return verdict


def contract_test(
    make_env: object,
    *,
    contract: Contract | str | PathLike[str] | None = None,
    budget: int | None = None,
    quick: bool = False,
    seed: int = 0,
    select: Sequence[str] = (),
    ignore: Sequence[str] = (),
    env_kwargs: Mapping[str, Any] | None = None,
) -> type:
    """A test class with a test for each check, for a test file: `TestContract = ...`.

    Args:
        make_env: a factory, or its name (`my_env.py:make`); with a name, the environment runs in a
            process of its own, so that a crash or a hang fails a test and not the session.
        contract: contract or file; None: the file beside the environment's, if there is one.
        budget: environment steps; None: 20,000.
        quick: limits the budget to 3,000 environment steps.
        seed: of the episodes.
        select: only checks whose ids begin so.
        ignore: all checks but those whose ids begin so.
        env_kwargs: keyword arguments of the factory.
    Raises:
        EvidenceError: `select` or `ignore` has an id that isn't the beginning of a check's.
    """
    options: dict[str, Any] = {
        "contract": contract,
        "quick": quick,
        "seed": seed,
        "select": list(select),
        "ignore": list(ignore),
        "env_kwargs": dict(env_kwargs or {}),
    }
    asked = _Asked(make_env, options if budget is None else {**options, "budget": budget})

    class TestContract:
        """The promises of an environment, a test for each."""

        @pytest.mark.parametrize("check", asked.ids())
        def test_promise(self, check: str, request: pytest.FixtureRequest) -> None:
            """The environment passes this check."""
            settle(asked.verdict(check, request.config), request.config)

    return TestContract


def settle(verdict: Verdict, config: pytest.Config) -> None:
    """Passes, fails, skips or expects the failure, by the verdict."""
    __tracebackhide__ = True
    if verdict.outcome == "failed":
        pytest.fail(_failure_text(verdict), pytrace=False)
    elif verdict.outcome == "error":
        pytest.fail(f"a fault of the check, not of the environment\n{verdict.reason}", False)
    elif verdict.outcome == "waived":
        pytest.xfail(verdict.reason)
    elif verdict.outcome in ("suspected", "not_exercised", "not_applicable"):
        pytest.skip(f"{verdict.outcome.replace('_', ' ')}: {verdict.reason}")
    elif verdict.reason:
        config.stash.setdefault(NOTES, []).append(f"{verdict.id}: {verdict.reason}")


def _failure_text(verdict: Verdict) -> str:
    """The claim, then all findings, and the program of the first one."""
    lines = [f"{verdict.id} ({verdict.severity}): {verdict.claim}"]
    for each in verdict.findings:
        lines += ["", f"  where: {each.where}", f"  expected: {each.expected}"]
        lines += [f"  actual: {each.actual}", f"  fix: {each.fix}"]
    for each in verdict.findings[:1]:
        lines += ["", each.reproducer.rstrip()]
    return "\n".join(lines)


class _Environment(pytest.Collector):
    """An environment that the command line names, with a test for each check."""

    asked: _Asked

    @classmethod
    def named(cls, session: pytest.Session, spec: str) -> _Environment:
        """Makes the collector of an environment that `--gamekeeper` names."""
        collector: _Environment = cls.from_parent(session, name=spec, nodeid=spec)
        get = session.config.getoption
        collector.asked = _Asked(
            spec,
            {
                "quick": get("gamekeeper_quick"),
                "contract": get("gamekeeper_contract"),
                "seed": 0,
                "ignore": get("gamekeeper_ignore"),
                "select": get("gamekeeper_select"),
                "env_kwargs": {},
            },
        )
        return collector

    def collect(self) -> Iterable[pytest.Item]:
        """A test for each check."""
        for name in self.asked.ids():
            yield _Promise.from_parent(self, name=name)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Shows errors of Gamekeeper without their traceback."""
        if isinstance(excinfo.value, GamekeeperError):
            return f"{OPTION} {self.name}: {excinfo.value}"
        return super().repr_failure(excinfo)


class _Promise(pytest.Item):
    """One check of an environment that the command line names."""

    def runtest(self) -> None:
        """Passes or fails by the audit's verdict."""
        assert isinstance(self.parent, _Environment)  # pytest built it so
        settle(self.parent.asked.verdict(self.name, self.config), self.config)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Shows errors of Gamekeeper without their traceback."""
        if isinstance(excinfo.value, GamekeeperError):
            return f"{type(excinfo.value).__name__}: {excinfo.value}"
        return super().repr_failure(excinfo)

    def reportinfo(self) -> tuple[PathLike[str] | str, int | None, str]:
        """The name of the test in reports."""
        return self.path, None, self.name


def pytest_addoption(parser: pytest.Parser) -> None:
    """The options of the plug-in."""
    group = parser.getgroup("gamekeeper", "contract tests of multi-agent environments")
    options: list[tuple[str, dict[str, Any]]] = [
        (
            OPTION,
            {
                "metavar": "ENV",
                "help": "Collect a test for each check of ENV. Repeatable; without paths on the "
                "command line other tests aren't collected (default: none).",
            },
        ),
        (
            "--gamekeeper-select",
            {"metavar": "ID", "help": "Only checks whose ids begin with ID (default: all)."},
        ),
        (
            "--gamekeeper-ignore",
            {"metavar": "ID", "help": "Skip checks whose ids begin with ID (default: none)."},
        ),
    ]
    for name, settings in options:
        group.addoption(name, action="append", default=[], **settings)
    group.addoption(
        "--gamekeeper-contract",
        metavar="FILE",
        help="Contract of ENV (default: the file beside the environment's, if there is one).",
    )
    group.addoption(
        "--gamekeeper-quick",
        action="store_true",
        help="Limit the budget to 3,000 environment steps (default: 20,000).",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Collects only environments where the command line has no paths."""
    if config.getoption("gamekeeper") and config.args_source is not config.ArgsSource.ARGS:
        config.args = []


@pytest.hookimpl(tryfirst=True)  # before -k and -m choose among the tests
def pytest_collection_modifyitems(session: pytest.Session, items: list[pytest.Item]) -> None:
    """Adds the tests of the environments that the command line names."""
    hook = session.ihook
    for spec in session.config.getoption("gamekeeper"):
        environment = _Environment.named(session, spec)
        hook.pytest_collectstart(collector=environment)
        report = hook.pytest_make_collect_report(collector=environment)
        hook.pytest_collectreport(report=report)
        items.extend(each for each in report.result if isinstance(each, pytest.Item))


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Shows waivers that are no longer needed."""
    notes = config.stash.get(NOTES, [])
    if notes:
        terminalreporter.section("gamekeeper: waivers")
        for note in notes:
            terminalreporter.line(note)
