"use strict";
// A person plays under the window of an agent: the prompt's messages, the tools as buttons, and what the budget has left.
// The server decides what is a valid answer; an answer to a prompt that has passed is refused.

const play = { number: 0, asked: null, busy: false, focus: null, live: "connecting" };

const PLAYED = `/api/play/${encodeURIComponent(document.body.dataset.game)}`;

// --- What is shown ---------------------------------------------------------------------------------------------------

const NAMES = { system: "system", user: "user", assistant: "you", tool: "game" };

function textOf(message) {
  const { content } = message;
  return typeof content === "string" ? content : (content ?? []).map((part) => part.text ?? "").join("");
}

// A call as one would say it: act("Move West").
function callIn({ function: { name, arguments: sent } }) {
  const values = Object.values(JSON.parse(sent || "{}")).map((value) => JSON.stringify(value));
  return element("p", { class: "call" }, element("b", {}, name), `(${values.join(", ")})`);
}

function messageCard(message) {
  const calls = (message.tool_calls ?? []).map(callIn);
  const text = textOf(message);
  const title = element("p", { class: "who" }, NAMES[message.role] ?? message.role);
  return element("article", { class: `message ${message.role}` }, title, text ? element("pre", {}, text) : null, ...calls);
}

function budgetBar({ short, share }) {
  const bar = share === null ? null : element("meter", { min: 0, max: 1, high: 0.85, optimum: 0, value: share });
  return element("li", {}, bar, short);
}

// The keys of actions: digits, then letters that have no other meaning; arrows for directions.
const LETTERS = [..."123456789", ..."qwertyuiasdfghjklzxcvbn"].filter((letter) => !"ompt".includes(letter));
const ARROWS = [
  ["ArrowLeft", "←", /\b(west|left)\b/i],
  ["ArrowRight", "→", /\b(east|right)\b/i],
  ["ArrowUp", "↑", /\b(north|up|forward)\b/i],
  ["ArrowDown", "↓", /\b(south|down|backward)\b/i],
];

// The first action of each direction.
function arrowsOf(actions) {
  const arrows = ARROWS.map(([key, sign, words]) => [actions.findIndex((name) => words.test(name)), key, sign]);
  return arrows.filter(([place]) => place >= 0);
}

function actionButton(name, place) {
  const act = () => answer(play.asked.asks === "call" ? { tool: "act", action: name } : { action: name });
  const arrow = arrowsOf(play.asked.actions).find(([at]) => at === place);
  const keys = [LETTERS[place], arrow?.[2]].filter(Boolean).map((key) => element("kbd", {}, key));
  return element("button", { type: "button", onclick: act }, ...keys, ` ${name}`);
}

const BUTTONS = new Set(["observe", "act", "read_manual", "take_notes"]);

// A tool that the budget adds: a field for each of its arguments, and a button.
function addedTool({ name, parameters }) {
  const fields = Object.entries(parameters.properties).map(([key, schema]) => {
    const input = element("input", { type: "text", "aria-label": `${name}: ${key}`, placeholder: schema.description, autocomplete: "off" });
    return [key, schema, input];
  });
  const call = () => answer({ tool: name, arguments: Object.fromEntries(fields.map(argumentOf)) });
  const button = element("button", { type: "button", onclick: call }, name);
  return element("p", { class: "buttons" }, ...fields.map(([, , input]) => input), button);
}

// What is left empty is null where a schema allows that; anything but text is JSON.
function argumentOf([key, schema, input]) {
  const kinds = schema.anyOf ?? [schema];
  if (!input.value && kinds.some(({ type }) => type === "null")) return [key, null];
  if (kinds.some(({ type }) => type === "string")) return [key, input.value];
  try {
    return [key, JSON.parse(input.value)];
  } catch {
    return [key, input.value];
  }
}

const QUESTIONS = { call: "Your move", action: "Choose an action", words: "Write what you think" };

