"""Checks: pure functions from contract and evidence to cases, in folders by family."""
