"""The flight recorder: a run that retains some of its episodes and stays within a size."""
