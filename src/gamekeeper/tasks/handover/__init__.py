"""Handover: a picker passes items to a carrier."""
