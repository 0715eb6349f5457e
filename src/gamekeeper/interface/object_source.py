"""Text and arguments by which another process builds what was handed over as an object.

A class or function that a module holds under its own name is found there again. A script's own are
found in its file, unless the script does more than define when it is run under another name: to
import it would record again. An object's arguments are known where its class keeps them: our base
classes do, and Gymnasium's `EzPickle`; else the class's defaults are assumed, and a replay tells.
"""

import ast
import inspect
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from gamekeeper.episodes.canonical import from_json, is_exact, to_json
from gamekeeper.interface.construction import required

FILE_MODULE: Final = "_gamekeeper_file_"
"""Prefix of the names under which files are loaded: no import can find them again."""
ASSUMED: Final = "assumed"
"""Mark of arguments that nobody keeps."""

Facts = dict[str, Any]
"""Entries of an identity."""


class LostError(Exception):
    """A thing that no text finds again; its text says why and what to add."""


def place_of(part: Callable[..., Any]) -> Facts:
    """`kind`, `entry_point` and `path` of a class or function.

    Raises:
        LostError: no text finds it.
    """
    name, module = getattr(part, "__qualname__", "") or "", getattr(part, "__module__", "") or ""
    if not name.isidentifier():
        inside = "a lambda" if "<lambda>" in name else f"{name or type(part).__qualname__}"
        raise LostError(
            f"{inside} of {module or 'no module'} can't be found by name; add a function or class "
            "of that module, not inside another, and hand that over"
        )
    if getattr(sys.modules.get(module), name, None) is not part:
        raise LostError(
            f"{module} has another {name} by now; name it with --env, as module:factory"
        )
    if module == "__main__" or module.startswith(FILE_MODULE):
        path = _file_of(module, name)
        return {"kind": "file", "entry_point": f"{path.name}:{name}", "path": path.as_posix()}
    return {"kind": "module", "entry_point": f"{module}:{name}"}


def class_name(kind: type) -> str:
    """A class with its module; of a file that was loaded by its path the stem, not its prefix."""
    module = kind.__module__
    file = getattr(sys.modules.get(module), "__file__", None)
    home = Path(file).stem if file and module.startswith(FILE_MODULE) else module
    return f"{home}.{kind.__qualname__}"


def facts_of(env: Any) -> Facts:
    """Entries of the identity of an environment object, by which it is built again.

    Raises:
        LostError: it can't be.
    """
    kind = type(env)
    inner = getattr(env, "unwrapped", env)
    if inner is not env:
        raise LostError(
            f"it was handed over as a {kind.__qualname__} around a {type(inner).__qualname__}; add "
            "a function that builds it, and hand that over"
        )
    return {**place_of(kind), **_arguments_of(env, kind)}


def kept_arguments(args: tuple[Any, ...], kwargs: Mapping[str, Any]) -> str | None:
    """Arguments as canonical text; None where one is an object that no text builds again."""
    try:
        text = to_json([list(args), dict(kwargs)])
    except Exception:  # an argument's own code may raise anything
        return None
    return text if is_exact(text) else None


def _arguments_of(env: Any, kind: type) -> Facts:
    """`kwargs`, and whether they are assumed."""
    kept = getattr(env, "built_with", None)
    if hasattr(env, "_ezpickle_args"):
        kept = kept_arguments(env._ezpickle_args, env._ezpickle_kwargs)
    elif not hasattr(env, "built_with"):
        signature = inspect.signature(kind)
        if needed := required(signature):
            raise LostError(
                f"nothing keeps the arguments that {kind.__qualname__} was built with; hand over "
                f"the class, and its arguments as env_kwargs: {', '.join(needed)}"
            )
        takes_none = not signature.parameters
        return {"kwargs": {}} | ({} if takes_none else {"arguments": ASSUMED})
    if kept is None:
        raise LostError(
            f"an argument of {kind.__qualname__} was an object that no text builds again; add a "
            "function without such arguments, and hand that over"
        )
    given: Any = from_json(kept)
    args, kwargs = given
    bound = inspect.signature(kind).bind(*args, **kwargs)
    named: dict[str, Any] = {}
    for name, value in bound.arguments.items():
        sort = bound.signature.parameters[name].kind
        if sort is inspect.Parameter.VAR_POSITIONAL:
            raise LostError(f"{kind.__qualname__} takes *{name}; add a function that passes them")
        named |= value if sort is inspect.Parameter.VAR_KEYWORD else {name: value}
    return {"kwargs": json.loads(to_json(named))}


def _file_of(module: str, name: str) -> Path:
    """The file of a script, or of a file that was loaded by its path."""
    file = getattr(sys.modules.get(module), "__file__", None)
    if not file or not file.endswith(".py"):
        raise LostError(f"{name} stands in no file; put it into one")
    path = Path(file).resolve()
    if module == "__main__" and not _only_defines(path):
        raise LostError(
            f"{path.name} records as soon as it is imported; put what it runs under "
            'if __name__ == "__main__":'
        )
    return path


def _only_defines(path: Path) -> bool:
    """A script does what it does under its guard, or calls nothing at its top level."""
    try:
        body = ast.parse(path.read_bytes()).body
    except (OSError, SyntaxError, ValueError):
        return False
    outside = [each for each in body if not _is_guard(each)]
    if len(outside) < len(body):
        return True
    defining = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    return not any(
        isinstance(node, ast.Call)
        for each in outside
        if not isinstance(each, defining)
        for node in ast.walk(each)
    )


def _is_guard(node: ast.stmt) -> bool:
    """`if __name__ == ...`."""
    return isinstance(node, ast.If) and any(
        isinstance(each, ast.Name) and each.id == "__name__" for each in ast.walk(node.test)
    )
