// Arrays as cells: observations or state, one shade a number. 2 axes: rows and columns; 3: a picture a layer, side by side; 1: rows of at most 32.

const LONG_ROW = 32;
const SHOWN = 12; // parts drawn at once
const SIDE = 150; // pixels of a part's longer side, if its cells allow
const CELL = 22; // pixels of a cell, at most
// cividis, which reads the same without red or green. Source: Nuñez, Anderton, Renslow 2018.
const RAMP = [[0, 34, 78], [53, 69, 108], [102, 105, 112], [148, 142, 119], [200, 184, 102], [254, 232, 56]];

const shades = new Uint32Array(256);
const endless = new DataView(shades.buffer);
for (let i = 0; i < 256; i++) {
  const at = (i / 255) * (RAMP.length - 1);
  const low = Math.min(RAMP.length - 2, Math.floor(at));
  RAMP[low].forEach((value, c) => endless.setUint8(4 * i + c, Math.round(value + (RAMP[low + 1][c] - value) * (at - low))));
  endless.setUint8(4 * i + 3, 255);
}

// Rows, columns and layers that a shape is drawn as.
const layout = (shape) => {
  const axes = shape.filter((size) => size !== 1);
  if (axes.length === 2) return { rows: axes[0], columns: axes[1], layers: 1, last: false };
  if (axes.length === 3) {
    const last = axes[2] <= axes[0]; // channels stand last in most observations
    return last ? { rows: axes[0], columns: axes[1], layers: axes[2], last } : { rows: axes[1], columns: axes[2], layers: axes[0], last };
  }
  const all = axes.reduce((product, size) => product * size, 1);
  const columns = Math.min(LONG_ROW, all);
  return { rows: Math.ceil(all / columns), columns, layers: 1, last: false };
};

// An array's values of one turn as pixels: layers side by side, a clear column between them.
const paint = (image, values, offset, size, { rows, columns, layers, last }) => {
  const pixels = new Uint32Array(image.data.buffer);
  const wide = image.width;
  for (let i = 0; i < size; i++) {
    const layer = last ? i % layers : Math.floor(i / (rows * columns));
    const cell = last ? Math.floor(i / layers) : i % (rows * columns);
    pixels[Math.floor(cell / columns) * wide + layer * (columns + 1) + (cell % columns)] = shades[values[offset + i]];
  }
};

const bytesOf = (text) => {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
};

const Part = class {
  constructor(part) {
    this.part = part;
    this.layout = layout(part.shape);
    this.size = part.shape.reduce((product, size) => product * size, 1);
    const { rows, columns, layers } = this.layout;
    this.canvas = gk.node("canvas", { role: "img" });
    [this.canvas.width, this.canvas.height] = [layers * (columns + 1) - 1, rows];
    const scale = Math.max(1, Math.min(CELL, Math.floor(SIDE / Math.max(rows, columns))));
    this.canvas.style.width = `${this.canvas.width * scale}px`;
    const range = part.low === part.high ? `always ${gk.short(part.low)}` : `${gk.short(part.low)} (dark) to ${gk.short(part.high)} (yellow)`;
    const size = `${part.shape.join(" × ")} number${this.size === 1 ? "" : "s"}`;
    this.caption = gk.node("figcaption", {}, gk.name(part.name), `: ${size}, ${range}`);
    this.root = gk.node("figure", { class: "cells-part" }, this.canvas, this.caption);
    this.drawn = null;
  }

  show(turn) {
    this.values ??= bytesOf(this.part.values);
    const { turns } = this.part;
    const at = gk.lastUntil(turns, turn);
    if (at === this.drawn) return;
    this.drawn = at;
    const ink = this.canvas.getContext("2d");
    const image = ink.createImageData(this.canvas.width, this.canvas.height);
    if (at >= 0) paint(image, this.values, at * this.size, this.size, this.layout);
    ink.putImageData(image, 0, 0);
    const seen = at < 0 ? "nothing yet" : `of turn ${turns[at]}`;
    this.canvas.setAttribute("aria-label", `${gk.visible(this.part.name)}: ${this.size} numbers ${seen}, dark is low`);
  }
};

gk.CellsDrawing = class {
  constructor(episode) {
    this.parts = episode.drawing.parts.map((part) => new Part(part));
    this.field = gk.node("div", { class: "cells" });
    this.from = 0;
    this.turn = 0;
    this.pager = this.parts.length > SHOWN ? this.#pages() : "";
    this.root = gk.node("div", {}, this.pager, this.field);
    this.#fill();
  }

  #pages() {
    const choice = gk.node("select", { "aria-label": "Which arrays are drawn" });
    for (let i = 0; i < this.parts.length; i += SHOWN) {
      const names = this.parts.slice(i, i + SHOWN).map((part) => gk.visible(part.part.name));
      choice.append(gk.node("option", { value: String(i), text: `${names[0]} … ${names.at(-1)}` }));
    }
    choice.addEventListener("change", () => {
      this.from = Number(choice.value);
      this.#fill();
      this.show(this.turn);
    });
    return choice;
  }

  #fill() {
    this.field.replaceChildren(...this.parts.slice(this.from, this.from + SHOWN).map((part) => part.root));
  }

  show(turn) {
    this.turn = turn;
    for (const part of this.parts.slice(this.from, this.from + SHOWN)) part.show(turn);
  }
};
