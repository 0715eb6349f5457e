"""Probes: schedules of plays that let promises be seen to hold or break, one file each."""
