"""Pursuit: hunters surround evaders on a grid."""
