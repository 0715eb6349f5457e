// The gallery: an episode each as a sparkline of the reward of all agents so far, on one scale; sorted, one press from the player.

const SCALE = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"; // as episode_list.py has it
const [WIDE, HIGH, BARS] = [72, 28, 14];

const ORDERS = [
  ["number", "number", (entry) => entry.episode, 1],
  ["return", "highest return", (entry) => entry.team ?? -Infinity, -1],
  ["worst", "lowest return", (entry) => entry.team ?? Infinity, 1],
  ["longest", "longest", (entry) => entry.turns, -1],
  ["shortest", "shortest", (entry) => entry.turns, 1],
  ["end", "ending", (entry) => `${entry.failing ? 0 : 1} ${entry.end}`, 1],
  ["behaviour", "behaviour, in groups", (entry) => entry.episode, 1],
];
const GROUPS = 4; // of episodes with one ending
const ALIKE = 0.25; // distance below which two episodes are alike; from 0 to 1 each: return, length, share of an action, a third of the sparkline
const PLACES = [3, 7, 11, 15, 19, 23]; // of the sparkline

const bounds = (values) => values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);

const level = (sign) => SCALE.indexOf(sign) / (SCALE.length - 1);

// Episodes by ending, then by return, length, actions and course: each with the nearest of a few that are far from each other.
const grouped = (entries) => {
  const kinds = Map.groupBy(entries, ({ failing, end }) => `${failing ? "failing, " : ""}${gk.endText(end)}`);
  const numbers = entries.map(({ team, turns }) => [team ?? 0, turns]);
  const scales = [0, 1].map((k) => bounds(numbers.map((each) => each[k])));
  const scaled = (value, [low, high]) => (value - low) / (high - low || 1);
  const most = Math.max(0, ...entries.map(({ acts }) => (acts ?? "").length));
  const shape = ({ spark, acts }) => [...PLACES.map((at) => (spark ? level(spark[at]) / 3 : 0)), ...Array.from({ length: most }, (_, k) => (acts?.[k] ? level(acts[k]) : 0))];
  const place = new Map(entries.map((entry, i) => [entry, [...scales.map((scale, k) => scaled(numbers[i][k], scale)), ...shape(entry)]]));
  const apart = (a, b) => Math.hypot(...place.get(a).map((value, k) => value - place.get(b)[k]));
  return [...kinds].flatMap(([kind, members]) => {
    const centres = [members[0]];
    const nearest = (entry) => centres.reduce((best, centre) => (apart(entry, centre) < apart(entry, best) ? centre : best));
    const distance = (entry) => apart(entry, nearest(entry));
    while (centres.length < GROUPS) {
      const far = members.reduce((best, entry) => (distance(entry) > distance(best) ? entry : best));
      if (distance(far) < ALIKE) break;
      centres.push(far);
    }
    return [...Map.groupBy(members, nearest).values()].map((group) => [kind, group]);
  }).sort((a, b) => b[1].length - a[1].length);
};

const groupTitle = ([kind, group]) => {
  const range = (values) => bounds(values).map(gk.number);
  const said = ([low, high]) => (low === high ? low : `${low} to ${high}`);
  const returns = group.map(({ team }) => team).filter((team) => team !== null && team !== undefined);
  const parts = [returns.length && `return ${said(range(returns))}`, `${said(range(group.map(({ turns }) => turns)))} steps`];
  return [`${group.length} ${group.length === 1 ? "episode" : "episodes"}`, kind, ...parts.filter(Boolean)].join(" · ");
};

const barsOf = (acts) => {
  const drawing = gk.svg("svg", { viewBox: `0 0 ${WIDE} ${BARS}`, width: WIDE, height: BARS, "aria-hidden": "true" });
  const wide = WIDE / acts.length;
  [...acts].forEach((sign, k) => {
    const high = level(sign) * BARS;
    drawing.append(gk.svg("rect", { x: (k * wide + 1).toFixed(1), y: (BARS - high).toFixed(1), width: (wide - 2).toFixed(1), height: high.toFixed(1), class: "act-bar" }));
  });
  return drawing;
};

const lineOf = (spark) => {
  const y = (sign) => (HIGH - 2 - level(sign) * (HIGH - 4)).toFixed(1);
  const points = [...spark].map((sign, i) => `${((i * WIDE) / (spark.length - 1)).toFixed(1)},${y(sign)}`).join(" ");
  const drawing = gk.svg("svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, width: WIDE, height: HIGH, "aria-hidden": "true" });
  drawing.append(gk.svg("polyline", { points, class: "spark" }));
  return drawing;
};

gk.Gallery = class {
  // `open(entry)` puts an episode on show.
  constructor(open) {
    this.open = open;
    this.order = gk.node("select", {}, ...ORDERS.map(([value, text]) => gk.node("option", { value, text })));
    this.order.addEventListener("change", () => this.draw());
    this.field = gk.node("div", { class: "gallery-field" });
    const text = "A line is the sum of all agents' rewards so far, on one scale; failing episodes are dashed. Bars are the shares of actions 0, 1, 2, … (the eighth: 7 and above).";
    const note = gk.node("p", { class: "note", text: gk.served ? text : `${text} Those without a frame are not on this page.` });
    this.root = gk.node("details", { class: "gallery", open: true }, gk.node("summary", { text: "Gallery" }), gk.node("p", { class: "list-choice" }, gk.node("label", {}, "Sort by ", this.order)), this.field, note);
    this.root.addEventListener("toggle", () => this.draw()); // drawn once it, and the list that it is in, is looked at
    this.entries = [];
    this.known = new Set();
  }

  fill(entries) {
    const isSame = entries.length === this.entries.length && entries.every((entry) => this.known.has(entry));
    if (isSame) return;
    this.known = new Set(entries);
    this.entries = entries;
    this.draw();
  }

  draw() {
    if (!this.root.open || !this.root.parentElement?.open) return;
    const [, , of, side] = ORDERS.find(([value]) => value === this.order.value);
    const before = (a, b) => (of(a) === of(b) ? a.episode - b.episode : of(a) < of(b) ? -side : side);
    const sorted = [...this.entries].sort(before);
    const groups = this.order.value === "behaviour" ? grouped(sorted) : [[null, sorted]];
    const tiles = ([kind, group]) => [kind === null ? "" : gk.node("h4", { text: groupTitle([kind, group]) }), ...group.map((entry) => this.#tile(entry))];
    this.field.replaceChildren(...groups.flatMap(tiles));
  }

  #tile(entry) {
    const said = `Episode ${entry.episode} of run ${gk.visible(entry.run)}, return ${gk.number(entry.team) || "unknown"}, ${entry.turns} steps, ${gk.visible(entry.end)}${entry.failing ? ", failing" : ""}`;
    const parts = [entry.spark ? lineOf(entry.spark) : "", entry.acts ? barsOf(entry.acts) : "", gk.node("small", { text: `${entry.episode}: ${gk.number(entry.team)}` })];
    const kind = `tile${entry.failing ? " failing" : ""}`;
    if (!entry.packed) return gk.node("span", { class: kind, title: said }, ...parts);
    return gk.button(() => this.open(entry), { class: kind, "aria-label": `Play: ${said}`, title: said }, ...parts);
  }
};
