// How the search ranks what it found: Sphinx's own figures, and first of all pages whose title is what was asked for.
var Scorer = {
  score: ([, title, anchor, , score, , kind]) => {
    const asked = (new URLSearchParams(location.search).get("q") ?? "").trim().toLowerCase();
    const isPage = anchor === "" && kind !== "object" && kind !== "index";
    return isPage && asked && title.toLowerCase().includes(asked) ? score + 100 : score;
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
