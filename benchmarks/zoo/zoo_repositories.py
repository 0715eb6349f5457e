"""Opens public repositories, which lie in the folder ZOO_REPOSITORIES as `owner+name`."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path
from typing import Any


def older(module: str, factory: str, **kwargs: Any) -> Any:
    """Calls a factory written for PettingZoo 1.24 or older.

    `pettingzoo.utils.agent_selector` was the class there; today it is the module that holds it.
    """
    import pettingzoo.utils

    pettingzoo.utils.agent_selector = pettingzoo.utils.AgentSelector  # type: ignore[assignment,misc]
    return getattr(importlib.import_module(module), factory)(**kwargs)


def of_repository(repository: str, module: str, factory: str, **kwargs: Any) -> Any:
    """Calls a factory of a repository that lies in the folder ZOO_REPOSITORIES as `owner+name`."""
    folder, _, inner = repository.partition(":")
    path = Path(os.environ["ZOO_REPOSITORIES"], folder, inner)
    if str(path) not in sys.path:
        sys.path.insert(0, str(path))
    return older(module, factory, **kwargs)


def inside_repository(repository: str, module: str, factory: str, **kwargs: Any) -> Any:
    """The same for one that reads files from the directory that it is run in."""
    os.chdir(Path(os.environ["ZOO_REPOSITORIES"], repository.partition(":")[0]))
    return of_repository(repository, module, factory, **kwargs)


def inner_module(repository: str, inner: str, module: str) -> Any:
    """A module of a repository whose packages lie in a folder of it, and are read from its root."""
    root = Path(os.environ["ZOO_REPOSITORIES"], repository)
    os.chdir(root)
    sys.path.insert(0, str(root / inner))
    return importlib.import_module(module)
