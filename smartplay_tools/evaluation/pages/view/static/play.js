"use strict";
// A person plays under the window of an agent: the prompt's messages, the tools as buttons, and what the budget has left.
// The server decides what is a valid answer; an answer to a prompt that has passed is refused.

const play = { number: 0, asked: null, busy: false };

async function send(path, body = {}) {
  const headers = { "Content-Type": "application/json", "X-SmartPlay-Key": document.body.dataset.key };
  const answer = await fetch(path, { method: "POST", headers, body: JSON.stringify(body) });
  $("problem").textContent = answer.ok ? "" : await answer.text();
  return answer.ok ? answer.json() : null;
}

// --- What is shown ---------------------------------------------------------------------------------------------------

const NAMES = { system: "system", user: "user", assistant: "you", tool: "game" };

function textOf(message) {
  const { content } = message;
  return typeof content === "string" ? content : (content ?? []).map((part) => part.text ?? "").join("");
}

function messageCard(message) {
  const calls = (message.tool_calls ?? []).map(({ function: { name, arguments: sent } }) =>
    element("p", { class: "call" }, element("b", {}, name), ` ${sent}`),
  );
  const said = textOf(message);
  const title = element("h4", {}, NAMES[message.role] ?? message.role);
  return element("article", { class: `message ${message.role}` }, title, said ? element("pre", {}, said) : null, ...calls);
}

function budgetBar({ short, share }) {
  const bar = share === null ? null : element("meter", { min: 0, max: 1, high: 0.85, optimum: 0, value: share });
  return element("li", {}, bar, short);
}

function actionButton(name, place) {
  const act = () => answer(play.asked.asks === "call" ? { tool: "act", action: name } : { action: name });
  return element("button", { type: "button", onclick: act }, element("kbd", {}, String(place + 1)), ` ${name}`);
}

const QUESTIONS = { call: "Your move", action: "Choose an action", words: "Write what you think" };

function showPrompt(asked) {
  const tools = new Set(asked.tools.map((tool) => tool.name));
  const calls = asked.asks === "call";
  $("messages").replaceChildren(...asked.messages.map(messageCard));
  $("question").textContent = asked.summary ? "Write a summary of the turns that leave" : QUESTIONS[asked.asks];
  $("actions").replaceChildren(...(asked.asks === "words" ? [] : asked.actions.map(actionButton)));
  $("words").hidden = $("send").hidden = asked.asks !== "words";
  $("observe").hidden = !calls;
  $("manual").hidden = !calls;
  $("words-beside").hidden = !calls;
  $("notes").hidden = $("take-notes").hidden = !(calls && tools.has("take_notes"));
  $("picture").hidden = !asked.pictures;
  $("drawn").replaceChildren();
  for (const id of ["text", "say"]) $(id).value = "";
  $("schemas").textContent = JSON.stringify(asked.tools, null, 1);
  $("schemas").parentElement.hidden = !asked.tools.length;
  $("messages").scrollTop = $("messages").scrollHeight;
}

function fact(name, what) {
  return element("div", { class: "chip" }, element("dt", {}, name), element("dd", {}, what));
}

function showEnd(over) {
  const share = over.normalized_score === null ? "" : ` (${percent(over.normalized_score)} of a human's)`;
  const facts = [
    fact("score", `${number(over.score)}${share}`),
    fact("steps", number(over.steps)),
    fact("end", over.end_reason.replaceAll("_", " ")),
  ];
  if (over.pictures) facts.push(fact("pictures", "shown when asked for"));
  $("result").replaceChildren(...facts);
  $("replay").setAttribute("href", over.replay);
}

function show(state) {
  [play.number, play.asked, play.busy] = [state.number, state.asked, false];
  document.body.dataset.number = state.number;
  $("live").textContent = { asking: "your turn", over: "over", failed: "stopped", waiting: "the game is busy" }[state.state];
  $("asking").hidden = state.state !== "asking";
  $("over").hidden = state.state !== "over";
  $("problem").textContent = "";
  $("budget-bars").replaceChildren(...(state.asked?.budget_bars ?? []).map(budgetBar));
  if (state.asked) showPrompt(state.asked);
  if (state.over) showEnd(state.over);
  if (state.error) $("live").textContent = state.error;
}

// --- What is answered ------------------------------------------------------------------------------------------------

async function answer(given) {
  if (play.busy || !play.asked) return;
  play.busy = true;
  const say = $("words-beside").hidden ? "" : $("say").value.trim();
  const sent = await send("/api/play/reply", { number: play.number, ...given, ...(say ? { say } : {}) });
  if (!sent) play.busy = false;
}

async function showPicture() {
  const found = await send("/api/play/picture", { number: play.number });
  if (!found) return;
  const note = element("span", { class: "small" }, "The record says that you have seen this picture.");
  $("drawn").replaceChildren(element("img", { src: found.image, alt: "The game, drawn by itself", class: "pixels" }), note);
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

const KEYS = {
  ...Object.fromEntries(Array.from({ length: 9 }, (_, place) => [String(place + 1), pressAction(place)])),
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
      const found = await fetch(`/api/play?after=${play.number}`);
      if (!found.ok) throw new Error(await found.text());
      const state = await found.json();
      if (state.number !== play.number) show(state);
    } catch {
      $("live").textContent = "the server does not answer";
      await new Promise((resolve) => setTimeout(resolve, 1000));
    }
    document.body.dataset.ready = "true";
  }
}

connectKeys(KEYS);
$("answer").addEventListener("submit", (event) => {
  event.preventDefault();
  if (play.asked?.asks === "words") answer({ text: $("text").value });
});
$("observe").addEventListener("click", () => answer({ tool: "observe" }));
$("manual").addEventListener("click", () => answer({ tool: "read_manual" }));
$("take-notes").addEventListener("click", () => answer({ tool: "take_notes", text: $("note").value }));
$("picture").addEventListener("click", showPicture);
$("next").addEventListener("click", () => send("/api/play/next"));
follow();
