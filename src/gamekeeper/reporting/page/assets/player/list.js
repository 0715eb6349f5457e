// The list of episodes: filtered, sorted, some at a time; each may be opened or put beside the one on show.

const AT_ONCE = 12;
const AGENTS = 8; // as many have columns of their own

const FILTERS = [
  ["all", "all episodes", () => true],
  ["packed", "episodes that can be played here", (entry) => entry.packed],
  ["failing", "failing", (entry) => entry.failing === true || entry.end === "failed"],
  ["labelled", "with a label", (entry) => (entry.labels ?? []).length > 0],
  ["counterfactuals", "counterfactuals", (entry) => Boolean(entry.base)],
];

gk.EpisodeList = class {
  // `open(entry)` and `beside(entry)` put an episode on show.
  constructor(open, beside) {
    Object.assign(this, { open, beside, from: 0, entries: [], shown: new Set(), sort: null, down: false });
    this.filter = gk.node("select", {}, ...FILTERS.map(([value, text]) => gk.node("option", { value, text })));
    this.words = gk.node("input", { type: "search", placeholder: "run, number, label, seed", autocomplete: "off", spellcheck: "false" });
    this.body = gk.node("tbody");
    this.head = gk.node("tr");
    this.range = gk.node("span", { role: "status" });
    const again = () => {
      this.from = 0;
      this.draw();
    };
    this.filter.addEventListener("change", again);
    this.words.addEventListener("input", again);
    const table = gk.node("table", { class: "data" }, gk.node("caption", { text: "Episodes" }), gk.node("thead", {}, this.head), this.body);
    const region = gk.node("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": "Episodes" }, table);
    const step = (by) => () => {
      this.from = Math.max(0, this.from + by);
      this.draw();
    };
    this.earlier = gk.button(step(-AT_ONCE), { text: "Earlier" });
    this.later = gk.button(step(AT_ONCE), { text: "Later" });
    const pager = gk.node("p", { class: "pager" }, this.earlier, this.range, this.later);
    const choice = gk.node("p", { class: "list-choice" }, gk.node("label", {}, "Show ", this.filter), gk.node("label", {}, "that have ", this.words));
    this.gallery = new gk.Gallery(open);
    const summary = gk.node("summary");
    this.summary = summary;
    this.root = gk.node("details", { class: "episode-list" }, summary, choice, this.gallery.root, region, pager);
    this.root.addEventListener("toggle", () => this.gallery.draw());
  }

  fill(entries) {
    this.entries = entries;
    const packed = entries.filter((entry) => entry.packed).length;
    const changed = entries.filter((entry) => entry.change).length;
    const played = changed ? `, ${changed} of them counterfactual${changed === 1 ? "" : "s"}` : "";
    const more = packed < entries.length ? ` (${packed} of them can be played here; gamekeeper view plays all)` : "";
    gk.say(this.summary, entries.length === 1 ? "The only episode" : `All ${entries.length} episodes${played}${more}`);
    this.agents = [...new Set(entries.slice(0, 200).flatMap((entry) => Object.keys(entry.returns ?? {})))];
    this.several = new Set(entries.map((entry) => entry.run)).size > 1;
    this.draw();
  }

  // Which episodes are on show, by `run/number`.
  show(keys) {
    this.shown = new Set(keys);
    this.draw();
  }

  found() {
    const test = FILTERS.find(([value]) => value === this.filter.value)[2];
    const words = this.words.value.toLowerCase().split(/\s+/).filter(Boolean);
    const text = (entry) => [entry.run, entry.episode, `seed ${entry.seed}`, entry.end, ...(entry.labels ?? []), ...(entry.why ?? [])].join(" ").toLowerCase();
    return this.entries.filter((entry) => test(entry) && words.every((word) => text(entry).includes(word)));
  }

  // What a column sorts by; null: the order that the page has.
  #columns() {
    const agents = this.agents.length <= AGENTS ? this.agents : [];
    const number = (title, key, of) => ({ title, key, of, number: true });
    const columns = [
      { title: "episode", key: "episode", of: (entry) => entry.episode },
      { title: "" },
      { title: "seed" },
      { title: "end", key: "end", of: (entry) => entry.end },
      number("steps", "turns", (entry) => entry.turns),
      number("team", "team", (entry) => entry.team),
      ...agents.map((agent) => number(agent, `of ${agent}`, (entry) => gk.own(entry.returns, agent))),
      { title: "notes" },
    ];
    return this.several ? [{ title: "run", key: "run", of: (entry) => entry.run }, ...columns] : columns;
  }

  #sorted(found, columns) {
    const by = columns.find(({ key }) => key && key === this.sort);
    if (!by) return found;
    const side = this.down ? -1 : 1;
    const empty = (value) => value === null || value === undefined;
    const compare = (a, b) => {
      if (empty(a) || empty(b)) return Number(empty(a)) - Number(empty(b)); // what has no value stands last
      return a === b ? 0 : side * (a < b ? -1 : 1);
    };
    return [...found].sort((a, b) => compare(by.of(a), by.of(b)));
  }

  #heading({ title, key, number }) {
    if (!title) return gk.node("td");
    const sorted = key && key === this.sort ? (this.down ? "descending" : "ascending") : null;
    const cell = gk.node("th", { scope: "col", class: number ? "num" : null, "aria-sort": sorted });
    if (!key) return gk.node("th", { scope: "col", text: title });
    const sign = sorted ? gk.node("span", { "aria-hidden": "true", text: this.down ? " ↓" : " ↑" }) : "";
    const sort = () => {
      this.down = this.sort === key ? !this.down : Boolean(number);
      this.sort = key;
      this.from = 0;
      this.draw();
      this.head.querySelector("[aria-sort] button")?.focus();
    };
    cell.append(gk.button(sort, { class: "sort", title: "Sort by this" }, gk.name(title), sign));
    return cell;
  }

  draw() {
    const columns = this.#columns();
    const found = this.#sorted(this.found(), columns);
    this.gallery.fill(found);
    if (this.from >= found.length) this.from = 0;
    const some = found.slice(this.from, this.from + AT_ONCE);
    this.head.replaceChildren(...columns.map((column) => this.#heading(column)));
    this.body.replaceChildren(...some.map((entry) => this.#row(entry, columns)));
    gk.say(this.range, found.length ? ` ${this.from + 1} to ${this.from + some.length} of ${found.length} ` : " none ");
    this.earlier.disabled = this.from === 0;
    this.later.disabled = this.from + AT_ONCE >= found.length;
  }

  #row(entry, columns) {
    const row = gk.node("tr", { class: this.shown.has(`${entry.run}/${entry.episode}`) ? "shown" : null });
    const cells = {
      run: () => gk.node("td", {}, gk.name(gk.runText(entry.run))),
      episode: () => gk.node("th", { scope: "row", text: String(entry.episode) }),
      seed: () => gk.node("td", { text: String(entry.seed ?? "") }),
      end: () => gk.node("td", {}, gk.name(gk.endText(entry.end))),
      notes: () => this.#notes(entry),
      "": () => this.#buttons(entry),
    };
    row.append(...columns.map(({ title, of, number }) => (number ? gk.node("td", { class: "num", text: gk.number(of(entry)) }) : cells[title]())));
    return row;
  }

  #notes(entry) {
    const notes = gk.node("td");
    if (entry.failing) notes.append(gk.node("span", { class: "badge high", text: "failing" }), " ");
    for (const label of entry.labels ?? []) notes.append(gk.node("span", { class: "badge plain" }, gk.name(label)), " ");
    if (entry.base) notes.append("counterfactual of ", gk.name(`${gk.runText(entry.base.run)}, episode ${entry.base.episode}`), " ");
    if (entry.why?.length) notes.append(gk.name(entry.why.join(", ")));
    return notes;
  }

  #buttons(entry) {
    if (!entry.packed) return gk.node("td", { class: "note", text: "numbers only" });
    const button = (text, work) => {
      const label = `${text} episode ${entry.episode} of run ${gk.visible(entry.run)}`;
      return gk.button(() => work(entry), { text, "aria-label": label });
    };
    return gk.node("td", { class: "buttons" }, button("Play", this.open), " ", button("Beside", this.beside));
  }
};
