"""The clock that stands still while something of ours is waited for."""

import pytest

from gamekeeper import waiting


def test_own_clock_stands_still_for_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wait within another counts once, and one that is ended twice too."""
    now = [100.0]
    monkeypatch.setattr(waiting, "monotonic", lambda: now[0])
    monkeypatch.setattr(waiting, "_signs", [])
    began_s = waiting.own_s()
    now[0] += 1
    outer = waiting.Wait()
    now[0] += 5
    inner = waiting.Wait()
    now[0] += 2
    inner.end()
    now[0] += 3
    outer.end()
    outer.end()
    now[0] += 1
    assert waiting.own_s() - began_s == 2
