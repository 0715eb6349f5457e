"""The files of a run: the only reader and writer of them."""
