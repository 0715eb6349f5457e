// What is drawn for one lane: first everything in sight goes into pixel columns (or turns, where they are wider), then each column is drawn once.

const STRIP = 0.24; // of a lane's height: who acted, below the rewards

let column = null; // one set of columns for all lanes

const columns = (count) => {
  if (column === null || column.what.length < count) {
    column = {
      paidHigh: new Float32Array(count),
      paidLow: new Float32Array(count),
      cumulativeHigh: new Float32Array(count),
      cumulativeLow: new Float32Array(count),
      what: new Uint8Array(count),
    };
  }
  for (const values of Object.values(column)) values.fill(0);
  return column;
};

// Puts what is in sight into columns: a column a turn where a turn is at least a pixel wide, else a column a pixel.
const gather = (episode, agents, level, { first, perTurn, width }) => {
  const past = first + Math.ceil(width / perTurn);
  const wide = perTurn >= 1;
  const into = columns(wide ? past - first + 1 : Math.ceil(width) + 1);
  const bin = (turn) => (wide ? turn - first : Math.max(0, Math.floor((turn - first) * perTurn)));
  if (level === null) {
    for (const agent of agents) {
      const end = episode.agentStart[agent + 1];
      for (let i = episode.place(agent, first); i < end; i++) {
        const row = episode.agentRows[i];
        if (episode.turn[row] >= past) break;
        gk.intoBin(into, bin(episode.turn[row]), episode, row);
      }
    }
  } else {
    const lastBin = Math.min(level.what.length, Math.ceil(past / level.width));
    for (let i = Math.floor(first / level.width); i < lastBin; i++) {
      const at = bin(i * level.width);
      if (at < into.what.length) gk.mergeBin(into, at, level, i);
    }
  }
  return [into, wide ? past - first : Math.ceil(width)];
};

const tall = (value, episode, half) => (value === 0 ? 0 : Math.max(1.5, Math.sqrt(Math.min(1, Math.abs(value) / episode.tallest)) * half));

// A lane, its top at 0; of several agents the largest and the smallest of their rewards.
gk.drawLane = (ink, episode, agents, level, shape) => {
  const colours = gk.colours();
  const [found, count] = gather(episode, agents, level, shape);
  const step = Math.max(1, shape.perTurn);
  const gap = step >= 4 ? 1 : 0;
  const strip = Math.round(shape.height * STRIP);
  const rewards = shape.height - strip - 2;
  const middle = rewards / 2;
  for (const agent of agents) drawPresence(ink, episode, agent, shape, middle, colours);
  fill(ink, colours.gain, found.paidHigh, count, (i, value) => bar(ink, i * step, step - gap, middle, -tall(value, episode, middle - 1)));
  fill(ink, colours.loss, found.paidLow, count, (i, value) => bar(ink, i * step, step - gap, middle, tall(value, episode, middle - 1)));
  const dash = (side) => (i, value) => ink.fillRect(i * step, middle + side * tall(value, episode, middle - 1) - 0.75, Math.max(1, step - gap), 1.5);
  if (episode.isTurnwise) {
    fill(ink, colours.cumulative, found.cumulativeHigh, count, dash(-1));
    fill(ink, colours.cumulative, found.cumulativeLow, count, dash(1));
  }
  const own = agents.length > 1 ? colours.grey : gk.colourAt(gk.placeOf("agent", episode.agents[agents[0]].name));
  drawActs(ink, found.what, count, { step, gap, top: rewards, strip, own, idle: colours.idle });
  if (agents.length === 1) drawEnd(ink, episode, agents[0], shape, colours);
};

const fill = (ink, colour, values, count, draw) => {
  ink.fillStyle = colour;
  for (let i = 0; i < count; i++) if (values[i] !== 0) draw(i, values[i]);
};

const bar = (ink, x, width, middle, height) => ink.fillRect(x, Math.min(middle, middle + height), Math.max(1, width), Math.abs(height));

// A quiet ground from where the agent is first seen to where it ended, and the line of nothing.
const drawPresence = (ink, episode, agent, { first, perTurn, width, height }, middle, colours) => {
  const start = episode.agentStart[agent];
  if (start === episode.agentStart[agent + 1]) return;
  const from = Math.max(0, (episode.turn[episode.agentRows[start]] - first) * perTurn);
  const end = episode.ends[agent];
  const past = Math.min(width, ((end === null ? episode.last + 1 : end.turn + 1) - first) * perTurn);
  if (past <= from) return;
  ink.fillStyle = colours.band;
  ink.fillRect(from, 1, past - from, height - 2);
  ink.fillStyle = colours.line;
  ink.fillRect(from, middle - 0.5, past - from, 1);
};

// An agent's actions in its own colour.
const drawActs = (ink, what, count, { step, gap, top, strip, own, idle }) => {
  const wide = Math.max(1, step - gap);
  ink.fillStyle = own;
  for (let i = 0; i < count; i++) if (what[i] === gk.ACTED) ink.fillRect(i * step, top, wide, strip);
  ink.fillStyle = idle;
  for (let i = 0; i < count; i++) if (what[i] === gk.IDLE) ink.fillRect(i * step, top + strip / 2, wide, strip / 2);
};

// A filled square where the rules ended the agent, an open one where it was cut off.
const drawEnd = (ink, episode, agent, { first, perTurn, width, height }, colours) => {
  const end = episode.ends[agent];
  if (end === null || end.turn < first) return;
  const size = 8;
  const x = Math.min(width - size - 1, Math.max(1, (end.turn - first + 0.5) * perTurn - size / 2));
  if ((end.turn - first) * perTurn > width) return;
  const y = 2;
  ink.fillStyle = end.how === "terminated" ? colours.ink : colours.ground;
  ink.strokeStyle = colours.ink;
  ink.lineWidth = 1.5;
  ink.fillRect(x, y, size, size);
  ink.strokeRect(x, y, size, size);
};
