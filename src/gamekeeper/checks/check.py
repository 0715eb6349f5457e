"""Checks and their decorator: a check is a pure function with an id."""

import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

from gamekeeper import plugins
from gamekeeper.checks.case import Case, Cases
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.verdict import HIGH, LOW, MEDIUM, Severity
from gamekeeper.contract import Contract
from gamekeeper.errors import EvidenceError

__all__ = ["HIGH", "LOW", "MEDIUM", "Case", "Cases", "Check", "check", "checks", "selected"]

GROUP: Final = "gamekeeper.checks"
PACKAGE: Final = "gamekeeper.checks"
ID: Final = re.compile(r"[A-Z]{2,8}\d{3,4}")

Run: TypeAlias = Callable[[Contract, ProbeEvidence], Cases]
Applies: TypeAlias = Callable[[Contract, ProbeEvidence], str | None]
"""Reason why a check has no case to judge here; None where it has."""


@dataclass(frozen=True, slots=True)
class Check:
    """A promise, and the pure function that looks whether it was kept.

    Attributes:
        id: `GK402`; never used again for another promise. Third parties take their own prefix.
        name: the promise as a name, `rewards_stop_at_the_end`.
        claim: the promise in one sentence.
        about: why it matters, with a bad and a good example; Markdown.
        needs: probes whose looks it reads; *not exercised* where none of them could look.
        severity: how bad it is to break the promise.
        confidence: how sure a broken promise is, in (0, 1].
        fix: what the author can do about it.
        api: `aec` or `parallel` where it is about one of them only.
        applies: says why there is nothing to judge.
        looks_at: what an episode must have for a case, as a noun, for where none had it.
        doubt: how a rule of the environment may explain what is broken, so that it is only
            suspected, also where a reproducer shows it; empty: no rule does.
        run: yields a case for every look.
    """

    id: str
    name: str
    claim: str
    about: str
    needs: tuple[str, ...]
    severity: Severity
    confidence: float
    fix: str
    api: str | None
    applies: Applies | None
    run: Run
    looks_at: str = ""
    doubt: str = ""

    def reason_against(self, contract: Contract, evidence: ProbeEvidence) -> str | None:
        """Reason why it isn't applicable; None where it is."""
        if self.api is not None and evidence.api != self.api:
            return f"only {'AEC' if self.api == 'aec' else 'Parallel'} environments promise it"
        return None if self.applies is None else self.applies(contract, evidence)


def check(
    id: str,  # the word that everybody uses for it
    severity: Severity,
    *needs: str,
    confidence: float = 1.0,
    api: str | None = None,
    applies: Applies | None = None,
    looks_at: str = "",
    doubt: str = "",
) -> Callable[[Run], Check]:
    """Makes a check of a pure function; its docstring begins with the promise, and ends with a fix.

    The arguments are `Check`'s.
    """

    def made(run: Run) -> Check:
        promised, _, fix = inspect.cleandoc(run.__doc__ or "").partition("\n\nFix: ")
        claim, _, about = promised.partition("\n")
        if not claim or not fix or not ID.fullmatch(id):
            raise EvidenceError(
                f"{id!r} is no check",
                where=f"{run.__module__}:{run.__qualname__}",
                expected="an id like GK402, and a docstring: first the promise, last `Fix: ...`",
                fix="give the check an id of its own prefix and a docstring",
            )
        return Check(
            id=id,
            name=run.__name__,
            claim=claim.strip(),
            about=about.strip(),
            needs=needs,
            severity=severity,
            confidence=confidence,
            fix=" ".join(fix.split()),
            api=api,
            applies=applies,
            run=run,
            looks_at=looks_at,
            doubt=doubt,
        )

    return made


def checks() -> dict[str, Check]:
    """Every check by its id: built-in ones, then those of installed distributions.

    Raises:
        EvidenceError: two checks have one id.
    """
    found: dict[str, Check] = {}
    for origin, each in plugins.load(GROUP, PACKAGE).parts(Check):
        if found.setdefault(each.id, each) is not each:
            raise EvidenceError(
                f"two checks are called {each.id}", where=origin, fix="take a free number"
            )
    return dict(sorted(found.items()))


def selected(select: tuple[str, ...] = (), ignore: tuple[str, ...] = ()) -> dict[str, Check]:
    """The checks whose ids begin with one of `select` (all if empty) and none of `ignore`.

    Small letters are as good.

    Raises:
        EvidenceError: a text begins no check's id.
    """
    known = checks()
    select, ignore = (tuple(map(str.upper, texts)) for texts in (select, ignore))
    for text in (*select, *ignore):
        if not any(id.startswith(text) for id in known):
            raise EvidenceError(
                f"no check is called {text!r}",
                where="select" if text in select else "ignore",
                expected="an id like GK402, or how some ids begin, like GK4",
                fix="`gamekeeper list checks` shows them all",
            )
    return {
        id: each
        for id, each in known.items()
        if (not select or id.startswith(select)) and not (ignore and id.startswith(ignore))
    }
