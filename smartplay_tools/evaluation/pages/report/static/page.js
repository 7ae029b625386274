"use strict";
// The page: which part of it is shown, the keys, the table of episodes, light and dark.

const page = { words: null, episodes: [], mistakes: [], parts: [], partWords: {}, textures: null };

async function start() {
  Object.assign(page, await unpack("index"));
  page.parts = Object.keys(page.partWords);
  if (page.textures) await loadSheet(page.textures);
  connect();
  await route();
  connectSite();
  document.body.dataset.ready = "true";
}

// Crafter's textures are one picture; a canvas paints parts of it.
async function loadSheet(textures) {
  textures.sheet = new Image();
  textures.sheet.src = textures.image;
  await textures.sheet.decode();
}

// The address says what is shown: `#episode=KEY&turn=N`, or else what the page opens with, or else the run.
async function route() {
  const asked = new URLSearchParams(location.hash.slice(1));
  if (asked.has("bare")) document.body.classList.add("alone", "bare");
  const key = asked.get("episode") ?? document.body.dataset.open;
  if (page.episodes.some((episode) => episode.key === key)) {
    const opened = shown.episode?.key !== key || $("player").hidden;
    // An episode that is being played opens at its last turn.
    const start = asked.get("turn") ?? (served?.playing ? "1e9" : "0");
    await showEpisode(key, Number(start) || 0);
    if (opened) takeFocus($("episode-title"));
    return;
  }
  stop();
  const [last, wasOpen] = [shown.episode?.key, !$("player").hidden];
  $("player").hidden = true;
  $("run").hidden = false;
  document.title = $("title").textContent;
  if (!wasOpen || !last) return;
  const row = document.querySelector(`#episodes tr[data-key="${CSS.escape(last)}"]`);
  if (row) row.hidden = false; // it may be one that the list does not show yet
  takeFocus(row?.querySelector("a"));
}

// A figure that is much wider than high has its own row. A narrow one is not enlarged: letters of all have like sizes.
async function widen(image) {
  await image.decode();
  image.style.maxWidth = `${0.8 * image.naturalWidth}px`;
  image.closest("figure").classList.toggle("wide", image.naturalWidth > 2.8 * image.naturalHeight);
}

function connect() {
  for (const image of document.querySelectorAll(".figures img")) widen(image);
  window.addEventListener("hashchange", route);
  window.addEventListener("resize", again);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  document.addEventListener("keydown", onKey);
  $("slider").addEventListener("input", () => goTo(Number($("slider").value)));
  $("prompt").addEventListener("toggle", () => renderPrompt());
  $("beside").addEventListener("input", () => {
    shown.beside = ($("beside").valueAsNumber || 0) - shown.turn;
    renderPrompt();
  });
  $("why").addEventListener("toggle", renderWhy);
  $("search").addEventListener("toggle", renderSearch);
  $("word").addEventListener("input", renderSearch);
  $("why-turn").addEventListener("input", () => askAbout($("why-turn").valueAsNumber || 0));
  const buttons = {
    play,
    "next-mistake": () => goToMistake(1),
    "episode-before": () => goToEpisode(-1),
    "episode-after": () => goToEpisode(1),
    "copy-link": () => copy($("copy-link"), location.href),
    "copy-turn": () => copy($("copy-turn"), turnAsMarkdown(shown)),
    "copy-picture": () => copyPicture($("copy-picture")),
    theme: turnTheme,
    help: () => $("keys").showModal(),
    "close-keys": () => $("keys").close(),
  };
  for (const [id, action] of Object.entries(buttons)) $(id).addEventListener("click", action);
  for (const [name, key] of [["first", "Home"], ["previous", "ArrowLeft"], ["next", "ArrowRight"], ["last", "End"]])
    $(name).addEventListener("click", () => KEYS[key]({ shiftKey: false }));
  $("pace").addEventListener("change", () => {
    if (shown.timer) [stop(), play()];
  });
  $("find").addEventListener("input", filterEpisodes);
  $("status").addEventListener("change", filterEpisodes);
  $("list-all").addEventListener("click", () => {
    document.querySelector("#episodes tbody").dataset.atOnce = Infinity;
    filterEpisodes();
  });
  for (const button of document.querySelectorAll("#episodes th button"))
    button.addEventListener("click", () => sortEpisodes(button));
}

