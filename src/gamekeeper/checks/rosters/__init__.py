"""Checks of rosters, GK1xx."""
