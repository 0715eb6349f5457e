"""Particle worlds: spread, tag, reference, speaker and listener, on one physics."""
