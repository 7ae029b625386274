"use strict";
// Where the tokens went: every prompt stacked by its parts, and what all prompts took together.

// The parts of all prompts of an episode together, requests for summaries included; null where they are not known.
function partsInAll(episode) {
  const prompts = episode.turns.flatMap(({ view, request }) => [request, view]).filter(Boolean);
  if (!prompts.length || prompts.some(({ parts }) => !parts)) return null;
  return page.parts.map((_, at) => prompts.reduce((sum, { parts }) => sum + parts[at], 0));
}

// One bar of parts, with a sentence for screen readers.
function partsBar(parts, name) {
  const total = parts.reduce((sum, count) => sum + count, 0);
  const words = page.parts.flatMap((part, at) => (parts[at] ? [`${page.partWords[part]} ${percent(parts[at] / total)}`] : []));
  const bar = element("div", { class: "gauge", role: "img", "aria-label": `${name}: ${words.join(", ")}` });
  page.parts.forEach((part, at) => {
    const piece = element("div", { class: `part of-${part}`, title: `${page.partWords[part]}: ${number(parts[at])}` });
    piece.style.flexGrow = parts[at];
    bar.append(piece);
  });
  return bar;
}

// The same as a table: this prompt, and all of them.
function partsTable(episode, turn) {
  const [now, all] = [episode.turns[turn].view?.parts ?? [], partsInAll(episode)];
  const total = all.reduce((sum, count) => sum + count, 0);
  const heading = (words) => element("th", { scope: "col", class: "number" }, words);
  const rows = page.parts.flatMap((part, at) =>
    all[at]
      ? [
          element(
            "tr",
            {},
            element("th", { scope: "row" }, element("span", { class: `swatch of-${part}` }), page.partWords[part]),
            ...[number(now[at]), number(all[at]), percent(all[at] / total)].map((cell) => element("td", { class: "number" }, cell)),
          ),
        ]
      : [],
  );
  const head = element("tr", {}, element("th", { scope: "col" }, "part"), ["this prompt", "all prompts", "share"].map(heading));
  return element("table", { class: "parts" }, element("thead", {}, head), element("tbody", {}, rows));
}

// Many prompts on few pixels: of each group the largest stands for all.
function columns(views, most = 600) {
  const size = Math.ceil(views.length / most);
  const groups = [];
  for (let at = 0; at < views.length; at += size) {
    const group = views.slice(at, at + size).filter(Boolean);
    const largest = group.reduce((one, other) => (other.tokens > (one?.tokens ?? -1) ? other : one), null);
    groups.push({ from: at, to: Math.min(at + size, views.length), parts: largest?.parts ?? page.parts.map(() => 0) });
  }
  return groups;
}

// Every prompt as a column of its parts, with the cap as a line.
function stack(box, episode, turn) {
  const [width, height] = [Math.max(320, box.clientWidth), 190];
  const cap = episode.budget.prompt_tokens;
  const x = turnScale(width, episode.turns.length);
  const reported = extent([0, ...episode.turns.map(({ view }) => view?.reported ?? 0)])[1];
  const marks = ticks(0, Math.max(episode.mostTokens, reported, cap ?? 0));
  const y = heightScale(marks, height);
  const drawn = columns(episode.turns.map(({ view }) => view));
  const below = drawn.map(() => 0);
  const layers = page.parts.map((part, at) => {
    const top = drawn.map(({ parts }, place) => below[place] + parts[at]);
    if (top.every((value, place) => value === below[place])) return null;
    const edge = (values, order) => order.map((place) => [drawn[place], y(values[place])]);
    const there = edge(top, [...drawn.keys()]).map(([{ from, to }, high]) => `L${x.start(from)} ${high}H${x.start(to)}`);
    const back = edge(below, [...drawn.keys()].reverse()).map(([{ from, to }, low]) => `L${x.start(to)} ${low}H${x.start(from)}`);
    top.forEach((value, place) => (below[place] = value));
    return shape("path", { class: `of-${part}`, d: `M${EDGE.left} ${y(0)}${there.join("")}${back.join("")}Z` }, shape("title", {}, page.partWords[part]));
  });
  const name = `Tokens of each prompt by part; now ${number(episode.turns[turn]?.view?.tokens)}`;
  box.replaceChildren(chart([width, height], name, marks, x, turn, [layers, cap === null ? null : across("cap", width, y(cap)), reportedMarks(episode, x, y)]));
  return x;
}
