"""The tree of errors: every error that Gamekeeper raises on purpose.

GamekeeperError
├── SpecError (ValueError)          an environment can't be named, found or built
├── ContractError (ValueError)      a contract can't be read, or a declaration contradicts another
├── PolicyError (ValueError)        a policy can't be found, or its answer can't be used
├── ActionError (ValueError)        an action is outside its space, or from an agent not in turn
├── OrderError (AttributeError)     a call came before reset or after the end
├── EnvError (RuntimeError)         the environment raised, hung or died while Gamekeeper ran it
├── DrawError (ValueError)          a seed can't name random numbers, or nothing can be drawn
├── EvidenceError (ValueError)      evidence can't be written, read or trusted
│   └── BundleError (OSError)       the files of a bundle are missing, damaged or in the way
├── TrustError (PermissionError)    evidence asks for code that nobody allowed to run
└── DependencyError (ImportError)   a package of an extra isn't installed
"""

from __future__ import annotations


class GamekeeperError(Exception):
    """Says what went wrong, where, what was expected against seen, and how to mend it.

    Args:
        what: one sentence, without a full stop.
        where: file and line, trace and turn, or the name of an argument.
        expected: what would have been right.
        seen: what was there instead.
        mend: what the user can do about it.
    """

    def __init__(
        self, what: str, *, where: str = "", expected: str = "", seen: str = "", mend: str = ""
    ) -> None:
        self.what, self.where, self.expected, self.seen, self.mend = (
            what,
            where,
            expected,
            seen,
            mend,
        )
        places = [("where", where), ("expected", expected), ("seen", seen)]
        middle = "   ".join(f"{name}: {text}" for name, text in places if text)
        lines = [what, f"  {middle}" if middle else "", f"  mend: {mend}" if mend else ""]
        super().__init__("\n".join(line for line in lines if line))


class SpecError(GamekeeperError, ValueError):
    """An environment can't be named, found or built."""


class ContractError(GamekeeperError, ValueError):
    """A contract can't be read, or a declaration contradicts another."""


class PolicyError(GamekeeperError, ValueError):
    """A policy can't be found, or its answer can't be used."""


class ActionError(GamekeeperError, ValueError):
    """An action is outside its space, or comes from an agent that is not in turn."""


class OrderError(GamekeeperError, AttributeError):
    """A call came before `reset` or after the end."""


class EnvError(GamekeeperError, RuntimeError):
    """The environment raised, hung or died while Gamekeeper ran it."""


class DrawError(GamekeeperError, ValueError):
    """A seed can't name random numbers, or a draw has nothing to choose from."""


class EvidenceError(GamekeeperError, ValueError):
    """Evidence can't be written, read or trusted."""


class BundleError(EvidenceError, OSError):
    """The files of a bundle are missing, damaged or in the way."""


class TrustError(GamekeeperError, PermissionError):
    """Evidence asks for code that nobody allowed to run."""


class DependencyError(GamekeeperError, ImportError):
    """A package of an extra isn't installed."""