function showPrompt(asked) {
  const tools = new Set(asked.tools.map((tool) => tool.name));
  const calls = asked.asks === "call";
  $("step").textContent = asked.rollout === null ? "" : `Step ${number(asked.steps)} of at most ${number(asked.rollout)}. The score is shown at the end: a model does not see it either.`;
  $("messages").replaceChildren(...asked.messages.map(messageCard));
  $("question").textContent = asked.summary ? "Write a summary of the turns that leave" : QUESTIONS[asked.asks];
  $("actions").replaceChildren(...(asked.asks === "words" ? [] : asked.actions.map(actionButton)));
  $("words").hidden = $("send").hidden = asked.asks !== "words";
  $("observe").hidden = !calls;
  $("manual").hidden = !calls;
  $("words-beside").hidden = !calls;
  $("notes").hidden = $("take-notes").hidden = !(calls && tools.has("take_notes"));
  $("added").replaceChildren(...(calls ? asked.tools.filter(({ name }) => !BUTTONS.has(name)).map(addedTool) : []));
  $("picture").hidden = !asked.pictures;
  $("drawn").replaceChildren();
  for (const id of ["text", "say"]) $(id).value = "";
  $("schemas").textContent = JSON.stringify(asked.tools, null, 1);
  $("schemas").parentElement.hidden = !asked.tools.length;
  $("messages").scrollTop = $("messages").scrollHeight;
}

function showEnd(over) {
  const share = over.normalized_score === null ? "" : `${percent(over.normalized_score)} of a human’s score. `;
  const pictures = over.pictures ? " Pictures were shown when asked for." : "";
  $("score").textContent = `Score ${number(over.score)}`;
  $("result").textContent = `${share}${plural(over.steps, "step")}; the end: ${over.end_reason.replaceAll("_", " ")}.${pictures}`;
  $("replay").setAttribute("href", over.replay);
  $("shown").setAttribute("src", `${over.replay}#turn=1e9&bare`);
  window.scrollTo(0, 0); // what comes late stands below, and moves nothing that is in sight
  showBeside(over);
}

// Where a turn went that the window has lost: what it showed, and when it was gone.
function lost({ gone, turns, first }) {
  if (!gone) return "At your last move, all that you had done was still in your window.";
  const example = first && `Turn ${first.turn} showed “${first.text}”; at turn ${first.left} it had left your window. `;
  return `${example ?? ""}At your last move, ${plural(gone, "turn")} of ${number(turns)} had left it.`;
}

// The score beside those of the paper's people and models, and of players of ours in the same world.
async function showBeside(over) {
  $("links").replaceChildren(linkToCopy("A link that replays it", location.origin + over.replay));
  const { answer: beside, problem } = await request(`${PLAYED}/beside`);
  if (!beside) return $("beside").replaceChildren(problem);
  $("gone").textContent = lost(beside);
  const isShare = over.normalized_score !== null;
  const all = [...Object.entries(beside.scores), ["you", isShare ? over.normalized_score : over.score]].sort(([, a], [, b]) => b - a);
  const [low, high] = [Math.min(0, all.at(-1)[1]), Math.max(1, all[0][1])];
  const rows = all.map(([name, score]) => {
    const bar = element("meter", { min: low, max: high, value: score, "aria-label": name });
    const shown = isShare ? percent(score) : number(score);
    return element("tr", { class: name === "you" ? "you" : "" }, element("th", { scope: "row" }, name), element("td", {}, bar), element("td", { class: "number" }, shown));
  });
  const words = isShare ? "Shares of a human’s score. rule and random played this world; the others are the paper’s." : "Scores. rule and random played this world; the others are the paper’s.";
  $("beside").replaceChildren(element("table", {}, element("caption", {}, words), element("tbody", {}, ...rows)));
}

// Links are percent-encoded, so that they can stand between quotation marks in every shell.
function linkToCopy(name, text) {
  const field = element("label", {}, element("span", {}, name), element("input", { type: "text", value: text, readonly: true }));
  return element("p", { class: "link" }, field, element("button", { type: "button", onclick: ({ target }) => copy(target, text) }, "copy"));
}

// The control that had the focus keeps it: actions are made anew, and a form that waits is hidden. It is given by its
// place among the actions, or by its id.
function keepFocus() {
  const place = [...$("actions").children].indexOf(document.activeElement);
  if ($("answer").contains(document.activeElement)) play.focus = place < 0 ? document.activeElement.id : place;
}

