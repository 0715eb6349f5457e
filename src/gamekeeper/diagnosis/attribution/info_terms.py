"""Reward terms in the infos of an environment that reports them nowhere else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isclose
from typing import Any

from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.outcome import plain_numbers


@dataclass(slots=True)
class InfoTerms:
    """Declared terms read from infos, step by step: fields of their names, also one level deeper.

    They count only where they sum to every reward that is paid: a field may have a term's name and
    hold something else, as a running total.

    Attributes:
        declared: names of the terms.
        found: those that stood in some info.
        is_unequal: some reward wasn't their sum.
    """

    declared: frozenset[str]
    found: set[str] = field(default_factory=set)
    is_unequal: bool = False

    @property
    def hold(self) -> bool:
        """Some were found, and every reward was their sum: those that weren't found were 0."""
        return bool(self.found) and not self.is_unequal

    def take(self, infos: Any, rewards: Mapping[str, float]) -> dict[str, dict[str, float]]:
        """Terms of one step, by agent.

        Args:
            infos: what agents were given after the step.
            rewards: what it paid them.
        """
        given = infos if isinstance(infos, Mapping) else {}
        terms = {agent_name(agent): self._terms(info) for agent, info in given.items()}
        for agent, reward in rewards.items():
            mine = terms.setdefault(agent, {})
            self.found.update(mine)
            if not isclose(sum(mine.values()), reward, rel_tol=1e-5, abs_tol=1e-6):
                self.is_unequal = True
        return terms

    def _terms(self, info: Any) -> dict[str, float]:
        nested = [each for each in info.values() if isinstance(each, Mapping)] if info else []
        found: dict[str, float] = {}
        for part in (*nested, info):
            numbers = plain_numbers(part)
            found.update({name: numbers[name] for name in self.declared & numbers.keys()})
        return found
