"""RLlib trains on every kind of space that its adapter takes; the rest is refused."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import pytest

from gamekeeper.errors import SpecError
from tests.adapters import kinds
from tests.adapters.rllib_books import config

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before torch: more threads only wait
os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")

pytestmark = [
    pytest.mark.trainer,
    # Foreign ones, by whose they are: Ray's and torch's own calls of what is deprecated.
    pytest.mark.filterwarnings("ignore::DeprecationWarning:ray"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:torch"),
    # RLlib registers its own environment with Gymnasium anew for each env runner.
    pytest.mark.filterwarnings("ignore:.*Overriding environment rllib-multi-agent:UserWarning"),
]
REFUSED = {("done", "MultiBinary"): "no distribution"}
BARE = {"Box"}
"""Observations that RLlib's networks read as they are."""


@pytest.fixture(scope="module", autouse=True)
def cluster() -> Iterator[None]:
    """Ray on one core, on this machine alone, stopped at the end."""
    import ray

    ray.init(
        num_cpus=1,
        include_dashboard=False,
        log_to_driver=False,
        logging_level="ERROR",
        _node_ip_address="127.0.0.1",
    )
    yield
    ray.shutdown()


@pytest.mark.parametrize("spec", [kinds.HERE, kinds.TURNS], ids=["parallel", "aec"])
@pytest.mark.parametrize("kind", kinds.EACH, ids=kinds.name)
def test_ppo_trains_on_every_kind_of_space(kind: dict[str, Any], spec: str) -> None:
    """An update on rows of numbers, then it plays; bare observations train or are refused."""
    from gamekeeper.adapters import rllib

    options = {"env_kwargs": kind, **kinds.cast(kind)}
    says = kinds.refusal(kind, REFUSED)
    for flatten in (True, False):
        is_read = flatten or kind.get("seen", "Box") in BARE
        if says is not None or not is_read:
            with pytest.raises(SpecError, match=says or "don't read such observations"):
                config(spec, flatten=flatten, **options)
            continue
        # RLlib's own look at an environment plays an action without regard to masks.
        asked = config(spec, flatten=flatten, **options).environment(disable_env_checking=True)
        algorithm = asked.build_algo()
        before = rllib.policy(algorithm).version
        algorithm.train()
        learnt = rllib.policy(algorithm)
        algorithm.stop()
        assert learnt.version != before
        kinds.plays(spec, kind, learnt)
