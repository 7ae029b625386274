"use strict";
// The cards of runs, and the table of what is being played.

function duration(seconds) {
  if (seconds < 90) return `${number(seconds, seconds < 1 ? 2 : seconds < 10 ? 1 : 0)} s`;
  return seconds < 5400 ? `${number(seconds / 60, 0)} min` : `${number(seconds / 3600, 1)} h`;
}

// A time in seconds since the epoch as day and minute, UTC.
function moment(seconds) {
  return new Date(1000 * seconds).toISOString().slice(0, 16).replace("T", " ");
}

function playersOf(run) {
  return run.players.length > 3 ? plural(run.players.length, "player") : run.players.join(", ");
}

function gamesOf(run) {
  return run.games.length > 2 ? plural(run.games.length, "game") : run.games.join(", ");
}

// What cards can be grouped by; a folder whose data cannot be read has no facts.
const CARDS_BY = {
  folder: (run) => run.name.split("/").slice(0, -1).join("/") || "top folder",
  day: (run) => (run.written_at ? moment(run.written_at).slice(0, 10) : "no date"),
  player: (run) => (run.error ? "" : playersOf(run)) || "unknown",
  game: (run) => (run.error ? "" : gamesOf(run)) || "unknown",
};

function bar(run) {
  const share = (count) => (100 * count) / Math.max(1, run.planned);
  const done = shape("rect", { class: "done", width: share(run.finished), height: 8 });
  const busy = shape("rect", { class: "busy", x: share(run.finished), width: share(run.running), height: 8 });
  const made = picture(100, 8, `${run.finished} of ${run.planned} finished`, shape("rect", { class: "trough", width: 100, height: 8 }), done, busy);
  made.setAttribute("preserveAspectRatio", "none");
  made.setAttribute("class", "bar");
  return made;
}

function words(run) {
  if (run.error) return [run.error];
  const counts = [`${number(run.finished)} of ${number(run.planned)} finished`];
  if (run.running) counts.push(`${number(run.running)} being played`);
  if (run.paused) counts.push(`${number(run.paused)} paused`);
  if (run.failed) counts.push(plural(run.failed, "failed attempt"));
  const spent = [`${number(run.tokens)} tokens`, run.cost === null ? "cost unknown" : run.cost ? `$${number(run.cost)}` : null];
  if (run.seconds_left !== null && run.finished < run.planned) spent.push(`about ${duration(run.seconds_left)} left`);
  if (run.score !== null && run.score !== undefined) spent.push(`mean score ${number(run.score)}`);
  const date = run.written_at ? `${moment(run.written_at)} UTC` : null;
  const played = run.seconds ? `${duration(run.seconds)} of play` : null;
  return [counts.join(", "), spent.filter(Boolean).join(", "), [playersOf(run), gamesOf(run)].filter(Boolean).join(" · "), [date, played].filter(Boolean).join(", ")].filter(Boolean);
}

// A card stays the same element as long as its run is there, so that it keeps the focus.
function card(run) {
  if (!site.cards.has(run.name)) {
    const made = element("button", { type: "button", class: "run", onclick: () => choose(run.name) });
    site.cards.set(run.name, { made, text: "" });
  }
  const kept = site.cards.get(run.name);
  const { made } = kept;
  const text = JSON.stringify(run);
  if (kept.text !== text) {
    kept.text = text;
    made.classList.toggle("bad", Boolean(run.error));
    const lines = words(run).map((line) => element("span", { class: "small" }, line));
    made.replaceChildren(element("b", {}, run.name), ...(run.error ? [] : [bar(run)]), ...lines);
  }
  made.setAttribute("aria-pressed", String(run.name === site.run));
  return made;
}

// The cards, or groups of them in the order of their newest run, each below its name.
function grouped() {
  const groupOf = CARDS_BY[$("cards-by").value];
  if (!groupOf) return site.runs.map(card);
  const groups = Map.groupBy(site.runs, groupOf);
  return [...groups].flatMap(([name, runs]) => {
    if (!site.headings.has(name)) site.headings.set(name, element("h2", { class: "of-cards" }));
    const heading = site.headings.get(name);
    heading.textContent = `${name}: ${plural(runs.length, "run")}`;
    return [heading, ...runs.map(card)];
  });
}

function showRuns() {
  const cards = grouped();
  const names = new Set(site.runs.map((run) => run.name));
  for (const name of [...site.cards.keys()]) if (!names.has(name)) site.cards.delete(name);
  // Elements that are moved lose the focus, so only a list that has changed is put in again.
  if (cards.length !== $("runs").children.length || cards.some((made, at) => $("runs").children[at] !== made)) {
    const focused = document.activeElement;
    $("runs").replaceChildren(...cards);
    if (cards.includes(focused)) focused.focus();
  }
  $("none").hidden = site.runs.length > 0;
  $("by").hidden = site.runs.length < 2;
  showPlaying();
}

function showPlaying() {
  const playing = site.runs.flatMap((run) => (run.playing ?? []).map((one) => ({ ...one, run: run.name })));
  $("now").hidden = !playing.length;
  const rows = playing.slice(0, 100).map((one) => {
    const href = `/episode/${encoded(`${one.run}/${one.record}`)}`;
    const known = document.querySelector(`#playing a[href="${CSS.escape(href)}"]`);
    const link = known ?? element("a", { href });
    link.textContent = `${one.game || one.key}, ${one.player}${one.seed === null ? "" : `, seed ${one.seed}`}`;
    const cells = [one.steps, one.calls, number(one.tokens), `${one.silent} s`];
    const row = known?.closest("tr") ?? element("tr", {}, element("td", {}, link));
    while (row.children.length > 1) row.lastChild.remove();
    row.append(...cells.map((cell) => element("td", { class: "number" }, String(cell))));
    return row;
  });
  const body = $("playing");
  if (rows.length !== body.children.length || rows.some((row, at) => body.children[at] !== row)) body.replaceChildren(...rows);
}
