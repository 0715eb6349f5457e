// The beginning: charts, copying, links into the player, the player itself; in `gamekeeper view` also what a recording adds.

const EVERY = 3000; // milliseconds between questions while a run is still recorded

document.documentElement.classList.add("js");

const copyFrom = async (button) => {
  const source = document.getElementById(button.dataset.copy);
  if (!source) return;
  let text = "Copied";
  try {
    await navigator.clipboard.writeText(source.textContent);
  } catch {
    getSelection().selectAllChildren(source); // a file of one's own may not write the clipboard everywhere
    text = "Selected: press Ctrl+C";
  }
  const before = button.dataset.text ?? button.textContent;
  button.dataset.text = before;
  button.textContent = text;
  setTimeout(() => (button.textContent = before), 2000);
};

// `#play:RUN/EPISODE/TURN`, with a range `#play:RUN/EPISODE/TURN~FROM`, of two side by side `#play:RUN/EPISODE/TURN+RUN/EPISODE`, with a chosen agent `…@AGENT`, alone `…@AGENT!`; or null.
const placeIn = (hash) => {
  const found = /^#play:([^/+]*)\/(\d+)(?:\/(\d+)(?:~(\d+))?)?(?:\+([^/+]*)\/(\d+))?(?:@([^!]*)(!)?)?$/.exec(hash);
  if (!found) return null;
  const [, run, episode, turn, anchor, other, beside, agent, solo] = found;
  const place = (key, number) => ({ run: decodeURIComponent(key), episode: Number(number) });
  try {
    const chosen = agent ? { agent: decodeURIComponent(agent), solo: Boolean(solo) } : {};
    return { ...place(run, episode), ...chosen, turn: turn === undefined ? undefined : Number(turn), anchor: anchor === undefined ? null : Number(anchor), beside: other === undefined ? null : place(other, beside) };
  } catch {
    return null; // not an address that we wrote
  }
};

const goTo = (player, place) => {
  const entries = [place, place?.beside].filter(Boolean).map(({ run, episode }) => player.entry(run, episode));
  if (!entries.length || !entries.every((entry) => entry?.packed)) return false;
  player.open(entries, { turn: place.turn, agent: place.agent, solo: place.solo, anchor: place.anchor, focus: true });
  return true;
};

const followLinks = (player) => {
  document.addEventListener("click", (event) => {
    const button = event.target.closest?.("button[data-copy]");
    if (button) copyFrom(button);
    const link = event.target.closest?.('a[href^="#play:"]'); // also where the address is there already
    if (!link || event.ctrlKey || event.metaKey || event.shiftKey) return;
    if (goTo(player, placeIn(link.hash))) event.preventDefault();
  });
  window.addEventListener("hashchange", () => goTo(player, placeIn(location.hash)));
};

// Keeps the list true while a run is still recorded.
const keepUp = (player) => {
  let version = gk.page.version ?? "";
  const known = new Map(player.entries.map((entry) => [`${entry.run}/${entry.episode}`, entry]));
  const ask = async () => {
    const news = await gk.fetched(`index.json?since=${encodeURIComponent(version)}`);
    version = news.version;
    gk.page.runs = news.runs ?? gk.page.runs;
    gk.page.pairs = news.pairs ?? gk.page.pairs;
    for (const entry of news.episodes) known.set(`${entry.run}/${entry.episode}`, entry);
    const runs = new Set(gk.page.runs.map((run) => run.key));
    for (const [key, entry] of known) if (!runs.has(entry.run)) known.delete(key); // a future that wasn't kept
    if (news.episodes.length) player.fill([...known.values()]);
    for (const entry of news.episodes) await player.grow(entry);
    player.goOn();
    if (!player.decks.length) begin(player);
  };
  player.refresh = ask;
  const open = () => gk.page.runs.some((run) => run.status === "open");
  const again = async (always = false) => {
    try {
      if (!document.hidden && (always || open())) await ask();
      player.trouble.hidden = player.trouble.hidden || player.trouble.dataset.kind !== "index";
    } catch (error) {
      player.trouble.hidden = false;
      player.trouble.dataset.kind = "index";
      gk.say(player.trouble, gk.visible(error.message));
      if (!(error instanceof gk.Trouble)) console.error(error);
    }
  };
  const forever = async (always) => {
    await again(always);
    setTimeout(forever, EVERY, false);
  };
  document.addEventListener("visibilitychange", () => again(true));
  forever(true);
};

const begin = (player) => {
  if (goTo(player, placeIn(location.hash))) return;
  // A report's list begins with what it was asked for; that of `gamekeeper view` is by number, and begins with what was broken off.
  const packed = player.entries.filter((entry) => entry.packed);
  const first = (gk.served && packed.find((entry) => ["open", "torn", "failed"].includes(entry.end))) || packed[0];
  if (first) player.open([first]);
};

const start = () => {
  gk.drawCharts();
  const host = document.getElementById("gk-player");
  if (!host) return;
  const player = new gk.Player(host);
  gk.player = player;
  gk.listenToKeys(player);
  followLinks(player);
  player.fill(gk.page.episodes ?? []);
  begin(player);
  if (gk.served) keepUp(player);
};

// Long parts of the page that are folded on screen are open on paper.
window.addEventListener("beforeprint", () => document.querySelectorAll("details:not([open])").forEach((one) => {
  one.dataset.folded = "1";
  one.open = true;
}));
window.addEventListener("afterprint", () => document.querySelectorAll("details[data-folded]").forEach((one) => {
  one.open = false;
  delete one.dataset.folded;
}));

start();
