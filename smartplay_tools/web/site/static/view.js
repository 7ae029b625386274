"use strict";
// The list: runs, what is being played, and the episodes of one run. Only the rows in sight are elements of the page.
// The address holds what is shown (`#run=NAME&find=crafter&only=mistakes&group=player&cards=day&sort=score&down=1`), so that it can be shared.
// When an episode is opened, the list is remembered, so that its page knows its neighbours and the way back.

const HEIGHT = 34;
const SHOWN = ["status", "game", "player", "budget", "trial", "score", "normalized", "steps", "tokens", "cost", "mistakes", "cut", "time", "end", "date", "seed"];
const NUMBERS = new Set(["trial", "seed", "score", "normalized", "steps", "tokens", "cost", "mistakes", "cut", "time", "date"]);
// The least width of each column in pixels, and its share of the room that is left.
const WIDTHS = {
  ...{ status: [86, 0], game: [236, 1.2], player: [70, 0.8], budget: [112, 2.6], seed: [104, 0], trial: [44, 0] },
  ...{ score: [64, 0], normalized: [92, 0], steps: [54, 0], tokens: [76, 0], cost: [66, 0], mistakes: [78, 0] },
  ...{ cut: [56, 0], time: [62, 0], date: [100, 0], end: [92, 0.7] },
};
// Columns that are shown only if an episode of the run has something there.
const RARE = new Set(["cost", "cut", "time", "date"]);
const LIST = "smartplay-list";

// `run` is the name of the run that is shown.
const site = { runs: [], run: null, at: {}, all: [], texts: [], listed: [], lines: [], closed: new Set(), columns: SHOWN, selected: 0, sort: null, down: false, cards: new Map(), headings: new Map() };

function value(episode, name) {
  return episode[site.at[name]];
}

function encoded(name) {
  return name.split("/").map(encodeURIComponent).join("/");
}

function address(episode) {
  const record = value(episode, "record");
  return record ? `/episode/${encoded(`${site.run}/${record}`)}` : null;
}

function shownRun() {
  return site.runs.find((run) => run.name === site.run);
}

// --- What the server tells --------------------------------------------------------------------------------------------

function listen() {
  const stream = new EventSource("/api/live");
  stream.onmessage = (event) => {
    const before = shownRun();
    site.runs = JSON.parse(event.data);
    $("live").textContent = "up to date";
    if (site.run === null && site.runs.length) return choose(site.runs[0].name);
    showRuns();
    const now = shownRun();
    const changed = ["finished", "running", "paused", "failed"].some((name) => before?.[name] !== now?.[name]);
    if (changed) load();
  };
  stream.onerror = () => ($("live").textContent = "the server does not answer");
}

// --- Episodes --------------------------------------------------------------------------------------------------------

async function load() {
  const answer = shownRun() ? await fetch(`/api/runs/${encoded(site.run)}/episodes`) : null;
  if (!answer?.ok) {
    [site.all, site.texts] = [[], []];
    list();
    $("count").textContent = (await answer?.text()) ?? absent();
    return;
  }
  const listed = await answer.json();
  site.at = Object.fromEntries(listed.columns.map((name, place) => [name, place]));
  site.all = listed.episodes;
  site.texts = site.all.map((one) => ["status", "game", "player", "budget", "end", "seed"].map((name) => value(one, name) ?? "").join(" ").toLowerCase());
  arrange();
  list();
}

// Choose the columns of the run, and lay them out.
function arrange() {
  // A phone has room for two columns, so that these are what was played and how well.
  const first = matchMedia("(max-width: 700px)").matches ? ["game", "score", "player"] : [];
  const isShown = (name) => (name === "status" ? site.all.some((one) => value(one, name) !== "finished") : !RARE.has(name) || site.all.some((one) => value(one, name)));
  const columns = [...new Set([...first, ...SHOWN])].filter((name) => name === site.sort || isShown(name));
  const widths = columns.map((name) => WIDTHS[name]);
  $("list").style.setProperty("--columns", widths.map(([least, share]) => (share ? `minmax(${least}px, ${share}fr)` : `${least}px`)).join(" "));
  $("list").style.setProperty("--wide", `${widths.reduce((sum, [least]) => sum + least, 0)}px`);
  site.columns = columns;
  heads();
}

