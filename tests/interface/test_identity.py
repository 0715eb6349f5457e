"""Who an environment is, and opening it again by that."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.errors import SpecError
from gamekeeper.interface.distributions import version_of
from gamekeeper.interface.env_source import Opened
from gamekeeper.interface.opening import open_env, reopen
from tests.interface.toys import PARALLEL_TEXT

Write = Callable[..., str]


def identity(opened: Opened) -> dict[str, Any]:
    """The identity as evidence keeps it."""
    return json.loads(json.dumps(opened.identity))


def test_identity_names_versions_of_what_an_environment_needs() -> None:
    """Python, the frameworks, the owning distribution, and what that requires for this group."""
    versions = identity(open_env("sisl/pursuit-v5"))["versions"]
    assert {"python", "numpy", "gymnasium", "pettingzoo", "pygame-ce", "scipy"} <= set(versions)
    assert "chess" not in versions
    assert {"mpe2", "scipy"} <= set(identity(open_env("mpe2.simple_spread_v3"))["versions"])


def test_identity_says_nothing_of_this_machine_but_the_path_of_a_file(write: Write) -> None:
    """Two people with the same file in two places have the same identity but for the path."""
    one = identity(open_env(write(PARALLEL_TEXT, "here/field.py"), n=3))
    two = identity(open_env(write(PARALLEL_TEXT, "there/field.py"), n=3))
    assert one.pop("path") != two.pop("path")
    assert one == two
    assert (one["kind"], one["entry_point"], one["name"], one["kwargs"]) == (
        "file",
        "field.py:Pair",
        "pair_v0",
        {"n": 3},
    )


def test_identity_has_one_digest_whatever_the_factory(write: Write) -> None:
    """The digest is of the files that define the environment, whatever stands around it."""
    path = write(PARALLEL_TEXT + "env = Pair()\ndef make(): return Pair()\n")
    digests = {
        identity(open_env(f"{path}:{name}"))["source_digest"] for name in ("env", "make", "Pair")
    }
    digests.add(identity(open_env(path, api="aec"))["source_digest"])
    assert len(digests) == 1


@pytest.mark.parametrize(
    "spec",
    ["aec:sisl/pursuit-v5", "mpe2.simple_spread_v3", "aec:mpe2.simple_spread_v3:parallel_env"],
)
def test_reopen_opens_the_same_environment_again(spec: str) -> None:
    """What evidence keeps of an environment is enough to open it with its arguments and its API."""
    opened = open_env(spec, max_cycles=7)
    again = reopen(identity(opened))
    assert (opened.spec, opened.api, opened.identity) == (again.spec, again.api, again.identity)


def test_reopen_keeps_arguments_that_arent_plain_json(write: Write) -> None:
    """Tuples stay tuples; an argument that is code can't come back, and is named."""
    path = write(PARALLEL_TEXT)
    assert reopen(identity(open_env(path, names=(1, 2)))).env.names == (1, 2)  # type: ignore[union-attr]
    with pytest.raises(SpecError, match="no text can build again"):
        reopen(identity(open_env(path, names=write)))


@pytest.mark.parametrize(
    "damage", [{}, {"entry_point": 3}, {"entry_point": "a.b:c", "api": "x"}, {"api": "aec"}]
)
def test_reopen_refuses_a_damaged_identity(damage: dict[str, Any]) -> None:
    """Evidence that lost its identity is told so."""
    with pytest.raises(SpecError, match="damaged"):
        reopen(damage)


def test_version_of_follows_what_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A package that is upgraded while the process lives has its new version in evidence."""
    monkeypatch.syspath_prepend(str(tmp_path))
    assert version_of("a-late-meadow") is None
    for version in ("1.0", "2.0"):
        folder = tmp_path / f"a_late_meadow-{version}.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: a-late-meadow\nVersion: {version}\n"
        )
        assert version_of("a-late-meadow") == version
        shutil.rmtree(folder)
    assert version_of("a-late-meadow") is None