function focusAgain() {
  if (document.activeElement !== document.body || play.focus === null) return;
  const control = typeof play.focus === "number" ? $("actions").children[play.focus] : $(play.focus);
  control?.focus({ preventScroll: true });
}

const LIVE = { asking: "your turn", over: "over", failed: "stopped", waiting: "the game is busy" };

function show(state) {
  keepFocus();
  [play.number, play.asked, play.busy] = [state.number, state.asked, false];
  document.body.dataset.number = state.number;
  $("asking").hidden = state.state !== "asking";
  $("over").hidden = state.state !== "over";
  $("step").hidden = state.state !== "asking";
  $("problem").textContent = "";
  $("budget-bars").replaceChildren(...(state.asked?.budget_bars ?? []).map(budgetBar));
  if (state.asked) showPrompt(state.asked);
  if (state.over) showEnd(state.over);
  focusAgain();
}

// --- What is answered ------------------------------------------------------------------------------------------------

async function answer(given) {
  if (play.busy || !play.asked) return;
  play.busy = true;
  const say = $("words-beside").hidden ? "" : $("say").value.trim();
  const sent = await send(`${PLAYED}/reply`, { number: play.number, ...given, ...(say ? { say } : {}) });
  if (!sent) play.busy = false;
}

async function showPicture() {
  const picture = await send(`${PLAYED}/picture`, { number: play.number });
  if (!picture) return;
  const note = element("span", { class: "small" }, "The record says that you have seen this picture.");
  $("drawn").replaceChildren(element("img", { src: picture.image, alt: "The game, drawn by itself", class: "pixels" }), note);
}

function press(id) {
  return () => {
    if (!$("asking").hidden && !$(id).hidden) $(id).click();
  };
}

function pressAction(place) {
  return () => {
    if (!$("asking").hidden) $("actions").children[place]?.click();
  };
}

function pressArrow(key) {
  return () => {
    const place = arrowsOf(play.asked?.actions ?? []).find(([, name]) => name === key)?.[0];
    if (place !== undefined) pressAction(place)();
  };
}

const KEYS = {
  ...Object.fromEntries(LETTERS.map((key, place) => [key, pressAction(place)])),
  ...Object.fromEntries(ARROWS.map(([key]) => [key, pressArrow(key)])),
  o: press("observe"),
  m: press("manual"),
  p: press("picture"),
  t: toggleTheme,
  "?": () => $("keys").showModal(),
};

// One question after the other: the server answers when something else is to be shown, or after some seconds.
async function follow() {
  for (;;) {
    try {
      const response = await fetch(`${PLAYED}?after=${play.number}`);
      if (!response.ok) throw new Error(await response.text());
      const state = await response.json();
      if (state.number !== play.number) show(state);
      $("live").textContent = play.live = state.error ?? LIVE[state.state];
    } catch {
      $("live").textContent = "the server does not answer";
      await new Promise((resolve) => setTimeout(resolve, 1000));
    }
    document.body.dataset.ready = "true";
  }
}

connectKeys(KEYS);
window.addEventListener("offline", () => ($("live").textContent = "no network"));
window.addEventListener("online", () => ($("live").textContent = play.live));
$("answer").addEventListener("submit", (event) => {
  event.preventDefault();
  if (play.asked?.asks === "words") answer({ text: $("text").value });
});
$("observe").addEventListener("click", () => answer({ tool: "observe" }));
$("manual").addEventListener("click", () => answer({ tool: "read_manual" }));
$("take-notes").addEventListener("click", () => answer({ tool: "take_notes", text: $("note").value }));
$("picture").addEventListener("click", showPicture);
$("copy-poster").addEventListener("click", () => copyPicture($("copy-poster"), () => painted([["title"], ["poster"]], $("poster")), `${document.body.dataset.game}.png`));
// The frame is as high as the replay in it.
$("shown").addEventListener("load", () => {
  const held = $("shown").contentDocument.body;
  new ResizeObserver(() => ($("shown").style.height = `${held.scrollHeight + 4}px`)).observe(held);
});
$("next").addEventListener("click", () => send(`${PLAYED}/next`));
follow();
