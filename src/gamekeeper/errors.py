"""The tree of errors: every error that Gamekeeper raises on purpose.

GamekeeperError
├── SpecError (ValueError)          an environment can't be named, found or built
├── ContractError (ValueError)      a contract can't be read, or a declaration contradicts another
├── PolicyError (ValueError)        a policy can't be found, or its answer can't be used
├── ActionError (ValueError)        an action is outside its space, or from an agent not in turn
├── OrderError (AttributeError)     a call came before reset or after the end
├── EnvError (RuntimeError)         the environment raised, hung or died while Gamekeeper ran it
├── DrawError (ValueError)          a seed can't be used, or a random choice has no options
├── EvidenceError (ValueError)      evidence can't be written, read or trusted
│   ├── DivergenceError (ValueError) a run played again isn't what was recorded
│   └── RunError (OSError)          the files of a run are missing, damaged or in the way
├── TrustError (PermissionError)    a run names code that the user hasn't allowed
└── DependencyError (ImportError)   a package of an extra isn't installed
"""

from __future__ import annotations

import typing

if typing.TYPE_CHECKING:
    from collections.abc import Iterable


class GamekeeperError(Exception):
    """Names the failure, its place, the expected and the actual value, and a fix.

    Args:
        what: the failure in one sentence, without a full stop.
        where: file and line, episode and turn, or the name of an argument.
        expected: the right value.
        actual: the value that was found.
        fix: an action of the user that solves it.
    """

    def __init__(
        self, what: str, *, where: str = "", expected: str = "", actual: str = "", fix: str = ""
    ) -> None:
        self.what, self.where, self.fix = what, where, fix
        self.expected, self.actual = expected, actual
        places = [("where", where), ("expected", expected), ("actual", actual)]
        middle = "   ".join(f"{name}: {text}" for name, text in places if text)
        lines = [what, f"  {middle}" if middle else "", f"  fix: {fix}" if fix else ""]
        super().__init__("\n".join(line for line in lines if line))

    def parts(self) -> dict[str, str]:
        """The arguments that it was made of: `Other(**error.parts())` says the same."""
        names = ("what", "where", "expected", "actual", "fix")
        return {name: getattr(self, name) for name in names}

    def to_json(self) -> dict[str, str]:
        """Its parts and the name of its class, as documents have them under `error`."""
        return {"kind": type(self).__name__, **self.parts()}


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
    """A seed can't be used, or a random choice has no options."""


class EvidenceError(GamekeeperError, ValueError):
    """Evidence can't be written, read or trusted."""


class DivergenceError(EvidenceError, ValueError):
    """A run that was played again isn't what was recorded; `divergence` is the first difference."""

    divergence: typing.Any = None


class RunError(EvidenceError, OSError):
    """The files of a run are missing, damaged or in the way."""


class TrustError(GamekeeperError, PermissionError):
    """A run names code that the user hasn't allowed."""


class DependencyError(GamekeeperError, ImportError):
    """A package of an extra isn't installed."""


def check_choice(
    value: object,
    known: Iterable[str],
    what: str,
    *,
    where: str,
    error: type[GamekeeperError] = SpecError,
) -> None:
    """Refuses a value that isn't one of the known ones.

    Raises:
        GamekeeperError: of the class `error`, which says `what`.
    """
    choices = list(known)
    if value not in choices:
        expected = " or ".join(choices)
        raise error(
            what, where=where, expected=expected, actual=repr(value)[:200], fix="use one of these"
        )


def not_installed(
    error: ImportError, package: str, extra: str, where: str, more: str = ""
) -> DependencyError:
    """Error of a package of an extra that can't be imported; `more` follows the fix."""
    fix = f"pip install 'gamekeeper[{extra}]'{more}"
    return DependencyError(f"{package} isn't installed", where=where, actual=str(error), fix=fix)
