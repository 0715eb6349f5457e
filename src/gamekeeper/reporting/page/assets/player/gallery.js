// The gallery: an episode each as a sparkline of the reward of all agents so far, on one scale; sorted, one press from the player.

const SCALE = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"; // as episode_list.py has it
const [WIDE, HIGH] = [72, 28];

const ORDERS = [
  ["number", "number", (entry) => entry.episode, 1],
  ["return", "highest return", (entry) => entry.team ?? -Infinity, -1],
  ["worst", "lowest return", (entry) => entry.team ?? Infinity, 1],
  ["longest", "longest", (entry) => entry.turns, -1],
  ["shortest", "shortest", (entry) => entry.turns, 1],
  ["end", "ending", (entry) => `${entry.failing ? 0 : 1} ${entry.end}`, 1],
];

const lineOf = (spark) => {
  const y = (sign) => (HIGH - 2 - (SCALE.indexOf(sign) / (SCALE.length - 1)) * (HIGH - 4)).toFixed(1);
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
    const text = "A line is the sum of all agents' rewards so far, on one scale; failing episodes are dashed. Those without a frame are not on this page.";
    const note = gk.node("p", { class: "note", text });
    this.root = gk.node("details", { class: "gallery" }, gk.node("summary", { text: "Gallery" }), gk.node("p", { class: "list-choice" }, gk.node("label", {}, "Sort by ", this.order)), this.field, note);
    this.root.addEventListener("toggle", () => this.draw()); // drawn once it is looked at
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
    if (!this.root.open) return;
    const [, , of, side] = ORDERS.find(([value]) => value === this.order.value);
    const before = (a, b) => (of(a) === of(b) ? a.episode - b.episode : of(a) < of(b) ? -side : side);
    this.field.replaceChildren(...[...this.entries].sort(before).map((entry) => this.#tile(entry)));
  }

  #tile(entry) {
    const said = `Episode ${entry.episode} of run ${gk.visible(entry.run)}, return ${gk.number(entry.team) || "unknown"}, ${entry.turns} steps, ${gk.visible(entry.end)}${entry.failing ? ", failing" : ""}`;
    const parts = [entry.spark ? lineOf(entry.spark) : "", gk.node("small", { text: `${entry.episode}: ${gk.number(entry.team)}` })];
    const kind = `tile${entry.failing ? " failing" : ""}`;
    if (!entry.packed) return gk.node("span", { class: kind, title: said }, ...parts);
    const made = gk.node("button", { type: "button", class: kind, "aria-label": `Play: ${said}`, title: said }, ...parts);
    made.addEventListener("click", () => this.open(entry));
    return made;
  }
};
