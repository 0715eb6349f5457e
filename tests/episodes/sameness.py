"""Equality that also sees types, dtypes, the sign of zero and NaN."""

import math
from typing import Any

import numpy as np


def same(a: Any, b: Any) -> bool:
    """Whether two values are equal in every respect that a recording promises to keep."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and same(a.tolist(), b.tolist())
    if isinstance(a, np.longdouble):
        return same(str(a), str(b))
    if isinstance(a, np.clongdouble):
        return same(a.real, b.real) and same(a.imag, b.imag)
    if isinstance(a, np.generic):
        return a.dtype == b.dtype and same(a.item(), b.item())
    if isinstance(a, dict):
        return len(a) == len(b) and all(_same_item(key, a[key], b) for key in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, set | frozenset):
        return len(a) == len(b) and all(any(same(x, y) for y in b) for x in a)
    if isinstance(a, complex):
        return same(a.real, b.real) and same(a.imag, b.imag)
    if isinstance(a, float):
        if math.isnan(a) or math.isnan(b):
            return math.isnan(a) and math.isnan(b)
        return a == b and math.copysign(1, a) == math.copysign(1, b)
    return bool(a == b)


def _same_item(key: Any, value: Any, other: dict[Any, Any]) -> bool:
    return any(same(key, k) and same(value, v) for k, v in other.items())
