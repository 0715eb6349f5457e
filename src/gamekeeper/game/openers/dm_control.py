"""`dm_control:cartpole/swingup`: DeepMind's control suite, one agent, or its soccer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from gamekeeper.errors import SpecError
from gamekeeper.game.opened import Source
from gamekeeper.game.openers import _family, _packages
from gamekeeper.game.shapes.gymnasium import guest_of

WORD: Final = "dm_control"
SYNTAX: Final = "dm_control:cartpole/swingup, or dm_control:soccer"
ORDER: Final = _family.ORDER

SOCCER: Final = "soccer"
PIP: Final = "shimmy dm-control imageio packaging"


def matches(spec: object) -> bool:
    """Whether it begins with `dm_control:`."""
    return _family.rest(spec, WORD) is not None


def locate(spec: str, api: str | None) -> Source:
    """A task of a domain, or soccer; arguments are those of `suite.load`, or of Shimmy's soccer."""
    name = _family.rest(spec, WORD) or ""
    _packages.need(WORD, pip=PIP)
    return Source(
        kind=WORD,
        factory=_soccer() if name == SOCCER else _task(name),
        spec=f"{WORD}:{name}",
        entry_point=f"{WORD}:{name}",
        pip=f"pip install {PIP}",
        facts=_packages.package_fact(WORD),
    )


def distrust(spec: str) -> str | None:
    """Why the packages aren't the installed ones; a task's name runs nothing else."""
    return _packages.distrust_package(WORD) or _packages.distrust_package("shimmy")


def _task(name: str) -> Any:
    suite = _packages.need("dm_control.suite", pip=PIP)
    shimmy = _packages.need("shimmy.dm_control_compatibility", pip=PIP)
    known = [f"{domain}/{task}" for domain, task in suite.ALL_TASKS]
    if name not in known:
        raise _family.unknown(name, "dm_control", [*known, SOCCER])

    def build(**kwargs: Any) -> object:
        domain, _, task = name.partition("/")
        env = suite.load(domain, task, **kwargs)
        return guest_of(shimmy.DmControlCompatibilityV0(env), name=name)

    return build


def _soccer() -> Any:
    shimmy = _packages.need("shimmy.dm_control_multiagent_compatibility", pip=PIP)

    def build(**kwargs: Any) -> object:
        arguments: Mapping[str, Any] = kwargs or {"team_size": 2}
        if not isinstance(arguments.get("team_size", 2), int):
            raise SpecError(
                "a team has no whole number of players",
                where="team_size",
                seen=repr(arguments["team_size"]),
            )
        return shimmy.DmControlMultiAgentCompatibilityV0(**arguments)

    return build
