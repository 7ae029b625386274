"use strict";
// The context band: which turns the model could see at a moment, which were dropped or marked, how full the budget was.

// What a prompt showed of everything before it: a state for each unit, which is a turn or, in the paper's protocol,
// an observation.
function visibility(episode, number) {
  const view = episode.turns[number].view;
  if (!view) return null;
  if (view.states) return { unit: "unit", states: view.states, marked: [] };
  if (episode.protocol === "paper") {
    const states = Array.from({ length: view.step }, (_, step) => (step < view.first ? "dropped" : "seen"));
    return { unit: "observation", states, marked: [] };
  }
  const states = Array(number).fill("dropped");
  for (const [first, last] of view.turns) states.fill("seen", first, last + 1);
  const marked = markedResults(episode, view);
  for (const [turn] of marked) states[turn] = "marked";
  if (isPinned(view)) states[pinnedIn(view)] = pinOf(view);
  return { unit: "turn", states, marked };
}

// The turn that a strategy had pinned in a prompt, if there was one: that with the notes, or another strategy's.
const pinnedIn = (view) => view.notes ?? view.pinned;
const isPinned = (view) => Number.isInteger(pinnedIn(view));
const pinOf = (view) => (Number.isInteger(view.notes) ? "notes" : "pinned");

// Neighbours of one state as [state, first, last].
function runs(states) {
  const spans = [];
  states.forEach((state, at) => {
    if (spans.length && spans.at(-1)[0] === state) spans.at(-1)[2] = at;
    else spans.push([state, at, at]);
  });
  return spans;
}

function inWords(states, state, unit) {
  const ranges = runs(states).filter((run) => run[0] === state);
  const count = ranges.reduce((sum, [, first, last]) => sum + last - first + 1, 0);
  if (!count) return null;
  return `${unit}${count === 1 ? "" : "s"} ${ranges.map(([, first, last]) => range(first, last)).join(", ")}`;
}

function sentence(episode, number) {
  if (isThread(episode)) return threadSentence(episode, episode.turns[number].view);
  const { unit, states, marked: results } = visibility(episode, number);
  const view = episode.turns[number].view;
  const kinds = ["seen", "marked", "notes", "pinned", "dropped"];
  const [seen, marked, notes, pinned, dropped] = kinds.map((state) => inWords(states, state, unit));
  const parts = [seen ? `The prompt showed ${seen} in full` : `The prompt showed no earlier ${unit} in full`];
  const count = results.filter(([turn]) => turn !== pinnedIn(view)).length;
  if (marked) parts.push(`${marked} with ${plural(count, "observation")} replaced by a marker`);
  if (notes) parts.push(`${notes} for the notes in it`);
  if (pinned) parts.push(`${pinned}, pinned by a strategy, with every observation masked`);
  if (dropped) parts.push(`${summaryIn(episode, view) ? "a summary in place of" : "nothing of"} ${dropped}`);
  const own = view.messages?.filter((piece) => !Array.isArray(piece)).length;
  if (own) parts.push(`${plural(own, "message")} of the compactor's own`);
  if (episode.pictures) parts.push(`${plural(picturesIn(episode, view), "picture")} in all`);
  if (view.pictures) parts.push(`${plural(view.pictures, "older picture")} left out`);
  const reach = `The view reached back ${plural(view.shown_steps, "observation")}, the current one included`;
  return `${parts.join("; ")}. ${reach}; ${episode.limits.history}.`;
}

