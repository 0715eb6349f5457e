"""Evaluation that is fair: shared seeds, roles kept apart, episodes and training runs as units."""
