"""Minari: each agent of a run as a data set, all of them as one, and data sets as evidence."""

from __future__ import annotations

from gamekeeper.adapters.minari.minari_export import export
from gamekeeper.adapters.minari.minari_load import load

__all__ = ["export", "load"]
