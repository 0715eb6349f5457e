"""Vector environments: many copies of one environment, stepped together; `gk.vector.make`."""

from gamekeeper.vector import wrappers
from gamekeeper.vector.vector_factory import make

__all__ = ["make", "wrappers"]
