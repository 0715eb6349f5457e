"""Intervals and tests, each with its source; those that would not cover as they say are refused."""
