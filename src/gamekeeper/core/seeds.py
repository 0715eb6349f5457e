"""Seeds of episodes and random streams of policies, all derived from the seed of the run.

Stable by promise: a recorded run names only its run seed, so the formulas here may not change
without a new format version. Nothing depends on the number of workers, on the order in which agents
or episodes are visited, on the platform or on the hash seed.
"""

from __future__ import annotations

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
            f"{name} is no whole number", where=name, expected="an integer >= 0", seen=repr(number)
        ) from None
    if number < 0:
        raise DrawError(
            f"{name} is negative", where=name, expected="an integer >= 0", seen=str(number)
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
            raise DrawError(f"a digest has {len(words)} words, {n_words} were asked for")
        return words[:n_words].astype(dtype, copy=False)
