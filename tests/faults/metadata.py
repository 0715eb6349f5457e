"""Metadata."""

from __future__ import annotations

from typing import Any

from tests.faults import faulty
from tests.faults.rovers import Rovers


@faulty("GK821")
class Nameless(Rovers):
    """The metadata has no name."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        k: v for k, v in Rovers.metadata.items() if k != "name"
    }


@faulty("GK822")
class ModeUndeclared(Rovers):
    """It renders in a mode that its metadata doesn't have."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        **Rovers.metadata,
        "render_modes": ["human"],
    }

    def __init__(self, count: int = 3, horizon: int = 20, render_mode: str = "rgb_array") -> None:
        super().__init__(count, horizon, render_mode)


@faulty("GK822")
class ModesAsText(Rovers):
    """The render modes are one text."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        **Rovers.metadata,
        "render_modes": "rgb_array",
    }


@faulty("GK822")
class FormerSpelling(Rovers):
    """The render modes stand under the key that Gym once had."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        "render.modes" if k == "render_modes" else k: v for k, v in Rovers.metadata.items()
    }


@faulty("GK822")
class ModesUnsaid(Rovers):
    """It takes a render mode and renders, and its metadata says nothing of modes."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        k: v for k, v in Rovers.metadata.items() if k != "render_modes"
    }


@faulty("GK823")
class NoRate(Rovers):
    """Pictures are rendered at no rate."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        k: v for k, v in Rovers.metadata.items() if k != "render_fps"
    }


@faulty("GK824")
class GrowingModes(Rovers):
    """Every instance adds a render mode to the list of the class.

    Adds a mode for text.
    """

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        **Rovers.metadata,
        "render_modes": ["rgb_array"],
    }

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode)
        self.metadata["render_modes"].append("ansi")  # type: ignore[attr-defined]

    def render(self) -> Any:
        """A picture, or the cells in words."""
        return str(self.cells) if self.render_mode == "ansi" else super().render()


@faulty("GK825")
class TextForBool(Rovers):
    """It says in words that it can't be made parallel."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        **Rovers.metadata,
        "is_parallelizable": "no",
    }


@faulty("GK825")
class OtherSpelling(Rovers):
    """It says under a British spelling that it can be made parallel."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        k.replace("izable", "isable"): v for k, v in Rovers.metadata.items()
    }
