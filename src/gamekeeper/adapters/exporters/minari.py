"""Minari data sets: one for each agent, and one of all; `minari:ID` is read as evidence."""

from gamekeeper.adapters.minari import export, load

__all__ = ["export", "load"]
