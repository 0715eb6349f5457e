"""Changes: one file for each thing that a rerun can do differently."""
