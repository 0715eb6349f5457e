// What belongs to stretches of turns: totals of a range, and a curve under the slider: of success, or of the gap between two returns.

const MOST = 40; // agents with a row of totals

// The whole-number sum over an agent's rows between two turns, both included.
const totals = (episode, agent, from, to) => {
  const found = { acted: 0, idle: 0, often: "", terms: new Map(Object.keys(episode.terms).map((term) => [term, 0])) };
  const counts = new Map();
  const past = episode.place(agent, to + 1);
  for (let at = episode.place(agent, from); at < past; at++) {
    const row = episode.agentRows[at];
    for (const term of found.terms.keys()) found.terms.set(term, found.terms.get(term) + (episode.terms[term][row] || 0));
    if (!episode.acted(row)) continue;
    found.acted++;
    if (episode.isIdle(row)) found.idle++;
    if (episode.action[row] < 0) continue;
    const text = gk.actionText(episode, row).slice(0, 60);
    counts.set(text, (counts.get(text) ?? 0) + 1);
  }
  const [text, count] = [...counts].reduce((best, each) => (each[1] > best[1] ? each : best), ["", 0]);
  if (count) found.often = `${text}, ${count} of ${found.acted}`;
  found.paid = episode.paidUntil(agent, to) - (from ? episode.paidUntil(agent, from - 1) : 0);
  return found;
};

