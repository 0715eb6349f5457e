"""Findings are given out without being confirmed in tests that aren't about that."""

from collections.abc import Sequence
from typing import Any

import pytest

from gamekeeper.checks.verdict import Verdict
from tests.auditing.kept_workers import keep_workers

CONFIRMED = {
    "tests.auditing.test_confirmation": 5,
    "tests.auditing.test_linked_causes": 1,
    "tests.auditing.test_readings": 1,
    "tests.auditing.test_seeds": 1,
}
"""Modules whose reproducers are run, each in so many processes."""


@pytest.fixture(autouse=True)
def _few_reproducers_run(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    def unconfirmed(drafts: Sequence[Any], **options: Any) -> tuple[Verdict, ...]:
        return tuple(verdict for verdict, _ in drafts)

    tries = CONFIRMED.get(request.module.__name__)
    if tries is None:
        monkeypatch.setattr("gamekeeper.auditing.audit.confirmed", unconfirmed)
    else:
        monkeypatch.setattr("gamekeeper.auditing.confirm.TRIES", tries)
        keep_workers(monkeypatch)
