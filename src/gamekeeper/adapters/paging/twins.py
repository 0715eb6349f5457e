"""The twins that a diagnosis kept beside a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from gamekeeper.adapters.paging.opening import opened
from gamekeeper.errors import GamekeeperError
from gamekeeper.report.page.compose import Shown

SHAM: Final = "sham"


def twins_of(run: Path, main: Shown, diagnosis: Mapping[str, Any] | None) -> Iterator[Shown]:
    """The bundles that a diagnosis kept: as it is, then under each remedy; none if they're gone.

    Args:
        run: the folder of the run.
        main: the run.
        diagnosis: its document, which names the bundles.
    """
    bundles = (diagnosis or {}).get("bundles")
    if not isinstance(bundles, Mapping) or SHAM not in bundles:
        return
    found = []
    arms = sorted(bundles, key=lambda arm: (arm != SHAM, arm))  # annotations keep no order
    for number, arm in enumerate(arms):
        told = bundles[arm]
        folder = _kept(run, str(told))
        if folder is None:
            continue
        word = "sham" if arm == SHAM else f"twin{number}"
        name = f"{main.name}, fresh seeds, as it is" if arm == SHAM else f"with {arm}"
        try:
            found.append(opened(folder, key=f"{main.key}.{word}", name=name))
        except GamekeeperError:  # the twins of a page are an extra: without them it is still true
            return
    if len(found) > 1 and found[0].key.endswith("sham"):
        yield from found


def _kept(run: Path, told: str) -> Path | None:
    """The folder of a kept bundle beside the run, wherever both were moved to.

    Evidence names no other folder of this machine that would be read.
    """
    beside = run.resolve().parent
    name = Path(told).name
    for folder in (beside / f"{run.resolve().name}-diagnosis" / "bundles" / name, Path(told)):
        if folder.is_dir() and beside in folder.resolve().parents:
            return folder
    return None
