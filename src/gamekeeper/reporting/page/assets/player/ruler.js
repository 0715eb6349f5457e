// The ruler above the lanes: turns, and the marks that one may jump to, each kind with a sign of its own.

const HEIGHT = 30;
const APART = 64; // pixels between numbers

gk.MARKS = {
  since: "★",
  divergence: "◆",
  failure: "▲",
  pivot: "▼",
  error: "✕",
  label: "●",
  change: "✚",
  ending: "■",
  penalty: "▽",
};

gk.markSign = (mark) => gk.own(gk.MARKS, mark.kind) ?? "•";

// Tells whether a mark is grey and comes after the others, as 1 or 0: endings, and first differences that the likely cause was not found by.
gk.quietOf = (marks) => {
  const quiet = ["ending", "penalty", ...(marks.some(({ kind }) => kind === "since") ? ["divergence"] : [])];
  return ({ kind }) => Number(quiet.includes(kind));
};

// 1, 2, 5, 10, 20, …: the least of these that keeps numbers apart.
const stride = (perTurn) => {
  const least = APART / perTurn;
  const power = 10 ** Math.floor(Math.log10(Math.max(1, least)));
  return [1, 2, 5, 10].map((n) => n * power).find((n) => n >= least) ?? 10 * power;
};

// `at(turn)`: its place in pixels, where that isn't the middle of its part of the width.
gk.drawRuler = (canvas, last, marks, { first, perTurn, width, at = (turn) => (turn - first + 0.5) * perTurn }) => {
  const colours = gk.colours();
  const ink = gk.sized(canvas, width, HEIGHT);
  ink.clearRect(0, 0, width, HEIGHT);
  ink.font = `11px ${colours.font}`;
  ink.textBaseline = "alphabetic";
  const each = stride(perTurn);
  const past = Math.min(last + 1, first + Math.ceil(width / perTurn));
  for (let turn = Math.ceil(first / each) * each; turn < past; turn += each) {
    const x = at(turn);
    ink.fillStyle = colours.line;
    ink.fillRect(x - 0.5, HEIGHT - 4, 1, 4);
    ink.fillStyle = colours.grey;
    const text = String(turn);
    ink.textAlign = x < 12 ? "left" : x > width - 16 ? "right" : "center";
    ink.fillText(text, Math.max(0, Math.min(width, x)), HEIGHT - 6);
  }
  const taken = []; // where marks crowd, the one that matters most is enough
  ink.textAlign = "center";
  const isQuiet = gk.quietOf(marks);
  for (const mark of [...marks].sort((a, b) => isQuiet(a) - isQuiet(b))) {
    if (mark.turn < first || mark.turn >= past) continue;
    const x = Math.max(5, Math.min(width - 5, at(mark.turn)));
    if (taken.some((other) => Math.abs(x - other) < 4)) continue;
    taken.push(x);
    ink.fillStyle = isQuiet(mark) ? colours.grey : colours.mark;
    ink.fillText(gk.markSign(mark), x, 11);
  }
};
