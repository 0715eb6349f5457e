// A map: where agents are, with the trail of their last moves (a track holds an agent's first place and each change). Roles differ in shape, agents in colour and by name.

const TRAIL = 40; // turns
const TRAILED = 64; // as many agents have trails; of more only the chosen one
const NAMED = 24; // as many agents have their names beside them
const LETTERS = 6; // half the height of a name, in pixels
const SIZE = 5; // pixels from a sign's centre to its edge
const SIDE = 360; // pixels of the picture's longer side, at most
const CELL = 48; // pixels of a cell's side, at most

const SHAPES = [
  (ink, x, y, r) => ink.arc(x, y, r, 0, 2 * Math.PI),
  (ink, x, y, r) => ink.rect(x - r, y - r, 2 * r, 2 * r),
  (ink, x, y, r) => polygon(ink, [[x, y - 1.3 * r], [x + 1.2 * r, y + r], [x - 1.2 * r, y + r]]),
  (ink, x, y, r) => polygon(ink, [[x, y - 1.4 * r], [x + 1.4 * r, y], [x, y + 1.4 * r], [x - 1.4 * r, y]]),
];

const polygon = (ink, [start, ...rest]) => {
  ink.moveTo(...start);
  rest.forEach((point) => ink.lineTo(...point));
  ink.closePath();
};

// [turn, x, y] of each move as columns; NaN where it is not there.
gk.trackOf = (points) => ({
  turns: Float64Array.from(points, (point) => point[0]),
  xs: Float64Array.from(points, (point) => point[1] ?? NaN),
  ys: Float64Array.from(points, (point) => point[2] ?? NaN),
});

const overlap = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;

// Places for names: right of their signs, left, below or above, where no other sign or name is and the picture doesn't end. A name without its action where both don't fit.
gk.placeNames = (labels, { size, width, height }) => {
  const box = (left, middle, wide, half) => ({ left, middle, right: left + wide, top: middle - half, bottom: middle + half });
  const taken = labels.map(({ x, y }) => box(x - size, y, 2 * size, size));
  const found = [];
  const fit = ({ x, y }, wide, i) => {
    const [apart, below] = [size + 3, size + LETTERS + 2];
    const middle = Math.max(1, Math.min(width - wide - 1, x - wide / 2));
    const places = [[x + apart, y], [x - apart - wide, y], [middle, y + below], [middle, y - below]];
    return places
      .map(([left, at]) => box(left, at, wide, LETTERS))
      .find((each) => each.left >= 0 && each.right <= width && each.top >= 0 && each.bottom <= height && !taken.some((other, k) => k !== i && overlap(each, other)));
  };
  labels.forEach((label, i) => {
    const long = label.long && fit(label, label.longWide, i);
    const free = long || fit(label, label.wide, i);
    if (!free) return;
    taken.push(free);
    found.push({ text: long ? label.long : label.text, ...free });
  });
  return found;
};

