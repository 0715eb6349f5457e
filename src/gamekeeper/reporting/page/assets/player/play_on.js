// Play on from here, in `gamekeeper view --interactive`: one agent's action or policy is changed at the cursor's turn, and the server plays futures.

const FUTURES = 64;
const EVERY = 400; // milliseconds between questions how far it is

// The agents that act at a turn, by their places.
const actors = (episode, turn) => {
  const [from, past] = episode.rowsAt(turn);
  const found = [];
  for (let row = from; row < past; row++) if (episode.acted(row)) found.push(episode.agent[row]);
  return found;
};

// The actions that a row's mask allows, among those of the space.
const legalOf = (episode, row, actions) => {
  const mask = episode.value(episode.mask[row]);
  const has = Array.isArray(mask) && mask.length === actions.length;
  return has ? actions.filter((_, i) => mask[i] === 1 || mask[i] === true) : actions;
};

const wordsOf = ({ value, low, high }, plus = "") => {
  if (value === null || value === undefined) return "";
  const figure = (x) => (x > 0 ? plus : "") + gk.number(Number(x.toPrecision(4)));
  return low === null || low === undefined ? figure(value) : `${figure(value)} [${figure(low)}, ${figure(high)}]`;
};

const option = (value, text) => gk.node("option", { value, text });

