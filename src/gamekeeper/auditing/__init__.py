"""The audit: probes gather what an environment does, checks judge it, findings show it."""
