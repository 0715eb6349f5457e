"""Fixtures of evaluation's tests."""

from __future__ import annotations

from functools import cache

import pytest

from gamekeeper.game.opening import identity, installed


@pytest.fixture(autouse=True)
def _owners_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whom a module belongs to is looked up once: in a source tree it takes 0.1 s."""
    monkeypatch.setattr(identity, "owner_of", OWNER_OF)


OWNER_OF = cache(installed.owner_of)