gk.PlayOn = class {
  constructor(player) {
    Object.assign(this, { player, offered: new Map(), episode: null, turn: 0, busy: false, shown: "", document: null });
    this.title = gk.node("summary", { text: "Play on from here" });
    this.who = gk.node("select", { "aria-label": "Agent" });
    this.kind = gk.node("select", { "aria-label": "What is changed" }, option("action", "does"), option("policy", "is played, from here on, by"));
    this.action = gk.node("select", { "aria-label": "Action" });
    this.text = gk.node("input", { type: "text", "aria-label": "Action, as JSON", autocomplete: "off", spellcheck: "false", hidden: true });
    this.policy = gk.node("select", { "aria-label": "Policy", hidden: true });
    this.count = gk.node("input", { type: "number", min: "2", max: String(gk.page.play_on.most), value: String(FUTURES), "aria-label": "Number of futures" });
    for (const choice of [this.who, this.kind]) choice.addEventListener("change", () => this.#fill());
    const button = (text, title, work) => gk.button(() => this.#guarded(work), { text, title });
    this.one = button("Play one", "On the recorded draws: all else goes on drawing as it did", () => this.#one(null));
    this.many = button("Play many", "On fresh draws, each as it was and as changed", () => this.#many());
    this.stop = gk.button(() => gk.order("stop", {}).catch(() => {}), { text: "Stop", hidden: true });
    this.status = gk.node("p", { role: "status" });
    this.error = gk.node("p", { class: "warning", role: "alert", hidden: true });
    this.keep = button("Keep as evidence", "Written beside the run; verified by replay", () => this.#keep());
    this.pick = gk.node("select", { "aria-label": "Which future" }, option("least", "the worst"), option("middle", "the middle"), option("most", "the best"));
    this.open = button("Show it beside", "Plays this future again, recorded", () => this.#one(this.#picked()));
    this.picking = gk.node("p", { hidden: true }, gk.node("label", {}, "Of the changed futures, ", this.pick), " ", this.open);
    this.fan = new gk.Fan();
    this.table = gk.node("div");
    this.keeping = gk.node("p", { hidden: true }, this.keep);
    const choice = gk.node("p", { class: "play-on-choice" }, this.where = gk.node("span"), this.who, this.kind, this.action, this.text, this.policy);
    const orders = gk.node("p", { class: "play-on-choice" }, this.one, this.many, gk.node("label", {}, "futures: ", this.count), this.stop);
    this.note = gk.node("p", { class: "note" });
    this.results = gk.node("details", { class: "more", hidden: true }, gk.node("summary", { text: "The futures on fresh draws" }), this.fan.root, this.table, this.picking);
    this.results.addEventListener("toggle", () => this.fan.draw());
    this.root = gk.node("details", { class: "play-on" }, this.title, choice, orders, this.note, this.error, this.status, this.keeping, this.results);
    this.root.addEventListener("toggle", () => this.root.open && this.#guarded(() => this.#offer()));
  }

  // What the cursor stands at.
  show(episode, turn) {
    const isOther = episode !== this.episode;
    if (!isOther && turn === this.turn && this.shown) return;
    Object.assign(this, { episode, turn });
    gk.say(this.title, `Play on from turn ${turn}`);
    if (isOther && this.asked && `${this.asked.run}/${this.asked.episode}` !== this.key) this.#forget();
    this.#fill();
    if (isOther && this.root.open) this.#guarded(() => this.#offer());
  }

  // What was played from another episode.
  #forget() {
    this.asked = null;
    this.results.hidden = true;
    this.keeping.hidden = true;
    gk.say(this.status, "");
  }

  get key() {
    return this.episode.key;
  }

  get offers() {
    return this.offered.get(this.key) ?? null;
  }

  async #offer() {
    if (this.offers || !this.episode) return;
    gk.say(this.status, "Opening the environment…");
    const { run, index } = this.episode;
    const { agents } = await gk.order("offers", { run, episode: index });
    this.offered.set(`${run}/${index}`, agents);
    gk.say(this.status, "");
    this.#fill();
  }

  // The choices at the cursor: agents that act, their legal actions, their policies.
  #fill() {
    if (!this.episode || !this.root.open) return;
    const acting = actors(this.episode, this.turn).filter((agent) => this.turn < this.episode.turns && agent >= 0);
    const names = acting.map((agent) => this.episode.agents[agent].name);
    const before = this.who.value;
    this.who.replaceChildren(...names.map((name) => option(name, gk.visible(name))));
    this.who.value = names.includes(before) ? before : names.includes(this.player.chosen) ? this.player.chosen : (names[0] ?? "");
    gk.say(this.where, `At turn ${this.turn}`);
    this.shown = `${this.key}/${this.turn}`;
    const has = names.length > 0 && this.offers !== null && !this.busy;
    const isAction = this.kind.value === "action";
    gk.say(this.note, isAction ? "The other agents do at this turn what they did; from the next turn on every policy chooses." : "Before this turn it is shown what was recorded; from here on it chooses.");
    for (const control of [this.one, this.many]) control.disabled = !has;
    if (names.length) this.#fillChoices(isAction);
    else if (this.offers) gk.say(this.status, "Nobody acts at this turn: choose an earlier one.");
  }

  #fillChoices(isAction) {
    const slot = this.episode.slot.get(this.who.value);
    const row = this.episode.rowOf(slot, this.turn);
    const offered = gk.own(this.offers ?? {}, this.who.value);
    const actions = offered?.actions ?? [];
    const isListed = actions.length > 0;
    this.action.hidden = !isAction || !isListed;
    this.text.hidden = !isAction || isListed;
    this.policy.hidden = isAction;
    if (!offered) return;
    const recorded = this.episode.value(this.episode.action[row]);
    const named = gk.own(this.episode.agents[slot], "actions") ?? [];
    const label = (action) => `${named[action] ? `${gk.visible(named[action])} (${action})` : action}${action === recorded ? ", as recorded" : ""}`;
    const legal = legalOf(this.episode, row, actions);
    const [action, policy] = [this.action.value, this.policy.value];
    this.action.replaceChildren(...legal.map((each) => option(String(each), label(each))));
    if (legal.map(String).includes(action) && this.shownAgent === this.who.value) this.action.value = action;
    else this.action.value = String(legal.find((each) => each !== recorded) ?? legal[0] ?? "");
    if (!isListed && this.shownText !== this.shown + this.who.value) {
      this.text.value = JSON.stringify(recorded);
      this.text.title = offered.space;
      this.shownText = this.shown + this.who.value;
    }
    this.policy.replaceChildren(...offered.policies.map((each) => option(each, gk.visible(each))));
    this.policy.value = offered.policies.includes(policy) ? policy : offered.policies.includes("reference") ? "reference" : offered.policies[0];
    this.shownAgent = this.who.value;
  }

  // The order that the choices make.
  #order() {
    const order = { run: this.episode.run, episode: this.episode.index, turn: this.turn, agent: this.who.value };
    if (this.kind.value === "policy") return { ...order, policy: this.policy.value };
    if (this.text.hidden) return { ...order, action: Number(this.action.value) };
    try {
      return { ...order, action: JSON.parse(this.text.value) };
    } catch {
      throw new gk.Trouble("the action is no JSON: numbers, or lists of them, as in [0.5, 1]");
    }
  }

  // One thing at a time; what goes wrong stands on the page.
  async #guarded(work) {
    if (this.busy) return;
    this.busy = true;
    this.error.hidden = true;
    this.stop.hidden = false;
    this.root.setAttribute("aria-busy", "true");
    for (const control of [this.one, this.many, this.open, this.keep]) control.disabled = true;
    try {
      await work();
    } catch (error) {
      this.error.hidden = false;
      gk.say(this.error, gk.visible(error.message));
      gk.say(this.status, "");
      if (!(error instanceof gk.Trouble)) console.error(error);
    } finally {
      this.busy = false;
      this.stop.hidden = true;
      this.root.removeAttribute("aria-busy");
      for (const control of [this.open, this.keep]) control.disabled = false;
      this.#fill();
    }
  }

  async #many() {
    const futures = Math.round(Number(this.count.value));
    const order = { ...this.#order(), futures, seed: 0 };
    gk.say(this.status, `Playing ${2 * futures} futures…`);
    const looks = setInterval(async () => {
      const { played, of } = await gk.fetched("play-on/progress.json").catch(() => ({}));
      if (played && this.busy) gk.say(this.status, `${played} of ${of} futures are played`);
    }, EVERY);
    try {
      this.document = await gk.order("futures", order);
    } finally {
      clearInterval(looks);
    }
    this.asked = order;
    this.#showMany();
  }

  #showMany() {
    const { document } = this;
    const { team, arms, failed } = document;
    const played = arms.changed.team.length;
    const worse = played < document.asked ? ` (${document.asked} were asked for: the limit of env steps was reached)` : "";
    gk.say(this.status, gk.visible(`${document.text}: ${played} futures on fresh draws${worse}. Mean difference ${wordsOf(team.difference ?? {}, "+")}.`));
    this.results.hidden = false;
    this.results.open = true;
    this.fan.fill(this.episode, document);
    const number = (text) => gk.node("td", { class: "num", text });
    const row = (name, cells) => gk.node("tr", {}, gk.node("th", { scope: "row" }, gk.name(name)), ...cells.map(number));
    const figures = (each) => [wordsOf(each.as_recorded), wordsOf(each.changed), wordsOf(each.difference ?? {}, "+")];
    const share = (each) => each && `${Math.round(100 * each.p)} % [${Math.round(100 * each.low)}, ${Math.round(100 * each.high)}]`;
    const rows = [row("all agents", figures(team)), ...Object.entries(document.agents).map(([name, each]) => row(name, figures(each)))];
    if (failed.changed) rows.push(row("failed", [share(failed.as_recorded), share(failed.changed), ""]));
    const heads = ["", "as it was, median", "as changed, median", "mean difference"].map((text, i) => gk.node(text ? "th" : "td", text ? { scope: "col", class: i ? "num" : null, text } : {}));
    const caption = gk.node("caption", { text: "Returns of the futures, with 95 % intervals where there are any" });
    const table = gk.node("table", { class: "data" }, caption, gk.node("thead", {}, gk.node("tr", {}, ...heads)), gk.node("tbody", {}, ...rows));
    this.table.replaceChildren(gk.node("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": "Returns of the futures" }, table));
    this.picking.hidden = played === 0;
  }

  // The number that the chosen one of the changed futures drew from.
  #picked() {
    const { numbers, team } = this.document.arms.changed;
    const order = team.map((_, i) => i).sort((a, b) => team[a] - team[b]);
    const at = { least: 0, middle: (order.length - 1) >> 1, most: order.length - 1 }[this.pick.value];
    return numbers[order[at]];
  }

  // One future, recorded by the server, beside the episode; of the fan with its `number`.
  async #one(number) {
    const order = number === null ? this.#order() : { ...this.asked, number };
    gk.say(this.status, "Playing one future…");
    const found = await gk.order("future", order);
    await this.player.refresh();
    const base = this.player.entry(order.run, order.episode);
    await this.player.open([base, this.player.entry(found.run, found.episode)], { turn: found.turn });
    this.future = found.run;
    this.keeping.hidden = false;
    this.results.open = false; // what was asked for now stands below
    this.keep.hidden = !found.replays;
    const draws = number === null ? "on the recorded draws" : "on fresh draws";
    const change = this.#difference();
    gk.say(this.status, gk.visible(`${found.text}, ${draws}: ${change}. It stands at the right${found.replays ? "" : "; it doesn't replay, so it can't be kept as evidence"}.`));
  }

  #difference() {
    const totals = this.player.decks.map(({ episode }) => episode.agents.reduce((sum, _, agent) => sum + episode.paidUntil(agent, episode.last), 0));
    return `all agents together get ${gk.number(Number(totals[1].toPrecision(6)))} in place of ${gk.number(Number(totals[0].toPrecision(6)))}`;
  }

  async #keep() {
    const { folder } = await gk.order("keep", { run: this.future });
    this.keeping.hidden = true;
    gk.say(this.status, gk.visible(`Kept as ${folder}`));
  }
};
