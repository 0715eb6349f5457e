"""Diagnosis of the failing agent and its cause: controlled experiments on recorded runs."""
