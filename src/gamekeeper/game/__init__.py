"""The door to live environments, and what stands right behind it."""
