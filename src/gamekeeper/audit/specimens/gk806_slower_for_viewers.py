"""With pictures, batteries last longer."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK806",)


class SlowerForViewers(Rovers):
    """Videos should show something."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Charges a little more where somebody looks on."""
        super().reset(seed, options)
        if self.render_mode is not None:
            self.battery = {agent: self.battery[agent] + 5 for agent in self.agents}
        return {a: self.observation(a) for a in self.agents}, {a: self.info(a) for a in self.agents}

    def observation(self, agent: str) -> Any:
        """Within the space, however full the battery is."""
        return super().observation(agent).clip(0, 1)


def make(**kwargs: Any) -> SlowerForViewers:
    """The environment with its one fault."""
    return SlowerForViewers(**kwargs)
