"""What `benchmarks/fuzz.py` reads: damaged bytes, and those who read them."""