// How full the prompt was: what stood unchanged since the prompt before, what was new, what was left free.
function gauge(episode, number) {
  const view = episode.turns[number].view;
  const cap = view.states ? view.cap : episode.budget.prompt_tokens;
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

// The band: a cell for each turn so far, as wide as its tokens. A long past that was dropped is one cell, so that what
// was seen has room. A click on a turn asks about it.
function band(box, episode, number, ask) {
  const { unit, states } = visibility(episode, number);
  const width = Math.max(320, box.clientWidth);
  const narrow = Math.min(1, width / 640);
  const dropped = states.findIndex((state) => state !== "dropped");
  const past = dropped > LONG_PAST ? dropped - Math.floor(LONG_PAST / 3) : 0;
  const view = episode.turns[number].view;
  const summary = summaryIn(episode, view);
  const [head, brief, gone, reply] = [BAND.head, BAND.summary, BAND.past, BAND.reply].map((size) => Math.max(46, size * narrow));
  const before = head + (summary ? brief : 0);
  const left = before + (past ? gone : 0);
  const place = places(episode, states, past, left, width - left - reply);
  const manual = hasManual(episode, number);
  const under = { class: "tick", "text-anchor": "middle" };
  const drawn = picture(
    width,
    BAND.height,
    sentence(episode, number),
    block("head", 0, head - 6, manual ? "head + manual" : "head"),
    summary ? block("summary", head, brief - 6, "summary") : null,
    past ? block("dropped", before, gone - 6, `${unit}s ${range(0, past - 1)}`) : null,
    states.length ? null : label(before + 8, 22, "nothing has been said yet", { class: "tick" }),
    cells(states, past, place, unit),
    block("reply", width - reply + 6, reply - 7, "reply"),
    numbers(past, states.length, place).map((at) => label((place(at) + place(at + 1)) / 2, 43, at, under)),
  );
  if (unit !== "observation") {
    drawn.classList.add("clickable");
    drawn.addEventListener("click", (event) => {
      const x = ((event.clientX - drawn.getBoundingClientRect().left) * width) / drawn.clientWidth;
      const at = states.findIndex((_, turn) => turn >= past && x < place(turn + 1));
      if (x >= left && at !== -1) ask(at);
      else if (past && x >= before && x < left) ask(past - 1);
    });
  }
  box.replaceChildren(drawn);
}

// Where each cell begins: they share the width as they share the tokens, or evenly where those are not known.
function places(episode, states, past, left, width) {
  const size = (state, at) => episode.turns[at].size?.[["marked", "notes", "pinned"].includes(state) ? 1 : 0] ?? 1;
  const isCounted = episode.departures !== null;
  const ends = [0];
  states.forEach((state, at) => ends.push(ends[at] + (at < past ? 0 : isCounted ? size(state, at) : 1)));
  return (at) => left + (ends[at] / Math.max(1, ends.at(-1))) * width;
}

const LETTER = 7.2;

// A block with words in it, if they fit; a pointer that rests on it says them anyway.
function block(kind, x, width, words) {
  const middle = { class: `inside ${kind}`, "text-anchor": "middle" };
  const rect = { class: `block ${kind}`, x, y: 4, width, height: 26, rx: 3 };
  return [
    shape("rect", rect, shape("title", {}, words)),
    words.length * LETTER < width ? label(x + width / 2, 21, words, middle) : null,
  ];
}

// Cells of their own where they are wide enough to be told apart, else one for each run of equal neighbours.
function cells(states, from, place, unit) {
  const each = (place(states.length) - place(from)) / Math.max(1, states.length - from);
  const gap = each > 6 ? 1.5 : 0;
  const shownStates = states.slice(from);
  const pieces = gap ? shownStates.map((state, at) => [state, at, at]) : runs(shownStates);
  return pieces.map(([state, first, last]) => {
    const x = place(from + first);
    const width = Math.max(0.5, place(from + last + 1) - x - gap);
    const title = shape("title", {}, `${unit} ${range(from + first, from + last)}: ${state}`);
    return shape("rect", { class: `cell ${state}`, x, y: 4, width, height: 26, rx: gap }, title);
  });
}

// The turns whose numbers stand under the band: as many as there is room for, at round distances.
function numbers(from, to, place) {
  const each = (place(to) - place(from)) / Math.max(1, to - from);
  const every = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000].find((step) => step * each > BAND.label) ?? 5000;
  let end = -Infinity;
  return Array.from({ length: to - from }, (_, at) => from + at).filter((at) => {
    const middle = (place(at) + place(at + 1)) / 2;
    if (at % every || middle - end < BAND.label * 0.7) return false;
    end = middle;
    return true;
  });
}

// Whether the manual stood in the head of a prompt.
function hasManual(episode, number) {
  if (episode.protocol === "paper") return episode.head.length > 1;
  return episode.manual === "pinned" || (number > 0 && episode.facts[number - 1].manual !== null);
}

