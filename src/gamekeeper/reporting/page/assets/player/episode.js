// A packed episode as typed columns, with the rows of a turn and of an agent found at once.

const numbers = (column, n) => {
  const out = new Float64Array(n).fill(NaN);
  if (column) for (let i = 0; i < n; i++) if (column[i] !== null) out[i] = column[i];
  return out;
};

const indices = (column, n) => {
  const out = new Int32Array(n).fill(-1);
  if (column) for (let i = 0; i < n; i++) if (column[i] !== null) out[i] = column[i];
  return out;
};

// 32 bits a turn of all that was recorded of it, also of what a page doesn't hold: two episodes that differ there differ in them.
const checksums = (text) => {
  const bytes = Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0));
  return new Uint32Array(bytes.buffer);
};

// Rows by key (turn or agent): the rows of key k are rows[start[k]] to rows[start[k + 1] - 1], in their order.
const grouped = (keys, count) => {
  const start = new Int32Array(count + 1);
  for (const key of keys) start[key + 1]++;
  for (let k = 0; k < count; k++) start[k + 1] += start[k];
  const next = start.slice();
  const rows = new Int32Array(keys.length);
  for (let i = 0; i < keys.length; i++) rows[next[keys[i]]++] = i;
  return { start, rows };
};

// The index of the last of rising numbers that is not beyond `turn`, or -1.
gk.lastUntil = (turns, turn) => {
  let [low, high] = [0, turns.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (turns[middle] <= turn) low = middle + 1;
    else high = middle;
  }
  return low - 1;
};

const PENALTIES = 20; // as many are marked

