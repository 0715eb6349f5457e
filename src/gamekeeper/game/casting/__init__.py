"""How policies are seated."""
