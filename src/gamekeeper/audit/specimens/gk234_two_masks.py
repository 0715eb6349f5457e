"""The mask in the info allows everything, the one in the observation does not."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._tokens import CELLS, Tokens

BREAKS = ("GK234",)


class TwoMasks(Tokens):
    """Half of the readers take the wrong one."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Infos with a mask of their own."""
        super().reset(seed, options)
        for agent in self.agents:
            self.infos[agent] = {"action_mask": np.ones(CELLS, np.int8)}


def make(**kwargs: Any) -> TwoMasks:
    """The environment with its one fault."""
    return TwoMasks(**kwargs)
