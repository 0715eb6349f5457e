"""Checks of copies and conversions, GK7xx."""
