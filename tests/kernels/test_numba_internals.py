"""What the kernels use of Numba beside its public names: the versions that it fits."""

import inspect
from importlib import import_module
from typing import Final

import pytest

from gamekeeper.kernels.scalar_rules import numba

FITS: Final = ("0.61", "0.62", "0.63", "0.64", "0.65", "0.66", "0.67", "0.68")
"""Minor versions that `numba>=0.61` covers so far; the next is looked at before it comes in."""
OVERRIDDEN: Final = {
    "core.codegen:JITCodeLibrary": (
        "_optimize_functions",
        "_optimize_final_module",
        "_finalize_final_module",
        "_finalize_dynamic_globals",
        "get_pointer_to_function",
    ),
    "core.compiler:Compiler": ("define_pipelines",),
    "core.compiler:CompileResult": ("_rebuild", "_reduce"),
    "core.caching:NullCache": ("load_overload", "save_overload"),
    "core.registry:CPUDispatcher": ("__call__",),
}

pytestmark = pytest.mark.skipif(numba() is None, reason="Numba, the extra `fast`, isn't there")


def test_version_of_numba_is_one_that_was_looked_at() -> None:
    """Overrides of private methods hold for these versions alone."""
    assert numba().__version__.rpartition(".")[0] in FITS


@pytest.mark.parametrize("owner", OVERRIDDEN)
def test_methods_that_are_overridden_are_there(owner: str) -> None:
    """Under another name, Numba would pass over ours without a word."""
    module, _, name = owner.partition(":")
    kind = getattr(import_module(f"numba.{module}"), name)
    assert dict.fromkeys(OVERRIDDEN[owner], True) == {
        method: callable(inspect.getattr_static(kind, method, None))
        or isinstance(inspect.getattr_static(kind, method, None), classmethod)
        for method in OVERRIDDEN[owner]
    }
