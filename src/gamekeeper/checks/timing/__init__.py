"""Checks of turns and their order, GK3xx."""
