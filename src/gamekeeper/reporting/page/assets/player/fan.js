// The fan of futures: the sum of all returns from the turn on, of each future as it was and as changed, beside the recording.

const HIGH = 190;
const EDGE = { left: 52, right: 10, top: 10, bottom: 22 };

// The recorded sum of all returns at each turn of an episode.
const recordedPath = (episode) => {
  const sums = new Float64Array(episode.last + 1);
  for (let row = 0; row < episode.reward.length; row++) sums[episode.turn[row]] += episode.reward[row] || 0;
  for (let turn = 1; turn < sums.length; turn++) sums[turn] += sums[turn - 1];
  // what step t paid stands in turn t: after it, one turn later
  return Array.from(sums, (value, turn) => [turn + 1, value]).slice(0, episode.turns);
};

gk.Fan = class {
  constructor() {
    this.canvas = gk.node("canvas", { role: "img" });
    const key = (kind, text) => gk.node("span", { class: "key" }, gk.node("i", { class: `key-${kind}` }), text);
    this.legend = gk.node("p", { class: "fan-legend note" }, key("recorded", "recorded"), key("before", "futures as it was"), key("after", "futures as changed"));
    this.root = gk.node("figure", { class: "fan", hidden: true }, gk.node("figcaption", { text: "Sum of all agents’ rewards so far, turn by turn" }), this.canvas, this.legend);
    gk.onColours(() => this.draw());
  }

  fill(episode, document) {
    this.given = document && { episode, document };
    this.root.hidden = !document;
    this.draw();
  }

  draw() {
    if (!this.given || this.root.hidden) return;
    const { episode, document } = this.given;
    const arms = [document.arms.as_recorded.paths, document.arms.changed.paths];
    const recorded = recordedPath(episode);
    const points = [recorded, ...arms.flat()].flat();
    const wide = Math.max(200, this.root.clientWidth);
    const most = Math.max(1, ...points.map(([turn]) => turn));
    const [low, high] = points.reduce(([a, b], [, value]) => [Math.min(a, value), Math.max(b, value)], [Infinity, -Infinity]);
    const x = (turn) => EDGE.left + (turn / most) * (wide - EDGE.left - EDGE.right);
    const y = (value) => HIGH - EDGE.bottom - ((value - low) / (high - low || 1)) * (HIGH - EDGE.top - EDGE.bottom);
    const colours = gk.colours();
    const ink = gk.sized(this.canvas, wide, HIGH);
    ink.clearRect(0, 0, wide, HIGH);
    const line = (path, colour, width, alpha) => {
      ink.globalAlpha = alpha;
      ink.strokeStyle = colour;
      ink.lineWidth = width;
      ink.beginPath();
      path.forEach(([turn, value], i) => ink[i ? "lineTo" : "moveTo"](x(turn), y(value)));
      ink.stroke();
      ink.globalAlpha = 1;
    };
    const faint = Math.max(0.18, Math.min(0.8, 8 / (arms[0].length || 1)));
    ink.setLineDash([4, 3]);
    for (const path of arms[0]) line(path, colours.grey, 1.2, faint);
    ink.setLineDash([]);
    for (const path of arms[1]) line(path, colours.accent, 1.2, faint);
    ink.fillStyle = colours.accent;
    for (const path of arms[1]) ink.fillRect(x(path.at(-1)[0]) - 2, y(path.at(-1)[1]) - 2, 4, 4);
    line(recorded, colours.ink, 2, 1);
    line([[document.branch.turn, low], [document.branch.turn, high]], colours.mark, 1.5, 1);
    ink.fillStyle = colours.grey;
    ink.font = `12px ${colours.font}`;
    ink.textBaseline = "middle";
    ink.textAlign = "right";
    for (const value of [low, high]) ink.fillText(gk.number(Number(value.toPrecision(3))), EDGE.left - 6, y(value));
    ink.textBaseline = "alphabetic";
    ink.fillText(`turn ${most}`, wide - EDGE.right, HIGH - 6);
    ink.textAlign = "left";
    ink.fillText(`turn ${document.branch.turn}`, Math.min(x(document.branch.turn), wide - 120), HIGH - 6);
    const ends = arms.map((paths) => paths.map((path) => path.at(-1)[1]).sort((a, b) => a - b));
    const reach = (values) => (values.length ? `${gk.number(values[0])} to ${gk.number(values.at(-1))}` : "none");
    this.canvas.setAttribute("aria-label", `${arms[0].length} futures from turn ${document.branch.turn} as it was end at ${reach(ends[0])}, as changed at ${reach(ends[1])}; recorded: ${gk.number(recorded.at(-1)?.[1] ?? 0)}`);
  }
};
