// The keyboard: only while something of the player has the focus, and never a key that the focused element needs itself.

const typing = (element) => element.matches("input:not([type=range]):not([type=checkbox]), select, textarea, [contenteditable]");

gk.listenToKeys = (player) => {
  const step = (by) => () => player.to(player.turn + by);
  const works = {
    ArrowLeft: step(-1),
    ArrowRight: step(1),
    "Shift+ArrowLeft": step(-10),
    "Shift+ArrowRight": step(10),
    PageUp: step(10),
    PageDown: step(-10),
    Home: () => player.to(0),
    End: () => player.to(player.last),
    " ": () => player.toggle(),
    "+": () => player.faster(1),
    "=": () => player.faster(1),
    "-": () => player.faster(-1),
    "[": () => player.toMark(-1),
    "]": () => player.toMark(1),
    r: () => player.mark(player.anchor === null ? player.turn : null),
  };
  const scrolls = (element) => element.matches(".lanes-scroll, .scroll, pre");
  player.host.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || typing(event.target)) return;
    const arrows = event.key.startsWith("Arrow");
    const name = event.shiftKey && arrows ? `Shift+${event.key}` : event.key;
    const work = works[name];
    if (!work) return;
    if (event.key === " " && event.target.matches("button, summary, input[type=checkbox]")) return;
    if (event.key.startsWith("Page") && !event.target.matches("input[type=range]")) return;
    if (scrolls(event.target) && event.target.matches(".scroll, pre") && (arrows || event.key === "Home" || event.key === "End")) return;
    event.preventDefault();
    work();
  });
};

const HELP = "← → a turn · Shift with them ten · Home, End · Space plays · + − speed · [ ] marks · R begins and ends a range. Clicking or dragging on the lanes selects a turn, too, dragging along the turns above them a range.";

// What the keys do, folded.
gk.keysHelp = () => gk.node("details", { class: "keys" }, gk.node("summary", { text: "Keys" }), gk.node("p", { class: "note", text: HELP }));
