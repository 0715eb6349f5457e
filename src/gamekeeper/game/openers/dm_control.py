"""`dm_control:cartpole/swingup`: a task of DeepMind's control suite, one agent, through Shimmy."""

from __future__ import annotations

from typing import Any, Final

from gamekeeper.errors import SpecError
from gamekeeper.game.openers import _family, _packages
from gamekeeper.game.opening.opened import Source
from gamekeeper.game.shapes.gymnasium import guest_of

WORD: Final = "dm_control"
SYNTAX: Final = "dm_control:cartpole/swingup"
ORDER: Final = _family.ORDER

SOCCER: Final = "soccer"
PIP: Final = "shimmy dm-control imageio packaging"


def matches(spec: object) -> bool:
    """Whether it begins with `dm_control:`."""
    return _family.rest(spec, WORD) is not None


def locate(spec: str, api: str | None) -> Source:
    """A task of a domain; keyword arguments are those of `suite.load`.

    Raises:
        DependencyError: a package is missing.
        SpecError: there is no such task, or it is the soccer, which Shimmy's face can't step: it
            hands a view of a dictionary on as actions, and no seed.
    """
    name = _family.rest(spec, WORD) or ""
    if name == SOCCER:
        raise SpecError(
            "soccer has no face that can be stepped and seeded",
            where=spec,
            expected="a task of one agent",
            seen="Shimmy 2.0.1: hands a view of a dictionary on as actions, and no seed",
            mend="write a ParallelEnv around dm_control.locomotion.soccer",
        )
    _packages.need(WORD, pip=PIP)
    return Source(
        kind=WORD,
        factory=_task(name),
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
        raise _family.unknown(name, "dm_control", known)

    def build(**kwargs: Any) -> object:
        domain, _, task = name.partition("/")
        env = suite.load(domain, task, **kwargs)
        return guest_of(shimmy.DmControlCompatibilityV0(env), name=name)

    return build
