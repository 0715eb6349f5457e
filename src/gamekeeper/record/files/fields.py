"""What the fields of a run's manifest may be, so that no reader meets another shape further on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import BundleError

SHOWN: Final = 80


def check_fields(manifest: Mapping[str, Any], path: Path) -> None:
    """Does nothing where every field that readers know is of the shape that they expect.

    A field that isn't there is none's fault: a run may be killed before it is known. One that isn't
    known is passed over: a newer writer may add it.

    Args:
        path: of the manifest, for the error.
    Raises:
        BundleError: a field is of another shape.
    """
    for name, (is_right, expected) in _FIELDS.items():
        value = manifest.get(name)
        if value is not None and not is_right(value):
            raise _wrong(path, name, expected, value)
    for name, expected, value in _inner(manifest):
        raise _wrong(path, name, expected, value)


def _inner(manifest: Mapping[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """What is of another shape within the environment and the spaces."""
    environment = manifest.get("environment") or {}
    for name in _OBJECTS:
        if not isinstance(environment.get(name), dict | None):
            yield f"environment.{name}", "an object", environment[name]
    for name in _TEXTS:
        if not isinstance(environment.get(name), str | None):
            yield f"environment.{name}", "a text", environment[name]
    for agent, pair in (manifest.get("spaces") or {}).items():
        if not isinstance(pair, dict):
            yield f"spaces.{agent}", "an object", pair
            continue
        for name in ("observation", "action"):
            if not isinstance(pair.get(name), dict | None):
                yield f"spaces.{agent}.{name}", "a space", pair[name]


def _is_texts(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(each, str) for each in value)


def _is_object(value: object) -> bool:
    return isinstance(value, dict)


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_whole(value: object) -> bool:
    return type(value) is int and abs(value) < 1 << 127


_OBJECTS: Final = ("imported", "kwargs", "versions")
_TEXTS: Final = ("api", "entry_point", "kind", "name", "path", "source_digest")
_FIELDS: Final[Mapping[str, tuple[Callable[[object], bool], str]]] = {
    "agents": (_is_texts, "a list of names"),
    "contract": (_is_object, "an object"),
    "environment": (_is_object, "an object"),
    "fingerprint": (_is_text, "a text"),
    "info_fingerprint": (_is_text, "a text"),
    "level": (_is_text, "a text"),
    "seed": (_is_whole, "a whole number"),
    "spaces": (_is_object, "an object"),
    "state_space": (_is_object, "a space"),
    "terms": (_is_texts, "a list of names"),
}


def _wrong(path: Path, name: str, expected: str, value: object) -> BundleError:
    return BundleError(
        f"{path.name} is damaged: {name} can't be that",
        where=f"{path}, {name}"[:300],
        expected=expected,
        seen=repr(value)[:SHOWN],
        mend="restore the file from a copy, or record the run again",
    )
