"""Seeds of episodes, one after the other, at a tenth of the cost of mixing each from the start."""

from __future__ import annotations

from typing import Final

from numpy.random import SeedSequence

from gamekeeper.core.seeds import EPISODE_SEED_BITS, episode_seed

WORD: Final = (1 << 32) - 1
POOL: Final = 4
"""Words of a pool, and the fewest that a run's seed takes."""
INIT_A, MULT_A = 0x43B0D7E5, 0x931E8875
INIT_B, MULT_B = 0x8B51F9DD, 0x58F38DED
MIX_L, MIX_R = 0xCA01F9DD, 0x4973F715


class EpisodeSeeds:
    """`episode_seed` of one run: all that its episodes have in common is mixed once.

    The number of the episode is the last word that `SeedSequence` mixes in, and only the first of
    its four words is read, so that one episode is a dozen operations on whole numbers.

    Attributes:
        pool: what all episodes of the run have in common, a 32-bit word.
        constant: what the number of an episode is mixed with first, likewise.

    Source: numpy.random.SeedSequence (O'Neill's seed_seq hash), whose output NumPy keeps stable.
    """

    __slots__ = ("_run_seed", "constant", "pool")

    def __init__(self, run_seed: int) -> None:
        """Mixes what all episodes of a run have in common.

        Raises:
            DrawError: the seed is negative or no whole number.
        """
        episode_seed(run_seed, 0)  # says what is wrong with it
        self._run_seed = int(run_seed)
        self.pool = MIX_L * int(SeedSequence(run_seed, spawn_key=(0,)).pool[0]) & WORD
        words = max(POOL, -(-self._run_seed.bit_length() // 32)) + 1  # and the 0 of the branch
        mixed = POOL * POOL + POOL * (words - POOL)
        self.constant = INIT_A * pow(MULT_A, mixed, WORD + 1) & WORD

    def __getitem__(self, episode: int) -> int:
        """The seed of an episode, in [0, 2**31)."""
        if episode > WORD:
            return episode_seed(self._run_seed, episode)
        value = (episode ^ self.constant) * (self.constant * MULT_A & WORD) & WORD
        value = self.pool - MIX_R * (value ^ value >> 16) & WORD
        value = ((value ^ value >> 16) ^ INIT_B) * (INIT_B * MULT_B & WORD) & WORD
        return (value ^ value >> 16) >> (32 - EPISODE_SEED_BITS)
