"""`gamekeeper view`: recorded runs, served to a browser on this machine."""
