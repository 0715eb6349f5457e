"""One file for each way in which an environment can be named."""
