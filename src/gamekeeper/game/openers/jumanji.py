"""`jumanji:RobotWarehouse-v0`: one copy of a Jumanji environment."""

from __future__ import annotations

from typing import Any, Final

from gamekeeper.game.openers import _family, _packages
from gamekeeper.game.opening.opened import Source
from gamekeeper.game.shapes.jumanji import Jumanji

WORD: Final = "jumanji"
SYNTAX: Final = "jumanji:RobotWarehouse-v0"
ORDER: Final = _family.ORDER


def matches(spec: object) -> bool:
    """Whether it begins with `jumanji:`."""
    return _family.rest(spec, WORD) is not None


def locate(spec: str, api: str | None) -> Source:
    """The environment that `jumanji.make` knows under the id, with its keyword arguments."""
    name = _family.rest(spec, WORD) or ""
    package = _packages.need(WORD)
    known = list(package.registered_environments())
    if name not in known:
        raise _family.unknown(name, "Jumanji", known)

    def build(**kwargs: Any) -> Jumanji:
        return Jumanji(package.make(name, **kwargs), _packages.need("jax"), name=name)

    return Source(
        kind=WORD,
        factory=build,
        spec=f"{WORD}:{name}",
        entry_point=f"{WORD}:{name}",
        pip=f"pip install {WORD}",
        facts=_packages.package_fact(WORD),
    )


def distrust(spec: str) -> str | None:
    """Why the package isn't the installed one; a name in its registry runs nothing else."""
    return _packages.distrust_package(WORD)
