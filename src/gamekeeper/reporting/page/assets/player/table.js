// What stands under the cursor: a row an agent, with what it was given, did and was paid. With few agents each keeps its place; with many, those who
// have a row at this turn, some at a time.

const FEW = 16;
const AT_ONCE = 40;
const LEGAL = 12; // of a mask's actions named

const flag = (value) => (value < 0 ? "" : value ? "yes" : "no");

// A mask of ones and zeros as its legal actions; anything else as it is.
const maskText = (mask) => {
  if (!Array.isArray(mask) || !mask.every((x) => x === 0 || x === 1 || x === true || x === false)) return gk.plain(mask);
  const legal = [];
  mask.forEach((x, i) => x && legal.push(i));
  const named = legal.slice(0, LEGAL).join(", ") + (legal.length > LEGAL ? ", …" : "");
  return `${legal.length} of ${mask.length}: ${named || "none"}`;
};

const COLUMNS = [
  { field: "action", title: "action", note: "the action, its number in brackets", long: true },
  { field: "paid", title: "reward", note: "the reward of this turn", number: true },
  { field: "cumulative_reward", title: "reward since last turn", note: "the cumulative reward before the action, as last() returns it: of the steps since the agent's last turn", number: true },
  { field: "total", title: "return so far", note: "sum of the rewards up to this turn", number: true },
  { field: "ended", title: "ended", note: "terminated or truncated, by its flags" },
  { field: "mask", title: "legal", note: "the actions that the mask allows", long: true },
  { field: "info", title: "info", long: true },
  { field: "nonconforming", title: "nonconforming", note: "values that don't fit their space or the protocol", long: true },
];

// The name of a row's action; null without one.
const actionName = (episode, row) => {
  const value = episode.value(episode.action[row]);
  const name = Number.isInteger(value) ? gk.own(episode.agents[episode.agent[row]].actions ?? [], value) : null;
  return name === null ? null : gk.visible(name);
};

// An action by its name, its number in brackets; the declared noop without a name is called so.
gk.actionText = (episode, row) => {
  const value = episode.value(episode.action[row]);
  const [name, text] = [actionName(episode, row), gk.plain(value)];
  if (name === null) return episode.isIdle(row) && Number.isInteger(value) ? `noop (${text})` : text;
  return `${name} (${text})`;
};

// Several numbers, each short; null of anything else.
const numbersText = (value) => {
  if (!Array.isArray(value) || !value.every(Number.isFinite)) return null;
  return `[${value.map(gk.short).join(", ")}]`;
};

// What an agent does at a turn, to stand beside its name: its action, else why there is none.
gk.doingText = (episode, agent, turn) => {
  const row = episode.rowOf(agent, turn);
  if (row >= 0 && episode.action[row] >= 0) return actionName(episode, row) ?? numbersText(episode.value(episode.action[row])) ?? `action ${gk.actionText(episode, row)}`;
  if (episode.hasEnded(agent, turn)) return "has ended";
  if (!episode.isThere(agent, turn)) return "";
  return turn < episode.last && episode.isTurnwise ? "not its turn" : "no action";
};

// How many of these agents act at a turn.
gk.actedOf = (episode, agents, turn) => agents.filter((agent) => {
  const row = episode.rowOf(agent, turn);
  return row >= 0 && episode.acted(row);
}).length;

// The least and the largest of numbers; "" where there is none.
gk.between = (values) => {
  const known = values.filter((value) => value !== null && !Number.isNaN(value));
  const [low, high] = [known.reduce((a, b) => Math.min(a, b), Infinity), known.reduce((a, b) => Math.max(a, b), -Infinity)];
  return known.length === 0 ? "" : low === high ? gk.number(low) : `${gk.number(low)} to ${gk.number(high)}`;
};

