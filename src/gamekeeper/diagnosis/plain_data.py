"""Results as plain data: every field by its name, whatever it holds as JSON has it."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any


class PlainData:
    """Frozen data whose JSON document has an entry for each of its fields."""

    __slots__ = ()

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        every: Any = self
        return {each.name: plain(getattr(self, each.name)) for each in fields(every)}


def plain(value: Any) -> Any:
    """A value as JSON has it: lists for tuples, and the documents of results."""
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return value.to_json() if hasattr(value, "to_json") else value


def frozen(value: Any) -> Any:
    """The same with tuples for lists, as frozen data holds them."""
    if isinstance(value, Mapping):
        return {key: frozen(each) for key, each in value.items()}
    return tuple(map(frozen, value)) if isinstance(value, list | tuple) else value
