"""Checks of cost: time and memory of steps and episodes do not grow."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from statistics import mean, stdev
from typing import Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import LOW, Case, Cases, check
from gamekeeper.checks.facts.cost_facts import EpisodeWork, TurnWork
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import text_of
from gamekeeper.checks.reproducers import work
from gamekeeper.contract import Contract

WINDOWS: Final = 8
"""Into so many stretches of equal length an episode is cut; one alone says little."""
LEAST_TURNS: Final = 40


def means(values: Sequence[float], windows: int = WINDOWS) -> list[float]:
    """The mean of each of `windows` equal stretches; what is left over at the end is left out."""
    width = len(values) // windows
    return [sum(values[k * width : (k + 1) * width]) / width for k in range(windows)]


def is_rising(stretches: Sequence[float], *, factor: float, least: float) -> bool:
    """Tells whether each stretch is above the one before, and the last far above the first.

    Args:
        stretches: in their order; one of them may be out of order.
        factor: the last is so many times the first at least.
        least: and above it by so much at least.
    """
    first, last = stretches[0], stretches[-1]
    falls = sum(b <= a for a, b in pairwise(stretches))
    return falls <= len(stretches) // 8 and last >= factor * first and last - first >= least


STEP_COST_FACTOR: Final = 2.0
STEP_COST_LEAST: Final = {"lines": 100.0, "passing": 4096.0}
"""Lines of Python, and bytes taken at the peak, by which a step must have grown."""
STEP_COST_WORDS: Final = {"lines": "lines of Python a step", "passing": "bytes taken by a step"}
STEP_COST_PROOF: Final = """\
env = make()
env.reset(seed=SEED)
costs = []
def turn(action):
    {look}env.step(action)
for action in ACTIONS:
    costs.append(work(turn, action))
part = len(costs) // 8
first, last = sum(costs[:part]) / part, sum(costs[-part:]) / part
assert last[{column}] < 2 * first[{column}], ('lines and bytes a step, first and last', first, last)
"""


@check("GK831", LOW, "long", confidence=0.9, looks_at="an episode of 40 turns or more")
def steps_cost_the_same_all_along(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The cost of a step doesn't grow with the length of the episode.

    A step, or an observation, that goes through the whole history makes an episode's cost
    quadratic. Counted are lines of Python and bytes, not seconds, so the verdict is the same on
    every run; work inside compiled code that takes no memory isn't seen. The episode is cut into
    eight stretches of equal length; the cost counts as growing where it rises from each to the next
    but one, to twice the first and by a hundred lines or 4 kB; where two episodes were looked at,
    in both. Growth that agents who joined explain isn't counted.

    Bad:
        self.history.append(self.cells.copy())
        self.path = sum(np.linalg.norm(b - a) for a, b in pairwise(self.history))

    Good:
        self.path += np.linalg.norm(self.cells - before)

    Fix: keep what is needed of the past up to date in step(), instead of going through all of it
    again
    """
    plays = [fact for fact in evidence.facts(TurnWork) if len(fact.value.live) >= LEAST_TURNS]
    for name, least in STEP_COST_LEAST.items():
        looks = [means(_by_agent(fact.value, name)) for fact in plays]
        if not looks:
            return
        is_growing = all(is_rising(look, factor=STEP_COST_FACTOR, least=least) for look in looks)
        first, last = round(looks[0][0]), round(looks[0][-1])
        first_lines, column = text_of(work)[0], 0 if name == "lines" else 1
        proof = _traced(evidence.api, STEP_COST_PROOF, "sys", first_lines, column=column)
        where = replace(plays[0].where, turn=None, agent=None, field=f"step.{name}")
        seen = f"{last} after {len(plays[0].value.live)} turns"
        yield Case(where, not is_growing, f"about {first} {STEP_COST_WORDS[name]}", seen, proof)


def _traced(api: str, lines: str, module: str, first: str = "", **values: int) -> Reproducer:
    """Lines that count memory; in an AEC environment `last()` is called before each step."""
    indent = lines.partition("{look}")[0].rpartition("\n")[2]
    look = "" if api == "parallel" else f"env.last()\n{indent}"
    imports = module, "tracemalloc"
    return Reproducer(first + lines.format(look=look, **values), plays=False, imports=imports)


def _by_agent(work: TurnWork, name: str) -> list[float]:
    """The series, scaled down where there are more agents than at first."""
    live, series = work.live, getattr(work, name)
    return [value / max(now / live[0], 1.0) for value, now in zip(series, live, strict=True)]


REPEATED: Final = "several episodes, one after the other, that were played to their end"
EPISODE_COST_WARM: Final = 2
"""Episodes in which caches may fill."""
EPISODE_COST_FACTOR: Final = 1.1
EPISODE_COST_LEAST: Final = {"lines": 60.0, "passing": 2048.0}
EPISODE_COST_WORDS: Final = {"lines": "lines of Python", "passing": "bytes at the peak"}
EPISODE_COST_PROOF: Final = """\
env = make()
def episode():
    env.reset(seed=SEED)
    for action in ACTIONS:
        {look}env.step(action)
costs = [work(episode) for _ in range(14)][2:]
assert costs[-1][{column}] < 1.1 * costs[0][{column}], ('lines and bytes by episode', costs)
"""