function absent() {
  if (site.run === null) return "no run yet";
  const why = /^[0-9]+$/.test(site.run) ? " An address names a run by its folder, and no longer by its position." : "";
  return `There is no run '${site.run}' here now.${why}`;
}

function choose(name) {
  site.run = name;
  site.closed.clear();
  site.selected = 0;
  keep("pushState");
  showRuns();
  return load();
}

const ONLY = {
  "": () => true,
  mistakes: (one) => value(one, "mistakes") > 0,
  cut: (one) => value(one, "cut") > 0,
};

function list() {
  const words = $("find").value.toLowerCase().split(/\s+/).filter(Boolean);
  const only = $("only").value;
  const wanted = ONLY[only] ?? ((one) => value(one, "status") === only);
  site.listed = site.all.filter((one, place) => wanted(one) && words.every((word) => site.texts[place].includes(word)));
  if (site.sort) {
    const place = site.at[site.sort];
    const sign = site.down ? -1 : 1;
    const compare = (a, b) => (typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b)));
    // Episodes without a value come last, whichever way the list is sorted.
    site.listed.sort((a, b) => (a[place] === null) - (b[place] === null) || sign * compare(a[place], b[place]));
  }
  site.lines = linesOf(site.listed, $("group").value, site.closed);
  site.selected = between(0, site.selected, Math.max(0, site.lines.length - 1));
  $("count").textContent = plural(site.listed.length, "episode");
  $("space").style.height = `${site.lines.length * HEIGHT}px`;
  draw();
}

// Open or close a group.
function toggle({ group }) {
  if (!site.closed.delete(group)) site.closed.add(group);
  list();
}

function figureOf(name, what) {
  // A seed is a name, not a quantity.
  if (name === "seed") return String(what ?? "–");
  if (name === "time") return what === null ? "–" : duration(what);
  return number(what, name === "cost" ? 4 : 2);
}

function cell(one, name) {
  const shown = value(one, name);
  const role = { role: "gridcell" };
  if (name === "status") return element("span", { ...role, class: `status ${shown}` }, shown);
  if (name === "game") {
    const href = address(one);
    return element("span", role, href ? element("a", { href, tabindex: -1 }, shown) : shown);
  }
  if (!NUMBERS.has(name)) return element("span", { ...role, title: shown && typeset(shown) }, typeset(shown ?? ""));
  if (name === "date") return element("span", { ...role, class: "number", title: shown && `${moment(shown)} UTC` }, shown ? moment(shown).slice(5) : "–");
  const poor = (name === "mistakes" || name === "cut") && shown > 0;
  return element("span", { ...role, class: `number${poor ? " poor" : ""}` }, figureOf(name, shown));
}

// Only the rows in sight, and a few beyond, are made.
function draw() {
  const first = Math.max(0, Math.floor($("list").scrollTop / HEIGHT) - 5);
  const last = Math.min(site.lines.length, first + Math.ceil($("list").clientHeight / HEIGHT) + 10);
  const rows = [];
  for (let place = first; place < last; place += 1) {
    const one = site.lines[place];
    const isGroup = one.group !== undefined;
    const kind = isGroup ? "group" : "";
    const onclick = () => (select(place), isGroup && toggle(one));
    const attributes = { role: "row", id: `row-${place}`, class: kind, "aria-selected": String(place === site.selected), "aria-rowindex": place + 2, onclick };
    const cells = isGroup ? groupCells(one, $("group").value, site.columns, site.closed.has(one.group)) : site.columns.map((name) => cell(one, name));
    rows.push(element("div", isGroup ? { ...attributes, "aria-expanded": String(!site.closed.has(one.group)) } : attributes, ...cells));
  }
  $("list").setAttribute("aria-rowcount", site.lines.length + 1);
  if (site.lines.length) $("list").setAttribute("aria-activedescendant", `row-${site.selected}`);
  else $("list").removeAttribute("aria-activedescendant");
  $("rows").style.top = `${first * HEIGHT}px`;
  $("rows").replaceChildren(...rows);
}

