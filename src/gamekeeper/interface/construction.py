"""Running foreign code to find and build environments: prints to stderr, failures shown in full."""

import contextlib
import copy
import difflib
import functools
import importlib
import importlib.util
import inspect
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any, Final, cast

import gymnasium
from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.episodes.exception_text import cut, message, said_by, traceback_text
from gamekeeper.errors import GamekeeperError, SpecError
from gamekeeper.interface.env_source import Env, Source, api_of

VERSION: Final = re.compile(r"[-_]v(\d+)$")
"""The version at the end of an id or of a module's name."""
MOST_FRAMES: Final = 20
"""A traceback's innermost frames that a message shows; an endless recursion has a thousand."""
MOST_CHARS: Final = 20_000
"""Length of a traceback in a message, in characters."""

_LACKING: Final = re.compile(r"missing \d+ required (positional|keyword-only) arguments?: ")
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
    except BaseException as error:  # also SystemExit and what test runners derive from it
        reason = said_by(error)
        raise SpecError(
            f"{doing} raised {reason}",
            where=where,
            actual=f"\n{foreign_traceback(error)}",
            fix=_fix(error, pip, where),
        ) from error


def foreign_traceback(error: BaseException) -> str:
    """The traceback as text, without frames of ours and of the import machinery."""
    try:
        summary = traceback.TracebackException.from_exception(error, limit=-MOST_FRAMES)
        summary.stack = traceback.StackSummary.from_list(
            [frame for frame in summary.stack if not frame.filename.startswith(_PASSAGES)]
        )
        return cut("".join(summary.format()).rstrip(), MOST_CHARS)
    except KeyboardInterrupt:
        raise
    except BaseException:  # attributes that raise when they are looked at
        return cut(traceback_text(error, limit=-MOST_FRAMES).rstrip(), MOST_CHARS)


def _fix(error: BaseException, pip: str, where: str) -> str:
    if isinstance(error, ModuleNotFoundError) and error.name:
        top = error.name.partition(".")[0]
        file, _, name = where.partition(":")
        folder = None if pip else _folder_above(Path(file), top)
        if folder is not None:
            is_here = folder == Path.cwd()
            module = ".".join(Path(file).resolve().relative_to(folder).with_suffix("").parts)
            return (
                f"'{top}' is in {'the current folder' if is_here else folder}, which a file can't "
                f"import from: {'' if is_here else 'start there, and '}name the environment by its "
                f"module, {module}:{name or 'NAME'}"
            )
        line = pip or f"pip install {top}"
        return f"install what provides the module '{error.name}': {line}"
    if isinstance(error, ImportError) and pip:
        return pip
    return ""


def _folder_above(file: Path, module: str) -> Path | None:
    """The nearest folder above a Python file's own that has the module; None where none has."""
    above = file.resolve().parents[1:] if file.suffix == ".py" else ()
    return next((folder for folder in above if is_in_folder(module, folder)), None)


def is_in_folder(module: str, folder: Path) -> bool:
    """Tells whether a module without dots lies in a folder, as a file or as a package."""
    return any((folder / f"{module}{end}").exists() for end in ("", ".py"))


def build(source: Source, kwargs: Mapping[str, Any]) -> Env:
    """One new instance from a source's factory, with copies of the keyword arguments.

    Raises:
        SpecError: the arguments don't fit, the factory raised, or what it returned is no PettingZoo
            environment.
    """
    _check_arguments(source, kwargs)
    try:
        given = copy.deepcopy(dict(kwargs))
    except Exception:  # some can't be copied (an open window); then they are shared, as they came
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
    close = difflib.get_close_matches(name, list(names), n=3, cutoff=0.7)
    quoted = ", ".join(repr(other) for other in close)
    return f"; the nearest {'is' if len(close) == 1 else 'are'} {quoted}" if close else ""


def did_you_mean(names: Iterable[str]) -> str:
    """The fix that offers these names; empty without any."""
    offered = " or ".join(names)
    return f"did you mean {offered}?" if offered else ""


def modules_called(package: str, name: str) -> list[str]:
    """The newest `package.name_v3:parallel_env` that lies in an installed package, or nothing."""
    found = None
    with contextlib.suppress(ImportError, ValueError):
        found = importlib.util.find_spec(package) if package else None
    folders = [] if found is None else found.submodule_search_locations or []
    names = {path.stem for folder in folders for path in Path(folder).glob(f"{name}_v*.py")}
    versions = [(int(each.rpartition("_v")[2]), each) for each in names if VERSION.search(each)]
    same = sorted(pair for pair in versions if VERSION.sub("", pair[1]) == name)
    return [f"{package}.{each}:parallel_env" for _, each in same[-1:]]


