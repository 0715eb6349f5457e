// The world at a turn: frames where they were recorded, else a map, else cells; nothing where nothing was recorded.

const FramesDrawing = class {
  constructor(episode) {
    this.drawing = episode.drawing;
    this.root = gk.node("img", { class: "drawing-frame", alt: "", decoding: "sync" });
    this.drawn = -1;
  }

  show(turn) {
    const at = Math.max(0, gk.lastUntil(this.drawing.at, turn));
    if (at === this.drawn || !this.drawing.images[at]) return;
    this.drawn = at;
    this.root.src = this.drawing.images[at];
    this.root.alt = `Frame of turn ${this.drawing.at[at]}`;
  }
};

const TextDrawing = class {
  constructor(episode) {
    this.drawing = episode.drawing;
    this.root = gk.node("pre", { class: "drawing-text", tabindex: "0", "aria-label": "The task's own drawing, in text" });
  }

  show(turn) {
    gk.say(this.root, gk.visible(this.drawing.texts[Math.max(0, gk.lastUntil(this.drawing.at, turn))] ?? ""));
  }
};

const Nothing = class {
  constructor(episode) {
    const text = "Nothing to draw: neither frames nor observations, positions or state were recorded.";
    this.root = gk.node("p", { class: "note", text: episode.drawingNote ? "Nothing to draw." : text });
  }

  show() {}
};

const KINDS = { frames: FramesDrawing, map: gk.MapDrawing, cells: gk.CellsDrawing, text: TextDrawing };

gk.drawingOf = (episode) => {
  const Kind = gk.own(KINDS, episode.drawing?.kind) ?? Nothing;
  return new Kind(episode);
};
