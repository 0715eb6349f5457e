"""A replay runs nothing that a manifest names unless the user allows it, and believes no claim."""

from pathlib import Path
from typing import Any

import pytest

from gamekeeper.errors import RunError, TrustError
from gamekeeper.runs.comparison import replay
from tests.runs.finalize_again import finalize_again
from tests.runs.plays import played, replayed

pytestmark = pytest.mark.usefixtures("nothing_is_ours")


def test_replay_asks_before_it_runs_a_file(tmp_path: Path) -> None:
    """Code outside the installed packages runs only where the user allows it."""
    played(tmp_path, ("TURNS = 5", "TURNS = 5\nopen(__file__ + '.ran', 'a').close()"))
    ran = tmp_path / "walks.py.ran"
    ran.unlink()

    with pytest.raises(TrustError, match="file outside the installed packages"):
        replay(tmp_path / "run")
    assert not ran.exists()


def test_replay_never_runs_what_a_hostile_manifest_names(tmp_path: Path) -> None:
    """`os:system` under the name of an environment or of a policy is refused."""
    played(tmp_path)
    mark = tmp_path / "mark"
    hostile = {
        "kind": "module",
        "entry_point": "os:system",
        "api": "parallel",
        "name": "walk_v0",
        "kwargs": {"command": f"touch {mark}"},
        "versions": {},
        "source_digest": None,
    }
    finalize_again(tmp_path / "run", environment=hostile)

    with pytest.raises(TrustError):
        replay(tmp_path / "run")
    with pytest.raises(TrustError):
        replay(tmp_path / "run", policies=True)
    assert not mark.exists()


@pytest.mark.parametrize("environment", [None, [], "walk", {}, {"kind": 3}, {"kind": "id"}])
def test_replay_refuses_a_damaged_identity(tmp_path: Path, environment: Any) -> None:
    """An identity that no recorder wrote is refused as damaged or untrusted, whatever it is."""
    played(tmp_path, episodes=1)
    finalize_again(tmp_path / "run", environment=environment)

    with pytest.raises((RunError, TrustError)):
        replay(tmp_path / "run")


def test_replay_trusts_no_fingerprint_that_a_manifest_names(tmp_path: Path) -> None:
    """Rows that replay don't verify under a fingerprint that isn't theirs."""
    fingerprint = played(tmp_path).fingerprint
    finalize_again(tmp_path / "run", fingerprint="0" * 64)

    found = replayed(tmp_path / "run").divergence

    assert found is not None
    assert ("fingerprint", "0" * 64, fingerprint) == (found.field, found.recorded, found.replayed)
