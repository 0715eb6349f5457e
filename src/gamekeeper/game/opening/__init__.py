"""How an environment is found, built and named."""
