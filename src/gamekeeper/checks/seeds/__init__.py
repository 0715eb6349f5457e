"""Checks of seeds, leaks and aliasing, GK6xx."""
