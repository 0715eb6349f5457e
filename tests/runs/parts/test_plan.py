import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.errors import EvidenceError, RunError
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.executors.task import KEY
from gamekeeper.rollouts.rollout_plan import MOST_EPISODES, PARTS, RolloutPlan
from gamekeeper.runs.parts.part_plan import FOLDER, claim, is_free, key_of, release
from tests.runs.parts.here import plan


@given(st.integers(1, 100_000))
def test_ranges_cover_every_episode_once_in_order(episodes: int) -> None:
    """Parts follow one another without gap or overlap, and their keys sort as they do."""
    ranges = list(plan(episodes=episodes).ranges())
    assert ranges[0].start == 0
    assert ranges[-1].stop == episodes
    assert all(a.stop == b.start for a, b in pairwise(ranges))
    assert all(1 <= len(each) <= MOST_EPISODES for each in ranges)
    assert len(ranges) <= max(PARTS, -(-episodes // MOST_EPISODES))
    keys = [key_of(each) for each in ranges]
    assert keys == sorted(set(keys))
    assert all(KEY.fullmatch(key) for key in keys)


def test_plan_crosses_with_its_very_arguments() -> None:
    """Tuples, arrays and numbers of NumPy are what they were once they have crossed as JSON."""
    wanted = plan(
        env_kwargs={"size": (2, 3), "at": np.float32(0.1)},
        options={"mask": np.arange(3, dtype=np.int8)},
    )
    back = RolloutPlan.from_json(json.loads(json.dumps(wanted.to_json())))
    assert back.env_kwargs == wanted.env_kwargs
    assert isinstance(back.env_kwargs["at"], np.float32)
    assert back.options is not None
    assert back.options["mask"].dtype == np.int8
    whole = replace(wanted, options=None, policies={"*": "random"})  # as it crosses
    assert replace(back, options=None) == whole
    with pytest.raises(EvidenceError, match="no text can build again"):
        plan(env_kwargs={"rules": object()}).to_json()


def test_storage_belongs_to_one_plan(tmp_path: Path) -> None:
    """The same plan finds its parts; another is told what differs; then it is free again."""
    storage = Storage.at(tmp_path / "parts")
    assert not claim(storage, plan())
    storage.put(f"{FOLDER}/x.json", b"{}")
    assert claim(storage, plan())
    assert is_free(storage, plan())
    assert not is_free(storage, plan(seed=4))
    with pytest.raises(RunError, match="another recording") as caught:
        claim(storage, plan(seed=4))
    assert caught.value.actual == "seed: 3"
    assert "take these parts away" in caught.value.fix
    release(storage)
    assert not (tmp_path / "parts").exists()
    assert not claim(storage, plan(seed=4))


def test_contract_counts_by_what_it_says(tmp_path: Path) -> None:
    """Parts played under an earlier text of a contract aren't this recording's."""
    file, storage = tmp_path / "c.toml", Storage.at(tmp_path / "parts")
    file.write_text('name = "a"')
    claim(storage, plan(contract=str(file)))
    file.write_text('name = "b"')
    with pytest.raises(RunError, match="another recording") as caught:
        claim(storage, plan(contract=str(file)))
    assert caught.value.actual.startswith("contract_digest")


def test_parts_without_a_plan_are_left_alone(tmp_path: Path) -> None:
    """What lies under `parts` in a place that isn't ours is neither taken nor deleted."""
    storage = Storage.at(tmp_path)
    storage.put("parts/mine.txt", b"keep")
    with pytest.raises(RunError, match="without their plan"):
        claim(storage, plan())
    assert storage.get("parts/mine.txt") == b"keep"
