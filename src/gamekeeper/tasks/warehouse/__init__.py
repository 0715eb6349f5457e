"""Warehouse: pickers and carriers on one floor, as ticks and as turns."""
