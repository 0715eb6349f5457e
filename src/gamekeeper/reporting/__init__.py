"""Pure functions from data to text: nothing here reads, writes, prints or looks at the clock."""
