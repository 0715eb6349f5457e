"""The rules of `pursuit`, R1 to R11 there, over one copy's state; nothing here draws a picture.

Pursuers are numbered first, then evaders. The field is kept with a border of rocks around it, as
wide as anybody sees, so that no window needs to ask where it ends. In `s.grid` a cell is EMPTY, a
ROCK, or holds number + 1 of who stands there; within a tick also what is wanted of it. Nothing is
done for pairs: a tick costs so much for each of them, however many there are.
"""

# mypy: disable-error-code="no-untyped-def"
# a rule's types are found when it compiles

from typing import Final

from gamekeeper.kernels import draws
from gamekeeper.kernels.scalar_rules import rule

EMPTY, ROCK, CONTESTED = 0, -1, -2
WANTED: Final = -3
"""Base of a cell's value: agent i alone wants it where it holds WANTED - i."""
STAY, NORTH, EAST, SOUTH, WEST = range(5)
MOVES: Final = 5
AGENTS, FLEE, WANDER, STILL = range(4)
"""Ways to move the evaders."""
PREY, HUNGER, CAPTURE, SURVIVAL = range(4)
"""Reward terms."""
CAUGHT, STARVED, CLEARED, FREE = range(1, 5)
"""Endings."""
CATCH: Final = 1.0
STARVING: Final = -1.0
BEING_CAUGHT: Final = -1.0
TICK: Final = 0.01
"""Reward of each event, in reward units."""
FULL: Final = 100
"""Energy is shown in percent."""
FAR: Final = 1 << 20


# -- the first state


