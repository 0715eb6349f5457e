"""The parts of the game form as it was measured, a module each. Pure."""
