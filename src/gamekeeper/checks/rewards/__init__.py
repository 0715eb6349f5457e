"""Checks of rewards, GK4xx."""
