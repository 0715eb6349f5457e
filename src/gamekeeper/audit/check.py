"""What a check is, and how one is written: a decorator over a pure function."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, TypeAlias

from gamekeeper import plugins
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.occasion import Occasion
from gamekeeper.core.verdict import HIGH, LOW, MEDIUM, Severity
from gamekeeper.errors import EvidenceError

__all__ = ["HIGH", "LOW", "MEDIUM", "Check", "Occasion", "check", "checks", "selected"]

GROUP: Final = "gamekeeper.checks"
PACKAGE: Final = "gamekeeper.audit.checks"
ID: Final = re.compile(r"[A-Z]{2,8}\d{3,4}")

Run: TypeAlias = Callable[[Contract, Gathered], Iterator[Occasion]]
Applies: TypeAlias = Callable[[Contract, Gathered], str | None]
"""Why a check has nothing to judge here; None where it has."""


@dataclass(frozen=True, slots=True)
class Check:
    """A promise, and the pure function that looks whether it was kept.

    Attributes:
        id: `GK402`; never used again for another promise.
        name: the promise as a name, `rewards_stop_at_the_end`.
        claim: the promise in one sentence.
        about: why it matters, with a bad and a good example; Markdown.
        needs: probes whose looks it reads.
        severity: how bad it is to break the promise.
        confidence: how sure a broken promise is, in (0, 1].
        mend: what the author can do about it.
        api: `aec` or `parallel` where it is about one of them only.
        applies: says why there is nothing to judge.
        run: yields an occasion for every look.
    """

    id: str
    name: str
    claim: str
    about: str
    needs: tuple[str, ...]
    severity: Severity
    confidence: float
    mend: str
    api: str | None
    applies: Applies | None
    run: Run

    def reason_against(self, contract: Contract, evidence: Gathered) -> str | None:
        """Why it isn't applicable; None where it is."""
        if self.api is not None and evidence.api != self.api:
            return f"only {'AEC' if self.api == 'aec' else 'Parallel'} environments promise it"
        return None if self.applies is None else self.applies(contract, evidence)


def check(
    id: str,  # the word that everybody uses for it
    *,
    needs: tuple[str, ...],
    severity: Severity,
    mend: str,
    confidence: float = 1.0,
    api: str | None = None,
    applies: Applies | None = None,
) -> Callable[[Run], Check]:
    """Makes a check of a pure function; its docstring's first line is the promise.

    Args:
        id: such as `GK402`; third parties take a prefix of their own.
        needs: probes whose looks it reads; it is *unseen* where none of them could look.
        severity: how bad it is to break the promise.
        mend: what the author can do about it.
        confidence: how sure a broken promise is, in (0, 1].
        api: where it is about one API only.
        applies: why there is nothing to judge, or None.
    """

    def made(run: Run) -> Check:
        claim, _, about = inspect.cleandoc(run.__doc__ or "").partition("\n")
        if not claim or not ID.fullmatch(id):
            raise EvidenceError(
                f"{id!r} is no check",
                where=f"{run.__module__}:{run.__qualname__}",
                expected="an id like GK402, and a docstring whose first line is the promise",
            )
        return Check(
            id=id, name=run.__name__, claim=claim.strip(), about=about.strip(), needs=needs,
            severity=severity, confidence=confidence, mend=mend, api=api, applies=applies, run=run,
        )  # fmt: skip

    return made


def checks() -> dict[str, Check]:
    """Every check by its id: built-in ones, then those of installed distributions.

    Raises:
        EvidenceError: two checks have one id.
    """
    found: dict[str, Check] = {}
    for origin, part in plugins.load(GROUP, PACKAGE).found.items():
        own = [part] if isinstance(part, Check) else vars(part).values()
        for each in own:
            if not isinstance(each, Check):
                continue
            if found.setdefault(each.id, each) is not each:
                raise EvidenceError(
                    f"two checks are called {each.id}", where=origin, mend="take a free number"
                )
    return dict(sorted(found.items()))


def selected(select: tuple[str, ...] = (), ignore: tuple[str, ...] = ()) -> dict[str, Check]:
    """The checks whose ids begin with one of `select` (all if empty) and none of `ignore`.

    Raises:
        EvidenceError: a text begins no check's id.
    """
    known = checks()
    for text in (*select, *ignore):
        if not any(id.startswith(text) for id in known):
            raise EvidenceError(
                f"no check is called {text!r}",
                where="select" if text in select else "ignore",
                expected="an id like GK402, or how some ids begin, like GK4",
                mend="`gamekeeper list checks` shows them all",
            )
    return {
        id: each
        for id, each in known.items()
        if (not select or id.startswith(select)) and not (ignore and id.startswith(ignore))
    }
