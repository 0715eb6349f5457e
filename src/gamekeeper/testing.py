"""Contract tests under pytest: a test for each check of the audit, of any environment.

In a test file, `TestContract = contract_test(make_env)`; on the command line,
`pytest --gamekeeper my_env.py:make`. An environment is audited once in a session, when its first
test runs. Broken fails with the finding and the program that shows it; unseen and not applicable
are skipped with the reason; waived is an expected failure with the contract's reason.
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
    from gamekeeper.core.contract import Contract
    from gamekeeper.core.verdict import Verdict

__all__ = ["contract_test"]

OPTION: Final = "--gamekeeper"
NOTES: Final = pytest.StashKey[list[str]]()
AUDITS: Final = pytest.StashKey[dict[str, Any]]()


@dataclass(frozen=True, slots=True)
class _Asked:
    """An audit that tests ask for, once in a session.

    Attributes:
        spec: what to audit.
        options: of `gk.audit`.
    """

    spec: object
    options: Mapping[str, Any]

    @property
    def key(self) -> str:
        """Equal for equal audits; a callable is known by itself."""
        name = self.spec if isinstance(self.spec, str) else f"{id(self.spec)}"
        return json.dumps([name, self.options], default=repr, sort_keys=True)

    def ids(self) -> list[str]:
        """The checks that will be asked, each with its name: `GK402-rewards_stop_at_the_end`.

        Raises:
            EvidenceError: no check begins like what is selected or ignored.
        """
        from gamekeeper.audit.check import selected

        chosen = selected(tuple(self.options["select"]), tuple(self.options["ignore"]))
        return [f"{each.id}-{each.name}" for each in chosen.values()]

    def verdict(self, test: str, config: pytest.Config) -> Verdict:
        """The verdict of the check that a test is called after."""
        found = config.stash.setdefault(AUDITS, {})
        if self.key not in found:
            from gamekeeper.audit.front import audit

            try:
                found[self.key] = audit(self.spec, **self.options)
            except GamekeeperError as error:
                found[self.key] = error
                raise
        if isinstance(found[self.key], GamekeeperError):  # told in full by the test that met it
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
        make_env: a factory, or text that names one (`my_env.py:make`); what is named by text runs
            in a process of its own, so that a crash or a hang fails a test and not the session.
        contract: what is declared; None: what lies beside the environment, if anything.
        budget: environment steps; 20,000 unless told.
        quick: 3,000 environment steps.
        seed: of the plays.
        select: only checks whose ids begin so.
        ignore: all checks but those whose ids begin so.
        env_kwargs: handed to the factory.
    Raises:
        EvidenceError: no check begins like `select` or `ignore`.
    """
    options: dict[str, Any] = {
        "contract": contract, "quick": quick, "seed": seed, "select": list(select),
        "ignore": list(ignore), "env_kwargs": dict(env_kwargs or {}),
    }  # fmt: skip
    asked = _Asked(make_env, options if budget is None else {**options, "budget": budget})

    class TestContract:
        """The promises of an environment, a test for each."""

        @pytest.mark.parametrize("check", asked.ids())
        def test_promise(self, check: str, request: pytest.FixtureRequest) -> None:
            """The environment keeps this promise, as far as it was seen."""
            settle(asked.verdict(check, request.config), request.config)

    return TestContract


def settle(verdict: Verdict, config: pytest.Config) -> None:
    """Passes, fails, skips or expects the failure, as the verdict says."""
    __tracebackhide__ = True
    if verdict.outcome == "broken":
        pytest.fail(_told(verdict), pytrace=False)
    elif verdict.outcome == "error":
        pytest.fail(f"a fault of the check, not of the environment\n{verdict.reason}", False)
    elif verdict.outcome == "waived":
        pytest.xfail(verdict.reason)
    elif verdict.outcome in ("unseen", "not_applicable"):
        pytest.skip(f"{verdict.outcome.replace('_', ' ')}: {verdict.reason}")
    elif verdict.reason:
        config.stash.setdefault(NOTES, []).append(f"{verdict.id}: {verdict.reason}")


def _told(verdict: Verdict) -> str:
    """The claim, then where it is broken, and the program that shows the first place."""
    lines = [f"{verdict.id} ({verdict.severity}): {verdict.claim}"]
    for each in verdict.findings:
        lines += ["", f"  where: {each.where}", f"  expected: {each.expected}"]
        lines += [f"  seen: {each.seen}", f"  mend: {each.mend}"]
    for each in verdict.findings[:1]:
        lines += ["", each.reproduce.rstrip()]
    return "\n".join(lines)


class _Environment(pytest.Collector):
    """An environment that the command line names, with a test for each check."""

    asked: _Asked

    @classmethod
    def named(cls, session: pytest.Session, spec: str) -> _Environment:
        """The collector of what `--gamekeeper` names."""
        collector: _Environment = cls.from_parent(session, name=spec, nodeid=spec)
        get = session.config.getoption
        options = {"quick": get("gamekeeper_quick"), "contract": get("gamekeeper_contract")}
        collector.asked = _Asked(spec, {
            **options, "seed": 0, "ignore": get("gamekeeper_ignore"),
            "select": get("gamekeeper_select"), "env_kwargs": {},
        })  # fmt: skip
        return collector

    def collect(self) -> Iterable[pytest.Item]:
        """A test for each check."""
        for name in self.asked.ids():
            yield _Promise.from_parent(self, name=name)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """An error of ours says what is wrong, without its traceback."""
        if isinstance(excinfo.value, GamekeeperError):
            return f"{OPTION} {self.name}: {excinfo.value}"
        return super().repr_failure(excinfo)


class _Promise(pytest.Item):
    """One check of an environment that the command line names."""

    def runtest(self) -> None:
        """Passes or not as the audit's verdict says."""
        assert isinstance(self.parent, _Environment)  # pytest built it so
        settle(self.parent.asked.verdict(self.name, self.config), self.config)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """An error of ours says what is wrong, without its traceback."""
        if isinstance(excinfo.value, GamekeeperError):
            return f"{type(excinfo.value).__name__}: {excinfo.value}"
        return super().repr_failure(excinfo)

    def reportinfo(self) -> tuple[PathLike[str] | str, int | None, str]:
        """How the test is called in reports."""
        return self.path, None, self.name


def pytest_addoption(parser: pytest.Parser) -> None:
    """The options of the plug-in."""
    group = parser.getgroup("gamekeeper", "contract tests of multi-agent environments")
    options: list[tuple[str, dict[str, Any]]] = [
        (OPTION, {"metavar": "ENV", "help": "Collect a test for each check of ENV. Repeatable; "
                  "without paths on the command line nothing else is collected."}),
        ("--gamekeeper-select", {"metavar": "ID", "help": "Only checks whose ids begin so."}),
        ("--gamekeeper-ignore", {"metavar": "ID", "help": "All checks but those."}),
    ]  # fmt: skip
    for name, settings in options:
        group.addoption(name, action="append", default=[], **settings)
    group.addoption("--gamekeeper-contract", metavar="FILE", help="The contract of ENV.")
    group.addoption(
        "--gamekeeper-quick", action="store_true", help="A budget of 3,000 steps, not 20,000."
    )


def pytest_configure(config: pytest.Config) -> None:
    """Where only environments are named, what else lies in the folder isn't collected."""
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
    """Says which waivers nothing needs any more."""
    notes = config.stash.get(NOTES, [])
    if notes:
        terminalreporter.section("gamekeeper: waivers")
        for note in notes:
            terminalreporter.line(note)
