"""Seeds of episodes and random streams of policies, all derived from the seed of the run.

Stable by promise: a recorded run names only its run seed, so the formulas here may not change
without a new format version. Nothing depends on the number of workers, on the order in which agents
or episodes are visited, on the platform or on the hash seed.
"""

from hashlib import blake2b
from operator import index
from typing import Any, Final

import numpy as np
from numpy.random import PCG64, Generator, SeedSequence
from numpy.random.bit_generator import ISeedSequence
from numpy.typing import NDArray

from gamekeeper.errors import DrawError

EPISODE_SEED_BITS: Final = 31
"""Environments hand seeds to C code and old generators that take a signed 32-bit integer."""

_ENV_BRANCH: Final = 0
_POLICY_TAG: Final = b"gamekeeper policy stream 1"


def episode_seed(run_seed: int, episode: int) -> int:
    """The seed that episode number `episode` of a run is reset with, in [0, 2**31).

    It is the upper 31 bits of the first word of `SeedSequence(run_seed, spawn_key=(0, episode))`.
    Two episodes of a run share a seed with probability 2**-31.

    Args:
        run_seed: whole number >= 0, of any size.
        episode: number of the episode in its run, from 0.
    Raises:
        DrawError: a number is negative or no whole number.
    Source: numpy.random.SeedSequence (O'Neill's seed_seq hash), whose output NumPy keeps stable.
    """
    run_seed, episode = _whole(run_seed, "run_seed"), _whole(episode, "episode")
    words = SeedSequence(run_seed, spawn_key=(_ENV_BRANCH, episode)).generate_state(1, np.uint32)
    return int(words[0]) >> (32 - EPISODE_SEED_BITS)


def policy_rng(run_seed: int, episode: int, agent: object) -> Generator:
    """A fresh random stream for one agent's policy in one episode.

    It hangs on the agent's name, so that another roster order, an agent that joins late or one
    agent more changes nobody else's draws. The environment's seed is no function of it, nor the
    reverse. The 256 bits of a blake2b digest are PCG64's state and increment: a quarter of the cost
    of mixing them once more through SeedSequence.

    Args:
        run_seed: whole number >= 0, of any size.
        episode: number of the episode in its run, from 0.
        agent: the agent's identity; its `str` counts.
    Raises:
        DrawError: a number is negative or no whole number.
    """
    numbers = b"%d,%d," % (_whole(run_seed, "run_seed"), _whole(episode, "episode"))
    name = str(agent).encode("utf-8", "surrogatepass")
    digest = blake2b(numbers + name, digest_size=32, key=_POLICY_TAG).digest()
    # NumPy documents that bit generators take any ISeedSequence; its stubs name only its own class.
    return Generator(PCG64(_Words(digest)))  # type: ignore[arg-type]


def _whole(number: int, name: str) -> int:
    try:
        number = index(number)
    except TypeError:
        raise DrawError(
            f"{name} is no whole number",
            where=name,
            expected="an integer >= 0",
            actual=repr(number),
            fix="give a whole number from 0 on",
        ) from None
    if number < 0:
        raise DrawError(
            f"{name} is negative",
            where=name,
            expected="an integer >= 0",
            actual=str(number),
            fix="give a whole number from 0 on",
        )
    return number


class _Words(ISeedSequence):
    """Hands a digest's words to a bit generator as they are."""

    __slots__ = ("_digest",)

    def __init__(self, digest: bytes) -> None:
        self._digest = digest

    def generate_state(self, n_words: int, dtype: Any = np.uint32) -> NDArray[Any]:
        # Little-endian on every machine; PCG64 asks for four 64-bit words, all that there are.
        words = np.frombuffer(self._digest, np.dtype(dtype).newbyteorder("<"))
        if n_words > len(words):
            raise DrawError(
                f"a digest has {len(words)} words, {n_words} were asked for",
                fix=f"ask for at most {len(words)} words",
            )
        return words[:n_words].astype(dtype, copy=False)


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
