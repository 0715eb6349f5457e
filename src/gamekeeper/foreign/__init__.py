"""Environments of other libraries behind PettingZoo's APIs: one plug-in for each library."""
