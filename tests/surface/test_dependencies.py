"""What the package imports is declared, and what is declared is imported."""

import ast
import sys
import tomllib
from functools import cache

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.surface.sources import ROOT, imports, modules

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DISTRIBUTIONS = {  # of modules that are called otherwise than what brings them
    "PIL": "pillow",
    "stable_baselines3": "stable-baselines3",
    "sb3_contrib": "sb3-contrib",
    "rerun": "rerun-sdk",
    "tensordict": "torchrl",  # its own half
    "markupsafe": "jinja2",  # its own half
}
"""Modules by the declared package that brings them."""
UNIMPORTED = {
    "nvidia-cuda-nvrtc",  # libraries in C that numba-cuda loads
    "nvidia-nvvm",
    "numba-cuda",  # stands in for numba.cuda
    "cuda-core",  # imported by its name where a device is, as it ships no types
}
GUESTS = {"pytest", "IPython", "traitlets"}
"""Modules that are imported only where they are there already."""


@cache
def imported() -> dict[str, set[str]]:
    """Top-level modules of others that are imported anywhere in the package, with who does so."""
    found: dict[str, set[str]] = {}
    for module, path in modules().items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for _, name in imports(tree, module, is_package=path.name == "__init__.py"):
            top = name.split(".")[0]
            if top not in sys.stdlib_module_names and top != "gamekeeper":
                found.setdefault(top, set()).add(module)
    return found


def declared() -> set[str]:
    """Names of all packages in pyproject.toml, extras among them."""
    texts = list(PROJECT["dependencies"])
    for extra in PROJECT["optional-dependencies"].values():
        texts += extra
    return {canonicalize_name(Requirement(text).name) for text in texts}


def test_imports_are_declared() -> None:
    """No module of the package leans on what only another package happens to bring."""
    names = {
        canonicalize_name(DISTRIBUTIONS.get(name, name)) for name in imported().keys() - GUESTS
    }
    assert names - declared() == set()


def test_declared_packages_are_imported() -> None:
    """Nothing is installed for nobody."""
    names = {canonicalize_name(DISTRIBUTIONS.get(name, name)) for name in imported()}
    assert declared() - names - UNIMPORTED == set()
