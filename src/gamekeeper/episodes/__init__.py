"""Episodes as columns: buffer, encoder, spaces, digests, comparison. No file, clock or print."""
