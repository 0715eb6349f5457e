"""Interventions: each is one thing that a rerun does differently, in files by what they touch."""
