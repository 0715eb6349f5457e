"""Two tiers of tests, told apart by measured seconds and by nothing else.

`seconds.json` beside this file has the seconds of every test that took LIMIT_S or longer when all
of them were last measured: on two quiet cores, set-up and teardown included. `--tier quick` leaves
those out and says so; `--tier slow` runs nothing else; without the option all tests run. Both tiers
together are all tests, each once. A test that isn't in the file is quick; one that failed keeps its
tier.

    make seconds       # runs all tests and writes the file
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import pytest

LIMIT_S: Final = 0.75
"""A test that takes this long or longer is slow."""
FILE: Final = Path(__file__).with_name("seconds.json")
ROOT: Final = FILE.parents[1]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds `--tier` and `--write-seconds`."""
    group = parser.getgroup("tiers")
    group.addoption(
        "--tier",
        choices=("quick", "slow", "all"),
        default="all",
        help=f"tests under {LIMIT_S:g} s, the others, or all (default: all)",
    )
    group.addoption(
        "--write-seconds",
        action="store_true",
        help=f"write the tests that took {LIMIT_S:g} s or longer into {FILE.name}",
    )


def measured() -> dict[str, float]:
    """Seconds of each slow test by its id."""
    seconds: dict[str, float] = json.loads(FILE.read_text(encoding="utf-8"))
    return seconds


class Tiers:
    """Leaves out the tests of the other tier, sums up seconds, says both at the end.

    Args:
        tier: `quick`, `slow` or `all`.
        writes: the seconds of this run are kept.
    """

    def __init__(self, tier: str, *, writes: bool) -> None:
        self.tier, self.writes = tier, writes
        self.before = measured()
        self.left_out: list[str] = []
        self.seconds: dict[str, float] = {}
        self.failed: set[str] = set()

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(
        self, config: pytest.Config, items: list[pytest.Item]
    ) -> None:
        """Deselects what belongs to the other tier."""
        if self.tier == "all":
            return
        wanted = [item for item in items if (item.nodeid in self.before) == (self.tier == "slow")]
        others = [item for item in items if (item.nodeid in self.before) != (self.tier == "slow")]
        config.hook.pytest_deselected(items=others)
        items[:] = wanted

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Adds what set-up, call and teardown took; with workers this is the one that hands out."""
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration
        if report.failed:
            self.failed.add(report.nodeid)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Says how much each tier is, by the seconds that were measured last."""
        total = sum(self.before.values())
        if self.tier == "quick":
            terminalreporter.write_line(
                f"tier quick: {len(self.before)} tests of {LIMIT_S:g} s or longer were left out, "
                f"{total:.0f} s together; `make check` runs them too"
            )
        if not self.writes:
            return
        kept = later(self.before, self.seconds, self.failed)
        FILE.write_text(json.dumps(kept, indent=0, sort_keys=True) + "\n", encoding="utf-8")
        terminalreporter.write_line(
            f"{len(kept)} of {len(self.seconds)} tests took {LIMIT_S:g} s or longer: "
            f"{sum(kept.values()):.0f} of {sum(self.seconds.values()):.0f} s"
        )


def later(
    before: dict[str, float], seconds: dict[str, float], failed: Iterable[str]
) -> dict[str, float]:
    """Seconds to keep after a run of all tests: those of slow tests, to a hundredth of a second.

    Args:
        before: the seconds that were kept.
        seconds: those of this run, by test.
        failed: tests whose seconds say nothing, as they stopped early; they keep what they had.
    """
    now = {test: round(took, 2) for test, took in seconds.items() if took >= LIMIT_S}
    broken = set(failed)
    return {test: took for test, took in now.items() if test not in broken} | {
        test: took for test, took in before.items() if test in broken
    }


def pytest_configure(config: pytest.Config) -> None:
    """Registers the tiers."""
    tiers = Tiers(config.getoption("--tier"), writes=config.getoption("--write-seconds"))
    config.pluginmanager.register(tiers, "tiers")
