// The ground of a map: cells of a grid, and things that are no agents. What a cell is, its letter says; the legend has the words.

const SOLID = ["wall", "rock"];
const SMALL = ["item"];

// Letters that differ, for words of one scene.
const lettersOf = (words) => {
  const taken = new Set();
  return new Map(
    words.map((word) => {
      const letter = [...word.toUpperCase()].find((sign) => /\S/.test(sign) && !taken.has(sign)) ?? "?";
      taken.add(letter);
      return [word, letter];
    }),
  );
};

// The cells of a layer at a turn: from the last turn on show forward, else from the beginning.
const Layer = class {
  constructor(layer) {
    Object.assign(this, layer);
    this.turn = -1;
  }

  at(turn) {
    if (this.turn < 0 || turn < this.turn) {
      this.cells = Int32Array.from(this.base);
      this.next = 0;
    }
    while (this.next < this.changes.length && this.changes[this.next][0] <= turn) {
      const [, cell, value] = this.changes[this.next++];
      this.cells[cell] = value;
    }
    this.turn = turn;
    return this.cells;
  }
};

gk.Scene = class {
  constructor(scene, episode) {
    Object.assign(this, scene);
    this.layers = scene.cells.map((layer) => new Layer(layer));
    this.things = scene.things.map(({ name, track }) => ({ name, ...gk.trackOf(track) }));
    const there = (layer) => new Set([...layer.base, ...layer.changes.map((change) => change[2])].map(String));
    const wordsOf = (layer, numbers) => Object.entries(layer.values).flatMap(([number, word]) => (numbers.has(number) ? [word] : []));
    const words = this.layers.flatMap((layer) => wordsOf(layer, there(layer))).filter((word) => !episode.slot.has(word));
    const pieces = this.layers.flatMap((layer) => Object.values(layer.pieces ?? {}));
    this.letters = lettersOf([...new Set([...words, ...pieces, ...this.things.map(({ name }) => name)])]);
    this.carried = scene.carries;
  }

  get legend() {
    const sign = (word, letter) => (SOLID.includes(word) ? "filled" : SMALL.includes(word) && this.grid ? "small square" : letter);
    const words = [...this.letters].map(([word, letter]) => `${sign(word, letter)}: ${gk.visible(word)}`);
    if (Object.keys(this.carried).length) words.push("square on an agent: it carries something");
    if (this.note) words.push(this.note);
    return words.join(" · ");
  }

  isCarrying(name, turn) {
    const track = this.carried[name];
    if (!track) return false;
    let last = 0;
    for (const [at, value] of track) {
      if (at > turn) break;
      last = value;
    }
    return Boolean(last);
  }

  // `x(column)`, `y(row)`: middles of cells; `per`: their side.
  draw(ink, turn, { x, y, per }, agentSign) {
    const colours = gk.colours();
    if (this.grid && this.size) this.#lines(ink, { x, y, per }, colours);
    ink.textAlign = "center";
    for (const layer of this.layers) {
      const cells = layer.at(turn);
      for (let cell = 0; cell < cells.length; cell++) {
        const word = gk.own(layer.values, String(cells[cell]));
        if (!word) continue;
        const [column, row] = [cell % layer.columns, Math.floor(cell / layer.columns)];
        if (agentSign(word, x(column), y(row), per * 0.36)) {
          const piece = gk.own(layer.pieces ?? {}, String(cells[cell]));
          if (piece) this.#letter(ink, piece, x(column), y(row), per, colours.raised);
          continue;
        }
        // Of cells that never change, one of each field has the letter.
        const isInside = layer.fixed && [column ? cell - 1 : cell, cell - layer.columns].some((near) => near !== cell && cells[near] === cells[cell]);
        this.#cell(ink, word, x(column), y(row), per, colours, !isInside);
      }
    }
    for (const thing of this.things) this.#thing(ink, thing, turn, { x, y, per }, colours);
  }

  #lines(ink, { x, y, per }, colours) {
    const [columns, rows] = this.size;
    ink.strokeStyle = colours.line;
    ink.lineWidth = 0.5;
    ink.beginPath();
    const [left, top] = [x(0) - per / 2, Math.min(y(0), y(rows - 1)) - per / 2];
    for (let i = 0; i <= columns; i++) ink.rect(left + i * per, top, 0, rows * per);
    for (let i = 0; i <= rows; i++) ink.rect(left, top + i * per, columns * per, 0);
    ink.stroke();
  }

  #cell(ink, word, x, y, per, colours, isNamed = true) {
    if (SMALL.includes(word)) {
      const side = Math.max(3, per * 0.3);
      ink.fillStyle = colours.ink;
      ink.fillRect(x + per / 2 - side - 1, y - per / 2 + 1, side, side);
      return;
    }
    ink.fillStyle = SOLID.includes(word) ? colours.grey : colours.band;
    ink.fillRect(x - per / 2 + 0.5, y - per / 2 + 0.5, per - 1, per - 1);
    if (isNamed && !SOLID.includes(word)) this.#letter(ink, word, x, y, per, colours.grey);
  }

  #letter(ink, word, x, y, per, colour) {
    ink.fillStyle = colour;
    ink.font = `${Math.max(8, Math.min(13, per * 0.42))}px ${gk.colours().font}`;
    ink.fillText(this.letters.get(word), x, y);
  }

  #thing(ink, thing, turn, { x, y, per }, colours) {
    const here = gk.lastUntil(thing.turns, turn);
    if (here < 0 || Number.isNaN(thing.xs[here])) return undefined;
    const [px, py] = [x(thing.xs[here]), y(thing.ys[here])];
    if (SMALL.includes(thing.name) && this.grid) return this.#cell(ink, thing.name, px, py, per, colours);
    const size = this.grid ? per * 0.36 : 9;
    ink.strokeStyle = colours.grey;
    ink.lineWidth = 1.5;
    ink.beginPath();
    ink.arc(px, py, size, 0, 2 * Math.PI);
    ink.stroke();
    return this.#letter(ink, thing.name, px, py, 2 * size, colours.grey);
  }
};
