"""How the door captures: packing, odd values, flags, rings."""
