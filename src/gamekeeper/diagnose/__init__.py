"""Which agent and which cause: controlled experiments on recorded runs."""
