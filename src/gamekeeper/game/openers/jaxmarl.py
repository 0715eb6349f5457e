"""`jaxmarl:MPE_simple_spread_v3`: one copy of a JaxMARL environment."""

from __future__ import annotations

from typing import Any, Final

from gamekeeper.game.openers import _family, _packages
from gamekeeper.game.opening.opened import Source
from gamekeeper.game.shapes.jaxmarl import JaxMarl

WORD: Final = "jaxmarl"
SYNTAX: Final = "jaxmarl:MPE_simple_spread_v3"
ORDER: Final = _family.ORDER


def matches(spec: object) -> bool:
    """Whether it begins with `jaxmarl:`."""
    return _family.rest(spec, WORD) is not None


def locate(spec: str, api: str | None) -> Source:
    """The environment that `jaxmarl.make` knows under the name, with its keyword arguments."""
    name = _family.rest(spec, WORD) or ""
    package = _packages.need(WORD)
    known = list(getattr(package, "registered_envs", ()))
    if known and name not in known:
        raise _family.unknown(name, "JaxMARL", known)

    def build(**kwargs: Any) -> JaxMarl:
        return JaxMarl(package.make(name, **kwargs), _packages.need("jax"), name=name)

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
