// A map: where agents are, with the trail of their last moves (a track holds an agent's first place and each change). Roles differ in shape, agents in colour and by name.

const TRAIL = 40; // turns
const NAMED = 24; // as many agents have their names beside them
const SIZE = 5; // pixels from a sign's centre to its edge
const SIDE = 340; // pixels of the picture's longer side, at most

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

gk.MapDrawing = class {
  constructor(episode) {
    this.episode = episode;
    const { extent, tracks } = episode.drawing;
    this.extent = extent;
    this.tracks = Object.entries(tracks).map(([name, points]) => {
      const seat = episode.seat.get(name);
      const role = seat === undefined ? 0 : gk.placeOf("role", episode.agents[seat].role);
      return {
        name,
        seat: seat ?? 0,
        shape: SHAPES[role % SHAPES.length],
        turns: Float64Array.from(points, (point) => point[0]),
        xs: Float64Array.from(points, (point) => point[1]),
        ys: Float64Array.from(points, (point) => point[2]),
      };
    });
    this.root = gk.node("canvas", { class: "drawing-map", role: "img" });
  }

  #scale() {
    const [x0, x1, y0, y1] = this.extent;
    const [across, up] = [x1 - x0 || 1, y1 - y0 || 1];
    const per = Math.min(SIDE / across, SIDE / up);
    this.width = Math.max(60, across * per) + 4 * SIZE;
    this.height = Math.max(60, up * per) + 4 * SIZE;
    this.x = (x) => 2 * SIZE + (x - x0) * per;
    this.y = (y) => this.height - 2 * SIZE - (y - y0) * per;
  }

  show(turn) {
    this.#scale();
    const colours = gk.colours();
    const ink = gk.sized(this.root, this.width, this.height);
    ink.fillStyle = colours.raised;
    ink.fillRect(0, 0, this.width, this.height);
    ink.strokeStyle = colours.line;
    ink.strokeRect(0.5, 0.5, this.width - 1, this.height - 1);
    ink.font = `11px ${colours.font}`;
    ink.textBaseline = "middle";
    const labels = [];
    for (const track of this.tracks) this.#draw(ink, track, turn, labels);
    ink.fillStyle = colours.ink;
    if (this.tracks.length <= NAMED) labels.forEach(([text, x, y]) => this.#write(ink, text, x, y));
    this.root.setAttribute("aria-label", `Map at turn ${turn}: ${this.#places(turn)}`);
  }

  #draw(ink, track, turn, labels) {
    const here = gk.lastUntil(track.turns, turn);
    if (here < 0) return;
    const colour = gk.colourAt(gk.placeOf("agent", track.name));
    ink.strokeStyle = colour;
    ink.fillStyle = colour;
    ink.lineWidth = 1.5;
    ink.globalAlpha = 0.45;
    ink.beginPath();
    for (let i = here; i >= 0; i--) {
      ink.lineTo(this.x(track.xs[i]), this.y(track.ys[i]));
      if (track.turns[i] < turn - TRAIL) break;
    }
    ink.stroke();
    const gone = !this.episode.isThere(track.seat, turn);
    ink.globalAlpha = 1;
    ink.beginPath();
    const [x, y] = [this.x(track.xs[here]), this.y(track.ys[here])];
    track.shape(ink, x, y, SIZE);
    if (gone) ink.stroke();
    else ink.fill();
    labels.push([gk.visible(track.name), x, y]);
  }

  // A name to the right of its sign, or to the left where the edge is near.
  #write(ink, text, x, y) {
    const short = text.length > 18 ? `${text.slice(0, 17)}…` : text;
    const left = x + 10 + ink.measureText(short).width > this.width;
    ink.textAlign = left ? "right" : "left";
    ink.fillText(short, left ? x - 8 : x + 8, y);
  }

  #places(turn) {
    const places = this.tracks.slice(0, 8).map((track) => {
      const here = gk.lastUntil(track.turns, turn);
      return here < 0 ? "" : `${gk.visible(track.name)} at ${gk.number(track.xs[here])}, ${gk.number(track.ys[here])}`;
    });
    return places.filter(Boolean).join("; ");
  }
};
