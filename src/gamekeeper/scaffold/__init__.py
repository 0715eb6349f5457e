"""A new task as text: from a person's answers to a package whose tests pass."""
