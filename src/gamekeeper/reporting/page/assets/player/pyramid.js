// A lane, of an agent or of several, seen from afar: bins of 4, 8, 16, … turns with the largest and smallest reward in each and whether it acted.
// Made when an agent first comes in sight and kept for the last few: 10^5 turns of hundreds of agents stay small.

const FINEST = 4; // turns in the smallest bins; below that the rows themselves are few enough
const KEPT = 160; // lanes

gk.ACTED = 1;
gk.IDLE = 2; // it acted, and only with "nothing"

const emptyLevel = (width, count) => ({
  width,
  paidHigh: new Float32Array(count),
  paidLow: new Float32Array(count),
  cumulativeHigh: new Float32Array(count),
  cumulativeLow: new Float32Array(count),
  what: new Uint8Array(count),
});

// Puts a row's numbers into a bin of a level (or into a pixel column, which has the same fields).
gk.intoBin = (level, bin, episode, row) => {
  const paid = episode.reward[row];
  const reward = episode.cumulative_reward[row];
  if (paid > level.paidHigh[bin]) level.paidHigh[bin] = paid;
  if (paid < level.paidLow[bin]) level.paidLow[bin] = paid;
  if (reward > level.cumulativeHigh[bin]) level.cumulativeHigh[bin] = reward;
  if (reward < level.cumulativeLow[bin]) level.cumulativeLow[bin] = reward;
  if (episode.acted(row)) mixWhat(level, bin, episode.isIdle(row) ? gk.IDLE : gk.ACTED);
};

// An agent that did something at least once in a bin acted in it.
const mixWhat = (level, bin, what) => {
  if (what === gk.ACTED || level.what[bin] === 0) level.what[bin] = what;
};

gk.mergeBin = (into, bin, from, other) => {
  if (from.paidHigh[other] > into.paidHigh[bin]) into.paidHigh[bin] = from.paidHigh[other];
  if (from.paidLow[other] < into.paidLow[bin]) into.paidLow[bin] = from.paidLow[other];
  if (from.cumulativeHigh[other] > into.cumulativeHigh[bin]) into.cumulativeHigh[bin] = from.cumulativeHigh[other];
  if (from.cumulativeLow[other] < into.cumulativeLow[bin]) into.cumulativeLow[bin] = from.cumulativeLow[other];
  if (from.what[other]) mixWhat(into, bin, from.what[other]);
};

const build = (episode, agents) => {
  const count = Math.ceil((episode.last + 1) / FINEST);
  const finest = emptyLevel(FINEST, count);
  for (const agent of agents) {
    for (let i = episode.agentStart[agent]; i < episode.agentStart[agent + 1]; i++) {
      const row = episode.agentRows[i];
      gk.intoBin(finest, Math.floor(episode.turn[row] / FINEST), episode, row);
    }
  }
  const levels = [finest];
  for (let below = finest; below.what.length > 64; ) {
    const level = emptyLevel(below.width * 2, Math.ceil(below.what.length / 2));
    for (let i = 0; i < below.what.length; i++) gk.mergeBin(level, i >> 1, below, i);
    levels.push(level);
    below = level;
  }
  return levels;
};

gk.Pyramids = class {
  constructor(episode) {
    this.episode = episode;
    this.built = new Map();
  }

  // The coarsest level whose bins are no wider than a pixel; null where the rows themselves are to be read.
  level(lane, turnsPerPixel) {
    if (turnsPerPixel < FINEST) return null;
    let levels = this.built.get(lane);
    if (levels) this.built.delete(lane);
    else levels = build(this.episode, lane.agents);
    this.built.set(lane, levels);
    if (this.built.size > KEPT) this.built.delete(this.built.keys().next().value);
    let best = levels[0];
    for (const level of levels) if (level.width <= turnsPerPixel) best = level;
    return best;
  }
};
