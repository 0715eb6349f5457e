"""`dm_control:cartpole/swingup`: a task of DeepMind's control suite, one agent, through Shimmy."""

from typing import Any, Final

from gamekeeper.errors import SpecError
from gamekeeper.foreign.gymnasium import guest_of
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.env_source import Source

WORD: Final = "dm_control"
SYNTAX: Final = "dm_control:cartpole/swingup"
ORDER: Final = foreign_openers.ORDER
matches: Final = foreign_openers.begins_with(WORD)
distrust: Final = foreign_openers.distrust_packages(WORD, "shimmy")

SOCCER: Final = "soccer"
PIP: Final = "shimmy dm-control imageio packaging"


def locate(spec: str, api: str | None) -> Source:
    """A task of a domain; keyword arguments are those of `suite.load`.

    Raises:
        DependencyError: a package is missing.
        SpecError: there is no such task, or it is the soccer, which Shimmy can't step: it
            hands a view of a dictionary on as actions, and no seed.
    """
    name = foreign_openers.rest(spec, WORD) or ""
    if name == SOCCER:
        raise SpecError(
            "soccer has no environment that can be stepped and seeded",
            where=spec,
            expected="a task of one agent",
            actual="Shimmy 2.0.1: hands a view of a dictionary on as actions, and no seed",
            fix="write a ParallelEnv around dm_control.locomotion.soccer",
        )
    foreign_openers.need(WORD, pip=PIP)
    return foreign_openers.source(WORD, name, _task(name), pip=PIP)


def _task(name: str) -> Any:
    suite = foreign_openers.need("dm_control.suite", pip=PIP)
    shimmy = foreign_openers.need("shimmy.dm_control_compatibility", pip=PIP)
    known = [f"{domain}/{task}" for domain, task in suite.ALL_TASKS]
    if name not in known:
        raise foreign_openers.unknown(name, "dm_control", known)

    def build(**kwargs: Any) -> object:
        domain, _, task = name.partition("/")
        env = suite.load(domain, task, **kwargs)
        return guest_of(shimmy.DmControlCompatibilityV0(env), name=name)

    return build
