"""Kernels: the rules of an environment written once as scalar functions over one copy's state."""
