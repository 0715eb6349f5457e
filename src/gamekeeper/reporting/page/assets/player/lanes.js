// The lanes of an episode: a lane an agent, or one for a folded role, turns from left to right, only what is in sight drawn.
// The cursor is an element of its own above the canvas, so that scrubbing draws nothing anew.

const ROOMY = 38; // pixels of a lane
const CLOSE = 20; // the same where there are many agents
const MANY = 24;
const WIDEST = 44; // pixels of a turn, zoomed in
const TALLEST = 420; // pixels of all lanes in sight at once
const CROWD = 50; // agents from which outliers come first, and the others are one lane
const OUTLIERS = 16;
const OTHERS = Symbol("others"); // no role
const FOLDED = 4; // of more agents a role can be folded
const MOST_FOLDS = 8;

gk.Lanes = class {
  // `choose(turn)` is called when the reader points at a turn, `pick(name)` when at an agent, `brush(from, to)` when along the ruler.
  constructor(episode, choose, pick, brush) {
    this.episode = episode;
    this.pyramids = new gk.Pyramids(episode);
    this.choose = choose;
    this.pick = pick;
    this.brush = brush;
    this.range = null; // first and last turn of the range
    this.all = orderOf(episode); // places of agents from top to bottom
    this.single = this.all.map((agent) => ({ name: episode.agents[agent].name, agents: [agent] }));
    this.folded = new Set(episode.agents.length < CROWD ? [] : [OTHERS]); // roles, and all but the outliers
    this.chosen = null;
    this.solo = false;
    this.#arrange();
    this.height = episode.agents.length > MANY ? CLOSE : ROOMY;
    this.cursor = 0;
    this.span = episode.last + 1; // turns on the scale: those of the longer one of two
    this.partner = null; // the lanes beside these, which show the same turns
    this.first = 0; // the turn at the left edge
    this.zoom = 1; // 1: the whole episode is in sight
    this.marks = episode.marks;
    this.pool = [];
    this.#make();
    this.redraw = gk.once(() => this.draw());
    this.scroll.addEventListener("scroll", this.redraw, { passive: true });
    new ResizeObserver(this.redraw).observe(this.box);
    this.#pointer();
  }

  #make() {
    this.ruler = gk.node("canvas", { class: "lanes-ruler", "aria-hidden": "true" });
    this.canvas = gk.node("canvas", { class: "lanes-canvas", role: "img" });
    this.names = gk.node("div", { class: "lanes-names" });
    this.view = gk.node("div", { class: "lanes-view" }, this.names, this.canvas);
    this.space = gk.node("div", { class: "lanes-space" }, this.view);
    const label = `Lanes of ${this.episode.agents.length} agents over turns 0 to ${this.episode.last}`;
    this.scroll = gk.node("div", { class: "lanes-scroll", tabindex: "0", role: "group", "aria-label": label }, this.space);
    this.line = gk.node("div", { class: "lanes-cursor", "aria-hidden": "true" });
    this.shade = gk.node("div", { class: "lanes-range", "aria-hidden": "true", hidden: true });
    this.corner = gk.node("span", { class: "lanes-corner", "aria-hidden": "true" });
    this.tip = gk.node("span", { class: "lanes-tip", "aria-hidden": "true", hidden: true });
    this.box = gk.node("div", { class: "lanes-box" }, this.ruler, this.scroll, this.shade, this.line, this.corner, this.tip);
    this.#fit();
    this.canvas.setAttribute("aria-label", this.summary());
    const note = "The height of a reward is the square root of its share of the episode's largest.";
    this.legend = gk.node("p", { class: "lanes-legend", title: note }, ...gk.legendOf(this.episode, this.every));
    this.zooms = this.#zooms();
    this.root = gk.node("div", { class: "lanes" }, this.zooms, this.box, this.legend);
  }

  // Marks and penalties.
  get every() {
    return [...this.marks, ...this.episode.penalties];
  }

  // Others than the episode's own marks.
  mark(marks) {
    this.marks = marks;
    this.legend.replaceChildren(...gk.legendOf(this.episode, this.every));
    this.redraw();
  }

  #fit() {
    const total = this.height * this.order.length;
    this.inSight = Math.min(total, TALLEST);
    this.space.style.height = `${total}px`;
    this.scroll.style.height = `${this.inSight}px`;
    this.view.style.height = `${this.inSight}px`;
  }

  // The lanes from top to bottom: one for each agent, then one for each folded role. The chosen agent has its own.
  #arrange() {
    const { agents } = this.episode;
    const isChosen = ({ name }) => name === this.chosen;
    if (this.solo && this.chosen !== null) return void (this.order = this.single.filter(isChosen));
    const roleOf = (lane) => agents[lane.agents[0]].role;
    let open = this.single.filter((lane) => isChosen(lane) || !this.folded.has(roleOf(lane)));
    const groups = [];
    const fold = (fold, text, lanes) => lanes.length && groups.push({ fold, name: `${text} (${lanes.length})`, agents: lanes.flatMap((lane) => lane.agents) });
    if (this.folded.has(OTHERS)) {
      const rest = open.slice(OUTLIERS).filter((lane) => !isChosen(lane));
      open = open.filter((lane) => !rest.includes(lane));
      fold(OTHERS, "others", rest);
    }
    for (const role of this.folded) if (role !== OTHERS) fold(role, gk.visible(role ?? "no role"), this.single.filter((lane) => roleOf(lane) === role && !isChosen(lane)));
    this.order = [...open, ...groups];
    return undefined;
  }

  // One lane for all agents of a role, or for all but the outliers; again: a lane each.
  fold(role) {
    const folded = new Set(this.folded);
    if (!folded.delete(role)) folded.add(role);
    this.refold(folded);
  }

  refold(folded) {
    this.folded = folded;
    for (const button of this.folds) button.setAttribute("aria-pressed", String(this.folded.has(button.fold)));
    this.#arrange();
    this.#fit();
    this.redraw();
    this.arranged?.();
  }

  #foldButtons() {
    const { agents } = this.episode;
    const counts = new Map();
    for (const { role } of agents) counts.set(role, (counts.get(role) ?? 0) + 1);
    const roles = agents.length > FOLDED ? [...counts].filter(([role, count]) => count > 1 && (counts.size > 1 || role !== null)).slice(0, MOST_FOLDS) : [];
    const offered = [...(agents.length < CROWD ? [] : [[OTHERS, "others"]]), ...roles.map(([role]) => [role, gk.visible(role ?? "no role")])];
    this.folds = offered.map(([role, text]) => {
      const button = gk.button(() => this.fold(role), { class: "fold", text, "aria-label": `One lane for ${text}`, title: `One lane for ${text}`, "aria-pressed": String(this.folded.has(role)) });
      button.fold = role;
      return button;
    });
    return this.folds.length ? [gk.node("span", { class: "folds-word", text: "Fold" }), ...this.folds] : [];
  }

  // Makes an agent stand out, alone with `solo`; null: all alike.
  stress(name, solo) {
    this.chosen = this.episode.slot.has(name) ? name : null;
    this.solo = solo;
    this.#arrange();
    this.#fit();
    this.redraw();
    if (this.chosen !== null) this.reveal(name);
  }

  #zooms() {
    const button = (text, label, work) => gk.button(work, { text, "aria-label": label, title: label });
    return gk.node(
      "div",
      { class: "lanes-zooms", role: "group", "aria-label": "Zoom and folding of the lanes" },
      "Zoom",
      button("−", "Show more turns", () => this.zoomBy(0.5)),
      button("+", "Show fewer turns", () => this.zoomBy(2)),
      button("All", "Show all turns", () => this.zoomBy(0)),
      ...this.#foldButtons(),
    );
  }

  // Pointing, dragging and tapping choose a turn, dragging along the ruler a range; the wheel with Ctrl zooms.
  #pointer() {
    const at = (event) => this.first + Math.floor((event.clientX - this.canvas.getBoundingClientRect().left) / this.perTurn);
    let start = 0;
    const follow = (event) => {
      const turn = Math.max(0, Math.min(this.episode.last, at(event)));
      this.#hint(event, turn);
      if (!(event.buttons & 1) && event.type !== "pointerdown") return;
      if (event.type === "pointerdown") start = turn;
      else if (event.currentTarget === this.ruler && turn !== start) return this.brush(start, turn);
      this.choose(turn);
    };
    for (const canvas of [this.canvas, this.ruler]) {
      canvas.addEventListener("pointerdown", (event) => {
        canvas.setPointerCapture(event.pointerId);
        follow(event);
      });
      canvas.addEventListener("pointermove", follow);
      canvas.addEventListener("pointerleave", () => (this.tip.hidden = true));
    }
    const wheel = (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      this.zoomBy(event.deltaY < 0 ? 2 : 0.5);
    };
    this.box.addEventListener("wheel", wheel, { passive: false });
  }

  // The turn under the pointer, in a lane also what the agent does there and is paid.
  #hint(event, turn) {
    const { left, top, width } = this.box.getBoundingClientRect();
    const down = event.clientY - this.canvas.getBoundingClientRect().top + this.scroll.scrollTop;
    const lane = down < 0 ? undefined : this.order[Math.floor(down / this.height)];
    const texts = [`turn ${turn}`];
    if (lane !== undefined) {
      const rewards = lane.agents.map((agent) => this.episode.rowOf(agent, turn)).map((row) => (row < 0 ? NaN : this.episode.reward[row]));
      texts.push([gk.visible(lane.name), this.#doing(lane, turn)].filter(Boolean).join(": "));
      texts.push(gk.between(rewards) && `reward ${gk.between(rewards)}`);
    }
    gk.say(this.tip, texts.filter(Boolean).join(" · "));
    this.tip.hidden = false;
    const x = Math.max(0, Math.min(width - this.tip.offsetWidth - 4, event.clientX - left + 12));
    this.tip.style.transform = `translate(${x}px, ${Math.max(0, event.clientY - top - 30)}px)`;
  }

  get perTurn() {
    const all = this.width / this.span;
    return this.zoom === 1 ? all : Math.max(all, Math.min(WIDEST, all * this.zoom));
  }

  get width() {
    return this.wide || 300;
  }

  // Twice, half, or (0) all; the cursor stays where it is seen.
  zoomBy(factor) {
    const seen = (this.cursor - this.first) * this.perTurn;
    const most = Math.max(1, (WIDEST * this.span) / this.width);
    this.zoom = factor === 0 ? 1 : Math.max(1, Math.min(most, this.zoom * factor));
    this.first = this.cursor - Math.min(seen, this.width * 0.8) / this.perTurn;
    this.#intoRange();
    this.redraw();
    this.partner?.follow(this);
  }

  // Shows the same turns as the lanes beside these.
  follow({ zoom, first }) {
    this.zoom = zoom;
    this.first = first;
    this.redraw();
  }

  // Two lanes on one scale.
  static pair(one, other) {
    one.span = other.span = Math.max(one.span, other.span);
    one.partner = other;
    other.partner = one;
  }

  #intoRange() {
    const shown = this.width / this.perTurn;
    this.first = Math.max(0, Math.min(Math.floor(this.first), Math.ceil(this.span - shown)));
  }

  // Puts the cursor on a turn; draws only when that turn was out of sight.
  show(turn) {
    this.cursor = Math.min(turn, this.span - 1);
    const shown = this.width / this.perTurn;
    if (this.cursor < this.first || this.cursor >= this.first + shown - 0.5) {
      this.first = this.cursor - shown * 0.2;
      this.#intoRange();
      this.redraw();
    }
    this.#place();
    this.#sayActions();
  }

  #place() {
    const per = this.perTurn;
    this.line.style.width = `${Math.max(2, per)}px`;
    this.line.style.transform = `translateX(${this.left + (this.cursor - this.first) * per}px)`;
    this.shade.hidden = this.range === null;
    if (this.range === null) return;
    const [from, to] = [Math.max(this.first, this.range[0]), Math.min(this.first + this.width / per, this.range[1] + 1)];
    this.shade.style.width = `${Math.max(0, to - from) * per}px`;
    this.shade.style.transform = `translateX(${this.left + (from - this.first) * per}px)`;
  }

  // Brings an agent's lane into sight.
  reveal(name) {
    const agent = this.episode.slot.get(name);
    const place = this.order.findIndex(({ agents }) => agents.includes(agent));
    if (place < 0) return;
    const top = place * this.height;
    if (top < this.scroll.scrollTop || top + this.height > this.scroll.scrollTop + this.inSight) this.scroll.scrollTop = top - this.inSight / 2;
  }

  draw() {
    if (!this.box.isConnected || this.box.clientWidth === 0) return;
    this.left = this.names.offsetWidth;
    this.wide = Math.max(40, this.scroll.clientWidth - this.left);
    this.#intoRange();
    const top = this.scroll.scrollTop;
    const from = Math.floor(top / this.height);
    const past = Math.min(this.order.length, Math.ceil((top + this.inSight) / this.height));
    const ink = gk.sized(this.canvas, this.wide, this.inSight);
    ink.clearRect(0, 0, this.wide, this.inSight);
    const shape = { first: this.first, perTurn: this.perTurn, width: this.wide, height: this.height };
    for (let place = from; place < past; place++) {
      const lane = this.order[place];
      ink.save();
      ink.translate(0, place * this.height - top);
      ink.globalAlpha = this.chosen === null || this.chosen === lane.name ? 1 : 0.3;
      gk.drawLane(ink, this.episode, lane.agents, this.pyramids.level(lane, 1 / shape.perTurn), shape);
      ink.restore();
    }
    gk.drawRuler(this.ruler, this.episode.last, this.every, shape);
    this.ruler.style.marginLeft = this.corner.style.width = `${this.left}px`;
    this.#nameLanes(from, past, top);
    this.#place();
    this.drawn?.();
  }

  #nameLanes(from, past, top) {
    while (this.pool.length < past - from) {
      const words = gk.node("span", { class: "lane-words" }, gk.node("bdi"), gk.node("small", { hidden: this.height === CLOSE }));
      const made = gk.button(() => (made.lane.fold === undefined ? this.pick(made.lane.name) : this.fold(made.lane.fold)), { class: "lane-name" }, gk.node("i", { "aria-hidden": "true" }), words);
      this.pool.push(made);
      this.names.append(made);
    }
    this.pool.forEach((made, i) => {
      made.hidden = from + i >= past;
      if (made.hidden) return;
      const lane = (made.lane = this.order[from + i]);
      const name = gk.visible(lane.name);
      gk.say(made.lastChild.firstChild, name);
      made.setAttribute("aria-pressed", String(this.chosen === lane.name));
      gk.signLane(made.firstChild, this.episode, lane);
      made.title = lane.fold === undefined ? `${name}, ${gk.visible(this.episode.agents[lane.agents[0]].role ?? "")}` : `${name}: a lane each`;
      made.style.height = `${this.height}px`;
      made.style.transform = `translateY(${(from + i) * this.height - top}px)`;
    });
    this.#sayActions();
  }

  // What each agent did at the cursor's turn, under its name.
  #sayActions() {
    gk.say(this.corner, `at turn ${this.cursor}`);
    if (this.height === CLOSE) return;
    for (const made of this.pool) if (!made.hidden) gk.say(made.lastChild.lastChild, this.#doing(made.lane, this.cursor));
  }

  // What an agent does, of several how many act.
  #doing({ agents, fold }, turn) {
    if (fold === undefined) return gk.doingText(this.episode, agents[0], turn);
    return `${gk.actedOf(this.episode, agents, turn)} acted`;
  }

  // What the picture says, for those who don't see it.
  summary() {
    const { agents, last, marks } = this.episode;
    const named = agents.slice(0, 8).map((agent) => gk.visible(agent.name));
    const more = agents.length > 8 ? ` and ${agents.length - 8} more` : "";
    const found = marks.slice(0, 8).map((mark) => `${mark.kind} at turn ${mark.turn}`);
    return `Actions and rewards, turns 0 to ${last}: ${named.join(", ")}${more}. ${found.join(", ")}. The table below shows the chosen turn.`;
  }
};

// Agents in their order; of a crowd those first whose return is furthest from the middle one, in median deviations.
const orderOf = (episode) => {
  const places = episode.agents.map((_, i) => i);
  if (places.length < CROWD) return places;
  const middle = (values) => [...values].sort((a, b) => a - b)[values.length >> 1];
  const returns = places.map((agent) => episode.paidUntil(agent, episode.last));
  const centre = middle(returns);
  const far = returns.map((value) => Math.abs(value - centre));
  return places.sort((a, b) => far[b] - far[a] || a - b);
};
