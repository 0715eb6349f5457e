"""What trainers with a fixed number of places see: a slot for each learning agent of each copy.

A slot is one agent's stream of decisions, whatever the API: in a Parallel environment it acts in
every step in which it lives, in an AEC environment when its turn comes. `acted` tells which slots
did; rewards of the others are what the world paid them meanwhile, and belong to what they did last.
"""

from gamekeeper.adapters.slots.slots import Slots, Step
from gamekeeper.adapters.slots.views import MASK, bare_space

__all__ = ["MASK", "Slots", "Step", "bare_space"]