// Forgetting at a glance: a column for each prompt, in it every earlier turn by how many turns ago it was, the latest at
// the bottom, filled where that turn was seen. The scale is logarithmic, so that a window keeps its height however long
// the episode is. The picture is painted once for a width and a theme; what moves is the line over it.
function windowMap(canvas, episode, turn) {
  const [width, height, sharp] = [Math.max(320, canvas.parentElement.clientWidth), 150, window.devicePixelRatio || 1];
  const style = getComputedStyle(canvas);
  const colours = ["dropped", "seen", "cut", "marked", "notes", "summary", "soft"];
  const paints = Object.fromEntries(colours.map((name) => [name, style.getPropertyValue(`--${name}`)]));
  const x = turnScale(width, episode.turns.length);
  const made = [width, sharp, ...Object.values(paints)].join();
  if (episode.map?.made !== made) {
    episode.map = { made, canvas: element("canvas", { width: width * sharp, height: height * sharp }) };
    paintMap(episode, episode.map.canvas.getContext("2d"), x, height, sharp, paints);
  }
  [canvas.width, canvas.height] = [width * sharp, height * sharp];
  const pen = canvas.getContext("2d");
  pen.drawImage(episode.map.canvas, 0, 0);
  pen.fillStyle = style.getPropertyValue("--ink");
  pen.fillRect((x.middle(turn) - 0.75) * sharp, 0, 1.5 * sharp, height * sharp);
  const unit = isThread(episode) ? "unit" : episode.protocol === "paper" ? "observation" : "turn";
  const name = `What each prompt could see: a column for each prompt; upwards, how many ${unit}s ago`;
  canvas.setAttribute("aria-label", `${name}. ${episode.turns[turn]?.view ? sentence(episode, turn) : ""}`);
  return x;
}

function paintMap(episode, pen, x, height, sharp, paints) {
  const [top, bottom] = [8, height - 4];
  const paper = episode.protocol === "paper";
  const count = isThread(episode) ? episode.turns.at(-1).view.states.length : episode.turns.length;
  const most = Math.max(2, paper ? episode.observations.length : count);
  const y = (age) => bottom - (Math.log(age) / Math.log(most)) * (bottom - top);
  // Whole pixels, so that neighbours neither overlap nor leave a seam.
  const box = (at, youngest, oldest) => {
    const [left, right] = [x.start(at), x.start(at + 1)].map((edge) => Math.round(edge * sharp));
    const [high, low] = [oldest + 1, youngest].map((age) => Math.round(y(Math.min(age, most)) * sharp));
    const gap = x.each > 8 ? Math.round(sharp) : 0;
    pen.fillRect(left, high, Math.max(right - left - gap, 1), Math.max(low - high, 1));
  };
  let summaries = 0;
  episode.turns.forEach(({ view }, at) => {
    if (!view) return;
    const now = paper ? view.step + 1 : (view.states?.length ?? at);
    const fill = (kind, first, last) => {
      pen.fillStyle = paints[kind];
      box(at, now - last, now - first);
    };
    if (view.states) return runs(view.states).forEach((run) => fill(...run));
    if (now > (paper ? 1 : 0)) fill("dropped", 0, now - 1);
    for (const [first, last] of paper ? [[view.first, view.step]] : view.turns) fill("seen", first, last);
    for (const [turn] of paper ? [] : markedResults(episode, view)) fill("marked", turn, turn);
    if (isPinned(view)) fill("notes", pinnedIn(view), pinnedIn(view));
    if ((view.summary ?? 0) > summaries) {
      pen.fillStyle = paints.summary;
      pen.fillRect(Math.round(x.start(at) * sharp), 0, Math.max(2, x.each) * sharp, 5 * sharp);
    }
    summaries = view.summary ?? 0;
  });
  pen.fillStyle = paints.soft;
  pen.font = `${11 * sharp}px system-ui, sans-serif`;
  pen.textAlign = "right";
  for (let age = 1; age <= most; age *= 10) pen.fillText(number(age), (EDGE.left - 8) * sharp, (y(age) + 1) * sharp);
}
