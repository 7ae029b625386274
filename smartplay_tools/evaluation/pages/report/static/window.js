"use strict";
// The context band: which turns the model could see at a moment, which were dropped or marked, how full the budget was.

// What a prompt showed of everything before it: a state for each unit, which is a turn or, in the paper's protocol,
// an observation.
function visibility(episode, number) {
  const view = episode.turns[number].view;
  if (!view) return null;
  if (episode.protocol === "paper") {
    const states = Array.from({ length: view.step }, (_, step) => (step < view.first ? "dropped" : "seen"));
    return { unit: "observation", states, marked: [] };
  }
  const states = Array(number).fill("dropped");
  for (const [first, last] of view.turns) states.fill("seen", first, last + 1);
  const marked = markedResults(episode, view);
  for (const [turn] of marked) states[turn] = "marked";
  if (Number.isInteger(view.notes)) states[view.notes] = "notes";
  return { unit: "turn", states, marked };
}

// Neighbours of one state as [state, first, last].
function runs(states) {
  const found = [];
  states.forEach((state, at) => {
    if (found.length && found.at(-1)[0] === state) found.at(-1)[2] = at;
    else found.push([state, at, at]);
  });
  return found;
}

function inWords(states, state, unit) {
  const ranges = runs(states).filter((run) => run[0] === state);
  const count = ranges.reduce((sum, [, first, last]) => sum + last - first + 1, 0);
  if (!count) return null;
  return `${unit}${count === 1 ? "" : "s"} ${ranges.map(([, first, last]) => range(first, last)).join(", ")}`;
}

function sentence(episode, number) {
  const { unit, states, marked: results } = visibility(episode, number);
  const view = episode.turns[number].view;
  const kinds = ["seen", "marked", "notes", "dropped"];
  const [seen, marked, notes, dropped] = kinds.map((state) => inWords(states, state, unit));
  const parts = [seen ? `The model saw ${seen} in full` : `The model saw no earlier ${unit} in full`];
  const count = results.filter(([turn]) => turn !== view.notes).length;
  if (marked) parts.push(`${marked} with ${plural(count, "observation")} replaced by a marker`);
  if (notes) parts.push(`${notes} for the notes in it`);
  if (dropped) parts.push(`${summaryIn(episode, view) ? "a summary in place of" : "nothing of"} ${dropped}`);
  const reach = `The view reached back ${plural(view.shown_steps, "observation")}, the current one included`;
  return `${parts.join("; ")}. ${reach}; ${episode.limits.history}.`;
}

// How full the prompt was: what stood unchanged since the prompt before, what was new, what was left free.
function gauge(episode, number) {
  const view = episode.turns[number].view;
  const cap = episode.budget.prompt_tokens;
  const [most, tokens] = [cap ?? episode.mostTokens, (count) => count.toLocaleString("en")];
  const full =
    cap === null
      ? `${tokens(view.tokens)} tokens; no cap`
      : `${tokens(view.tokens)} of ${tokens(cap)} tokens, ${percent(view.tokens / cap)} full`;
  const parts = [
    ["stable", view.prefix_tokens, "unchanged since the prompt before"],
    ["new", view.tokens - view.prefix_tokens, "new"],
    ["free", most - view.tokens, cap === null ? "below the largest prompt" : "free"],
  ];
  const bar = element("div", { class: "gauge", role: "img", "aria-label": full });
  for (const [kind, count] of parts) {
    const part = element("div", { class: `part ${kind}` });
    part.style.flexGrow = count;
    bar.append(part);
  }
  const legend = parts.map(([kind, count, meaning]) =>
    element("li", {}, element("span", { class: `swatch ${kind}` }), `${tokens(count)} ${meaning}`),
  );
  return [bar, element("ul", { class: "legend" }, element("li", { class: "full" }, full), legend)];
}

const BAND = { height: 46, head: 104, summary: 84, past: 132, reply: 64, label: 30 };
const LONG_PAST = 30;

// The band: a cell for each turn so far. A long past that was dropped is one cell, so that what was seen has room.
function band(box, episode, number, go) {
  const { unit, states } = visibility(episode, number);
  const width = Math.max(320, box.clientWidth);
  const dropped = states.findIndex((state) => state !== "dropped");
  const past = dropped > LONG_PAST ? dropped - Math.floor(LONG_PAST / 3) : 0;
  const view = episode.turns[number].view;
  const summary = summaryIn(episode, view);
  const told = BAND.head + (summary ? BAND.summary : 0);
  const left = told + (past ? BAND.past : 0);
  const each = (width - left - BAND.reply) / Math.max(1, states.length - past);
  const place = (at) => left + (at - past) * each;
  const manual = hasManual(episode, number);
  const under = { class: "tick", "text-anchor": "middle" };
  const drawn = picture(
    width,
    BAND.height,
    sentence(episode, number),
    block("head", 0, BAND.head - 6, manual ? "head + manual" : "head"),
    summary ? block("summary", BAND.head, BAND.summary - 6, "summary") : null,
    past ? block("dropped", told, BAND.past - 6, `${unit}s ${range(0, past - 1)}`) : null,
    states.length ? null : label(told + 8, 22, "nothing has been said yet", { class: "tick" }),
    cells(states.slice(past), past, place, each, unit),
    block("reply", width - BAND.reply + 6, BAND.reply - 6, "reply"),
    numbers(past, states.length, each).map((at) => label(place(at) + each / 2, 43, at, under)),
  );
  if (unit === "turn") {
    drawn.classList.add("clickable");
    drawn.addEventListener("click", (event) => {
      const x = ((event.clientX - drawn.getBoundingClientRect().left) * width) / drawn.clientWidth;
      const at = past + Math.floor((x - left) / each);
      if (at >= past && at < states.length) go(at);
    });
  }
  box.replaceChildren(drawn);
}

