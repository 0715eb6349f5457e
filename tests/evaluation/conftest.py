"""Fixtures of evaluation's tests."""

from collections.abc import Iterator
from functools import cache

import pytest

from gamekeeper.evaluation import inspection
from gamekeeper.interface import distributions, identity


@pytest.fixture(autouse=True, scope="package")
def _owners_known() -> Iterator[None]:
    """Whom a module belongs to is looked up once: in a source tree it takes 0.1 s."""
    known = cache(distributions.owner_of)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(identity, "owner_of", known)
        patch.setattr(inspection, "owner_of", known)
        yield