// A table of what each agent did and was paid in a range of turns.
gk.RangeTable = class {
  constructor(episode, order) {
    this.episode = episode;
    this.order = order.slice(0, MOST);
    this.terms = Object.keys(episode.terms);
    this.hasIdle = episode.idle.some((values) => values.size);
    const heads = ["agent", "actions", this.hasIdle && "did “nothing”", "most often", "return", ...this.terms.map(gk.visible)].filter(Boolean);
    this.caption = gk.node("caption");
    this.body = gk.node("tbody");
    const head = gk.node("tr", {}, ...heads.map((text, i) => gk.node("th", { scope: "col", class: i && text !== "most often" ? "num" : null, text })));
    const table = gk.node("table", { class: "data range-table" }, this.caption, gk.node("thead", {}, head), this.body);
    this.root = gk.node("div", { class: "scroll range-totals", tabindex: "0", role: "group", "aria-label": "Totals of the range", hidden: true }, table);
  }

  // `range`: the first and the last turn; null: none.
  show(range) {
    this.root.hidden = range === null || range[0] > this.episode.last;
    if (this.root.hidden) return;
    const [from, to] = [range[0], Math.min(range[1], this.episode.last)];
    const more = this.episode.agents.length - this.order.length;
    gk.say(this.caption, `Totals of turns ${from} to ${to}${more > 0 ? `, ${this.order.length} agents; ${more} more` : ""}`);
    this.body.replaceChildren(...this.order.map((agent) => this.#row(agent, from, to)));
  }

  #row(agent, from, to) {
    const member = this.episode.agents[agent];
    const found = totals(this.episode, agent, from, to);
    const sign = gk.node("i", { class: "agent-sign", "aria-hidden": "true" });
    gk.signAgent(sign, member);
    const number = (value) => gk.node("td", { class: "num", text: gk.number(value) });
    const idle = this.hasIdle ? [number(found.idle)] : [];
    const terms = this.terms.map((term) => number(found.terms.get(term)));
    return gk.node("tr", {}, gk.node("th", { scope: "row" }, sign, gk.name(member.name)), number(found.acted), ...idle, gk.node("td", { text: found.often }), number(found.paid), ...terms);
  }
};

const HEIGHT = 46;
const EDGE = 3; // pixels above 100 % and below 0
const percent = (share) => `${Math.round(100 * share)} %`;

// The share of continuations that succeed, turn by turn, where `gamekeeper pivots` played them; null elsewhere.
gk.successCurve = ({ curve, marks }) => {
  if (!curve.length) return null;
  const falls = marks.filter((mark) => mark.kind === "pivot");
  const [first, last] = [curve[0], curve.at(-1)];
  const said = falls.map((mark) => `turn ${mark.turn}: ${gk.visible(mark.text)}`).join("; ");
  const text = `Success if the policies go on from a turn, 0 to 100 %: ${percent(first[1])} from turn ${first[0]}, ${percent(last[1])} from turn ${last[0]}.`;
  return { points: curve, bounds: [0, 1], falls: falls.map(({ turn }) => turn), text: said ? `${text} Lost at ${said}.` : text };
};

// What all agents were paid up to each turn; beyond an episode's end the sum stays.
const paidSoFar = (episode, turns) => {
  const sums = new Float64Array(turns);
  episode.reward.forEach((value, row) => (sums[episode.turn[row]] += value || 0));
  for (let turn = 1; turn < turns; turn++) sums[turn] += sums[turn - 1];
  return sums;
};

// The return of the right episode above that of the left one, turn by turn; null where a reward isn't finite.
gk.gapCurve = (left, right) => {
  const turns = Math.max(left.last, right.last) + 1;
  const [one, two] = [left, right].map((episode) => paidSoFar(episode, turns));
  const gaps = two.map((value, turn) => value - one[turn]);
  if (!gaps.every(Number.isFinite)) return null;
  const widest = gaps.reduce((best, gap, turn) => (Math.abs(gap) > Math.abs(gaps[best]) + 1e-9 ? turn : best), 0); // sums differ in their last digits
  const reach = Math.abs(gaps[widest]) || 1;
  const text = `Return of all agents so far, right less left: ${gk.number(gaps[turns - 1])} at the end; widest at turn ${widest}, ${gk.number(gaps[widest])}.`;
  return { points: [...gaps].map((gap, turn) => [turn, gap, gap, gap]), bounds: [-reach, reach], falls: [], text };
};

// A curve under the slider: points [turn, value, low, high], the turns at which it falls, its meaning.
gk.SliderCurve = class {
  constructor() {
    this.canvas = gk.node("canvas", { role: "img" });
    this.note = gk.node("p", { class: "note" });
    this.root = gk.node("div", { class: "scrub-curve", hidden: true }, this.canvas, this.note);
  }

  // `at(turn)`: the place of a turn, in pixels; `found`: null for no curve.
  draw(found, { wide, at }) {
    this.root.hidden = found === null;
    if (this.root.hidden) return;
    const { points, bounds: [low, high], falls, text } = found;
    const colours = gk.colours();
    const ink = gk.sized(this.canvas, wide, HEIGHT);
    const y = (value) => EDGE + ((high - value) / (high - low)) * (HEIGHT - 2 * EDGE);
    const line = (k) => points.forEach((point, i) => ink[i ? "lineTo" : "moveTo"](at(point[0]), y(point[k])));
    ink.clearRect(0, 0, wide, HEIGHT);
    ink.fillStyle = colours.raised;
    ink.fillRect(0, EDGE, wide, HEIGHT - 2 * EDGE);
    ink.fillStyle = colours.line;
    ink.fillRect(0, y(0) - 0.5, wide, 1);
    ink.beginPath();
    line(3);
    [...points].reverse().forEach((point) => ink.lineTo(at(point[0]), y(point[2])));
    ink.fillStyle = colours.idle;
    ink.globalAlpha = 0.45;
    ink.fill();
    ink.globalAlpha = 1;
    ink.beginPath();
    line(1);
    ink.strokeStyle = colours.accent;
    ink.lineWidth = 2;
    ink.stroke();
    ink.fillStyle = colours.mark;
    for (const turn of falls) ink.fillRect(at(turn) - 1, EDGE, 2, HEIGHT - 2 * EDGE);
    this.canvas.setAttribute("aria-label", text);
    gk.say(this.note, text);
  }
};
