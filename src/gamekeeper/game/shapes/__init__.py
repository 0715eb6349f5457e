"""Environments of other shapes behind PettingZoo's faces, and ours in the old Gym's shape."""
