"""`pogema:pogema_v0`: POGEMA's grids, built from the fields of its GridConfig."""

from __future__ import annotations

from typing import Any, Final

from gamekeeper.errors import SpecError
from gamekeeper.game.openers import _family, _packages
from gamekeeper.game.opening.opened import Source
from gamekeeper.game.shapes.pogema import Pogema

WORD: Final = "pogema"
SYNTAX: Final = "pogema:pogema_v0"
ORDER: Final = _family.ORDER

NAMES: Final = ("pogema_v0",)
KINDS: Final = {
    "finish": "Pogema",
    "nothing": "PogemaCoopFinish",
    "restart": "PogemaLifeLong",
}
"""Classes by what happens to agents on their target. Source: pogema.envs._make_pogema."""


def matches(spec: object) -> bool:
    """Whether it begins with `pogema:`."""
    return _family.rest(spec, WORD) is not None


def locate(spec: str, api: str | None) -> Source:
    """The grid; keyword arguments are GridConfig's fields (`size`, `num_agents`, `on_target`, ...).

    POGEMA's own lists are opened: its PettingZoo face, and its factory, ask Gymnasium for a way
    through wrappers that Gymnasium 1.0 took away.
    """
    name = _family.rest(spec, WORD) or ""
    package, envs = _packages.need(WORD), _packages.need(f"{WORD}.envs")
    if name not in NAMES:
        raise _family.unknown(name, "POGEMA", list(NAMES))

    def build(**kwargs: Any) -> Pogema:
        grid = package.GridConfig(**kwargs)
        kind = KINDS.get(grid.on_target)
        if kind is None:
            raise SpecError(
                "POGEMA has no such rule for agents on their target",
                where="on_target",
                expected=", ".join(KINDS),
                seen=repr(grid.on_target),
            )
        return Pogema(getattr(envs, kind)(grid_config=grid), name=name)

    return Source(
        kind=WORD,
        factory=build,
        spec=f"{WORD}:{name}",
        entry_point=f"{WORD}:{name}",
        accepts=package.GridConfig,
        pip=f"pip install {WORD}",
        facts=_packages.package_fact(WORD),
    )


def distrust(spec: str) -> str | None:
    """Why the package isn't the installed one; fields of a grid run nothing else."""
    return _packages.distrust_package(WORD)