function block(kind, x, width, words) {
  const middle = { class: `inside ${kind}`, "text-anchor": "middle" };
  return [
    shape("rect", { class: `block ${kind}`, x, y: 4, width, height: 26, rx: 3 }),
    label(x + width / 2, 21, words, middle),
  ];
}

// Cells of their own where they are wide enough to be told apart, else one for each run of equal neighbours.
function cells(states, from, place, each, unit) {
  const gap = each > 6 ? 1.5 : 0;
  const pieces = gap ? states.map((state, at) => [state, at, at]) : runs(states);
  return pieces.map(([state, first, last]) => {
    const width = Math.max(0.5, (last - first + 1) * each - gap);
    const title = shape("title", {}, `${unit} ${range(from + first, from + last)}: ${state}`);
    return shape("rect", { class: `cell ${state}`, x: place(from + first), y: 4, width, height: 26, rx: gap }, title);
  });
}

// The turns whose numbers stand under the band: as many as there is room for, at round distances.
function numbers(from, to, each) {
  const every = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000].find((step) => step * each > BAND.label) ?? 5000;
  return Array.from({ length: to - from }, (_, at) => from + at).filter((at) => at % every === 0);
}

// Whether the manual stood in the head of a prompt.
function hasManual(episode, number) {
  if (episode.protocol === "paper") return episode.head.length > 1;
  return episode.manual === "pinned" || (number > 0 && episode.facts[number - 1].manual !== null);
}

// The whole episode at a glance: a column for each prompt, a row for each turn, filled where that turn was seen.
// The picture is painted once for a width and a theme; what moves is the line over it.
function windowMap(canvas, episode, turn) {
  const [width, height, sharp] = [Math.max(320, canvas.parentElement.clientWidth), 150, window.devicePixelRatio || 1];
  const style = getComputedStyle(canvas);
  const paints = ["dropped", "seen", "marked", "notes"].map((name) => style.getPropertyValue(`--${name}`));
  const x = turnScale(width, episode.turns.length);
  const made = [width, sharp, ...paints].join();
  if (episode.map?.made !== made) {
    episode.map = { made, canvas: element("canvas", { width: width * sharp, height: height * sharp }) };
    paintMap(episode, episode.map.canvas.getContext("2d"), x, height, sharp, paints);
  }
  [canvas.width, canvas.height] = [width * sharp, height * sharp];
  const pen = canvas.getContext("2d");
  pen.drawImage(episode.map.canvas, 0, 0);
  pen.fillStyle = style.getPropertyValue("--ink");
  pen.fillRect((x.middle(turn) - 0.75) * sharp, 0, 1.5 * sharp, height * sharp);
  const unit = episode.protocol === "paper" ? "observation" : "turn";
  const name = `What each prompt could see: a column for each prompt, a row for each earlier ${unit}`;
  canvas.setAttribute("aria-label", `${name}. ${episode.turns[turn]?.view ? sentence(episode, turn) : ""}`);
  return x;
}

function paintMap(episode, pen, x, height, sharp, [dropped, seen, marked, notes]) {
  const [top, bottom] = [4, height - 4];
  const paper = episode.protocol === "paper";
  const each = (bottom - top) / Math.max(1, paper ? episode.observations.length : episode.turns.length);
  // Whole pixels, so that neighbours neither overlap nor leave a seam.
  const box = (at, first, last) => {
    const [left, right] = [x.start(at), x.start(at + 1)].map((edge) => Math.round(edge * sharp));
    const [high, low] = [last + 1, first].map((unit) => Math.round((bottom - unit * each) * sharp));
    const gap = x.each > 8 ? Math.round(sharp) : 0;
    pen.fillRect(left, high, Math.max(right - left - gap, 1), Math.max(low - high, 1));
  };
  episode.turns.forEach(({ view }, at) => {
    if (!view) return;
    const units = paper ? view.step : at;
    pen.fillStyle = dropped;
    if (units) box(at, 0, units - 1);
    pen.fillStyle = seen;
    for (const [first, last] of paper ? [[view.first, view.step]] : view.turns) box(at, first, last);
    pen.fillStyle = marked;
    for (const [turn] of paper ? [] : markedResults(episode, view)) box(at, turn, turn);
    pen.fillStyle = notes;
    if (Number.isInteger(view.notes)) box(at, view.notes, view.notes);
  });
}
