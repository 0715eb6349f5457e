"""The generators of the whole process: held, disturbed, restored."""

import random

import numpy as np

from gamekeeper.audit.specimens.clean_rovers import make
from gamekeeper.record.recording import cast_of
from gamekeeper.run.changes.global_generators import GlobalGeneratorsDisturbed
from gamekeeper.run.episode import Play, perform
from gamekeeper.run.global_generators import held, states


def test_held_starts_from_one_seed_and_leaves_no_trace() -> None:
    """Two times within it draw alike, and nobody outside notices."""
    before = states()
    drawn = []
    for _ in range(2):
        with held():
            drawn.append((random.random(), np.random.rand()))

    assert drawn[0] == drawn[1]
    assert before == states()


def test_disturbed_generators_are_put_back_after_the_play() -> None:
    """A play disturbs them between all turns and leaves them as they were."""
    env, seen = make(), []
    before = states()
    perform(
        Play(seed=1, most_turns=3), env, cast=cast_of("random", env, None),
        change=GlobalGeneratorsDisturbed(),
        watch=lambda turn, env, out: seen.append(np.random.get_state(legacy=True)[1][0]),
    )  # fmt: skip

    assert len(set(seen)) == 4
    assert before == states()
