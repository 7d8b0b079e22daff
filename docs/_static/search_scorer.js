// Guides before names of code: the reference comes after all guides, and what is for developers after the others.
var Scorer = {
  score: ([docname, , , , score]) => {
    if (docname.startsWith("api/")) return score - 1000;
    return ["changelog", "contributing"].includes(docname) ? score - 100 : score;
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
