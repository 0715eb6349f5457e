"""Executors: what plays many tasks, on this machine or on many, behind one `map`."""
