"""Running foreign code to find and build environments: prints to stderr, failures told in full."""

from __future__ import annotations

import contextlib
import copy
import difflib
import functools
import importlib
import inspect
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, cast

import gymnasium

from gamekeeper.errors import GamekeeperError, SpecError
from gamekeeper.game.opening.opened import Env, Source, api_of

MOST_FRAMES: Final = 20
"""A traceback's innermost frames that a message shows; an endless recursion has a thousand."""

_PASSAGES: Final = (str(Path(__file__).parents[2]), "<frozen importlib", importlib.__file__)
"""Files whose frames only lead to the foreign code."""


@contextlib.contextmanager
def foreign(doing: str, *, where: str, pip: str = "") -> Iterator[None]:
    """Foreign code runs in here: what it prints goes to stderr, what it raises becomes a SpecError.

    Ctrl-C passes. `sys.exit()` does not: opening an environment is no place to end the process.

    Args:
        doing: what goes on, for the message: "importing farm.envs".
        where: the spec as it was typed.
        pip: what to install if a package is missing.

    Raises:
        SpecError: the code raised; with its traceback as text and as `__cause__`.
    """
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    except (GamekeeperError, KeyboardInterrupt):
        raise
    except (
        BaseException
    ) as error:  # also SystemExit and what test runners derive from BaseException
        said = said_by(error)
        raise SpecError(
            f"{doing} raised {said}",
            where=where,
            seen=f"\n{foreign_traceback(error)}",
            mend=_mend(error, pip),
        ) from error


def said_by(error: BaseException) -> str:
    """The type and text of an exception in one line, also where its own `__str__` raises."""
    return traceback.format_exception_only(error)[-1].strip()


def foreign_traceback(error: BaseException) -> str:
    """The traceback as text, without frames of ours and of the import machinery."""
    told = traceback.TracebackException.from_exception(error, limit=-MOST_FRAMES)
    told.stack = traceback.StackSummary.from_list(
        [frame for frame in told.stack if not frame.filename.startswith(_PASSAGES)]
    )
    return "".join(told.format()).rstrip()


def _mend(error: BaseException, pip: str) -> str:
    if isinstance(error, ModuleNotFoundError) and error.name:
        line = pip or f"pip install {error.name.partition('.')[0]}"
        return f"install what provides the module '{error.name}': {line}"
    if isinstance(error, ImportError) and pip:
        return pip
    return ""


def build(source: Source, kwargs: Mapping[str, Any]) -> Env:
    """One new instance from a source's factory, with copies of the keyword arguments.

    Raises:
        SpecError: the arguments don't fit, the factory raised, or what it returned is no PettingZoo
            environment.
    """
    _check_arguments(source, kwargs)
    try:
        given = copy.deepcopy(dict(kwargs))
    except (
        Exception
    ):  # some arguments can't be copied (an open window); then they are shared, as they came
        given = dict(kwargs)
    with foreign(f"building {source.spec}", where=source.spec, pip=source.pip):
        try:
            env = source.factory(**given)
        except TypeError as error:
            refused = _refused(error, source, kwargs)
            if refused is None:
                raise
            raise refused from error
    if api_of(env) is None:
        raise _no_env(env, source)
    return cast("Env", env)


def nearest(name: str, names: Iterable[str]) -> str:
    """A clause naming the likeliest of what is there, or nothing: `; the nearest is 'make'`."""
    close = difflib.get_close_matches(name, list(names), n=3, cutoff=0.6)
    quoted = ", ".join(repr(other) for other in close)
    return f"; the nearest {'is' if len(close) == 1 else 'are'} {quoted}" if close else ""


def _check_arguments(source: Source, kwargs: Mapping[str, Any]) -> None:
    target = source.accepts or source.factory
    try:
        signature = inspect.signature(target)
    except (
        TypeError,
        ValueError,
    ):  # some builtins and extension types have none; calling will tell
        return
    try:
        signature.bind(**kwargs)
    except TypeError as error:
        names = list(signature.parameters)
        unknown = "".join(nearest(name, names) for name in kwargs if name not in names)
        raise SpecError(
            f"the arguments don't fit {source.spec}: {error}{unknown}",
            where="keyword arguments",
            expected=f"{_called(target)}{signature}",
            seen=", ".join(f"{name}={value!r}"[:80] for name, value in kwargs.items()) or "none",
            mend="name only arguments that the factory takes, and all that it needs",
        ) from None


def _refused(error: TypeError, source: Source, kwargs: Mapping[str, Any]) -> SpecError | None:
    # PettingZoo's own factories take **kwargs and pass them on: the refusal comes from further in.
    text = str(error)
    named = [name for name in kwargs if f"unexpected keyword argument '{name}'" in text]
    if not named:
        return None
    return SpecError(
        f"the arguments don't fit {source.spec}: {text}",
        where="keyword arguments",
        expected=_innermost_signature(error),
        seen=f"{named[0]}={kwargs[named[0]]!r}"[:80],
        mend="name only arguments that the factory takes",
    )


def _innermost_signature(error: TypeError) -> str:
    """The signature of what the innermost frame tried to call, as far as names tell."""
    called = str(error).partition("()")[0].removesuffix(".__init__")
    frame = error.__traceback__
    while frame is not None and frame.tb_next is not None:
        frame = frame.tb_next
    names = {**frame.tb_frame.f_globals, **frame.tb_frame.f_locals} if frame is not None else {}
    for value in names.values():
        if callable(value) and getattr(value, "__qualname__", None) == called:
            with contextlib.suppress(TypeError, ValueError):
                return f"{called}{inspect.signature(value)}"
    return ""


def _called(target: Callable[..., object]) -> str:
    while isinstance(target, functools.partial):
        target = target.func
    return str(getattr(target, "__qualname__", type(target).__qualname__))


def _no_env(env: object, source: Source) -> SpecError:
    seen, mend = f"{type(env).__module__}.{type(env).__qualname__}", "return the environment"
    if env is None:
        seen, mend = "None", "return the environment at the factory's end"
    elif inspect.isclass(env):
        seen, mend = f"the class {env.__qualname__} itself", "return an instance of it"
    elif inspect.iscoroutine(env):
        env.close()
        mend = "a factory can't be async"
    elif isinstance(env, gymnasium.Env):
        seen, mend = f"{seen}, a single-agent Gymnasium environment", "give it agents"
    elif hasattr(env, "possible_agents") and hasattr(env, "step"):
        mend = "let its class inherit from pettingzoo.AECEnv or pettingzoo.ParallelEnv"
    return SpecError(
        f"{source.spec} built something that is no PettingZoo environment",
        where=source.spec,
        expected="an AECEnv or a ParallelEnv",
        seen=seen,
        mend=mend,
    )
