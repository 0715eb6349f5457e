// The player: one episode, or two side by side, with one cursor.

const SPEEDS = [1, 2, 5, 10, 20, 50, 100, 200, 500]; // turns a second
const THUMB = 16; // pixels of the slider's thumb, as style.css has it
const BESIDE = 480; // pixels left of the slider in which the buttons have room
const SETTLED = 500; // milliseconds after which a turn is read out and stands in the address

gk.Player = class {
  constructor(host) {
    Object.assign(this, { host, decks: [], chosen: null, solo: false, turn: 0, speed: 3, playing: false, part: null, settled: 0, generation: 0, moved: false, anchor: null });
    this.#make();
    this.render = gk.once(() => this.#render());
    gk.onColours(() => this.decks.forEach((deck) => deck.repaint(this.turn)));
  }

  #make() {
    this.list = new gk.EpisodeList(
      (entry) => this.open([entry], { focus: true }),
      (entry) => this.beside(entry),
    );
    this.pair = gk.node("select", { "aria-label": "Compare two episodes" });
    this.pair.addEventListener("change", () => this.#showPair());
    this.stage = gk.node("div", { class: "decks" });
    this.trouble = gk.node("p", { class: "warning", role: "alert", hidden: true });
    this.parted = gk.node("p", { class: "parted", hidden: true });
    this.jumps = gk.node("div", { class: "jumps", role: "group", "aria-label": "Jump to" });
    this.status = gk.node("p", { class: "sr-only", role: "status", "aria-live": "polite" });
    this.pairing = gk.node("p", { class: "pairing", hidden: true }, gk.node("label", {}, "Compare: ", this.pair));
    this.follow = gk.node("input", { type: "checkbox", checked: true });
    this.follow.addEventListener("change", () => this.follow.checked && this.to(this.last));
    this.following = gk.node("label", { class: "following", hidden: true }, this.follow, " follow the recording");
    this.curve = new gk.SliderCurve();
    this.playOn = gk.page.play_on && new gk.PlayOn(this);
    const parts = [this.pairing, this.trouble, this.parted, this.jumps, this.playOn?.root ?? "", this.curve.root, this.stage, this.#controls(), gk.keysHelp()];
    // A page begins with its episode; the list, in `gamekeeper view` the way to all of them, is a line.
    this.host.append(...(gk.served ? [this.list.root, ...parts] : [...parts, this.list.root]), this.status);
  }

  #controls() {
    const button = (sign, label, work) => gk.button(work, { "aria-label": label, title: label }, gk.icon(sign));
    this.play = button("play", "Play (space)", () => this.toggle());
    const mark = (by) => () => this.toMark(by);
    const buttons = [
      button("first", "First turn (Home)", () => this.to(0)),
      button("markBefore", "Mark before ([)", mark(-1)),
      button("back", "Turn before (left arrow)", () => this.to(this.turn - 1)),
      this.play,
      button("next", "Next turn (right arrow)", () => this.to(this.turn + 1)),
      button("markAfter", "Next mark (])", mark(1)),
      button("last", "Last turn (End)", () => this.to(this.last)),
    ];
    this.pace = gk.node("output", { class: "pace", "aria-label": "Speed" });
    const slower = button("slower", "Slower (−)", () => this.faster(-1));
    this.alone = gk.node("input", { type: "checkbox" });
    this.alone.addEventListener("change", () => this.pick(this.chosen, this.alone.checked));
    this.picked = gk.node("bdi");
    this.picking = gk.node("label", { class: "picking", hidden: true }, this.alone, " only ", this.picked);
    this.ticks = gk.node("canvas", { class: "scrub-marks", "aria-hidden": "true" });
    const speed = gk.node("span", { class: "speed" }, slower, this.pace, button("faster", "Faster (+)", () => this.faster(1)));
    this.slider = gk.node("input", { type: "range", min: "0", max: "0", value: "0", step: "1", "aria-label": "Turn", class: "scrub" });
    this.slider.addEventListener("input", () => this.to(Number(this.slider.value)));
    this.ranging = gk.button(() => this.mark(this.anchor === null ? this.turn : null), { class: "ranging", "aria-pressed": "false", title: "Totals from this turn on (R)", text: "Range" });
    this.number = gk.node("input", { type: "number", min: "0", value: "0", "aria-label": "Go to turn", title: "Go to turn" });
    this.number.addEventListener("input", () => this.number.value !== "" && this.to(Number(this.number.value)));
    this.until = gk.node("span", { class: "until" });
    this.where = gk.node("label", { class: "where" }, gk.node("span", { class: "where-word", text: "Turn " }), this.number, this.until);
    this.faster(0);
    this.bar = gk.node(
      "div",
      { class: "controls", role: "group", "aria-label": "Playback" },
      gk.node("div", { class: "control-buttons" }, ...buttons, this.where, speed, this.picking, this.following),
      gk.node("div", { class: "control-slider" }, this.slider, this.ticks),
    );
    // What is jumped to stands above the bar, however high it is.
    new ResizeObserver(() => this.host.style.setProperty("--bar", `${this.bar.offsetHeight}px`)).observe(this.bar);
    return this.bar;
  }

  get last() {
    return Math.max(0, ...this.decks.map((deck) => deck.episode.last));
  }

  get marks() {
    const pair = this.decks.length > 1; // where each parts from some third one is no matter here
    const kept = (deck) => deck.episode.marks.filter((mark) => !pair || mark.kind !== "divergence");
    const all = this.decks.flatMap((deck) => kept(deck).map((mark) => ({ ...mark, side: deck.side })));
    all.push(...this.partMarks());
    return all.sort((a, b) => a.turn - b.turn);
  }

  partMarks() {
    if (!this.part || this.part.turn === null) return [];
    const { turn, agent, field } = this.part;
    const text = field === "length" ? "one of them ends" : `${gk.own(gk.FIELD_WORDS, field) ?? field} differs`;
    return [{ turn: Math.min(turn, this.last), kind: "divergence", agent, text, both: true }];
  }

  // Every episode there is, after the first time also what a recording added.
  fill(entries) {
    this.entries = entries;
    this.list.fill(entries);
    this.#fillPairs();
  }

  entry(run, episode) {
    return this.entries.find((entry) => entry.run === run && entry.episode === episode);
  }

  #fillPairs() {
    const pairs = gk.page.pairs ?? [];
    this.pairs = pairs.filter(({ left, right }) => this.entry(left.run, left.episode)?.packed && this.entry(right.run, right.episode)?.packed);
    const options = this.pairs.map((pair, i) => gk.node("option", { value: String(i), text: gk.visible(pair.text) }));
    this.pair.replaceChildren(gk.node("option", { value: "", text: "one episode alone" }), ...options);
    this.#choosePair();
    this.pairing.hidden = this.pairs.length === 0;
  }

  #showPair() {
    this.moved = true;
    const pair = this.pairs[Number(this.pair.value)];
    if (this.pair.value === "" || !pair) return this.#show([this.decks[0]?.entry].filter(Boolean));
    return this.#show([pair.left, pair.right].map(({ run, episode }) => this.entry(run, episode)));
  }

  // The pair on show, if the page offers it; then also what was found out about it when the page was made.
  get known() {
    const [left, right] = this.decks.map(({ entry }) => entry);
    const is = (place, entry) => place.run === entry.run && place.episode === entry.episode;
    return right && this.pairs.find((pair) => is(pair.left, left) && is(pair.right, right));
  }

  #choosePair() {
    const at = this.pairs.indexOf(this.known);
    this.pair.value = at < 0 ? "" : String(at);
  }

  // Makes an agent stand out everywhere, or releases it where it does; `solo`: it is alone.
  pick(name, solo = false) {
    const again = name === this.chosen && solo === this.solo;
    this.chosen = again ? null : name;
    this.solo = this.chosen !== null && solo;
    this.moved = true;
    this.#stress();
    this.render();
  }

  #stress() {
    this.decks.forEach((deck) => deck.stress(this.chosen, this.solo));
    this.alone.checked = this.solo;
    this.picking.hidden = this.chosen === null;
    gk.say(this.picked, gk.visible(this.chosen ?? ""));
  }

  // Opens an episode, or two side by side, at a turn.
  async open(entries, { turn, focus = false, agent = null, solo = false, anchor = null } = {}) {
    await this.#show(entries, turn);
    this.mark(anchor);
    [this.chosen, this.solo] = [agent, agent !== null && solo];
    this.#stress();
    if (focus) this.#bringIntoSight();
  }

  // Where the player begins stands at the top of the window, below the list of `gamekeeper view`.
  #bringIntoSight() {
    this.moved = true;
    const top = gk.served ? [this.pairing, this.jumps].find((part) => !part.hidden) : this.host.closest("section");
    top?.scrollIntoView({ block: "start", behavior: "instant" });
    this.slider.focus({ preventScroll: true });
  }

  // Puts an episode beside the one on show.
  async beside(entry) {
    const first = this.decks[0]?.entry;
    this.moved = true;
    if (!first) return this.open([entry]);
    await this.#show(first === entry ? [first] : [first, entry]);
    return this.#bringIntoSight();
  }

  async #show(entries, turn) {
    this.pause();
    const mine = ++this.generation;
    this.goesOn = false;
    try {
      const episodes = await Promise.all(entries.map((entry) => gk.load(entry.run, entry.episode)));
      if (mine !== this.generation) return; // the reader chose another one meanwhile
      this.trouble.hidden = true;
      this.#deal(episodes, entries);
      this.to(turn ?? this.#start());
      this.began = this.turn;
    } catch (error) {
      if (mine !== this.generation) return;
      this.trouble.hidden = false;
      gk.say(this.trouble, gk.visible(`Not opened: ${error.message}`));
      if (!(error instanceof gk.Trouble)) console.error(error);
    }
  }

  #deal(episodes, entries) {
    const titles = episodes.length > 1 ? ["Left", "Right"] : ["Episode"];
    this.decks = episodes.map((episode, i) => {
      const deck = new gk.Deck(episode, entries[i], `${titles[i]}: run ${gk.visible(episode.run)}, episode ${episode.index}`, (turn) => this.to(turn), (name) => this.pick(name), (from, to) => this.to(to, from));
      Object.assign(deck, { entry: entries[i], side: titles[i].toLowerCase() });
      return deck;
    });
    const [one, other] = this.decks;
    if (other) {
      gk.Lanes.pair(one.lanes, other.lanes);
      one.haunt(other);
      other.haunt(one);
    }
    one.lanes.drawn = () => this.#align();
    one.lanes.zooms.append(this.ranging);
    this.#choosePair();
    this.part = episodes.length < 2 ? null : this.known ? this.known.divergence : gk.firstDifference(...episodes);
    if (episodes.length > 1) this.decks.forEach((deck) => deck.mark(this.partMarks()));
    this.found = episodes.length > 1 ? gk.gapCurve(...episodes) : gk.successCurve(episodes[0]);
    this.stage.classList.toggle("two", episodes.length > 1);
    this.stage.replaceChildren(...this.decks.map((deck) => deck.root));
    this.slider.max = String(this.last);
    this.following.hidden = episodes[0].end !== "open";
    this.#sayPart(episodes);
    this.#fillJumps();
    this.list.show(entries.map((entry) => `${entry.run}/${entry.episode}`));
    this.#stress();
    this.decks.forEach((deck) => deck.lanes.draw());
  }

  // The slider stands above the lanes of one episode, its thumb above their cursor where all turns are in sight, its marks above theirs.
  #align() {
    const { lanes } = this.decks[0];
    const half = THUMB / 2;
    const one = this.decks.length === 1 && this.last > 0;
    const per = one ? lanes.width / (this.last + 1) : 0;
    const from = one ? lanes.canvas.getBoundingClientRect().left - this.bar.getBoundingClientRect().left + per / 2 - half : 0;
    const wide = one ? this.last * per + THUMB : this.bar.clientWidth;
    this.bar.classList.toggle("beside", from >= BESIDE);
    this.host.style.setProperty("--from", `${from}px`);
    this.slider.style.width = `${wide}px`;
    const perTurn = (wide - THUMB) / Math.max(1, this.last);
    const at = (turn) => half + turn * perTurn;
    gk.drawRuler(this.ticks, this.last, [...this.marks, ...this.decks.flatMap((deck) => deck.episode.penalties)], { first: 0, perTurn, width: wide, at });
    this.curve.draw(this.found, { wide, at });
  }

  // A pair begins at its first difference, what broke off where it did, a lost one at the turn that lost it, a failure in the midst of an episode where it is, a failed one that was played again otherwise where the closest of those first differed, anything else at its beginning.
  #start() {
    if (this.decks.length > 1) return Math.min(this.last, this.part?.turn ?? 0);
    const found = (kind) => this.marks.find((mark) => mark.kind === kind)?.turn;
    if (this.decks[0].episode.end === "open") return this.last;
    const failure = found("failure");
    return found("error") ?? found("pivot") ?? found("since") ?? (failure < this.last ? failure : (this.marks.findLast((mark) => mark.kind === "divergence")?.turn ?? 0));
  }

  #sayPart(episodes) {
    this.parted.hidden = episodes.length < 2;
    if (episodes.length > 1) gk.say(this.parted, gk.differenceText(this.part, episodes));
  }

  #fillJumps() {
    const go = (mark) => {
      this.to(mark.turn);
      if (mark.agent) this.decks.forEach((deck) => deck.lanes.reveal(mark.agent));
    };
    this.jumps.replaceChildren(...gk.jumpsOf(this.marks, { several: this.decks.length > 1, go }));
  }

  to(turn, from = null) {
    if (from !== null) this.mark(from); // a range, to this turn
    this.turn = Math.max(0, Math.min(this.last, Math.round(turn)));
    this.follow.checked = this.turn === this.last; // a reader who goes back stays there
    this.render();
  }

  // Begins a range at a turn; it reaches to the cursor, wherever that goes. null: no range.
  mark(turn) {
    this.anchor = turn === null ? null : Math.max(0, Math.min(this.last, turn));
    this.ranging.setAttribute("aria-pressed", String(this.anchor !== null));
    this.moved ||= this.anchor !== null;
    this.render();
  }

  // First and last turn of the range.
  get range() {
    return this.anchor === null ? null : [Math.min(this.anchor, this.turn), Math.max(this.anchor, this.turn)];
  }

  // The mark before or after the cursor.
  toMark(by) {
    const turns = this.marks.map((mark) => mark.turn);
    const found = by > 0 ? turns.find((turn) => turn > this.turn) : turns.reverse().find((turn) => turn < this.turn);
    if (found !== undefined) this.to(found);
  }

  faster(by) {
    this.speed = Math.max(0, Math.min(SPEEDS.length - 1, this.speed + by));
    this.pace.textContent = `${SPEEDS[this.speed]}/s`;
  }

  toggle() {
    if (this.playing) return this.pause();
    if (this.turn >= this.last) this.to(0);
    this.playing = true;
    this.#sayPlaying();
    let before = performance.now();
    let owed = 0;
    const frame = (now) => {
      if (!this.playing) return;
      owed += ((now - before) / 1000) * SPEEDS[this.speed];
      before = now;
      if (owed >= 1) {
        this.to(this.turn + Math.floor(owed));
        owed %= 1;
      }
      if (this.turn >= this.last) this.pause();
      else requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
    return undefined;
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.#sayPlaying();
    this.#settle();
  }

  #sayPlaying() {
    this.play.replaceChildren(gk.icon(this.playing ? "pause" : "play"));
    this.play.setAttribute("aria-label", this.playing ? "Pause (space)" : "Play (space)");
    this.play.title = this.play.getAttribute("aria-label");
  }

  #render() {
    if (!this.decks.length) return;
    const [a, b] = this.decks;
    this.decks.forEach((deck) => deck.select(this.range));
    a.show(this.turn, b ? b.episode : null);
    if (b) b.show(this.turn, a.episode);
    if (this.slider.value !== String(this.turn)) this.slider.value = String(this.turn);
    this.slider.setAttribute("aria-valuetext", `turn ${this.turn} of ${this.last}`);
    if (this.number.value !== String(this.turn)) this.number.value = String(this.turn);
    this.number.max = String(this.last);
    gk.say(this.until, ` / ${this.last}`);
    this.host.dataset.turn = String(this.turn);
    this.playOn?.show(a.episode, this.turn);
    if (!this.playing) this.#settle();
  }

  // Once the cursor rests: the turn is read out, and the address leads back to it.
  #settle() {
    clearTimeout(this.settled);
    this.settled = setTimeout(() => {
      gk.say(this.status, this.#spoken());
      if (this.turn !== this.began) this.moved = true; // an untouched page keeps its address
      const hasAddress = location.protocol !== "about:"; // a frame in a notebook has none
      if (this.moved && hasAddress) history.replaceState(null, "", this.address);
    }, SETTLED);
  }

  // `#play:RUN/EPISODE/TURN`, behind a `~` where the range begins, behind a `+` the episode beside it, behind an `@` the chosen agent, with a `!` where it is alone.
  get address() {
    const [one, other] = this.decks.map(({ episode }) => `${encodeURIComponent(episode.run)}/${episode.index}`);
    const agent = this.chosen === null ? "" : `@${encodeURIComponent(this.chosen)}${this.solo ? "!" : ""}`;
    const range = this.anchor === null ? "" : `~${this.anchor}`;
    return `#play:${one}/${this.turn}${range}${other ? `+${other}` : ""}${agent}`;
  }

  #spoken() {
    const here = this.marks.filter((mark) => mark.turn === this.turn).map(gk.markText);
    return [this.decks[0].table.caption.textContent, ...here].join(". ");
  }

  // Reads an episode that is still being recorded again; the cursor stays, or follows its end.
  async grow(entry) {
    const at = this.decks.findIndex((deck) => deck.entry.run === entry.run && deck.entry.episode === entry.episode);
    if (at < 0 || (this.decks[at].episode.turns === entry.turns && this.decks[at].episode.end === entry.end)) return;
    const mine = this.generation;
    await gk.load(entry.run, entry.episode, { again: true });
    if (mine !== this.generation || this.playing) return;
    const [turn, following] = [this.turn, this.follow.checked];
    const looks = this.decks.map((deck) => deck.look);
    const entries = this.decks.map((deck) => this.entry(deck.entry.run, deck.entry.episode) ?? deck.entry);
    await this.#show(entries, turn);
    this.decks.forEach((deck, i) => deck.lookLike(looks[i]));
    if (following) this.to(this.last);
    this.goesOn = following && entries.length === 1 && entries[0].end !== "open";
  }

  // From the end of an episode that was followed to the one that is recorded next.
  goOn() {
    if (!this.goesOn || !this.follow.checked) return;
    const next = this.entries.findLast((entry) => entry.run === this.decks[0].entry.run && entry.end === "open" && entry.packed);
    if (next) this.open([next]);
  }
};
