"""Rollouts, reruns with one change, and the processes they run in."""
