"""Wrappers for both interfaces that keep spaces, masks, infos, seeds, endings and rosters."""

from gamekeeper.interface.wrappers.action_wrappers import (
    clip_actions,
    mask_to_info,
    mask_to_observation,
    pad_actions,
    sticky_actions,
)
from gamekeeper.interface.wrappers.normalization import Statistics, normalize
from gamekeeper.interface.wrappers.observation_wrappers import (
    agent_id,
    flatten_observations,
    frame_stack,
)
from gamekeeper.interface.wrappers.reward_wrappers import clip_rewards, weigh_rewards
from gamekeeper.interface.wrappers.time_limit import time_limit

__all__ = [
    "Statistics",
    "agent_id",
    "clip_actions",
    "clip_rewards",
    "flatten_observations",
    "frame_stack",
    "mask_to_info",
    "mask_to_observation",
    "normalize",
    "pad_actions",
    "sticky_actions",
    "time_limit",
    "weigh_rewards",
]
