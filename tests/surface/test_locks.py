"""The lock files hold all that the project declares, each with its hashes, and no address."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.surface.sources import ROOT

TRAINERS = ROOT / "requirements" / "trainers"
LOCKS = ["base.txt", "test.txt", *(f"trainers/{path.name}" for path in TRAINERS.glob("*.txt"))]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = [
    text
    for extra, texts in PROJECT["optional-dependencies"].items()
    if extra != "cuda"  # only machines with a device install it
    and not (TRAINERS / f"{extra}.in").exists()  # has its own lock
    for text in texts
]


def locked(name: str) -> dict[str, set[str]]:
    """Version(s) of each package of a lock file."""
    pins: dict[str, set[str]] = {}
    for line in (ROOT / "requirements" / name).read_text(encoding="utf-8").splitlines():
        if match := re.match(r"([a-zA-Z0-9._-]+)(?:\[.*\])?==([^ ;]+)", line):
            pins.setdefault(canonicalize_name(match[1]), set()).add(match[2])
    return pins


def asked(path: Path) -> list[str]:
    """The requirements of an `.in` file."""
    lines = (line.split("#")[0].strip() for line in path.read_text(encoding="utf-8").splitlines())
    return [line for line in lines if line and not line.startswith("-")]


@pytest.mark.parametrize(
    ("lock", "texts"),
    [
        ("base.txt", PROJECT["dependencies"]),
        ("base.txt", asked(ROOT / "requirements" / "base.in")),
        ("test.txt", PROJECT["dependencies"] + EXTRAS),
        ("test.txt", asked(ROOT / "requirements" / "test.in")),
    ],
    ids=["dependencies", "base.in", "extras", "test.in"],
)
def test_lock_satisfies_what_is_declared(lock: str, texts: list[str]) -> None:
    """Every declared dependency is locked at a version that it allows; if not: `make lock`."""
    pins = locked(lock)
    for requirement in map(Requirement, texts):
        versions = pins.get(canonicalize_name(requirement.name), set())
        assert versions, f"{requirement} is not in {lock}"
        assert all(requirement.specifier.contains(v) for v in versions), (
            f"{requirement}: {versions}"
        )


def test_locks_agree() -> None:
    """The tests run on the versions that users of the demo get."""
    base, test = locked("base.txt"), locked("test.txt")
    assert {name: test.get(name) for name in base} == base


@pytest.mark.parametrize("lock", LOCKS)
def test_lock_holds_a_hash_for_every_package(lock: str) -> None:
    """Each file that pip fetches can be checked."""
    text = (ROOT / "requirements" / lock).read_text(encoding="utf-8")
    blocks = re.split(r"^(?=[a-zA-Z])", text, flags=re.M)[1:]
    assert [b.split()[0] for b in blocks if "--hash=sha256:" not in b] == []


@pytest.mark.parametrize("lock", LOCKS)
def test_lock_holds_no_address(lock: str) -> None:
    """Where packages come from is the machine's affair."""
    text = (ROOT / "requirements" / lock).read_text(encoding="utf-8")
    assert (
        re.findall(r"\w+://\S*|--(?:extra-index|index|find)\S* \S+", text.split("\n", 2)[2]) == []
    )
