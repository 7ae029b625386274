"use strict";
// The list: runs, what is being played, and the episodes of one run. Only the rows in sight are elements of the page.
// The address holds what is shown (`#run=1&find=crafter&only=mistakes&sort=score&down=1`), so that it can be shared.

const HEIGHT = 34;
const SHOWN = ["status", "game", "player", "budget", "trial", "score", "normalized", "steps", "tokens", "cost", "mistakes", "cut", "end"];
const NUMBERS = new Set(["trial", "seed", "score", "normalized", "steps", "tokens", "cost", "mistakes", "cut"]);

const site = { runs: [], run: 0, at: {}, all: [], texts: [], listed: [], selected: 0, marked: [], sort: null, down: false };

function value(episode, name) {
  return episode[site.at[name]];
}

function address(episode, kind) {
  const record = value(episode, "record");
  return record ? `/${kind ?? (value(episode, "status") === "running" ? "watch" : "episode")}/${site.run}/${record}` : null;
}

// --- Runs and what is being played -----------------------------------------------------------------------------------

function duration(seconds) {
  if (seconds < 90) return `${number(seconds, 0)} s`;
  return seconds < 5400 ? `${number(seconds / 60, 0)} min` : `${number(seconds / 3600, 1)} h`;
}

function bar(run) {
  const share = (count) => (100 * count) / Math.max(1, run.planned);
  const done = shape("rect", { class: "done", width: share(run.finished), height: 8 });
  const busy = shape("rect", { class: "busy", x: share(run.finished), width: share(run.running), height: 8 });
  const made = picture(100, 8, `${run.finished} of ${run.planned} finished`, shape("rect", { class: "trough", width: 100, height: 8 }), done, busy);
  made.setAttribute("preserveAspectRatio", "none");
  made.setAttribute("class", "bar");
  return made;
}

function card(run, place) {
  if (run.error) return element("p", { class: "card bad" }, element("b", {}, run.name), run.error);
  const words = [`${number(run.finished)} of ${number(run.planned)} finished`];
  if (run.running) words.push(`${number(run.running)} being played`);
  if (run.paused) words.push(`${number(run.paused)} paused`);
  if (run.failed) words.push(`${plural(run.failed, "failed attempt")}`);
  const spent = [`${number(run.tokens)} tokens`, run.cost === null ? "cost unknown" : run.cost ? `$${number(run.cost)}` : null];
  if (run.seconds_left !== null) spent.push(`about ${duration(run.seconds_left)} left`);
  const attributes = { type: "button", class: "run", "aria-pressed": String(place === site.run), onclick: () => choose(place) };
  return element("button", attributes, element("b", {}, run.name), bar(run), words.join(", "), element("br"), element("span", { class: "small" }, spent.filter(Boolean).join(", ")));
}

function showRuns() {
  $("runs").replaceChildren(...site.runs.map(card));
  const playing = site.runs.flatMap((run, place) => (run.playing ?? []).map((one) => ({ ...one, place })));
  $("now").hidden = !playing.length;
  $("playing").replaceChildren(
    ...playing.slice(0, 100).map((one) => {
      const link = element("a", { href: `/watch/${one.place}/${one.record}` }, `${one.game || one.key}, ${one.player}, seed ${one.seed}`);
      const cells = [one.steps, one.calls, number(one.tokens), `${one.silent} s`];
      return element("tr", {}, element("td", {}, link), ...cells.map((cell) => element("td", { class: "number" }, String(cell))));
    }),
  );
}

// The report page of the run that is shown; with another one, their comparison.
function linkReport() {
  const others = site.runs.map((run, place) => ({ run, place })).filter(({ run, place }) => place !== site.run && !run.error);
  const chosen = $("other").value;
  const choices = others.map(({ run, place }) => element("option", { value: place, selected: String(place) === chosen }, run.name));
  $("other").replaceChildren(element("option", { value: "" }, "no other run"), ...choices);
  $("against").hidden = !others.length;
  const other = $("other").value;
  $("report").setAttribute("href", `/report?run=${site.run}${other ? `&run=${other}` : ""}`);
  $("report").textContent = other ? "comparison of both runs" : "report of this run";
}

function listen() {
  const stream = new EventSource("/api/live");
  stream.onmessage = (event) => {
    const before = site.runs[site.run];
    const count = site.runs.length;
    site.runs = JSON.parse(event.data);
    $("live").textContent = "up to date";
    showRuns();
    if (site.runs.length !== count) linkReport();
    const now = site.runs[site.run];
    const changed = ["finished", "running", "paused", "failed"].some((name) => before?.[name] !== now?.[name]);
    if (before && changed) load();
  };
  stream.onerror = () => ($("live").textContent = "the server does not answer");
}

// --- Episodes --------------------------------------------------------------------------------------------------------

async function load() {
  const answer = await fetch(`/api/runs/${site.run}/episodes`);
  if (!answer.ok) {
    [site.all, site.texts] = [[], []];
    $("count").textContent = await answer.text();
    return draw();
  }
  const found = await answer.json();
  site.at = Object.fromEntries(found.columns.map((name, place) => [name, place]));
  site.all = found.episodes;
  site.texts = site.all.map((one) => ["status", "game", "player", "budget", "end", "seed"].map((name) => value(one, name) ?? "").join(" ").toLowerCase());
  list();
}

