"""Checks: pure functions from contract and evidence to occasions, one file each."""
