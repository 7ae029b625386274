"use strict";
// The player: one episode, turn by turn. `shown` is what stands on the page; everything else follows from it.

const shown = { episode: null, turn: 0, step: null, timer: null };
const LONG_PROMPT = 80;

async function showEpisode(key, turn) {
  stop();
  if (shown.episode?.key !== key) {
    shown.episode = await openEpisode(key);
    const tokens = shown.episode.turns.map(({ view }) => view?.tokens ?? 0);
    shown.episode.mostTokens = extent([0, ...tokens])[1];
    describeEpisode(shown.episode);
  }
  $("run").hidden = true;
  $("player").hidden = false;
  goTo(turn ?? 0);
}

function lastTurn() {
  return Math.max(0, shown.episode.turns.length - 1);
}

// Go to a turn; `step` shows the game after one of its calls instead of after all of them.
function goTo(turn, step = null) {
  shown.turn = between(0, turn, lastTurn());
  shown.step = step;
  history.replaceState(null, "", `#episode=${encodeURIComponent(shown.episode.key)}&turn=${shown.turn}`);
  render();
}

function render() {
  const { episode, turn } = shown;
  const facts = episode.facts[turn] ?? { step: 0 };
  $("slider").max = lastTurn();
  $("slider").value = turn;
  const place = `turn ${number(turn)} of ${number(lastTurn())}, step ${number(facts.step)}`;
  $("slider").setAttribute("aria-valuetext", place);
  $("place").textContent = place;
  renderGame();
  renderTurn();
  renderContext();
  renderCurves();
}

// --- What is true of the whole episode -------------------------------------------------------------------------------

function describeEpisode(episode) {
  const result = episode.result;
  $("episode-title").replaceChildren(`${episode.game} `, element("span", { class: "by" }, `played by ${episode.player ?? "an unnamed player"}`));
  document.title = `${episode.game}, ${episode.player ?? "unnamed"}, seed ${episode.seed}`;
  const end = result ? result.end_reason.replaceAll("_", " ") : (episode.error ?? "the record stops before the end");
  const mistakes = result ? result.illegal_actions + result.malformed_calls + result.idle_replies : null;
  const chips = [
    [episode.status, end, `status ${episode.status}`],
    ["score", result ? number(result.score) + (result.normalized_score === null ? "" : ` (${percent(result.normalized_score)} of a human's)`) : "–"],
    ["steps", result ? `${number(result.steps)} of ${number(episode.rollout)}` : `${number(episode.facts.at(-1)?.step ?? 0)} of ${number(episode.rollout)}`],
    ["turns", number(episode.turns.length)],
    ["prompt tokens", result ? number(result.tokens.prompt) : "–"],
    ["prefix-stable", result?.tokens.prompt ? percent(result.tokens.prefix / result.tokens.prompt) : "–"],
    ["mistakes", number(mistakes)],
    ["seed", String(episode.seed)],
    ...(episode.trial === null ? [] : [["trial", number(episode.trial)]]),
    ...(episode.cost === null ? [] : [["cost", `$${number(episode.cost, 4)}`]]),
  ];
  $("chips").replaceChildren(...chips.map(([name, value, kind]) => element("div", { class: `chip ${kind ?? ""}` }, element("dt", {}, name), element("dd", {}, value))));
  describeRules(episode);
  drawMistakes(episode);
}

function describeRules(episode) {
  const { budget, check } = episode;
  const limit = (value) => (value === null || value === undefined ? "no limit" : number(value));
  const proof =
    check.differ === null
      ? `${plural(check.prompts, "prompt")}; too many to check each of them here, \`smartplay-tools replay\` does`
      : check.differ.length
        ? `the prompts of turns ${check.differ.join(", ")} are NOT what the record's sha256 says`
        : `all ${plural(check.prompts, "prompt")} rebuilt and found to have the record's sha256`;
  const facts = {
    history: `${limit(budget.history)} past observations`, "prompt tokens": limit(budget.prompt_tokens), "reply tokens": limit(budget.reply_tokens),
    "episode tokens": limit(budget.episode_tokens), "result tokens": limit(budget.result_tokens), "tool calls": limit(budget.tool_calls), slack: number(budget.slack),
    manual: episode.manual, "calls in one message": episode.batch, protocol: episode.protocol, "context owned by": episode.context, engine: episode.engine ?? "the only one",
    options: JSON.stringify(episode.options), tokenizer: episode.tokenizer, prompts: proof,
    "differs from the paper in": Object.entries(episode.result?.deviations ?? {}).map(([name, { paper, played }]) => `${name}: ${JSON.stringify(played)} for ${JSON.stringify(paper)}`).join("; ") || "nothing that is recorded",
    versions: Object.entries(episode.result?.versions ?? {}).map((pair) => pair.join(" ")).join(", "),
  };
  const rows = Object.entries(facts).map(([name, value]) => element("div", {}, element("dt", {}, name), element("dd", {}, value)));
  const failure = episode.error ? [element("p", { class: "caption bad" }, episode.error), episode.traceback ? element("pre", {}, episode.traceback) : null] : [];
  $("rules").replaceChildren(element("dl", { class: "facts" }, rows), ...failure.filter(Boolean));
}

