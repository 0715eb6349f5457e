"""It says that it is parallelizable, and its opening trader rotates."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK710",)


class RotatesAllTheSame(Traders):
    """The flag of an environment in cycles, without the cycles."""

    metadata = {**Traders.metadata, "is_parallelizable": True}  # noqa: RUF012  # as PettingZoo has it


def make(**kwargs: Any) -> RotatesAllTheSame:
    """The environment with its one fault."""
    return RotatesAllTheSame(**kwargs)
