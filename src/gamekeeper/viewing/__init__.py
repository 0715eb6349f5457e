"""Reports, the live viewer, videos and SQL over recorded runs."""
