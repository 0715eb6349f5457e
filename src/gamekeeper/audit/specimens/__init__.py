"""Specimens: small environments, each with one fault or none, that checks are measured on."""
