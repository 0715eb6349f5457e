"""Attacks on what is promised of safety; `benchmarks/attacks.py` runs them."""