// Marks under the slider where something went wrong.
function drawMistakes(episode) {
  const wrong = mistakes(episode);
  const count = Math.max(1, episode.turns.length - 1);
  const marks = wrong.map((turn) => shape("rect", { class: "mistake", x: (1000 * turn) / count - 1.5, y: 0, width: 3, height: 8 }));
  const strip = picture(1000, 8, wrong.length ? `Mistakes in ${plural(wrong.length, "turn")}` : "No mistakes", marks);
  strip.setAttribute("preserveAspectRatio", "none");
  $("mistakes").replaceChildren(strip);
  $("next-mistake").disabled = wrong.length === 0;
}

function mistakes(episode) {
  return episode.turns.flatMap((turn, at) => (isMistaken(turn) ? [at] : []));
}

function isMistaken(turn) {
  const idle = turn.items.some(({ by }) => by === "library");
  return idle || !turn.message && turn.view || turn.choice?.fallback || turn.items.some(({ call }) => call?.is_error);
}

// --- What is true of the moment --------------------------------------------------------------------------------------

function renderGame() {
  const { episode, turn } = shown;
  const step = shown.step ?? episode.facts[turn]?.step ?? 0;
  const drawn = draw(episode, step, page.textures);
  $("game-step").textContent = `after step ${number(step)}`;
  $("game").replaceChildren(...(drawn.length ? drawn : [element("p", { class: "caption" }, "There is no picture of this game.")]));
  $("source").textContent = episode.drawing.source;
}

function renderTurn() {
  const { episode, turn } = shown;
  const now = episode.turns[turn];
  $("turn-title").textContent = `Turn ${number(turn)}`;
  $("said").replaceChildren(...(now ? saidIn(now, episode) : [element("p", { class: "caption" }, "Nothing has been recorded yet.")]));
  $("answers").replaceChildren(...(now?.items ?? []).map((item) => answer(item, now)));
  if (now?.choice) $("answers").prepend(caption(now.choice.fallback ? `No action was named; the first was played: ${now.choice.action}` : `Chosen: ${now.choice.action}`, now.choice.fallback));
  const calls = (now?.items ?? []).filter(({ call }) => call).map(({ call }) => `${call.name} ${call.is_error ? "failed" : "answered"}`);
  if (!shown.timer) $("announce").textContent = `Turn ${turn}. ${calls.join(", ") || "No call."}`;
}

function saidIn(turn, episode) {
  const { message, usage } = turn;
  if (!message) return [element("p", { class: "caption bad" }, turn.view ? "No reply came to this prompt." : "The host's agent called; what it said is not on record.")];
  const thoughts = [message.reasoning_content, ...(message.provider_items ?? []).map((item) => JSON.stringify(item, null, 1))].filter(Boolean);
  const said = textOf(message);
  const calls = (message.tool_calls ?? []).map(({ function: { name, arguments: sent } }) => callLine(name, sent));
  const cost = usage ? `${plural(usage.reply ?? 0, "token")}${usage.overrun ? ", more than it was allowed" : ""}${usage.provider ? `; the provider counted ${number(usage.provider.prompt)} + ${number(usage.provider.reply)}` : ""}` : null;
  return [
    thoughts.length ? element("details", {}, element("summary", {}, "Reasoning and provider items"), element("pre", {}, thoughts.join("\n"))) : null,
    said ? element("pre", { class: "speech" }, said) : null,
    ...calls,
    !said && !calls.length ? caption("An empty reply.", true) : null,
    cost ? element("p", { class: "small" }, cost) : null,
  ].filter(Boolean);
}

function callLine(name, sent) {
  let plain = sent;
  try {
    plain = Object.values(JSON.parse(sent || "{}")).map((value) => JSON.stringify(value)).join(", ");
  } catch {
    // Not JSON: shown as it was written.
  }
  return element("p", { class: "call", title: `${name} ${sent}` }, element("b", {}, name), "(", element("span", {}, plain), ")");
}

function answer({ call, message, by }, turn) {
  if (message) return element("article", { class: "answer" }, element("h4", {}, `${message.role} message, by the ${by}`), element("pre", {}, textOf(message)));
  const kind = call.is_error ? "error" : call.manual ? "manual" : call.observation === undefined ? "note" : "observation";
  const what = kind === "observation" ? `observation ${number(call.observation)}` : kind === "error" ? `error: ${call.mistake ?? "refused"}` : kind;
  const several = turn.items.filter((item) => item.call?.legal).length > 1;
  const look = several && call.legal ? element("button", { type: "button", onclick: () => goTo(shown.turn, call.step) }, "show the game here") : null;
  const score = call.legal ? element("span", { class: "small" }, ` reward ${signed(call.reward)}, score ${number(call.score)}`) : null;
  const asked = turn.message?.tool_calls ? null : callLine(call.name, call.arguments);
  return element("article", { class: `answer ${kind}` }, element("h4", {}, `${call.name}: ${what}`, score, look), asked, element("pre", {}, call.text));
}