@rule
def reset(s, t):
    """Rocks, then pursuers and evaders in cells of their own (R1, R2)."""
    for cell in range(len(s.grid)):
        s.grid[cell] = ROCK
    for row in range(t.rows):
        for column in range(t.columns):
            is_rock = row & 1 == 1 and column & 1 == 1 and t.rocks > 0.0
            if not (is_rock and draws.uniform(s, 0.0, 1.0) < t.rocks):
                s.grid[place(t, row, column)] = EMPTY
    cells = t.rows * t.columns
    for i in range(t.pursuers + t.evaders):
        cell = -1
        while cell < 0 or s.grid[cell] != EMPTY:
            drawn = draws.integers(s, cells)
            cell = place(t, drawn // t.columns, drawn % t.columns)
        s.grid[cell] = i + 1
        s.cells[i] = cell
        s.there[i] = 1
    for i in range(t.pursuers):
        s.energy[i] = t.stamina
    s.pursuers = t.pursuers
    s.evaders = t.evaders


@rule
def place(t, row, column):
    """The number of a cell of the field."""
    return (row + t.border) * t.width + column + t.border


# -- a tick


@rule
def step_of_both(s, t, actions, rewards, terminated, truncated):
    """A tick in which evaders are agents."""
    for i in range(t.pursuers):
        s.aims[i] = actions[0][i]
    for j in range(t.evaders):
        s.aims[t.pursuers + j] = actions[1][j]
    move(s, t)
    hunt(s, t, rewards, terminated)
    for i in range(t.pursuers, t.pursuers + t.evaders):
        if s.there[i] == 1:
            rewards[i, SURVIVAL] = TICK
        elif s.gone[i] == s.time:
            rewards[i, CAPTURE] = BEING_CAUGHT
            terminated[i] = True
            s.ending[i] = CAUGHT
    if s.pursuers == 0:
        for i in range(t.pursuers, t.pursuers + t.evaders):
            if s.there[i] == 1:
                terminated[i] = True
                s.ending[i] = FREE


@rule
def step_of_pursuers(s, t, actions, rewards, terminated, truncated):
    """A tick in which evaders follow a script (R11)."""
    for i in range(t.pursuers):
        s.aims[i] = actions[i]
    for i in range(t.pursuers, t.pursuers + t.evaders):
        if s.there[i] == 1:
            s.aims[i] = scripted(s, t, i)
    move(s, t)
    hunt(s, t, rewards, terminated)


@rule
def move(s, t):
    """All move at once: into empty cells, and none of several that want the same (R3, R4).

    `s.aims` holds moves and then cells. A cell that two want is CONTESTED whoever comes first, and
    who stood somewhere as the tick began stands there until all have said what they want: so no
    order of agents shows.
    """
    count = t.pursuers + t.evaders
    for i in range(count):
        if s.there[i] == 1:
            cell = s.cells[i]
            to = cell + t.ahead[s.aims[i]]
            held = s.grid[to]
            if held == EMPTY:
                s.grid[to] = WANTED - i
                s.aims[i] = to
            elif held < ROCK:
                s.grid[to] = CONTESTED
                s.aims[i] = to
            else:
                s.aims[i] = cell
    for i in range(count):
        if s.there[i] == 1 and s.grid[s.aims[i]] == WANTED - i:
            s.grid[s.cells[i]] = EMPTY
            s.grid[s.aims[i]] = i + 1
            s.cells[i] = s.aims[i]
    for i in range(count):
        if s.there[i] == 1 and s.aims[i] != s.cells[i]:
            s.grid[s.aims[i]] = EMPTY


@rule
def hunt(s, t, rewards, terminated):
    """Catches, feeds and starves after the moves (R5 to R8), and ends the episode (R9)."""
    count = t.pursuers + t.evaders
    for i in range(t.pursuers, count):
        s.beside[i] = catchers_of(s, t, i) if s.there[i] == 1 else 0
    for i in range(t.pursuers):
        if s.there[i] == 1:
            eat(s, t, i, rewards)
    for i in range(t.pursuers, count):
        if s.beside[i] > 0:
            leave(s, i)
            s.evaders -= 1
    for i in range(t.pursuers):
        if s.there[i] == 1:
            if t.stamina > 0 and s.energy[i] == 0:
                rewards[i, HUNGER] = STARVING
                terminated[i] = True
                s.ending[i] = STARVED
                leave(s, i)
                s.pursuers -= 1
            elif s.evaders == 0:
                terminated[i] = True
                s.ending[i] = CLEARED


@rule
def catchers_of(s, t, i):
    """Number of pursuers that catch an evader, 0 where they are too few (R5)."""
    pursuers = 0
    open_sides = 0
    for side in range(NORTH, MOVES):
        held = s.grid[s.cells[i] + t.ahead[side]]
        if held != ROCK:
            open_sides += 1
        if held > EMPTY and held <= t.pursuers:
            pursuers += 1
    return pursuers if pursuers >= min(t.catchers, open_sides) else 0


@rule
def eat(s, t, i, rewards):
    """A tick's hunger, and shares of what was caught on each side of a pursuer (R6, R7)."""
    if t.stamina > 0:
        s.energy[i] -= 1
    for side in range(NORTH, MOVES):
        held = s.grid[s.cells[i] + t.ahead[side]]
        if held > t.pursuers and s.beside[held - 1] > 0:
            rewards[i, PREY] += CATCH / s.beside[held - 1]
            s.energy[i] = t.stamina


@rule
def leave(s, i):
    """Somebody leaves the field."""
    s.grid[s.cells[i]] = EMPTY
    s.there[i] = 0
    s.gone[i] = s.time


@rule
def scripted(s, t, i):
    """Action of an evader that follows a script (R11)."""
    if t.script == STILL:
        return STAY
    if t.script == WANDER or not sees_pursuers(s, t, i):
        return draws.integers(s, MOVES)
    best = 0
    ties = 0
    for k in range(MOVES):
        if k == STAY or s.grid[s.cells[i] + t.ahead[k]] == EMPTY:
            if s.nearest[k] > best:
                best = s.nearest[k]
                ties = 0
            if s.nearest[k] == best:
                ties += 1
    chosen = draws.integers(s, ties)
    for k in range(MOVES):
        is_open = k == STAY or s.grid[s.cells[i] + t.ahead[k]] == EMPTY
        if is_open and s.nearest[k] == best:
            if chosen == 0:
                return k
            chosen -= 1
    return STAY


@rule
def sees_pursuers(s, t, i):
    """Tells whether an evader's window has any; `s.nearest[k]`: how near after move k."""
    for k in range(MOVES):
        s.nearest[k] = FAR
    is_any = False
    sight = t.evader_sight
    for y in range(-sight, sight + 1):
        for x in range(-sight, sight + 1):
            held = s.grid[s.cells[i] + y * t.width + x]
            if held > EMPTY and held <= t.pursuers:
                is_any = True
                for k in range(MOVES):
                    down = (1 if k == SOUTH else 0) - (1 if k == NORTH else 0)
                    right = (1 if k == EAST else 0) - (1 if k == WEST else 0)
                    s.nearest[k] = min(s.nearest[k], abs(y - down) + abs(x - right))
    return is_any


# -- what they see


@rule
def observe_both(s, t, obs):
    """Everybody's window (R10)."""
    for i in range(t.pursuers):
        look(s, t, i, obs[0], i, t.pursuer_sight, True)
    for j in range(t.evaders):
        look(s, t, t.pursuers + j, obs[1], j, t.evader_sight, False)


@rule
def observe_pursuers(s, t, obs):
    """The pursuers' windows (R10)."""
    for i in range(t.pursuers):
        look(s, t, i, obs, i, t.pursuer_sight, True)


@rule
def look(s, t, i, obs, at, sight, tells_energy):
    """Fills one window; who left in an earlier tick has none."""
    if s.there[i] == 0 and s.gone[i] != s.time:
        return
    for y in range(2 * sight + 1):
        first = s.cells[i] + (y - sight) * t.width - sight
        for x in range(2 * sight + 1):
            held = s.grid[first + x]
            obs[at, y, x, 0] = held == ROCK
            obs[at, y, x, 1] = held > EMPTY and held <= t.pursuers
            obs[at, y, x, 2] = held > t.pursuers
            if tells_energy and held > EMPTY and held <= t.pursuers:
                obs[at, y, x, 1] = percent(s, t, held - 1)


@rule
def percent(s, t, i):
    """A pursuer's energy, rounded up; all of it where nobody starves."""
    return FULL if t.stamina == 0 else (s.energy[i] * FULL + t.stamina - 1) // t.stamina


@rule
def inform(s, t, infos):
    """Row and column, energy, and how many evaders are left."""
    for i in range(len(infos)):
        infos[i].position[0] = s.cells[i] // t.width - t.border
        infos[i].position[1] = s.cells[i] % t.width - t.border
        infos[i].energy = s.energy[i] if i < t.pursuers else 0
        infos[i].evaders = s.evaders


@rule
def overview(s, t, state):
    """The field: -2 a rock, -1 an evader, 0 empty, else a pursuer's energy (1: never starves)."""
    for row in range(t.rows):
        for column in range(t.columns):
            held = s.grid[place(t, row, column)]
            value = 0
            if held == ROCK:
                value = -2
            elif held > t.pursuers:
                value = -1
            elif held > EMPTY:
                value = max(s.energy[held - 1], 1)
            state[row, column] = value
