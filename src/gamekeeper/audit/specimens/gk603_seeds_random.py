"""The reset seeds the generator of the module random, for everybody."""

from __future__ import annotations

import random
from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK603",)


class SeedsRandom(Rovers):
    """Seeds whatever might be drawn from."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Seeds more than its own."""
        if seed is not None:
            random.seed(seed)
        return super().reset(seed, options)


def make(**kwargs: Any) -> SeedsRandom:
    """The environment with its one fault."""
    return SeedsRandom(**kwargs)