def _check_arguments(source: Source, kwargs: Mapping[str, Any]) -> None:
    target = source.accepts or source.factory
    try:
        signature = inspect.signature(target)
    except (TypeError, ValueError):  # some builtins have none; calling will tell
        return
    try:
        signature.bind(**kwargs)
    except TypeError as error:
        names = list(signature.parameters)
        unknown = "".join(nearest(name, names) for name in kwargs if name not in names)
        missing = set(required(signature)) - set(kwargs)
        raise _misfit(
            source,
            f"{error}{unknown}",
            kwargs,
            takes=f"{_called(target)}{signature}",
            missing=[name for name in names if name in missing],
        ) from None


def required(signature: inspect.Signature) -> list[str]:
    """Names of the parameters that a call can't leave out."""
    return [
        name
        for name, parameter in signature.parameters.items()
        if parameter.default is parameter.empty
        and parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
    ]


def _refused(error: TypeError, source: Source, kwargs: Mapping[str, Any]) -> SpecError | None:
    # PettingZoo's own factories take **kwargs and pass them on: the refusal comes from further in.
    text, frame = message(error), _innermost_frame(error)
    unknown = [name for name in kwargs if f"unexpected keyword argument '{name}'" in text]
    missing: list[str] = []
    if frame is not None and frame.f_code.co_flags & inspect.CO_VARKEYWORDS:
        missing = re.findall(r"'(\w+)'", text) if _LACKING.search(text) else []
    if not unknown and not missing:
        return None
    return _misfit(source, text, kwargs, takes=_innermost_signature(error), missing=missing)


def _misfit(
    source: Source, reason: str, kwargs: Mapping[str, Any], *, takes: str, missing: Sequence[str]
) -> SpecError:
    fix = "name only arguments that the factory takes"
    if missing:
        reason = f"{', '.join(map(repr, missing))} must be given"
        document = ", ".join(f'"{name}": ...' for name in missing)
        python = ", ".join(f"{name}=..." for name in missing)
        fix = f"give a value to each: --kwargs '{{{document}}}', in Python gk.make(..., {python})"
    return SpecError(
        f"the arguments don't fit {source.spec}: {reason}",
        where="keyword arguments",
        expected=takes,
        actual=", ".join(f"{name}={value!r}"[:80] for name, value in kwargs.items()) or "none",
        fix=fix,
    )


def _innermost_signature(error: TypeError) -> str:
    """The signature of what the innermost frame tried to call, as far as names tell."""
    called = message(error).partition("()")[0].removesuffix(".__init__")
    frame = _innermost_frame(error)
    names = {**frame.f_globals, **frame.f_locals} if frame is not None else {}
    for value in names.values():
        if callable(value) and getattr(value, "__qualname__", None) == called:
            with contextlib.suppress(TypeError, ValueError):
                return f"{called}{inspect.signature(value)}"
    return ""


def _innermost_frame(error: BaseException) -> FrameType | None:
    passed = error.__traceback__
    while passed is not None and passed.tb_next is not None:
        passed = passed.tb_next
    return None if passed is None else passed.tb_frame


def _called(target: Callable[..., object]) -> str:
    while isinstance(target, functools.partial):
        target = target.func
    return str(getattr(target, "__qualname__", type(target).__qualname__))


def _no_env(env: object, source: Source) -> SpecError:
    actual, fix = f"{type(env).__module__}.{type(env).__qualname__}", "return the environment"
    if env is None:
        actual, fix = "None", "return the environment at the factory's end"
    elif inspect.isclass(env):
        actual, fix = f"the class {env.__qualname__} itself", "return an instance of it"
    elif inspect.iscoroutine(env):
        env.close()
        fix = "a factory can't be async"
    elif isinstance(env, gymnasium.Env):
        actual, fix = f"{actual}, a single-agent Gymnasium environment", "give it agents"
    elif hasattr(env, "possible_agents") and hasattr(env, "step"):
        fix = "let its class inherit from pettingzoo.AECEnv or pettingzoo.ParallelEnv"
    return SpecError(
        f"{source.spec} built something that is no PettingZoo environment",
        where=source.spec,
        expected="an AECEnv or a ParallelEnv",
        actual=actual,
        fix=fix,
    )


FACTORY_NAMES: Final = {
    None: ("parallel_env", "env", "make", "raw_env"),
    "parallel": ("parallel_env", "make", "env", "raw_env"),
    "aec": ("env", "make", "raw_env", "parallel_env"),
}
"""Names tried in order where none is given, by the API asked for."""

_MISSING: Final = object()


