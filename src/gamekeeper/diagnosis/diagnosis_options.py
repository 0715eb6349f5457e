"""Settings of a diagnosis, as `gk.diagnose` takes them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.arms import ArmRunner
from gamekeeper.errors import EvidenceError
from gamekeeper.rollouts.executors.task import Executor

NOTES: Final = "outcomes.jsonl"


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagnosisOptions:
    """Settings of a diagnosis; `gk.diagnose` says what each means."""

    failed: str | None
    contract: Contract | str | PathLike[str] | None
    env: object | None
    policies: Mapping[str, Any] | None
    replace: Mapping[str, Any] | None
    expected: float
    part: float
    seed: int
    episodes: int
    budget: int | None
    perturbations: bool | None
    workers: int | Executor
    folder: Path | None
    allow_import: bool
    timeout_s: float | None
    on_message: Callable[[dict[str, Any]], None] | None

    def runner(
        self, contract: Contract, head: Mapping[str, Any], longest: int, *, least: int
    ) -> ArmRunner:
        """Player of arms, with the notes of this experiment.

        Args:
            head: what the notes have to begin with, beside the seed.
            longest: env steps of the longest recorded episode.
            least: episodes without which there is no answer.
        Raises:
            EvidenceError: it is too small.
        """
        if self.budget is not None and self.budget < least * longest:
            raise EvidenceError(
                f"{self.budget:,} env steps are too few for a diagnosis",
                where="budget",
                expected=f"{least * longest:,} or more: {least} episodes as long as the longest",
                actual=f"{self.budget:,}",
                fix="raise it (budget=, --budget)",
            )
        return ArmRunner(
            contract,
            workers=self.workers,
            on_message=self.on_message,
            silence_s=self.timeout_s,
            notes=None if self.folder is None else self.folder / NOTES,
            head={**head, "seed": self.seed},
            longest=longest,
            most=self.episodes,
            budget=self.budget,
        )

    @property
    def goes_on(self) -> str:
        """Tells what becomes of what was played, if it is interrupted."""
        if self.folder is None:
            return "nothing was kept; with an output folder the next call would go on"
        return f"what was played stays in {self.folder}; the same command goes on from there"