gk.TurnTable = class {
  // `lanes`: an agent, or a folded role, has a row as it has a lane.
  constructor(episode, label, lanes) {
    this.episode = episode;
    this.lanes = lanes;
    this.from = 0;
    this.other = null;
    this.columns = this.#columns();
    this.head = gk.node("tr", {}, gk.node("th", { scope: "col", text: "agent" }), ...this.columns.map(headCell));
    this.body = gk.node("tbody");
    this.caption = gk.node("caption");
    const table = gk.node("table", { class: "data turn-table" }, this.caption, gk.node("thead", {}, this.head), this.body);
    this.pager = this.#pages();
    const region = gk.node("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": `${label}: observation, action and reward of each agent` }, table);
    this.root = gk.node("div", { class: "turn" }, region, this.pager);
    this.rows = [];
  }

  // Columns that say nothing over the whole episode are left out.
  #columns() {
    const e = this.episode;
    const seen = (column) => column.some((value) => value >= 0);
    const used = { mask: seen(e.mask), info: seen(e.info), nonconforming: seen(e.nonconforming) };
    used.cumulative_reward = e.isTurnwise;
    const kept = COLUMNS.filter(({ field }) => used[field] ?? true);
    const terms = Object.keys(e.terms).map((term) => ({ field: term, title: gk.visible(term), note: "a term of the reward", number: true, isTerm: true }));
    kept.splice(1 + kept.findIndex(({ field }) => field === "paid"), 0, ...terms);
    return kept;
  }

  #pages() {
    const step = (by) => () => {
      this.from = Math.max(0, this.from + by);
      this.show(this.turn, this.other);
    };
    const button = (text, by) => gk.button(step(by), { text });
    this.range = gk.node("span");
    return gk.node("p", { class: "pager", hidden: true }, button("Earlier agents", -AT_ONCE), this.range, button("Later agents", AT_ONCE));
  }

  // `other`: the episode beside this one; what differs from it is marked.
  show(turn, other = null) {
    this.turn = turn;
    this.other = other;
    const e = this.episode;
    const [from, past] = e.rowsAt(turn);
    const rows = new Map();
    for (let row = from; row < past; row++) rows.set(e.agent[row], row);
    const { order, chosen } = this.lanes;
    const lanes = e.agents.length <= FEW ? order : order.filter(({ agents }) => agents.some((agent) => rows.has(agent)));
    const count = lanes.length;
    if (this.from >= count) this.from = 0;
    const shown = Math.min(AT_ONCE, count - this.from);
    while (this.rows.length < shown) this.#addRow();
    this.rows.forEach((cells, i) => {
      cells.row.hidden = i >= shown;
      if (i >= shown) return;
      const lane = lanes[this.from + i];
      cells.row.classList.toggle("chosen", lane.name === chosen);
      this.#fill(cells, lane, lane.agents.map((agent) => rows.get(agent) ?? -1), turn);
    });
    gk.say(this.caption, this.#says(turn, from, past));
    this.pager.hidden = count <= AT_ONCE;
    if (!this.pager.hidden) gk.say(this.range, ` ${this.from + 1} to ${this.from + shown} of ${count} `);
  }

  #says(turn, from, past) {
    const e = this.episode;
    if (turn > e.last) return `This episode has no turn ${turn}: its last is ${e.last}.`;
    let acted = 0;
    for (let row = from; row < past; row++) if (e.acted(row)) acted++;
    const who = acted === 1 ? "1 agent acted" : `${acted} agents acted`;
    return `Turn ${turn} of ${e.last}: ${acted ? who : "no agent acted"}`;
  }

  #addRow() {
    const sign = gk.node("i", { class: "agent-sign", "aria-hidden": "true" });
    const name = gk.node("bdi");
    const cells = this.columns.map(({ number, long }) => gk.node("td", { class: number ? "num" : long ? "long" : null }));
    const row = gk.node("tr", {}, gk.node("th", { scope: "row" }, sign, name), ...cells);
    this.body.append(row);
    this.rows.push({ row, sign, name, cells });
  }

  #fill({ row: line, sign, name, cells }, lane, rows, turn) {
    const e = this.episode;
    const [[agent], [row]] = [lane.agents, rows];
    gk.signLane(sign, e, lane);
    gk.say(name, gk.visible(lane.name));
    line.classList.toggle("absent", rows.every((each) => each < 0));
    line.classList.toggle("acted", rows.some((each) => each >= 0 && e.acted(each)));
    if (lane.fold !== undefined) return this.columns.forEach((column, i) => this.#sum(cells[i], column, lane.agents, rows, turn));
    const slot = this.other ? this.other.slot.get(e.agents[agent].name) : undefined;
    const otherRow = slot === undefined ? -1 : this.other.rowOf(slot, turn);
    this.columns.forEach((column, i) => {
      this.#say(cells[i], column, agent, row, turn);
      cells[i].classList.toggle("differs", this.other !== null && this.#differs(column, row, otherRow));
    });
    return undefined;
  }

  // Of several agents the least and the largest number, how many acted and have ended.
  #sum(cell, column, agents, rows, turn) {
    const e = this.episode;
    const { field, number } = column;
    cell.classList.remove("zero", "differs");
    if (number) return gk.say(cell, gk.between(agents.map((agent, i) => this.#number(column, agent, rows[i], turn))));
    if (field === "action") return gk.say(cell, `${gk.actedOf(e, agents, turn)} acted`);
    return gk.say(cell, field === "ended" ? `${rows.filter((row) => row >= 0 && Math.max(e.terminated[row], e.truncated[row]) > 0).length}` : "");
  }

  // Numbers; a zero is pale, for the eye looks for the others.
  #number({ field, isTerm }, agent, row, turn) {
    const e = this.episode;
    if (field === "total") return turn > e.last ? null : e.paidUntil(agent, turn);
    return row < 0 ? null : isTerm ? e.terms[field][row] : field === "paid" ? e.reward[row] : e.cumulative_reward[row];
  }

  #say(cell, column, agent, row, turn) {
    const e = this.episode;
    const { field, number } = column;
    if (number) {
      const value = this.#number(column, agent, row, turn);
      cell.classList.toggle("zero", value === 0);
      return gk.say(cell, gk.number(value));
    }
    if (row < 0) return gk.say(cell, "");
    if (field === "ended") return gk.say(cell, this.#ended(row));
    if (field === "mask") return gk.sayValue(cell, e.mask[row] < 0 ? null : maskText(e.value(e.mask[row])));
    if (field === "action" && e.action[row] >= 0) return gk.sayValue(cell, gk.actionText(e, row));
    if (field === "nonconforming") return gk.sayValue(cell, e.nonconforming[row] < 0 ? null : `⚠ ${gk.plain(e.value(e.nonconforming[row]))}`);
    return gk.sayValue(cell, e.value(e[field][row]));
  }

  #ended(row) {
    const e = this.episode;
    const how = [e.terminated[row] > 0 && "terminated", e.truncated[row] > 0 && "truncated"].filter(Boolean).join(", ");
    if (how) return how;
    return flag(Math.max(e.terminated[row], e.truncated[row]));
  }

  #differs({ field }, row, otherRow) {
    if (field === "total" || (row < 0 && otherRow < 0)) return false;
    if (row < 0 || otherRow < 0) return true;
    const fields = field === "ended" ? ["terminated", "truncated"] : [field];
    const differ = (name) => {
      if (name in this.episode.terms && !(name in this.other.terms)) return false;
      return !Object.is(gk.field(this.episode, row, name), gk.field(this.other, otherRow, name));
    };
    return fields.some(differ);
  }
};

const headCell = ({ title, note, number, isTerm }) => {
  const made = gk.node("th", { scope: "col", class: number ? "num" : null, title: note ?? null, text: title });
  if (isTerm) {
    made.prepend(gk.node("i", { class: "term", "aria-hidden": "true" }));
    gk.signTerm(made.firstChild, title);
  }
  return made;
};
