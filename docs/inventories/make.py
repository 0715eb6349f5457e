"""Writes the inventories that `docs/conf.py` names: `python docs/inventories/make.py`.

An inventory tells Sphinx where another project's page describes a name. Only names that our pages
refer to are listed; their places are those of the projects' published pages.
"""

from __future__ import annotations

import zlib
from pathlib import Path

NAMES = {
    "gymnasium": {
        "gymnasium.Env": "py:class 1 api/env/#$",
        "gymnasium.Space": "py:class 1 api/spaces/#gymnasium.spaces.Space",
        "gymnasium.spaces.Space": "py:class 1 api/spaces/#$",
        "gymnasium.vector.VectorEnv": "py:class 1 api/vector/#$",
    },
    "pettingzoo": {
        "pettingzoo.AECEnv": "py:class 1 api/aec/#pettingzoo.utils.env.AECEnv",
        "pettingzoo.ParallelEnv": "py:class 1 api/parallel/#pettingzoo.utils.env.ParallelEnv",
        "pettingzoo.utils.env.AECEnv": "py:class 1 api/aec/#$",
        "pettingzoo.utils.env.ParallelEnv": "py:class 1 api/parallel/#$",
    },
    "python": {
        "ValueError": "py:exception 1 library/exceptions.html#$",
        "pathlib.Path": "py:class 1 library/pathlib.html#$",
    },
}


def inventory(project: str, names: dict[str, str]) -> bytes:
    """An inventory of version 2, as Sphinx reads it."""
    head = (
        "# Sphinx inventory version 2\n"
        f"# Project: {project}\n"
        "# Version: \n"
        "# The remainder of this file is compressed using zlib.\n"
    )
    lines = "".join(f"{name} {place} -\n" for name, place in sorted(names.items()))
    return head.encode() + zlib.compress(lines.encode(), 9)


if __name__ == "__main__":
    for project, names in NAMES.items():
        Path(__file__).with_name(f"{project}.inv").write_bytes(inventory(project, names))
