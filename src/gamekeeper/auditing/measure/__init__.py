"""The parts of the structure as it was measured, a module each. Pure."""