@dataclass(frozen=True, slots=True)
class NamedFactory:
    """A factory and its name in its module; `is_single` where that is an environment already."""

    name: str
    factory: Callable[..., object]
    is_single: bool = False


def find_factory(
    module: ModuleType, name: str | None, api: str | None, *, where: str
) -> NamedFactory:
    """The factory called `name`; without a name the usual names, then the only environment class.

    Args:
        name: dotted name inside it, or None.
        api: `aec` or `parallel` where the user asked for one.
        where: the module or file as it was typed, for messages.
    Raises:
        SpecError: there is no such name, it can't be called, or there is none or more than one to
            choose.
    """
    if name is not None:
        return _named(module, name, where)
    for usual in FACTORY_NAMES[api]:
        value = _get(module, usual, where)
        # A submodule called env, or an instance made to try things out, is no factory.
        if callable(value) and api_of(value) is None and not _is_imported(value, usual, module):
            return NamedFactory(usual, value)
    return _only_class(module, api, where)


def _named(module: ModuleType, name: str, where: str) -> NamedFactory:
    value: object = module
    for part in name.split("."):
        holder, value = value, _get(value, part, where)
        if value is _MISSING:
            public = [other for other in dir(holder) if not other.startswith("_")]
            raise SpecError(
                f"{where} has nothing called '{name}'{nearest(part, public)}",
                where=f"{where}:{name}",
                expected="the name of a function or class that builds the environment",
                actual=f"there are {_some(_builders(module))}",
                fix="name one of those, or define it in the module",
            )
    if api_of(value) is not None:
        instance = value
        return NamedFactory(name, lambda: instance, is_single=True)
    if not callable(value):
        raise SpecError(
            f"{where}:{name} can't be called",
            where=f"{where}:{name}",
            expected="a function or class that builds the environment",
            actual=f"{type(value).__qualname__}",
            fix="name a function or class of the module",
        )
    return NamedFactory(name, value)


def _only_class(module: ModuleType, api: str | None, where: str) -> NamedFactory:
    classes = _env_classes(module)
    leaves = {
        name: found
        for name, found in classes.items()
        if not any(other is not found and issubclass(other, found) for other in classes.values())
    }
    wanted = {"aec": AECEnv, "parallel": ParallelEnv}
    if api is not None and len(leaves) > 1:
        leaves = {name: kind for name, kind in leaves.items() if issubclass(kind, wanted[api])}
    if len(leaves) == 1:
        name, found = leaves.popitem()
        return NamedFactory(name, found)
    tried = ", ".join(FACTORY_NAMES[None])
    raise SpecError(
        f"{where} doesn't say which environment is meant"
        if leaves or classes
        else f"{where} has no environment that can be found without its name",
        where=where,
        expected=f"one of {tried}, or exactly one class derived from AECEnv or ParallelEnv",
        actual=_some([f"{where}:{name}" for name in (leaves or classes)] or _builders(module)),
        fix=did_you_mean(modules_called(*_split(where))) or f"name the factory: {where}:NAME",
    )


def _split(module: str) -> tuple[str, str]:
    """Package and name of a module, without its version."""
    package, _, name = module.rpartition(".")
    return package, VERSION.sub("", name)


def _is_imported(value: object, name: str, module: ModuleType) -> bool:
    """Tells whether another package offers this under its name: `from gymnasium import make`."""
    home = (getattr(value, "__module__", None) or "").partition(".")[0]
    is_own = home == module.__name__.partition(".")[0]
    return not is_own and getattr(sys.modules.get(home), name, None) is value


def _env_classes(module: ModuleType) -> dict[str, type]:
    # A package may define its class in a part of itself and only name it again at the top.
    own = (module.__name__, module.__name__ + ".")
    return {
        name: value
        for name, value in sorted(vars(module).items())
        if inspect.isclass(value)
        and issubclass(value, AECEnv | ParallelEnv)
        and not name.startswith("_")
        and (value.__module__ == own[0] or value.__module__.startswith(own[1]))
    }


def _builders(module: ModuleType) -> list[str]:
    public = {
        name: value
        for name, value in sorted(vars(module).items())
        if not name.startswith("_") and (inspect.isfunction(value) or inspect.isclass(value))
    }
    own = [name for name, value in public.items() if value.__module__ == module.__name__]
    return own or list(public)


def _get(holder: object, name: str, where: str) -> object:
    # A module's own __getattr__ may import, warn or raise anything.
    with foreign(f"looking up '{name}' in {where}", where=where):
        return getattr(holder, name, _MISSING)


def _some(names: list[str], *, most: int = 12) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(names[:most]) + more) if names else "none"
