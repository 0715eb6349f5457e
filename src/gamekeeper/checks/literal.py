"""Values as Python that a reader can paste; numbers plain where a space takes them so."""

import copy
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def literal(value: Any) -> str:
    """The value as an expression over `np`; what has no such form is its `repr` in quotes."""
    if isinstance(value, np.generic):
        return _scalar(value)
    if isinstance(value, np.ndarray):
        items = value.tolist() if value.dtype != np.float32 else _short(value)
        return f"np.array({_nested(items)}, np.{_dtype(value)})"
    if isinstance(value, Mapping):
        keys = (key_literal(key) if is_value(key) else literal(key) for key in value)
        pairs = (f"{key}: {literal(item)}" for key, item in zip(keys, value.values(), strict=True))
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, tuple):
        inner = ", ".join(map(literal, value))
        return f"({inner},)" if len(value) == 1 else f"({inner})"
    if isinstance(value, list):
        return "[" + ", ".join(map(literal, value)) + "]"
    if isinstance(value, float):
        return _number(value)
    if value is None or isinstance(value, bool | int | str | bytes):
        return repr(value)
    return repr(repr(value))


def step_literal(api: str, actions: Mapping[Any, Any]) -> str:
    """The argument of a step with these actions; in an AEC environment the only one."""
    return literal(dict(actions) if api == "parallel" else next(iter(actions.values()), None))


def is_value(agent: Any) -> bool:
    """Tells whether an agent equals a copy of it, as names do; where none can be made it may."""
    try:
        return agent.__class__ is str or bool(copy.deepcopy(agent) == agent)
    except Exception:  # whatever foreign code raises, nothing is known against it
        return True


def key_literal(key: Any) -> str:
    """An agent, or another key: what has no form of its own is found in a program by its text."""
    if _has_form(key):
        return literal(key)
    return f"agent_of({repr(key)!r})" if is_value(key) else repr(key)


def _has_form(key: Any) -> bool:
    if type(key) is tuple:
        return all(map(_has_form, key))
    return type(key) in (str, int, float, bool, bytes, type(None)) or isinstance(key, np.generic)


def _scalar(value: np.generic) -> str:
    if isinstance(value, np.bool_ | np.integer | np.str_):
        return repr(value.item())
    if isinstance(value, np.floating):
        return _number(float(value))
    return f"np.{value.dtype.name}({value.item()!r})"


def _short(value: np.ndarray[Any, Any]) -> Any:
    """Floats of 32 bits with no more digits than they need."""
    short = [float(str(each)) for each in value.ravel()]
    return np.array(short).reshape(value.shape).tolist()


def _dtype(value: np.ndarray[Any, Any]) -> str:
    return "bool_" if value.dtype.kind == "b" else value.dtype.name


def _nested(items: Any) -> str:
    if isinstance(items, list):
        return "[" + ", ".join(map(_nested, items)) + "]"
    return _number(items) if isinstance(items, float) else repr(items)


def _number(value: float) -> str:
    if math.isnan(value):
        return "np.nan"
    return repr(value) if math.isfinite(value) else ("np.inf" if value > 0 else "-np.inf")
