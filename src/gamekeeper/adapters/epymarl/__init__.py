"""EPyMARL's shape: what codes with a centralised critic or mixer (MAPPO, QMIX, VDN) expect."""

from __future__ import annotations

from gamekeeper.adapters.epymarl.front import gymma, multi_agent_env

__all__ = ["gymma", "multi_agent_env"]