gk.MapDrawing = class {
  constructor(episode) {
    this.episode = episode;
    const { extent, tracks, scene } = episode.drawing;
    this.extent = extent;
    this.scene = scene ? new gk.Scene(scene, episode) : null;
    this.chosen = null; // the agent that stands out
    this.ghost = null; // the map beside this one, whose agents are drawn as outlines where they are elsewhere
    this.tracks = Object.entries(tracks).map(([name, points]) => {
      const slot = episode.slot.get(name);
      const role = slot === undefined ? 0 : gk.placeOf("role", episode.agents[slot].role);
      return {
        name,
        slot: slot ?? 0,
        shape: SHAPES[role % SHAPES.length],
        ...gk.trackOf(points),
      };
    });
    this.canvas = gk.node("canvas", { class: "drawing-map", role: "img" });
    const words = [this.scene?.legend, "colour: the agent, as in the lanes", ...gk.roleWords(episode), "line: an agent's way here", "hollow: it has ended"];
    this.root = gk.node("div", {}, this.canvas, gk.node("p", { class: "note legend", text: words.filter(Boolean).join(" · ") }));
  }

  get size() {
    return this.scene?.grid ? Math.max(3.5, Math.min(13, this.per * 0.3)) : SIZE;
  }

  #scale() {
    const [x0, x1, y0, y1] = this.extent;
    const grid = this.scene?.grid;
    const [across, up] = grid ? [x1 - x0 + 1, y1 - y0 + 1] : [x1 - x0 || 1, y1 - y0 || 1];
    this.per = Math.min(SIDE / across, SIDE / up, grid ? CELL : Infinity);
    const edge = grid ? 0 : 4 * SIZE;
    this.width = Math.max(60, across * this.per) + edge;
    this.height = Math.max(grid ? 1 : 60, up * this.per) + edge;
    const half = grid ? this.per / 2 : 2 * SIZE;
    this.x = (x) => half + (x - x0) * this.per;
    this.y = (y) => (this.scene?.down ? half + (y - y0) * this.per : this.height - half - (y - y0) * this.per);
  }

  show(turn) {
    this.#scale();
    const colours = gk.colours();
    const ink = gk.sized(this.canvas, this.width, this.height);
    ink.fillStyle = colours.raised;
    ink.fillRect(0, 0, this.width, this.height);
    ink.strokeStyle = colours.line;
    ink.lineWidth = 1;
    ink.strokeRect(0.5, 0.5, this.width - 1, this.height - 1);
    ink.font = `11px ${colours.font}`;
    ink.textBaseline = "middle";
    this.scene?.draw(ink, turn, { x: this.x, y: this.y, per: this.per }, (name, x, y, size) => this.#sign(ink, name, x, y, size));
    ink.font = `11px ${colours.font}`;
    const labels = [];
    for (const track of this.tracks) this.#draw(ink, track, turn, labels);
    for (const track of this.ghost?.tracks ?? []) this.#haunt(ink, track, turn);
    ink.fillStyle = colours.ink;
    if (this.tracks.length <= NAMED) this.#name(ink, labels);
    this.canvas.setAttribute("aria-label", `Map at turn ${turn}: ${this.#places(turn)}`);
  }

  #draw(ink, track, turn, labels) {
    const here = gk.lastUntil(track.turns, turn);
    if (here < 0 || Number.isNaN(track.xs[here])) return;
    const faint = this.chosen !== null && this.chosen !== track.name ? 0.25 : 1;
    const colour = gk.colourAt(gk.placeOf("agent", track.name));
    ink.strokeStyle = colour;
    ink.fillStyle = colour;
    ink.lineWidth = 1.5;
    ink.globalAlpha = 0.45 * faint;
    ink.beginPath();
    const isTrailed = this.tracks.length <= TRAILED || this.chosen === track.name;
    for (let i = here; isTrailed && i >= 0 && !Number.isNaN(track.xs[i]); i--) {
      ink.lineTo(this.x(track.xs[i]), this.y(track.ys[i]));
      if (track.turns[i] < turn - TRAIL) break;
    }
    ink.stroke();
    const gone = !this.episode.isThere(track.slot, turn);
    ink.globalAlpha = faint;
    ink.beginPath();
    const [x, y] = [this.x(track.xs[here]), this.y(track.ys[here])];
    track.shape(ink, x, y, this.size);
    if (gone) ink.stroke();
    else ink.fill();
    if (this.scene?.isCarrying(track.name, turn)) {
      const side = this.size * 0.8;
      ink.fillStyle = gk.colours().ink;
      ink.fillRect(x - side / 2, y - side / 2, side, side);
    }
    ink.globalAlpha = 1;
    if (faint === 1) labels.push({ name: track.name, doing: gk.doingText(this.episode, track.slot, turn), x, y });
  }

  // An agent of the episode beside this one: an outline, joined to where the agent is here.
  #haunt(ink, track, turn) {
    const there = gk.lastUntil(track.turns, turn);
    if (there < 0 || Number.isNaN(track.xs[there])) return;
    const mine = this.tracks.find((each) => each.name === track.name);
    if (!mine) return; // this episode never had it
    const here = gk.lastUntil(mine.turns, turn);
    if (here >= 0 && mine.xs[here] === track.xs[there] && mine.ys[here] === track.ys[there]) return;
    const [x, y] = [this.x(track.xs[there]), this.y(track.ys[there])];
    ink.strokeStyle = gk.colourAt(gk.placeOf("agent", track.name));
    ink.lineWidth = 1.5;
    ink.setLineDash([3, 2]);
    ink.beginPath();
    if (here >= 0 && !Number.isNaN(mine.xs[here])) {
      ink.moveTo(this.x(mine.xs[here]), this.y(mine.ys[here]));
      ink.lineTo(x, y);
      ink.stroke();
      ink.beginPath();
    }
    track.shape(ink, x, y, this.size);
    ink.stroke();
    ink.setLineDash([]);
  }

  // An agent's sign in a cell of a board; false where the word is no agent.
  #sign(ink, name, x, y, size) {
    const slot = this.episode.slot.get(name);
    if (slot === undefined) return false;
    ink.fillStyle = gk.colourAt(gk.placeOf("agent", name));
    ink.beginPath();
    const role = gk.roleWords(this.episode).length ? gk.placeOf("role", this.episode.agents[slot].role) : slot;
    SHAPES[role % SHAPES.length](ink, x, y, size);
    ink.fill();
    return true;
  }

  // Names beside their signs; those without room are left out, the lanes have all.
  #name(ink, labels) {
    const short = (text) => (text.length > 18 ? `${text.slice(0, 17)}…` : text);
    const sized = labels.map(({ name, doing, x, y }) => {
      const text = short(gk.visible(name));
      const long = doing && `${text}: ${short(doing)}`;
      return { text, long, x, y, wide: ink.measureText(text).width, longWide: ink.measureText(long).width };
    });
    const named = gk.placeNames(sized, this);
    ink.textAlign = "left";
    ink.lineWidth = 3;
    ink.strokeStyle = gk.colours().raised; // a rim, so that names are read on cells
    for (const { text, left, middle } of named) {
      ink.strokeText(text, left, middle);
      ink.fillText(text, left, middle);
    }
  }

  #places(turn) {
    const places = this.tracks.slice(0, 8).map((track) => {
      const here = gk.lastUntil(track.turns, turn);
      return here < 0 || Number.isNaN(track.xs[here]) ? "" : `${gk.visible(track.name)} at ${gk.number(track.xs[here])}, ${gk.number(track.ys[here])}`;
    });
    return places.filter(Boolean).join("; ");
  }
};
