"""Live environments: captures, base classes for authors, converters, openers, policies."""
