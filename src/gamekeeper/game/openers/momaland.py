"""`momaland:mobeach_v0`: a MOMAland environment, its vector rewards made into sums of terms."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Sequence
from typing import Any, Final

from gamekeeper.game.openers import _family, _packages
from gamekeeper.game.opening.factory import find_factory
from gamekeeper.game.opening.opened import Source, api_of
from gamekeeper.game.shapes.vector_rewards import Scalarised, ScalarisedTurns

WORD: Final = "momaland"
SYNTAX: Final = "momaland:mobeach_v0"
ORDER: Final = _family.ORDER


def matches(spec: object) -> bool:
    """Whether it begins with `momaland:`."""
    return _family.rest(spec, WORD) is not None


def locate(spec: str, api: str | None) -> Source:
    """The environment, with its own arguments and two of ours.

    `objectives` names the components of its reward, in order (else `objective_0`, ...); `weights`
    are those by which they are summed (else 1 each).
    """
    name = _family.rest(spec, WORD) or ""
    envs = _packages.need(f"{WORD}.envs")
    homes = {
        info.name.rpartition(".")[2]: info.name
        for info in pkgutil.walk_packages(envs.__path__, f"{envs.__name__}.", onerror=_passed_over)
        if info.name.rpartition("_v")[2].isdigit()
    }
    if name not in homes:
        raise _family.unknown(name, "MOMAland", list(homes))
    module = importlib.import_module(homes[name])
    factory = find_factory(module, None, api, where=homes[name]).factory

    def build(
        *,
        objectives: Sequence[str] | None = None,
        weights: Sequence[float] | None = None,
        **kwargs: Any,
    ) -> object:
        env: Any = factory(**kwargs)
        kind = Scalarised if api_of(env) == "parallel" else ScalarisedTurns
        return kind(env, objectives, weights)

    return Source(
        kind=WORD,
        factory=build,
        spec=f"{WORD}:{name}",
        entry_point=f"{WORD}:{name}",
        pip="pip install momaland",
        facts=_packages.package_fact(WORD),
    )


def distrust(spec: str) -> str | None:
    """Why the package isn't the installed one; a name of one of its modules runs nothing else."""
    return _packages.distrust_package(WORD)


def _passed_over(package: str) -> None:
    """A package of MOMAland's whose own requirements aren't installed hides no other."""
