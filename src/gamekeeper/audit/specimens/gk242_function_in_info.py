"""Infos hold a function."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK242",)


class FunctionInInfo(Rovers):
    """No process can send such an info to another."""

    def info(self, agent: str) -> dict[str, Any]:
        """A way to ask later."""
        return {**super().info(agent), "ask": lambda: self.battery[agent]}


def make(**kwargs: Any) -> FunctionInInfo:
    """The environment with its one fault."""
    return FunctionInInfo(**kwargs)
