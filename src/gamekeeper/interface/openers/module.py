"""`module:factory`: an importable module, installed or in the current folder."""

from types import ModuleType
from typing import Final

from gamekeeper.interface import foreign_openers
from gamekeeper.interface.construction import find_factory
from gamekeeper.interface.distributions import distrust_module
from gamekeeper.interface.env_source import NotHereError, Source
from gamekeeper.interface.modules import current_folder_last, load_module, within

SYNTAX: Final = "module:factory"
ORDER: Final = 90
CONTRACT: Final = ".toml"


def matches(spec: object) -> bool:
    """Tells whether it is a dotted name, with or without `:factory`."""
    if not isinstance(spec, str):
        return False
    module, colon, name = spec.partition(":")
    if (
        colon and module in foreign_openers.words()
    ):  # `jaxmarl:` and the like say whose environment it is
        return False
    parts = module.split(".") + (name.split(".") if colon else [])
    return all(part.isidentifier() for part in parts) and not module.endswith(".py")


def locate(spec: str, api: str | None) -> Source:
    """The factory in the module; the current folder is looked in too, after everything else."""
    name, _, factory = spec.partition(":")
    found = find_factory(_loaded(name), factory or None, api, where=name)
    return Source(
        kind="module",
        factory=found.factory if found.is_single else within(current_folder_last, found.factory),
        spec=f"{name}:{found.name}",
        entry_point=f"{name}:{found.name}",
        is_single=found.is_single,
    )


def _loaded(name: str) -> ModuleType:
    try:
        return load_module(name)
    except NotHereError as error:
        if not name.endswith(CONTRACT):
            raise
        raise NotHereError(
            "a contract alone is no environment",
            where=name,
            expected="what it is the contract of",
            actual="the name of a TOML file",
            fix=f"name the environment, and beside it --contract {name}",
        ) from error


def distrust(spec: str) -> str | None:
    """Reason why the module isn't known to hold environments: absent, or no such name in it."""
    name, _, factory = spec.partition(":")
    return distrust_module(name, factory)
