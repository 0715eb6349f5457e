"""Damage of recorded values is told apart from faults of ours."""

import json
import struct
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from gamekeeper.episodes.plain_json import legible
from gamekeeper.errors import EvidenceError

DAMAGED: list[Callable[[], Any]] = [
    lambda: json.loads("{"),
    lambda: b"\xff".decode(),
    lambda: struct.unpack("i", b"x"),
    lambda: pa.ipc.open_stream(b"no stream"),
    lambda: pa.array([1]).cast(pa.binary(3)),
    lambda: json.loads("[1]").items(),
    lambda: np.zeros(2).items(),  # type: ignore[attr-defined]
    lambda: json.loads("{}")["environment"],
]
FAULTS: list[Callable[[], Any]] = [
    lambda: SimpleNamespace().digest,
    lambda: json.leads("{}"),  # type: ignore[attr-defined]
    lambda: undefined,  # type: ignore[name-defined]  # noqa: F821
]


@pytest.mark.parametrize("read", DAMAGED)
def test_values_that_damage_can_leave_are_evidence_errors(read: Callable[[], Any]) -> None:
    """JSON, text, `struct`, Arrow, and JSON of another shape."""
    with pytest.raises(EvidenceError, match="can't be read"):
        legible(read)()


@pytest.mark.parametrize("read", FAULTS)
def test_faults_of_ours_leave_as_they_are(read: Callable[[], Any]) -> None:
    """A missing attribute of an object or a module, and a missing name, are no damage."""
    with pytest.raises((AttributeError, NameError)):
        legible(read)()
