"""What the tutorials tell a reader to type works as it stands."""

from pathlib import Path

import pytest

from tests.surface.test_docs_run import ELSEWHERE, TUTORIALS
from tests.surface.typed_pages import at_home, short, type_page


@pytest.mark.parametrize("page", [p for p in TUTORIALS if short(p) not in ELSEWHERE], ids=short)
def test_tutorial_works_as_it_is_typed(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every block of the page runs, after those before it, and exits as it says."""
    type_page(page, at_home(tmp_path, monkeypatch))