function choose(place) {
  site.run = place;
  site.marked = [];
  site.selected = 0;
  keep();
  showRuns();
  linkReport();
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
    // What has no value stands last, whichever way the list is sorted.
    site.listed.sort((a, b) => (a[place] === null) - (b[place] === null) || sign * compare(a[place], b[place]));
  }
  site.selected = between(0, site.selected, Math.max(0, site.listed.length - 1));
  $("count").textContent = plural(site.listed.length, "episode");
  $("space").style.height = `${site.listed.length * HEIGHT}px`;
  draw();
}

function cell(one, name) {
  const found = value(one, name);
  if (name === "status") return element("span", { class: `status ${found}` }, found);
  if (name === "game") {
    const href = address(one);
    return href ? element("a", { href }, found) : element("span", {}, found);
  }
  if (!NUMBERS.has(name)) return element("span", { title: found }, found ?? "");
  const poor = (name === "mistakes" || name === "cut") && found > 0;
  return element("span", { class: `number${poor ? " poor" : ""}` }, number(found, name === "cost" ? 4 : 2));
}

// Only the rows in sight, and a few beyond, are made.
function draw() {
  const first = Math.max(0, Math.floor($("list").scrollTop / HEIGHT) - 5);
  const last = Math.min(site.listed.length, first + Math.ceil($("list").clientHeight / HEIGHT) + 10);
  const rows = [];
  for (let place = first; place < last; place += 1) {
    const one = site.listed[place];
    const marked = site.marked.includes(value(one, "record")) ? "marked" : "";
    const attributes = { role: "row", class: marked, "aria-selected": String(place === site.selected), "aria-rowindex": place + 1, onclick: () => select(place) };
    rows.push(element("div", attributes, ...SHOWN.map((name) => cell(one, name))));
  }
  $("rows").style.top = `${first * HEIGHT}px`;
  $("rows").replaceChildren(...rows);
}

function select(place) {
  site.selected = between(0, place, site.listed.length - 1);
  const box = $("list");
  const top = site.selected * HEIGHT;
  if (top < box.scrollTop) box.scrollTop = top;
  if (top + 2 * HEIGHT > box.scrollTop + box.clientHeight) box.scrollTop = top + 3 * HEIGHT - box.clientHeight;
  draw();
}

function mark() {
  const record = site.listed[site.selected] && value(site.listed[site.selected], "record");
  if (!record) return;
  const known = site.marked.includes(record);
  site.marked = known ? site.marked.filter((one) => one !== record) : [...site.marked, record].slice(-2);
  $("compare").hidden = site.marked.length < 2;
  if (site.marked.length === 2) {
    const parts = site.marked.map((one) => `${site.run}/${one}`);
    $("compare").setAttribute("href", `/compare?a=${encodeURIComponent(parts[0])}&b=${encodeURIComponent(parts[1])}`);
  }
  draw();
}

function heads() {
  const made = SHOWN.map((name) => {
    const sort = () => {
      [site.sort, site.down] = [name, site.sort === name ? !site.down : NUMBERS.has(name)];
      keep();
      heads();
      list();
    };
    const arrow = site.sort === name ? (site.down ? " ↓" : " ↑") : "";
    return element("button", { type: "button", onclick: sort, class: NUMBERS.has(name) ? "number" : "" }, name + arrow);
  });
  $("head").replaceChildren(...made);
}

// --- The address and keys ---------------------------------------------------------------------------------------------

function keep() {
  const asked = { run: site.run || null, find: $("find").value, only: $("only").value, sort: site.sort, down: site.down ? 1 : null };
  const words = Object.entries(asked).filter(([, what]) => what !== null && what !== "");
  history.replaceState(null, "", words.length ? `#${new URLSearchParams(words)}` : location.pathname);
}

function recall() {
  const asked = new URLSearchParams(location.hash.slice(1));
  site.run = Number.parseInt(asked.get("run") ?? "0", 10) || 0;
  $("find").value = asked.get("find") ?? "";
  $("only").value = asked.get("only") ?? "";
  if (!$("only").value) $("only").value = "";
  site.sort = SHOWN.includes(asked.get("sort")) ? asked.get("sort") : null;
  site.down = asked.get("down") === "1";
}

const KEYS = {
  j: () => select(site.selected + 1),
  k: () => select(site.selected - 1),
  ArrowDown: () => select(site.selected + 1),
  ArrowUp: () => select(site.selected - 1),
  x: mark,
  "/": () => $("find").focus(),
  t: toggleTheme,
  "?": () => $("keys").showModal(),
  Enter: () => {
    const chosen = site.listed[site.selected] && address(site.listed[site.selected]);
    if (chosen) location.assign(chosen);
  },
};

async function start() {
  recall();
  heads();
  for (const id of ["find", "only"]) $(id).addEventListener("input", () => [keep(), list()]);
  $("list").addEventListener("scroll", draw);
  window.addEventListener("resize", draw);
  window.addEventListener("hashchange", () => [recall(), heads(), showRuns(), load()]);
  connectKeys(KEYS);
  site.runs = await (await fetch("/api/runs")).json();
  showRuns();
  linkReport();
  $("other").addEventListener("input", linkReport);
  await load();
  listen();
  document.body.dataset.ready = "true";
}

start();
