"""What the converters and the slim stack are made of."""
