"""Robotic warehouse: robots bring requested shelves to workstations."""
