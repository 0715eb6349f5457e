"""BenchMARL's experiments run over every kind of space that its adapter takes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from gamekeeper.errors import SpecError
from tests.adapters import kinds
from tests.adapters.test_benchmarl import one_thread, pytestmark, ran  # noqa: F401  # a fixture, and the marks

REFUSED = {
    ("done", done): "no algorithm" for done in ("MultiDiscrete", "MultiBinary", "Dict", "Tuple")
}


@pytest.mark.parametrize("spec", [kinds.HERE, kinds.TURNS], ids=["parallel", "aec"])
@pytest.mark.parametrize("kind", kinds.EACH, ids=kinds.name)
def test_experiment_runs_on_every_kind_of_space(
    kind: dict[str, Any], spec: str, tmp_path: Path
) -> None:
    """Two batches, each learnt from; vectors of actions for agents that act at once."""
    from benchmarl import algorithms

    is_continuous = kind.get("done") == "Box"
    algorithm = algorithms.MaddpgConfig if is_continuous else algorithms.IppoConfig
    options = {"env_kwargs": kind, **kinds.cast(kind)}
    says = kinds.refusal(kind, REFUSED)
    if is_continuous and spec == kinds.TURNS:
        says = "who then act at once"
    if says is not None:
        with pytest.raises(SpecError, match=says):
            ran(algorithm, spec, tmp_path, **options)
        return
    assert ran(algorithm, spec, tmp_path, **options).total_frames == 160
