"""Checks of rendering, state, metadata and cost, GK8xx."""