gk.Episode = class {
  constructor(packed) {
    Object.assign(this, { run: packed.run, index: packed.episode, seed: packed.seed, api: packed.api, turns: packed.turns });
    Object.assign(this, { end: packed.end, error: packed.error, base: packed.base, change: packed.change });
    this.agents = packed.agents;
    this.values = packed.values ?? [];
    this.endings = packed.endings ?? {};
    this.drawing = packed.drawing ?? null;
    this.curve = packed.curve ?? []; // [turn, share that succeeds, low, high]
    this.drawingNote = packed.drawing_note ?? "";
    const rows = packed.rows;
    const n = rows.turn.length;
    this.turn = Int32Array.from(rows.turn);
    this.agent = Int32Array.from(rows.agent);
    this.order = indices(rows.order, n);
    this.action = indices(rows.action, n);
    this.cumulative_reward = numbers(rows.cumulative_reward, n);
    this.reward = numbers(rows.reward, n);
    this.terminated = indices(rows.terminated, n);
    this.truncated = indices(rows.truncated, n);
    this.mask = indices(rows.mask, n);
    this.info = indices(rows.info, n);
    this.nonconforming = indices(rows.nonconforming, n);
    this.terms = Object.create(null); // a term may have any name, "constructor" too
    for (const [name, column] of Object.entries(rows.terms ?? {})) this.terms[name] = numbers(column, n);
    this.checksums = checksums(packed.checksums);
    this.last = Math.max(n ? this.turn[n - 1] : 0, packed.end === "ended" ? packed.turns : 0); // of T steps turns 0 to T, the last without actions
    this.isTurnwise = packed.api === "aec"; // else the cumulative reward is the reward of the turn before
    // What was found after the last row belongs to it.
    this.marks = (packed.marks ?? []).map((mark) => ({ ...mark, turn: Math.max(0, Math.min(mark.turn, this.last)) })).sort((a, b) => a.turn - b.turn);
    this.byTurn = grouped(this.turn, this.last + 1).start;
    const byAgent = grouped(this.agent, this.agents.length);
    this.agentStart = byAgent.start;
    this.agentRows = byAgent.rows;
    this.sums = new Map();
    this.texts = new Map();
    this.penalties = this.#penalties(); // drawn beside the marks; too many to be jumped to
    this.tallest = Math.max(1e-12, this.#tallest(this.reward), this.#tallest(this.cumulative_reward));
    this.idle = this.#idleValues();
    this.slot = new Map(this.agents.map((agent, i) => [agent.name, i]));
    this.ends = this.agents.map((agent) => gk.own(this.endings, agent.name));
  }

  get key() {
    return `${this.run}/${this.index}`;
  }

  // [first, past] rows of a turn.
  rowsAt(turn) {
    return turn < 0 || turn > this.last ? [0, 0] : [this.byTurn[turn], this.byTurn[turn + 1]];
  }

  // Where in `agentRows` an agent's first row at or after a turn stands.
  place(agent, turn) {
    let [low, high] = [this.agentStart[agent], this.agentStart[agent + 1]];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.turn[this.agentRows[middle]] < turn) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  // The agent's row at exactly this turn, or -1.
  rowOf(agent, turn) {
    const place = this.place(agent, turn);
    if (place >= this.agentStart[agent + 1]) return -1;
    const row = this.agentRows[place];
    return this.turn[row] === turn ? row : -1;
  }

  // What an agent was paid up to a turn and with it.
  paidUntil(agent, turn) {
    if (!this.sums.has(agent)) {
      const [from, past] = [this.agentStart[agent], this.agentStart[agent + 1]];
      const sums = new Float64Array(past - from + 1);
      for (let i = from; i < past; i++) sums[i - from + 1] = sums[i - from] + (this.reward[this.agentRows[i]] || 0);
      this.sums.set(agent, sums);
    }
    const sum = this.sums.get(agent)[this.place(agent, turn + 1) - this.agentStart[agent]];
    return Math.abs(sum) < this.tallest * 1e-12 ? 0 : sum; // what floats leave of a sum of 0
  }

  // Whether an agent has ended before a turn.
  hasEnded(agent, turn) {
    return this.ends[agent] !== null && this.ends[agent].turn < turn;
  }

  // Whether the agent's action in a row is its declared "nothing".
  isIdle(row) {
    return this.action[row] >= 0 && this.idle[this.agent[row]].has(this.action[row]);
  }

  // Whether the agent acted in a row; an ended agent's turn, which only takes it off the roster, is no act.
  acted(row) {
    return this.action[row] >= 0 || (this.order[row] >= 0 && this.terminated[row] < 1 && this.truncated[row] < 1);
  }

  value(index) {
    return index < 0 ? null : this.values[index];
  }

  // A value's JSON, made once: what two episodes are compared by.
  textOf(index) {
    if (index < 0) return "";
    if (!this.texts.has(index)) this.texts.set(index, JSON.stringify(this.values[index]));
    return this.texts.get(index);
  }

  // Whether an agent is in the game at a turn: it has been seen, and has not ended before.
  isThere(agent, turn) {
    const [from, past] = [this.agentStart[agent], this.agentStart[agent + 1]];
    if (from === past || this.turn[this.agentRows[from]] > turn) return false;
    return !this.hasEnded(agent, turn);
  }

  // Rewards below 0 that are at least half as large as the largest loss; none where such losses are usual.
  #penalties() {
    let least = 0;
    for (const value of this.reward) if (value < least && value !== -Infinity) least = value;
    const rows = [];
    for (let row = 0; least < 0 && row < this.reward.length; row++) if (this.reward[row] <= least / 2) rows.push(row);
    if (rows.length > PENALTIES) return [];
    return rows.map((row) => ({ turn: this.turn[row], kind: "penalty", agent: this.agents[this.agent[row]].name, text: gk.number(this.reward[row]) }));
  }

  #tallest(column) {
    let most = 0;
    for (const value of column) {
      const size = Math.abs(value);
      if (size > most && size !== Infinity) most = size;
    }
    return most;
  }

  #idleValues() {
    const texts = this.agents.map((agent) => (agent.noop === null || agent.noop === undefined ? null : JSON.stringify(agent.noop)));
    if (texts.every((text) => text === null)) return texts.map(() => new Set());
    const found = new Map();
    this.values.forEach((value, i) => {
      const text = JSON.stringify(value);
      if (!found.has(text)) found.set(text, new Set());
      found.get(text).add(i);
    });
    return texts.map((text) => (text !== null && found.get(text)) || new Set());
  }
};
