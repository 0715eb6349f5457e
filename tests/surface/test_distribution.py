"""Wheel and sdist are built, whole, and work where nothing else of the clone is."""

import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

from tests.surface.sources import ROOT

SOURCE = ROOT / "src"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with both."""
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-d", str(folder)],
        cwd=ROOT,
        check=True,
        capture_output=True,
        timeout=300,
    )
    return folder


def test_wheel_works_in_an_empty_environment(built: Path, tmp_path: Path) -> None:
    """Installed alone, beside the packages that it requires, it answers from its own folder."""
    (wheel,) = built.glob("*.whl")
    venv.create(tmp_path / "empty", with_pip=True)
    python = tmp_path / "empty" / "bin" / "python"
    install = [python, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", wheel]
    subprocess.run(install, check=True, cwd=tmp_path, timeout=300)
    site = next((tmp_path / "empty" / "lib").glob("python*/site-packages"))
    (site / "required.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    code = "import gamekeeper.cli; print(gamekeeper.__file__)"
    done = subprocess.run(
        [python, "-c", code], check=True, cwd=tmp_path, capture_output=True, text=True
    )
    assert Path(done.stdout.strip()).is_relative_to(site)
    line = [tmp_path / "empty" / "bin" / "gamekeeper", "contract", "two_robot_line", "--json"]
    done = subprocess.run(line, check=True, cwd=tmp_path, capture_output=True, text=True)
    assert '"two_robot_line_v0"' in done.stdout  # with its contract, which is no Python file


def test_wheel_and_sdist_hold_every_file_of_the_package(built: Path) -> None:
    """Templates, contracts and pages come along."""
    kept = {
        path.relative_to(SOURCE).as_posix()
        for path in SOURCE.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        assert kept <= set(archive.namelist())
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {f"src/{name}" for name in kept} <= names
    assert {"README.md", "LICENSE", "pyproject.toml"} <= names


OLDER = """
import importlib, pkgutil
from gymnasium import spaces

def refused(cls, item):
    raise TypeError(f"{cls} is not a generic class")

for each in vars(spaces).values():
    if isinstance(each, type) and each is not spaces.Space:
        each.__class_getitem__ = classmethod(refused)
import gamekeeper
for info in pkgutil.walk_packages(gamekeeper.__path__, "gamekeeper."):
    try:
        importlib.import_module(info.name)
    except ImportError:
        continue  # an extra that isn't installed
"""


def test_package_is_imported_beside_an_older_gymnasium() -> None:
    """In Gymnasium 1.2, which RLlib pins, `MultiDiscrete[Any]` and its like can't be written."""
    done = subprocess.run([sys.executable, "-c", OLDER], capture_output=True, text=True)
    assert (done.returncode, done.stderr[-2_000:]) == (0, "")
