"""The seed of an episode as a rule, so that compiled copies begin their next episode by themselves.

The same numbers as `gamekeeper.core.episode_seeds.EpisodeSeeds`, which holds what all episodes of a
run have in common.
"""

from __future__ import annotations

from gamekeeper.core.episode_seeds import INIT_B, MIX_R, MULT_A, MULT_B, WORD
from gamekeeper.kernels.rules import rule


@rule
def episode_seed(pool, constant, episode):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """The seed of episode `episode`, below 2**32, of the run whose `EpisodeSeeds` these are of."""
    value = (episode ^ constant) * (constant * MULT_A & WORD) & WORD
    value = (pool - (MIX_R * (value ^ (value >> 16)) & WORD)) & WORD
    value = ((value ^ (value >> 16)) ^ INIT_B) * (INIT_B * MULT_B & WORD) & WORD
    return (value ^ (value >> 16)) >> 1
