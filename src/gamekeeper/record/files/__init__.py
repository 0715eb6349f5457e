"""The files of a bundle: the only reader and writer of them."""