@check("GK832", LOW, "repeated", looks_at=REPEATED)
def episodes_cost_the_same(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The cost of an episode doesn't grow with the number of episodes before it.

    Otherwise training becomes slower day by day, although nothing of the game has changed. One
    short episode is repeated from the same seed in one instance; lines of Python and bytes are
    counted, so the verdict is the same on every run. After two episodes in which caches may fill,
    the last may cost a tenth more than the first at most, or rise and fall.

    Bad:
        def reset(self, seed=None, options=None):
            self.totals = [sum(log) for log in self.logs]      # of all episodes ever

    Good:
        def reset(self, seed=None, options=None):
            self.log = []

    Fix: empty in reset() what step() has gathered
    """
    for fact in evidence.facts(EpisodeWork):
        for name, least in EPISODE_COST_LEAST.items():
            costs = getattr(fact.value, name)[EPISODE_COST_WARM:]
            is_growing = is_rising(costs, factor=EPISODE_COST_FACTOR, least=least)
            first, column = text_of(work)[0], 0 if name == "lines" else 1
            proof = _traced(evidence.api, EPISODE_COST_PROOF, "sys", first, column=column)
            where = replace(fact.where, field=f"episodes.{name}")
            is_ok = not is_growing
            expected = f"about {costs[0]} {EPISODE_COST_WORDS[name]} an episode"
            yield Case(where, is_ok, expected, f"{costs[-1]} after {len(costs)} more", proof)


EPISODE_MEMORY_WARM: Final = 4
"""Episodes in which caches may fill."""
LINE_BYTES: Final = 512
NUMBER_BYTES: Final = 64
"""An episode may leave a line of a log, and in it a number for each agent."""
EPISODE_MEMORY_PROOF: Final = """\
env = make()
def episode():
    env.reset(seed=SEED)
    for action in ACTIONS:
        {look}env.step(action)
for _ in range(4):
    episode()
tracemalloc.start()
others = [tracemalloc.Filter(False, name) for name in ("*_arraypad_impl.py", tracemalloc.__file__)]
sizes = []
for _ in range(16):
    episode()
    gc.collect()
    taken = tracemalloc.take_snapshot().filter_traces(others).traces
    sizes.append(sum(each.size for each in taken))
left = np.diff(sizes[4:])
least = np.mean(left) - 3 * np.std(left, ddof=1) / len(left) ** 0.5
assert least < {most}, ('at least', least, 'bytes more an episode', sizes)
"""


@check("GK833", LOW, "repeated", looks_at=REPEATED)
def episodes_leave_nothing_behind(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An episode leaves no memory behind: what is in use doesn't grow from episode to episode.

    A leak ends a long training run after hours. One short episode is repeated from the same seed in
    one instance. Of the episodes after the first four the mean growth is taken, with an interval of
    three standard errors on both sides: a leak is what lies wholly above a line of a log, 512
    bytes and 64 for each agent. Memory that compiled libraries take by themselves isn't seen, nor
    what NumPy's own `pad` keeps.

    Bad:
        def reset(self, seed=None, options=None):
            self.episodes.append([])                  # and step() writes into the last one

    Good:
        def reset(self, seed=None, options=None):
            self.episode = []

    Fix: let go in reset() of what belongs to an episode
    """
    for fact in evidence.facts(EpisodeWork):
        left = [
            after - before for before, after in pairwise(fact.value.sizes[EPISODE_MEMORY_WARM:])
        ]
        most = LINE_BYTES + NUMBER_BYTES * len(evidence.agents)
        middle, error = mean(left), 3 * stdev(left) / len(left) ** 0.5
        where = replace(fact.where, field="episodes.memory")
        is_ok = middle - error < most
        seen = f"{middle - error:.0f} to {middle + error:.0f} bytes more an episode"
        proof = _traced(evidence.api, EPISODE_MEMORY_PROOF, "gc", most=most)
        yield Case(where, is_ok, f"less than {most} bytes more an episode", seen, proof)


LEAST_BYTES: Final = 32 << 10
"""A step may keep that much: a game may know its history."""
STEP_MEMORY_PROOF: Final = """\
env = make()
env.reset(seed=SEED)
tracemalloc.start()
sizes = []
for action in ACTIONS:
    {look}env.step(action)
    gc.collect()
    sizes.append(tracemalloc.get_traced_memory()[0])
assert np.median(np.diff(sizes)) < 32768, ('bytes in use after each step', sizes)
"""


@check("GK834", LOW, "long", looks_at="an episode of 40 turns or more")
def steps_keep_little(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A step keeps no more than 32 kB of memory until the end of the episode.

    Many copies of the environment run at once, and each would hold a whole film of its episode. A
    game may know its history: only every second step that keeps so much, over forty turns or more,
    is called a fault.

    Bad:
        self.film.append(self.draw())

    Good:
        self.moves.append(action)

    Fix: keep what the rules need of the past, not whole observations or pictures
    """
    for fact in evidence.facts(TurnWork):
        if len(fact.value.sizes) >= LEAST_TURNS:
            kept = sorted(after - before for before, after in pairwise(fact.value.sizes))
            middle = kept[len(kept) // 2]
            proof = _traced(evidence.api, STEP_MEMORY_PROOF, "gc")
            where = replace(fact.where, field="step.memory")
            expected = f"less than {LEAST_BYTES} bytes a step"
            yield Case(where, middle < LEAST_BYTES, expected, f"{middle} bytes a step", proof)
