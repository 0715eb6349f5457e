"""Statistics of evaluation: estimates, and intervals that cover as they say or are refused."""
