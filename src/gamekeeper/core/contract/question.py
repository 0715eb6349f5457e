"""Questions about an environment that its author answers in the contract."""

from __future__ import annotations

from dataclasses import dataclass

from gamekeeper.core.contract.places import path_text


@dataclass(frozen=True, slots=True)
class Question:
    """Asks for one declaration by the name of its key.

    Args:
        path: key path of the answer, as ("roles", "picker", "noop").
        ask: the question, as one sentence.
        answer: what the answer looks like, as `N` or `true | false`.
        hint: what the answer can be, as `N in 0 to 4`.
        lines: TOML lines to fill in, where the answer is more than one value.
    """

    path: tuple[str, ...]
    ask: str
    answer: str
    hint: str = ""
    lines: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """The key path as a reader types it: `roles.picker.noop`."""
        return path_text(self.path)

    def __str__(self) -> str:
        hint = f" ({self.hint})" if self.hint else ""
        return f"{self.ask} -> {self.key} = {self.answer}{hint}"
