"""What each agent brings to its team, whose doing changes what, and who is made to pay for it."""
