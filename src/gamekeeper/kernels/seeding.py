"""The seed of an episode as a rule, so that compiled copies begin their next episode by themselves.

The same number as `gamekeeper.core.seeds.episode_seed`, which asks NumPy's SeedSequence.
Source: M. O'Neill, seed_seq_fe; numpy/random/bit_generator.pyx (mix_entropy, generate_state).
"""

from __future__ import annotations

from typing import Final

from gamekeeper.kernels.rules import rule

WORD: Final = 0xFFFFFFFF
INIT_A: Final = 0x43B0D7E5
MULT_A: Final = 0x931E8875
INIT_B: Final = 0x8B51F9DD
MULT_B: Final = 0x58F38DED
MIX_L: Final = 0xCA01F9DD
MIX_R: Final = 0x4973F715
POOL: Final = 4


@rule
def _mixed(x, y):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    value = ((MIX_L * x) & WORD) - ((MIX_R * y) & WORD)
    value &= WORD
    return value ^ (value >> 16)


@rule
def episode_seed(run, high, episode):  # type: ignore[no-untyped-def]  # as above
    """The seed of episode `episode` of the run whose seed is `run + high * 2**32`.

    Args:
        run: the low 32 bits of the run's seed.
        high: the high 32 bits.
        episode: below 2**32.
    """
    # the entropy, padded to the pool, then the spawn key (0, episode)
    words = (run, high, 0, 0, 0, episode)
    pool0 = pool1 = pool2 = pool3 = 0
    hashed = INIT_A
    for i in range(POOL):
        value = words[i] ^ hashed
        hashed = (hashed * MULT_A) & WORD
        value = (value * hashed) & WORD
        value ^= value >> 16
        if i == 0:
            pool0 = value
        elif i == 1:
            pool1 = value
        elif i == 2:
            pool2 = value
        else:
            pool3 = value
    for source in range(POOL):
        for target in range(POOL):
            if source != target:
                taken = pool0
                if source == 1:
                    taken = pool1
                elif source == 2:
                    taken = pool2
                elif source == 3:
                    taken = pool3
                value = taken ^ hashed
                hashed = (hashed * MULT_A) & WORD
                value = (value * hashed) & WORD
                value ^= value >> 16
                if target == 0:
                    pool0 = _mixed(pool0, value)
                elif target == 1:
                    pool1 = _mixed(pool1, value)
                elif target == 2:
                    pool2 = _mixed(pool2, value)
                else:
                    pool3 = _mixed(pool3, value)
    for k in range(POOL, 6):
        for target in range(POOL):
            value = words[k] ^ hashed
            hashed = (hashed * MULT_A) & WORD
            value = (value * hashed) & WORD
            value ^= value >> 16
            if target == 0:
                pool0 = _mixed(pool0, value)
            elif target == 1:
                pool1 = _mixed(pool1, value)
            elif target == 2:
                pool2 = _mixed(pool2, value)
            else:
                pool3 = _mixed(pool3, value)
    value = pool0 ^ INIT_B
    value = (value * ((INIT_B * MULT_B) & WORD)) & WORD
    value ^= value >> 16
    return value >> 1
