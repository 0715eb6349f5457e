"""What the turns of one tick pay together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from gamekeeper.game.authoring.verbs import AgentId
from gamekeeper.game.books import Books
from gamekeeper.game.capture.accounts import paid_others, pays_others

FEW: Final = 4  # agents: up to here adding every reward takes less than finding those that count
Totals = dict[Any, Any]


class TickRewards:
    """Adds up rewards, and reward terms where the environment keeps them, turn by turn."""

    def __init__(self, books: Any) -> None:
        """Takes where an AEC environment keeps its books."""
        self._books = books
        self._keeps_books = isinstance(books, Books)
        self.has_terms = isinstance(getattr(books, "terms", None), dict)
        self.terms: dict[Any, dict[str, float]] = {}

    def added(self, totals: Totals | None, actor: AgentId) -> Totals | None:
        """The totals with what the last turn paid; None where nothing has been paid yet."""
        books = self._books
        rewards = books.rewards
        if self.has_terms and books.terms:
            self._add_terms(books.terms)
        if self._keeps_books:
            paid = books.touched.paid
            if not paid:
                return totals
        else:
            paid = rewards
        if totals is None:
            return dict(rewards)
        if not self._keeps_books and len(rewards) > FEW:
            own = rewards.get(actor)
            if pays_others(rewards, own):
                paid = paid_others(rewards, actor)
            if own is not None:
                totals[actor] = totals[actor] + own if actor in totals else own
            if paid is rewards:
                return totals
        for agent in paid:
            totals[agent] = totals[agent] + rewards[agent] if agent in totals else rewards[agent]
        return totals

    def _add_terms(self, paid: Mapping[Any, Mapping[str, float]]) -> None:
        for agent, amounts in paid.items():
            sums = self.terms.setdefault(agent, {})
            for term, amount in amounts.items():
                sums[term] = sums.get(term, 0.0) + amount
