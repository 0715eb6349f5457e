"""Reproducers run once in tests that aren't about them: each run is a process."""

import pytest


@pytest.fixture(autouse=True)
def _reproducers_run_once(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.module.__name__ != "tests.auditing.test_confirmation":
        monkeypatch.setattr("gamekeeper.auditing.confirm.TRIES", 1)
