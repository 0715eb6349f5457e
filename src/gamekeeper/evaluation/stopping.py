"""Playing until intervals are narrow enough."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gamekeeper.episodes.outcome import EACH, TEAM
from gamekeeper.errors import EvidenceError
from gamekeeper.evaluation.episode_rows import LENGTH, RETURN, ROLE, SUCCESS, Sheet
from gamekeeper.evaluation.inspection import Inspection
from gamekeeper.evaluation.matchups import Checkpoint
from gamekeeper.evaluation.spec import Spec
from gamekeeper.statistics.interval import FloatArray
from gamekeeper.statistics.narrowing import Narrowing


@dataclass(slots=True)
class Stopping:
    """Values so far, by environment and checkpoint.

    Attributes:
        seen: [episodes] figures, in the order of their numbers.
        rounds: number of times that the intervals were worked out.
    """

    spec: Spec
    inspections: Mapping[str, Inspection]
    seen: dict[tuple[str, Checkpoint], FloatArray] = field(default_factory=dict)
    rounds: int = 0

    @property
    def sequence(self) -> Narrowing:
        """The intervals: of shares bounded ones, of everything else those without bounds."""
        if self._stop.metric == SUCCESS:
            return Narrowing(least=0.0, most=1.0, level=self.spec.level)
        return Narrowing(level=self.spec.level)

    @property
    def _stop(self) -> Any:
        return self.spec.stop

    def take(self, environment: str, side: Checkpoint, sheet: Sheet) -> None:
        """Takes the next episodes of a checkpoint.

        Raises:
            EvidenceError: they have no such figure.
        """
        scope = self._scope(environment)
        sheet = replace(sheet, failed_return=self.spec.environments[environment].failed_return)
        values = sheet.values(self._stop.metric, scope, self._stop.who)
        if np.isnan(values).any():
            named = {RETURN, LENGTH, SUCCESS, *sheet.metrics(None, self.spec.infos)}
            raise EvidenceError(
                "an episode lacks the figure by which playing is to stop",
                where=f"stop, {environment}",
                expected=", ".join(sorted(named)),
                actual=f"{self._stop.metric} of {self._stop.who}",
                fix="name a figure that every episode has; one that broke off has none, unless "
                "failed_return says what it counts as",
            )
        before = self.seen.get((environment, side), np.empty(0))
        self.seen[environment, side] = np.concatenate([before, values])

    def is_enough(self) -> bool:
        """Tells whether every interval is narrow enough."""
        self.rounds += 1
        return all(
            row["width"] is not None and row["width"] <= self._stop.width
            for row in self.sequences()
        )

    def sequences(self) -> list[dict[str, Any]]:
        """The interval of each checkpoint as it stands."""
        return [
            {
                "environment": environment,
                "policy": side.policy,
                "run": side.run,
                **self._interval(values),
            }
            for (environment, side), values in self.seen.items()
        ]

    def _interval(self, values: FloatArray) -> dict[str, Any]:
        """An interval and its width; none before there are enough values for one."""
        try:
            found = self.sequence.interval(values)
        except EvidenceError:
            mean = float(values.mean())
            nothing = dict.fromkeys(("low", "high", "width", "method"))
            return {"n": len(values), "value": mean, **nothing}
        return {**found.to_json(), "width": found.high - found.low}

    def to_json(self, episodes: int) -> dict[str, Any]:
        """As the document has it."""
        stop, sequences = self._stop, self.sequences()
        widths = [row["width"] for row in sequences]
        return {
            "metric": stop.metric,
            "who": stop.who,
            "width": stop.width,
            "most": stop.most,
            "rounds": self.rounds,
            "episodes": episodes,
            "level": self.spec.level,
            "reached": all(width is not None and width <= stop.width for width in widths),
            "sequences": sequences,
        }

    def _scope(self, environment: str) -> str:
        who, inspection = self._stop.who, self.inspections[environment]
        if who == TEAM:
            return TEAM
        if who in inspection.role_names:
            return ROLE
        if who in inspection.roles:
            return EACH
        raise EvidenceError(
            "there is nobody of this name",
            where=f"stop.who, {environment}",
            expected=", ".join([TEAM, *inspection.role_names, *inspection.roles]),
            actual=who,
            fix="name the team, a role or an agent of this environment",
        )
