"""Installed distributions: the one that a module belongs to, found without importing it."""

import importlib.util
import inspect
import json
import re
import sys
from functools import lru_cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution, distributions
from pathlib import Path
from typing import Final
from urllib.parse import urlparse
from urllib.request import url2pathname

from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.errors import SpecError
from gamekeeper.interface.construction import foreign
from gamekeeper.interface.modules import imported
from gamekeeper.plugins import Installed, installed

FACTORY_NAMES: Final = frozenset({"env", "parallel_env", "raw_env"})
"""Names of factories in PettingZoo's packages; these names need no look into the module."""

_REQUIREMENT: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_EXTRA: Final = re.compile(r"""extra\s*==\s*['"]([^'"]+)['"]""")


def owner_of(module: str) -> Distribution | None:
    """The distribution that installed a module; None for stdlib, loose files and namespaces."""
    top = module.partition(".")[0]
    if top in sys.stdlib_module_names or top == "__main__" or not top.isidentifier():
        return None
    return _owner(top, installed())


def version_of(name: str) -> str | None:
    """The version of an installed distribution; None where there is none of this name."""
    return _version(name, installed())


def requirements(owner: Distribution, extra: str = "") -> dict[str, str]:
    """Versions of what is installed of a distribution's requirements, plain and of one extra."""
    found: dict[str, str] = {}
    for line in _needs(owner, installed()):
        name, extras = _REQUIREMENT.match(line), _EXTRA.findall(line)
        if name is None or (extras and extra not in extras):
            continue
        version = version_of(name[0])
        if version is not None:
            found[normal_name(name[0])] = version
    return found


def normal_name(name: str) -> str:
    """A distribution's name in its one normal spelling.

    Source: packaging.python.org, "Names and normalization".
    """
    return re.sub(r"[-_.]+", "-", name).lower()


def distrust_module(module: str, factory: str) -> str | None:
    """Reason why evidence from elsewhere may not have `module:factory` opened, or None.

    It may where the module stands in an installed distribution (an editable one too) that itself
    requires PettingZoo, and the factory is called as PettingZoo's packages call theirs, or is a
    class derived from AECEnv or ParallelEnv. Only for the last question is the module imported, and
    never before the others are answered: `os:system` gets no further than its first word.
    """
    top = module.partition(".")[0]
    owner = owner_of(top)
    if owner is None or not _is_found_there(top, owner):
        return f"the module {module} belongs to no installed distribution"
    needs = {normal_name(m[0]) for line in owner.requires or () if (m := _REQUIREMENT.match(line))}
    if "pettingzoo" not in {*needs, normal_name(owner.name)}:
        return f"{module} belongs to {owner.name}, which doesn't require pettingzoo"
    if "__main__" in module.split("."):
        return f"{module} is a program"
    return None if factory in FACTORY_NAMES else _distrust_name(module, factory)


def _distrust_name(module: str, factory: str) -> str | None:
    try:
        with foreign(f"importing {module}", where=module):
            value = getattr(imported(module), factory, None)
    except SpecError as error:
        return error.what
    if inspect.isclass(value) and issubclass(value, AECEnv | ParallelEnv):
        return None
    usual = ", ".join(sorted(FACTORY_NAMES))
    return f"{module}:{factory} is neither called {usual} nor a class of PettingZoo environments"


def _is_found_there(top: str, owner: Distribution) -> bool:
    """Tells whether importing `top` takes the distribution's files, not a namesake before them."""
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        return False
    if spec is None or spec.origin is None:
        return False
    if Path(str(owner.locate_file(""))).resolve() == Path.cwd():
        return False  # a folder full of evidence may hold what looks like an installation
    origin = Path(spec.origin).resolve()
    editable = _editable_folder(owner)
    if editable is not None:
        return origin.is_relative_to(editable)
    return any(
        Path(str(owner.locate_file(file))).resolve() == origin
        for file in owner.files or ()
        if file.name == origin.name and len(file.parts) <= 2
    )


def _editable_folder(owner: Distribution) -> Path | None:
    # Source: packaging.python.org, "Recording the Direct URL Origin of installed distributions".
    try:
        record = json.loads(owner.read_text("direct_url.json") or "{}")
        if record.get("dir_info", {}).get("editable") is True:
            return Path(url2pathname(urlparse(record["url"]).path)).resolve()
    except (ValueError, KeyError, AttributeError, TypeError):
        pass
    return None


@lru_cache(maxsize=64)
def _owner(top: str, there: Installed) -> Distribution | None:
    try:
        same_name = distribution(top)
        if top in _top_levels(same_name):
            return same_name
    except (PackageNotFoundError, ValueError):
        pass
    # Reads the records of everything installed: only where names differ.
    owners = {each.name for each in distributions() if _provides(each, top)}
    return distribution(owners.pop()) if len(owners) == 1 else None


@lru_cache(maxsize=256)
def _version(name: str, there: Installed) -> str | None:
    try:
        return distribution(name).version
    except PackageNotFoundError:
        return None


@lru_cache(maxsize=64)
def _needs(owner: Distribution, there: Installed) -> tuple[str, ...]:
    return tuple(owner.requires or ())


def _provides(each: Distribution, top: str) -> bool:
    """Tells whether a distribution has a module of Python code of this name at its top.

    Its record is searched as text, as a path object for each of ten thousand lines takes longer
    than opening an environment.
    """
    record = None if each.read_text("top_level.txt") else each.read_text("RECORD")
    if record is None:
        return top in _top_levels(each)
    return re.search(rf"^{re.escape(top)}(/[^,\n]*)?\.py,", record, re.M) is not None


def _top_levels(owner: Distribution) -> set[str]:
    text = owner.read_text("top_level.txt")
    if text:
        return set(text.split())
    return {file.parts[0].removesuffix(".py") for file in owner.files or ()}
