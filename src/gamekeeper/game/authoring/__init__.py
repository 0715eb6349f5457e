"""What the base classes for authors are made of."""
