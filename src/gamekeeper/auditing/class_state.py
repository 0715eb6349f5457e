"""What the classes of an environment keep, put back before a rerun."""

import contextlib
import copy
from typing import Any

from gamekeeper.auditing.holds import kept_by_classes


class ClassState:
    """Attributes of the classes of an environment and its wrappers, as before any play.

    Default arguments of their functions are among them.
    """

    __slots__ = ("_values",)

    def __init__(self, env: Any) -> None:
        self._values: list[tuple[Any, str, Any]] = []
        for owner, name, value in kept_by_classes(env):
            with contextlib.suppress(Exception):  # what can't be copied stays as it is
                self._values.append((owner, name, copy.deepcopy(value)))

    def restore(self) -> None:
        """Puts copies of it back."""
        for owner, name, value in self._values:
            setattr(owner, name, copy.deepcopy(value))