function renderContext() {
  const { episode, turn } = shown;
  const view = episode.turns[turn]?.view;
  $("context-body").hidden = !view;
  $("no-context").hidden = Boolean(view);
  if (!view) {
    $("no-context").textContent = episode.context === "host" ? "The host owns the context of this episode: what its model saw is not on record." : "No prompt led to this turn.";
    return;
  }
  $("gauge").replaceChildren(...gauge(episode, turn));
  band($("band"), episode, turn, goTo);
  $("sentence").textContent = sentence(episode, turn);
  const allowed = view.max_tokens === null ? "A reply of any length was allowed." : `The reply was allowed ${plural(view.max_tokens, "token")}.`;
  const spent = episode.budget.episode_tokens === null ? "" : ` Spent after this turn: ${number(episode.facts[turn].spent)} of ${number(episode.budget.episode_tokens)} tokens.`;
  $("allowed").textContent = allowed + spent;
  renderPrompt();
}

// The prompt word for word; made only when somebody has opened it.
function renderPrompt(everything = false) {
  if (!$("prompt").open) return;
  const { episode, turn } = shown;
  const parts = promptParts(episode, page.words, turn) ?? [];
  const before = turn > 0 ? (sentMessages(episode, page.words, turn - 1) ?? []) : [];
  const differs = parts.findIndex(({ message }, at) => JSON.stringify(message) !== JSON.stringify(before[at]));
  const same = differs === -1 ? parts.length : differs;
  const cards = parts.map((part, at) => () => messageCard(part, at >= same));
  const hidden = everything || cards.length <= LONG_PROMPT ? 0 : cards.length - LONG_PROMPT;
  const more = element("button", { type: "button", onclick: () => renderPrompt(true) }, `show ${plural(hidden, "more message")}`);
  const first = hidden ? 2 : 0;
  const list = [...cards.slice(0, first).map((make) => make()), hidden ? more : null, ...cards.slice(first + hidden).map((make) => make())];
  const tools = episode.tools.length ? element("details", { class: "message schema" }, element("summary", {}, `tool schemas: ${episode.tools.map((tool) => tool.name).join(", ")}`), element("pre", {}, JSON.stringify(episode.tools, null, 1))) : null;
  $("messages").replaceChildren(...[tools, ...list].filter(Boolean));
}

function messageCard({ message, turn, marked }, fresh) {
  const from = turn === undefined ? "" : ` of turn ${number(turn)}`;
  const title = element("h4", {}, `${message.role}${from}`, marked ? element("span", { class: "tag marked" }, "marked") : null, fresh ? element("span", { class: "tag fresh" }, "new") : null);
  const calls = (message.tool_calls ?? []).map(({ function: { name, arguments: sent } }) => element("p", { class: "call" }, element("b", {}, name), ` ${sent}`));
  const said = textOf(message);
  return element("article", { class: `message ${message.role}${marked ? " is-marked" : ""}` }, title, said || !calls.length ? element("pre", {}, said) : null, ...calls);
}

function renderCurves() {
  const { episode, turn } = shown;
  const clickable = (box, x) => {
    box.onclick = (event) => goTo(x.turn(event.clientX - box.getBoundingClientRect().left));
  };
  const scores = episode.facts.map(({ score }) => score);
  clickable($("scores"), curve($("scores"), { name: "Score", values: scores, stepped: true, kind: "score", turn }));
  const tokens = episode.turns.map(({ view }) => view?.tokens ?? null);
  $("cap-note").hidden = episode.budget.prompt_tokens === null;
  $("token-chart").hidden = $("map-chart").hidden = tokens.every((value) => value === null);
  if ($("token-chart").hidden) return;
  clickable($("tokens"), curve($("tokens"), { name: "Tokens of the prompt", values: tokens, cap: episode.budget.prompt_tokens, kind: "tokens", turn }));
  clickable($("map"), windowMap($("map"), episode, turn));
}

// --- Moving ----------------------------------------------------------------------------------------------------------

function play() {
  if (shown.timer) return stop();
  if (shown.turn >= lastTurn()) goTo(0);
  $("play").textContent = "⏸";
  $("play").setAttribute("aria-label", "Pause");
  shown.timer = setInterval(() => (shown.turn < lastTurn() ? goTo(shown.turn + 1) : stop()), Number($("pace").value));
}

function stop() {
  clearInterval(shown.timer);
  shown.timer = null;
  $("play").textContent = "▶";
  $("play").setAttribute("aria-label", "Play");
}

function goToMistake(direction) {
  const wrong = mistakes(shown.episode);
  const found = direction > 0 ? wrong.find((turn) => turn > shown.turn) : wrong.findLast((turn) => turn < shown.turn);
  if (found !== undefined) goTo(found);
}

function goToEpisode(direction) {
  const keys = page.episodes.map((episode) => episode.key);
  const at = keys.indexOf(shown.episode.key) + direction;
  if (at in keys) location.hash = `#episode=${encodeURIComponent(keys[at])}&turn=0`;
}
