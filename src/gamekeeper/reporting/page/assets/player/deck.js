// How an episode ended, in words; of one without an end a page can't tell whether somebody records it still.
gk.endText = (end) => gk.own({ open: "no end: still recorded, or killed", torn: "torn: its recorder was killed" }, end) ?? end;

// A run by its name; its letter tells it from others, where more than one was recorded (a counterfactual's has a dot).
gk.runText = (key) => {
  const name = gk.page.runs.find((run) => run.key === key)?.name ?? key;
  const recorded = gk.page.runs.filter((run) => !run.key.includes("."));
  return recorded.length > 1 && name !== key ? `${name} (run ${key})` : name;
};

// One episode on show: what it is, the world drawn, its lanes, and the table under the cursor.

const FEW = 16; // agents whose table follows every frame
const READABLE = 125; // milliseconds between two tables of more, while the cursor moves

gk.Deck = class {
  // `choose(turn)`, `pick(name)`, `brush(from, to)`: the reader points at a turn, an agent, or along turns, in the lanes.
  constructor(episode, entry, label, choose, pick, brush) {
    this.episode = episode;
    this.label = label;
    this.drawing = gk.drawingOf(episode);
    this.lanes = new gk.Lanes(episode, choose, pick, brush);
    this.totals = new gk.RangeTable(episode, this.lanes.all);
    this.table = new gk.TurnTable(episode, label, this.lanes);
    this.lanes.arranged = () => this.table.turn !== undefined && this.table.show(this.table.turn, this.table.other);
    const note = episode.drawingNote && gk.node("p", { class: "note", text: (episode.drawing ? "Drawn: " : "") + gk.visible(episode.drawingNote) });
    const world = gk.node("div", { class: "deck-world" }, this.drawing.root, note || "");
    const parts = [this.#heading(entry), this.#trouble(), this.#before()].filter(Boolean);
    const top = gk.node("div", { class: "deck-top" }, ...parts);
    this.root = gk.node("article", { class: "deck", "aria-label": label }, top, world, gk.node("div", { class: "deck-lanes" }, this.lanes.root, this.totals.root), this.table.root);
  }

  #heading(entry) {
    const e = this.episode;
    const texts = [`${e.turns} steps`, gk.endText(e.end)];
    if (e.seed !== null && e.seed !== undefined) texts.unshift(`seed ${e.seed}`);
    const named = gk.page.runs.length > 1 || gk.served;
    const heading = gk.node("h3", {}, `Episode ${e.index}`, ...(named ? [" · ", gk.name(gk.runText(e.run))] : []));
    const facts = gk.node("p", { class: "deck-facts", text: texts.join(" · ") });
    for (const label of entry?.labels ?? []) facts.append(" ", gk.node("span", { class: "badge plain" }, gk.name(label)));
    return gk.node("header", {}, heading, facts);
  }

  #trouble() {
    if (!this.episode.error) return null;
    const text = gk.node("pre", { text: gk.visible(this.episode.error), tabindex: "0" });
    return gk.node("details", { class: "more warning", open: true }, gk.node("summary", { text: "It ended with an error" }), text);
  }

  #before() {
    const e = this.episode;
    if (!e.base && !e.change) return null;
    const note = gk.node("p", { class: "note" });
    if (e.base) note.append("A counterfactual of ", gk.name(gk.runText(e.base.run)), `, episode ${e.base.episode}. `);
    if (e.change) note.append("Changed: ", gk.name(e.change));
    return note;
  }

  // Puts the cursor on a turn; beyond its end the last turn stays, and is said to be the last.
  show(turn, other = null) {
    const here = Math.min(turn, this.episode.last);
    this.drawing.show(here);
    this.lanes.show(turn);
    this.#tell(turn, other);
    this.root.classList.toggle("over", turn > this.episode.last);
  }

  // The table of a crowd costs most of a frame, and is read at rest: while the cursor moves it follows eight times a second.
  #tell(turn, other) {
    clearTimeout(this.later);
    const work = () => {
      this.told = performance.now();
      this.table.show(turn, other);
    };
    const left = this.episode.agents.length > FEW ? READABLE - (performance.now() - (this.told ?? 0)) : 0;
    if (left <= 0) return work();
    this.later = setTimeout(work, left);
    return undefined;
  }

  // A range of turns: shaded in the lanes, its totals below them; null: none.
  select(range) {
    this.lanes.range = range;
    this.totals.show(range);
  }

  // One agent stands out in the map, the lanes and the table, or is alone there; null: all alike.
  stress(name, solo) {
    this.drawing.chosen = this.episode.slot.has(name) ? name : null;
    this.lanes.stress(name, solo);
  }

  // The agents of the episode beside this one, as outlines on this map.
  haunt(other) {
    if (this.drawing instanceof gk.MapDrawing && other.drawing instanceof gk.MapDrawing) this.drawing.ghost = other.drawing;
  }

  // What the reader has zoomed and scrolled to, for an episode that is read again.
  get look() {
    const { zoom, first, scroll, folded } = this.lanes;
    return { zoom, first, folded, top: scroll.scrollTop, from: this.table.from };
  }

  lookLike({ zoom, first, folded, top, from }) {
    this.lanes.refold(folded);
    this.lanes.follow({ zoom, first });
    this.lanes.scroll.scrollTop = top;
    this.table.from = from;
  }

  // The marks of a pair: where these two part, and not where one of them parts from a third.
  mark(extra) {
    this.lanes.mark([...this.episode.marks.filter((mark) => mark.kind !== "divergence"), ...extra].sort((a, b) => a.turn - b.turn));
  }

  // Everything again, in the colours that hold now; at once, since a page that is printed waits for no frame.
  repaint(turn) {
    this.lanes.draw();
    this.drawing.show(Math.min(turn, this.episode.last));
  }
};
