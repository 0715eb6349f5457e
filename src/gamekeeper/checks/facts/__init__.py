"""Facts: what probes saw that is no turn; frozen classes that checks read."""
