"""One file for each policy that Gamekeeper brings, under the name that users type."""
