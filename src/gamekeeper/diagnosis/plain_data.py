"""Results as plain data: every field by its name, whatever it holds as JSON has it."""

from collections.abc import Mapping
from typing import Any

from gamekeeper.episodes.plain_json import fields_json


class PlainData:
    """Frozen data whose JSON document has an entry for each of its fields."""

    __slots__ = ()

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return fields_json(self)


def frozen(value: Any) -> Any:
    """The same with tuples for lists, as frozen data holds them."""
    if isinstance(value, Mapping):
        return {key: frozen(each) for key, each in value.items()}
    return tuple(map(frozen, value)) if isinstance(value, list | tuple) else value
