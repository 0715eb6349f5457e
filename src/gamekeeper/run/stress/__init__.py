"""What stressors are made of: parts of observations, numbers in them, and what may be done now."""
