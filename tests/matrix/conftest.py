"""Audits that the selected tests of the matrix read are made together, before the first of them."""

import pytest

from tests.matrix.audits import CLEAN, ask


@pytest.fixture(scope="session", autouse=True)
def _audits(request: pytest.FixtureRequest) -> None:
    """Asks for the audits of all tests here that were selected."""
    here = [item for item in request.session.items if "tests/matrix/" in item.nodeid]
    named = [item.callspec.params for item in here if hasattr(item, "callspec")]
    is_all = len(named) < len(here)  # the test without a parameter reads the clean ones
    ask([*(CLEAN if is_all else ()), *(each["name"] for each in named)])
