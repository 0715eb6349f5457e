"""Pure data and functions: no file, clock, print, environment variable or own randomness."""
