"""Foraging: agents collect food that needs several of them."""
