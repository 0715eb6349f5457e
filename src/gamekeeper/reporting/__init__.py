"""Pure functions from data to text: nothing here reads, writes, prints or looks at the clock.

`width` is everywhere the number of columns that no line exceeds, as far as names allow.
"""
