"""Questions about an environment that its author answers in the contract."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Question:
    """Asks for one declaration by the name of its key.

    Args:
        path: key path of the answer, as ("roles", "picker", "noop").
        ask: the question, as one sentence.
        answer: what the answer looks like, as `N` or `true | false`.
        lines: TOML lines to fill in, where the answer is more than one value.
    """

    path: tuple[str, ...]
    ask: str
    answer: str
    lines: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.ask} -> {'.'.join(self.path)} = {self.answer}"
