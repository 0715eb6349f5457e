"""Adapters: trainers, data sets and viewers, each imported where it is used and nowhere else."""
