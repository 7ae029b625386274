"use strict";
// A turn in words: what the player said, what it got back, and the prompt that led to it.

// A prompt of more messages than this is shown with a gap, until somebody asks for all of it.
const LONG_PROMPT = 80;

function renderTurn() {
  const { episode, turn } = shown;
  const now = episode.turns[turn];
  $("turn-title").textContent = `Turn ${number(turn)}`;
  $("said").replaceChildren(
    ...(now ? saidIn(now, episode) : [element("p", { class: "caption" }, "Nothing has been recorded yet.")]),
  );
  $("answers").replaceChildren(...(now?.items ?? []).map((item) => answer(item, now)));
  if (now?.choice)
    $("answers").prepend(
      caption(
        now.choice.fallback
          ? `No action was named; the first was played: ${now.choice.action}`
          : `Chosen: ${now.choice.action}`,
        now.choice.fallback,
      ),
    );
  for (const id of ["said", "answers"]) letScroll($(id));
  const calls = (now?.items ?? [])
    .filter(({ call }) => call)
    .map(({ call }) => `${call.name} ${call.is_error ? "failed" : "answered"}`);
  if (!shown.timer) $("announce").textContent = `Turn ${turn}. ${calls.join(", ") || "No call."}`;
}

function saidIn(turn, episode) {
  const { message, usage } = turn;
  if (!message)
    return [
      element(
        "p",
        { class: "caption bad" },
        turn.view ? "No reply came to this prompt." : "The host's agent called; what it said is not on record.",
      ),
    ];
  const text = textOf(message);
  const calls = (message.tool_calls ?? []).map(({ function: { name, arguments: sent } }) => callLine(name, sent));
  const took = turn.seconds === undefined ? "" : `, in ${number(turn.seconds, turn.seconds < 10 ? 1 : 0)} s`;
  const cost = usage ? costOf(usage) + took : null;
  return [
    thoughtsOf(message),
    text ? element("pre", { class: "speech" }, text) : null,
    ...calls,
    !text && !calls.length ? caption("An empty reply.", true) : null,
    cost ? element("p", { class: "small" }, cost) : null,
  ].filter(Boolean);
}

// What a message carries in addition to its words: reasoning, and what its provider wants back unchanged.
function thoughtsOf(message) {
  const items = (message.provider_items ?? []).map((item) => JSON.stringify(item, null, 1));
  const thoughts = [message.reasoning_content, ...items].filter(Boolean);
  if (!thoughts.length) return null;
  const words = element("pre", {}, thoughts.join("\n"));
  return element("details", {}, element("summary", {}, "Reasoning and provider items"), words);
}

function costOf({ reply, overrun, provider }) {
  const more = overrun ? ", more than it was allowed" : "";
  const counted = provider ? `; the provider counted ${number(provider.prompt)} + ${number(provider.reply)}` : "";
  return plural(reply ?? 0, "token") + more + counted;
}

function callLine(name, sent) {
  let plain = sent;
  try {
    plain = Object.values(JSON.parse(sent || "{}"))
      .map((value) => JSON.stringify(value))
      .join(", ");
  } catch {
    // Not JSON: shown as it was written.
  }
  return element(
    "p",
    { class: "call", title: `${name} ${sent}` },
    element("b", {}, name),
    "(",
    element("span", {}, plain),
    ")",
  );
}

function answer({ call, message, by }, turn) {
  if (message)
    return element(
      "article",
      { class: "answer" },
      element("h4", {}, `${message.role} message, by the ${by}`),
      element("pre", {}, textOf(message)),
    );
  const kind = call.is_error
    ? "error"
    : call.manual
      ? "manual"
      : call.observation_step === undefined
        ? "note"
        : "observation";
  const what =
    kind === "observation"
      ? `observation ${number(call.observation_step)}`
      : kind === "error"
        ? `error: ${call.mistake ?? "refused"}`
        : kind;
  const several = turn.items.filter((item) => item.call?.legal).length > 1;
  const look =
    several && call.legal
      ? element("button", { type: "button", onclick: () => goTo(shown.turn, call.step) }, "show the game here")
      : null;
  const score = call.legal
    ? element("span", { class: "small" }, ` reward ${signed(call.reward)}, score ${number(call.score)}`)
    : null;
  const asked = turn.message?.tool_calls ? null : callLine(call.name, call.arguments);
  return element(
    "article",
    { class: `answer ${kind}` },
    element("h4", {}, `${call.name}: ${what}`, score, look),
    asked,
    element("pre", {}, call.text),
    call.picture ? pictureSeen(call.picture) : null,
  );
}

// A picture of the game, as the model was sent it.
function pictureSeen({ sha256, width, height }) {
  const { files, missing } = shown.episode.pictures;
  const size = `${number(width)} × ${number(height)} pixels`;
  if (!files[sha256]) return caption(`A picture of ${size}. ${missing ?? ""}`);
  const src = `data:image/png;base64,${files[sha256]}`;
  return element("img", { class: "seen-picture", src, width, height, alt: `What the model was shown: the game as a picture of ${size}` });
}

// --- Copying ---------------------------------------------------------------------------------------------------------

