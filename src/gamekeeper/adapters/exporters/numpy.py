"""One .npz file: every agent's rows as plain arrays, read without pickle."""

from gamekeeper.adapters.numpy_arrays import export

__all__ = ["export"]
