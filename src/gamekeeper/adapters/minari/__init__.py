"""Minari: each agent of a run as a data set, all of them as one, and data sets as evidence."""

from __future__ import annotations

from gamekeeper.adapters.minari.reading import load
from gamekeeper.adapters.minari.writing import export

__all__ = ["export", "load"]
