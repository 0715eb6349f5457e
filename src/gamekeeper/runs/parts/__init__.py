"""Recordings in parts: ranges of episodes played anywhere, then merged into one run."""
