"""Checks of endings, roles and life cycles, GK5xx."""
