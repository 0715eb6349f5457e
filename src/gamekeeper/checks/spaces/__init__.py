"""Checks of spaces, masks, actions and infos, GK2xx."""
