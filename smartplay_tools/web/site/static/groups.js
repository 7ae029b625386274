"use strict";
// The lines of the list: its episodes, or groups of them, each below a line with the means of the finished ones.

const GROUPS = ["game", "player", "budget", "seed", "status", "end"];

// The columns whose means a group shows; all come after those with words.
const MEANS = ["score", "normalized", "steps", "tokens", "cost", "mistakes", "cut", "time"];

function linesOf(episodes, by, closed) {
  if (!GROUPS.includes(by)) return episodes;
  const groups = new Map();
  for (const one of episodes) {
    const name = String(value(one, by) ?? "–");
    if (!groups.has(name)) groups.set(name, []);
    groups.get(name).push(one);
  }
  return [...groups].flatMap(([name, members]) => [{ group: name, members }, ...(closed.has(name) ? [] : members)]);
}

function meanOf(members, name) {
  const values = members.map((one) => value(one, name)).filter((what) => typeof what === "number");
  return values.length ? values.reduce((sum, what) => sum + what, 0) / values.length : null;
}

function groupCells({ group, members }, by, columns, isClosed) {
  const words = columns.findIndex((name) => MEANS.includes(name));
  const title = `${isClosed ? "▸" : "▾"} ${typeset(group) || "usual"}: ${plural(members.length, "episode")}, means`;
  const finished = members.filter((one) => value(one, "status") === "finished");
  const means = columns.slice(words).map((name) => {
    const mean = MEANS.includes(name) ? meanOf(finished, name === "score" ? "counted" : name) : null;
    return element("span", { role: "gridcell", class: "number", title: `mean ${name} of ${plural(finished.length, "finished episode")}` }, mean === null ? "" : figureOf(name, name === "tokens" ? Math.round(mean) : mean));
  });
  return [element("span", { role: "gridcell", class: `words span${words}`, "aria-colspan": words, title: by }, title), ...means];
}
