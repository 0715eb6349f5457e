"""The battery in the infos is declared as a whole number, and is a float."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK243",)


CONTRACT = {"infos": {"battery": {"dtype": "int64", "shape": []}}}


class OtherInfo(Rovers):
    """Told as a part of a full battery."""

    def info(self, agent: str) -> dict[str, Any]:
        """Between 0 and 1."""
        return {"battery": self.battery[agent] / 30}


def make(**kwargs: Any) -> OtherInfo:
    """The environment with its one fault."""
    return OtherInfo(**kwargs)
