"""Randomness that is counted and not stored: Philox, streams, seeds."""