function turnTheme() {
  toggleTheme();
  again();
}

function again() {
  if (!$("player").hidden && shown.episode) render();
}

// --- Keys ------------------------------------------------------------------------------------------------------------

const KEYS = {
  ArrowLeft: (event) => goTo(shown.turn - (event.shiftKey ? 10 : 1)),
  ArrowRight: (event) => goTo(shown.turn + (event.shiftKey ? 10 : 1)),
  Home: () => goTo(0),
  End: () => goTo(lastTurn()),
  " ": play,
  m: () => goToMistake(1),
  M: () => goToMistake(-1),
  p: togglePrompt,
  f: findWord,
  w: () => askAbout(shown.asked_about),
  n: () => goToEpisode(1),
  b: () => goToEpisode(-1),
  Escape: () => (served ? leave() : (location.hash = "")),
};

// Open the prompt where it can be seen, or close it.
function togglePrompt() {
  if ($("prompt").toggleAttribute("open")) $("prompt").scrollIntoView({ block: "start" });
}

function findWord() {
  $("search").open = true;
  $("search").scrollIntoView({ block: "center" });
  $("word").focus();
}

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || $("keys").open) return;
  const typing = event.target.matches("input:not([type=range]), select, textarea");
  if (typing) return;
  if (event.key === "?") return $("keys").showModal();
  if (event.key === "t") return turnTheme();
  // Keys that the focused element uses itself keep their meaning.
  const own = event.target.matches("button, summary, a")
    ? [" "]
    : event.target.matches("[type=range]")
      ? ["Home", "End"]
      : [];
  if ($("player").hidden || !(event.key in KEYS) || own.includes(event.key)) return;
  event.preventDefault();
  KEYS[event.key](event);
}

// --- The table of episodes -------------------------------------------------------------------------------------------

function filterEpisodes() {
  const words = $("find").value.toLowerCase().split(/\s+/).filter(Boolean);
  const status = $("status").value;
  const atOnce = Number(document.querySelector("#episodes tbody").dataset.atOnce);
  let count = 0;
  for (const row of document.querySelectorAll("#episodes tbody tr")) {
    const text = row.textContent.toLowerCase();
    const isFound = words.every((word) => text.includes(word)) && (!status || row.dataset.status === status);
    count += isFound ? 1 : 0;
    row.hidden = !isFound || count > atOnce;
  }
  $("list-all").hidden = count <= atOnce;
  $("count").textContent = plural(count, "episode") + (count > atOnce ? `, the first ${atOnce} listed` : "");
}

function sortEpisodes(button) {
  const header = button.closest("th");
  const column = header.cellIndex;
  const down = header.getAttribute("aria-sort") !== "descending";
  for (const other of header.parentElement.children) other.removeAttribute("aria-sort");
  header.setAttribute("aria-sort", down ? "descending" : "ascending");
  const value = (row) => row.cells[column].dataset.value ?? row.cells[column].textContent.trim();
  const compare = (one, other) => {
    const [a, b] = [Number(one), Number(other)];
    return Number.isNaN(a) || Number.isNaN(b) ? one.localeCompare(other) : a - b;
  };
  const body = document.querySelector("#episodes tbody");
  const rows = [...body.rows].sort((one, other) => (down ? -1 : 1) * compare(value(one), value(other)));
  body.append(...rows);
  filterEpisodes();
}

start().catch((error) => {
  const words = `The episodes cannot be unpacked here: ${error.message}. Current browsers can.`;
  document.querySelector("main").prepend(element("p", { class: "notice", role: "alert" }, words));
});
