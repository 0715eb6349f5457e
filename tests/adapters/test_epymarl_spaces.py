"""EPyMARL's shape holds every kind of observation, and Discrete actions alone."""

from __future__ import annotations

from typing import Any

import pytest

from gamekeeper.errors import SpecError
from tests.adapters import kinds
from tests.adapters.test_epymarl import made, played

REFUSED = {
    ("done", done): "numbered actions only"
    for done in ("MultiDiscrete", "MultiBinary", "Box", "Dict", "Tuple")
}


@pytest.mark.parametrize("spec", [kinds.HERE, kinds.TURNS], ids=["parallel", "aec"])
@pytest.mark.parametrize("kind", kinds.EACH, ids=kinds.name)
def test_every_kind_of_space_is_played(kind: dict[str, Any], spec: str) -> None:
    """Two episodes of available actions: all that is seen is as long as EPyMARL was told."""
    options = {"env_kwargs": kind, "time_limit": 40, **kinds.cast(kind)}
    says = kinds.refusal(kind, REFUSED)
    if says is not None:
        with pytest.raises(SpecError, match=says):
            made(spec, **options)
        return
    env = made(spec, **options)
    for _ in range(2):
        told = played(env)
        assert {len(seen) for row in told for seen in row["obs"]} == {env.get_obs_size()}
        assert {len(flags) for flags in env.get_avail_actions()} == {env.get_total_actions()}
        assert sum(row["reward"] for row in told) > 0
    env.close()