// The turn as Markdown: what was said, called and answered. A fence is longer than any in the text.
function turnAsMarkdown({ episode, turn }) {
  const { message, items } = episode.turns[turn];
  const fenced = (text) => {
    const longest = Math.max(2, ...[...text.matchAll(/`+/g)].map(([ticks]) => ticks.length));
    const fence = "`".repeat(longest + 1);
    return `${fence}\n${text}\n${fence}`;
  };
  const calls = (message?.tool_calls ?? []).map(({ function: { name, arguments: sent } }) => fenced(`${name} ${sent}`));
  const answers = items.map((item) => fenced(item.call?.text ?? textOf(item.message)));
  const parts = [
    `### ${episode.game}, ${episode.player ?? "unnamed"}, seed ${episode.seed}, turn ${turn}`,
    textOf(message ?? {}).replace(/^/gm, "> "),
    ...calls,
    ...(answers.length ? ["It got back:", ...answers] : []),
  ];
  return `${parts.filter((part) => part.trim() && part !== "> ").join("\n\n")}\n`;
}

// --- The prompt ------------------------------------------------------------------------------------------------------

// The prompt word for word, beside another; made only when somebody has opened it.
function renderPrompt(everything = false) {
  if (!$("prompt").open) return;
  const { episode, turn } = shown;
  const other = between(0, turn + (shown.beside ?? -1), lastTurn());
  $("beside").max = lastTurn();
  $("beside").value = other;
  const parts = promptParts(episode, page.words[episode.prompts], turn) ?? [];
  const changes = difference(parts, promptParts(episode, page.words[episode.prompts], other) ?? []);
  const count = (change) => changes.filter((part) => part.change === change).length;
  const [here, there] = [plural(count("new"), "message"), plural(count("gone"), "message")];
  $("difference").textContent = other === turn ? "" : `${here} only here, ${there} only there.`;
  // What is not in this prompt is shown when somebody has asked for another one beside it.
  const listed = shown.beside === null ? changes.filter((part) => part.change !== "gone") : changes;
  const cards = listed.map((part) => () => messageCard(part));
  const hidden = everything || cards.length <= LONG_PROMPT ? 0 : cards.length - LONG_PROMPT;
  const more = element(
    "button",
    { type: "button", onclick: () => renderPrompt(true) },
    `show ${plural(hidden, "more message")}`,
  );
  const first = hidden ? 2 : 0;
  const list = [
    ...cards.slice(0, first).map((make) => make()),
    hidden ? more : null,
    ...cards.slice(first + hidden).map((make) => make()),
  ];
  const tools = episode.tools.length
    ? element(
        "details",
        { class: "message schema" },
        element("summary", {}, `tool schemas: ${episode.tools.map((tool) => tool.name).join(", ")}`),
        element("pre", {}, JSON.stringify(episode.tools, null, 1)),
      )
    : null;
  $("messages").replaceChildren(...[askedBefore(episode, turn), tools, ...list].filter(Boolean));
  letScroll($("messages"));
}

// The prompt for a summary that came before this one, and what the model answered.
function askedBefore(episode, turn) {
  const asked = requestParts(episode, page.words[episode.prompts], turn);
  if (!asked) return null;
  const { summary } = episode.turns[turn];
  const outcome = !summary ? "no reply came" : summary.empty ? "empty" : summary.cut ? "cut to its cap" : "shown whole";
  const speech = summary ? element("pre", { class: "speech" }, textOf(summary.message)) : null;
  return element(
    "details",
    { class: "message summary" },
    element("summary", {}, `Before this prompt a summary was asked for: ${outcome}`),
    ...[speech, ...asked.map((part) => messageCard(part))].filter(Boolean),
  );
}

// The messages of two prompts in one list: those of both, those that are `new` in the first, those that are `gone`.
// Messages keep their order from prompt to prompt, so each is looked for behind the one that was met before.
function difference(parts, others) {
  const [mine, theirs] = [parts, others].map((list) => list.map(({ message }) => JSON.stringify(message)));
  const here = new Set(mine);
  const list = [];
  let at = 0;
  const gone = (to) => {
    for (; at < to; at += 1) if (!here.has(theirs[at])) list.push({ ...others[at], change: "gone" });
  };
  parts.forEach((part, place) => {
    const met = theirs.indexOf(mine[place], at);
    if (met !== -1) gone(met);
    if (met !== -1) at += 1;
    list.push(met === -1 ? { ...part, change: "new" } : part);
  });
  gone(theirs.length);
  return list;
}

const CHANGES = { new: "new", gone: "not in this prompt" };

function messageCard({ message, turn, marked, what, change }) {
  const from = turn === undefined ? "" : ` of turn ${number(turn)}`;
  const title = element(
    "h3",
    {},
    `${message.role}${message.name ? ` (${message.name})` : ""}${from}`,
    what ? element("span", { class: `tag ${what}` }, what) : null,
    marked ? element("span", { class: "tag marked" }, "marked") : null,
    change ? element("span", { class: `tag ${change}` }, CHANGES[change]) : null,
  );
  const calls = (message.tool_calls ?? []).map(({ function: { name, arguments: sent } }) =>
    element("p", { class: "call" }, element("b", {}, name), ` ${sent}`),
  );
  const text = textOf(message);
  return element(
    "article",
    { class: `message ${message.role}${marked ? " is-marked" : ""} ${change ?? ""}` },
    title,
    thoughtsOf(message),
    text || !calls.length ? element("pre", {}, text) : null,
    message.sent ? element("details", {}, element("summary", {}, "as it is in the record"), element("pre", {}, JSON.stringify(message.sent, null, 1))) : null,
    ...picturesOf(message).map(pictureSeen),
    ...calls,
  );
}
