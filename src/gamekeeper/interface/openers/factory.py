"""A callable that builds the environment: a function, a class, a partial."""

from collections.abc import Callable
from typing import Final

from gamekeeper.interface.env_source import Source, api_of
from gamekeeper.interface.object_source import LostError, place_of

SYNTAX: Final = "a factory callable"
ORDER: Final = 10


def matches(spec: object) -> bool:
    """Tells whether it can be called and is no environment itself."""
    return callable(spec) and api_of(spec) is None


def locate(spec: Callable[..., object], api: str | None) -> Source:
    """A source of kind `module` or `file` where its name finds it again, of kind `factory` else."""
    name = getattr(spec, "__qualname__", "") or getattr(type(spec), "__qualname__", "")
    entry_point = f"{getattr(spec, '__module__', None) or '?'}:{name}"
    try:
        place = place_of(spec)
    except LostError as lost:
        return Source(
            kind="factory",
            factory=spec,
            spec=f"<factory {entry_point}>",
            entry_point=entry_point,
            facts={"lost": str(lost)},
        )
    path = {"path": place["path"]} if "path" in place else {}
    return Source(
        kind=place["kind"],
        factory=spec,
        spec=f"{place['path']}:{name}" if path else entry_point,
        entry_point=place["entry_point"],
        facts=path,
    )


def distrust(spec: object) -> str | None:
    """Always: a text can't name a callable of another process."""
    return "it was recorded from a factory in memory, which no text can find again"