function select(place) {
  site.selected = between(0, place, Math.max(0, site.lines.length - 1));
  const box = $("list");
  const top = site.selected * HEIGHT;
  if (top < box.scrollTop) box.scrollTop = top;
  if (top + 2 * HEIGHT > box.scrollTop + box.clientHeight) box.scrollTop = top + 3 * HEIGHT - box.clientHeight;
  draw();
  // The row has to be in sight of the page, too.
  document.getElementById(`row-${site.selected}`)?.scrollIntoView({ block: "nearest" });
}

function heads() {
  const made = site.columns.map((name) => {
    const sort = () => {
      [site.sort, site.down] = [name, site.sort === name ? !site.down : NUMBERS.has(name)];
      keep();
      heads();
      list();
      $("head").children[site.columns.indexOf(name)].firstChild.focus();
    };
    const order = site.down ? "descending" : "ascending";
    const arrow = site.sort === name ? (site.down ? " ↓" : " ↑") : "";
    const button = element("button", { type: "button", onclick: sort, class: NUMBERS.has(name) ? "number" : "" }, name + arrow);
    return element("span", { role: "columnheader", "aria-sort": site.sort === name ? order : null, class: NUMBERS.has(name) ? "number" : "" }, button);
  });
  $("head").replaceChildren(...made);
}

// --- The address and keys ---------------------------------------------------------------------------------------------

function listAddress() {
  const asked = { run: site.run, find: $("find").value, only: $("only").value, group: $("group").value, cards: $("cards-by").value, sort: site.sort, down: site.down ? 1 : null };
  const kept = Object.entries(asked).filter(([, what]) => what !== null && what !== "");
  return kept.length ? `/#${new URLSearchParams(kept)}` : "/";
}

function keep(how = "replaceState") {
  history[how](null, "", listAddress());
}

function recall() {
  const asked = new URLSearchParams(location.hash.slice(1));
  site.run = asked.get("run") ?? site.runs[0]?.name ?? null;
  $("find").value = asked.get("find") ?? "";
  $("only").value = asked.get("only") ?? "";
  if (!$("only").value) $("only").value = "";
  $("group").value = GROUPS.includes(asked.get("group")) ? asked.get("group") : "";
  $("cards-by").value = asked.get("cards") in CARDS_BY ? asked.get("cards") : "";
  site.sort = SHOWN.includes(asked.get("sort")) ? asked.get("sort") : null;
  site.down = asked.get("down") === "1";
}

// What an episode's page needs to know of this list, and what this list needs when it is shown again.
function remember() {
  const records = site.listed.map(address).filter(Boolean);
  const place = { selected: site.selected, top: $("list").scrollTop };
  try {
    sessionStorage.setItem(LIST, JSON.stringify({ home: listAddress(), records, ...place }));
  } catch {
    // Storage that is full or switched off: the neighbours are then those of the run.
  }
}

function restore() {
  let kept = null;
  try {
    kept = JSON.parse(sessionStorage.getItem(LIST));
  } catch {
    return;
  }
  if (!kept) return;
  if (kept.home !== listAddress()) return;
  site.selected = between(0, kept.selected, Math.max(0, site.lines.length - 1));
  $("list").scrollTop = kept.top;
  draw();
}

const KEYS = {
  j: () => select(site.selected + 1),
  k: () => select(site.selected - 1),
  ArrowDown: () => select(site.selected + 1),
  ArrowUp: () => select(site.selected - 1),
  "/": () => $("find").focus(),
  t: toggleTheme,
  "?": () => $("keys").showModal(),
  Enter: () => {
    const one = site.lines[site.selected];
    if (one?.group !== undefined) return toggle(one);
    const chosen = one && address(one);
    if (chosen) location.assign(chosen);
  },
};

async function start() {
  site.runs = await (await fetch("/api/runs")).json();
  recall();
  heads();
  for (const id of ["find", "only", "group"]) $(id).addEventListener("input", () => [keep(), list()]);
  $("cards-by").addEventListener("input", () => [keep(), showRuns()]);
  $("list").addEventListener("scroll", draw);
  window.addEventListener("resize", draw);
  window.addEventListener("popstate", () => [recall(), heads(), showRuns(), load()]);
  window.addEventListener("pagehide", remember);
  connectKeys(KEYS);
  showRuns();
  document.querySelector('#runs [aria-pressed="true"]')?.scrollIntoView({ block: "nearest" });
  await load();
  restore();
  listen();
  document.body.dataset.ready = "true";
}

start();
