"""Probes: schedules of episodes that let promises be seen to hold or break, one file each."""
