"use strict";
// Prompts, word for word. The page holds turns, and for each prompt which turns it showed and which results it marked;
// here they become the messages that were sent. A test compares every one of them with what the library rebuilds.

function textOf(message) {
  const content = message.content;
  if (content === null || content === undefined) return "";
  if (typeof content === "string") return content;
  return content.map((part) => (typeof part === "string" ? part : (part.text ?? part.refusal))).join("");
}

// The pictures of the game that a message names.
function picturesOf({ content }) {
  return Array.isArray(content) ? content.filter(({ type, sha256 }) => type === "image" && sha256) : [];
}

// What each turn added to the running facts: the manual that has been read, and how far the game has come.
function runningFacts(episode) {
  let [manual, step, score, reward, spent, errors] = [null, 0, 0, 0, 0, 0];
  return episode.turns.map((turn) => {
    for (const { call } of turn.items) {
      if (!call) continue;
      if (call.manual === true) manual = call.text; // it became a part of the head, and does not with a compactor
      if (call.legal) {
        step = call.step;
        score = call.score;
        reward += call.reward;
      }
      if (call.is_error) errors += 1;
    }
    if (turn.pinned !== undefined) manual = turn.pinned;
    spent += turn.questions ?? 0;
    // A reply that never came is not charged, whatever its attempts cost.
    if (Number.isInteger(turn.usage?.reply)) spent += turn.view.tokens + turn.usage.reply;
    if (turn.summary) spent += turn.request.tokens + turn.summary.usage.reply;
    return { manual, step, score, reward, spent, errors };
  });
}

// The prompt that asked for a summary before a turn; null where none was asked for. It shows what the prompt of the
// previous turn showed, without the turns that stay, and a question.
function requestParts(episode, words, number) {
  const view = episode.turns[number]?.request;
  if (!view) return null;
  const question = { role: "user", content: episode.summary_request };
  return [...windowParts(episode, words, number - 1, view), { message: question }];
}

// The text of the summary that a prompt showed; empty if it showed none.
function summaryIn(episode, view) {
  return view.summary ? episode.summaries[view.summary - 1] : "";
}

// The results of a view whose observation was masked, as [turn, item]: listed, or those that are older than the view's
// oldest observation. Of the turn that a strategy has pinned all are, and of those that a strategy of the user's has
// masked.
function markedResults(episode, view) {
  if (view.oldest === undefined) return view.masked ?? [];
  const isHidden = (at) => at === pinnedIn(view) || isWithin(view.hidden ?? [], at);
  return itemsIn(episode, view).filter(([at, item, { call }]) => {
    const isEmpty = isLeftOut(episode, view, at, item) && call.text.startsWith(page.words[episode.prompts].picture_shown);
    const isReplaced = call?.observation_step !== undefined && view.messages && !isWithin(view.messages, numberOf(episode, at) + 1 + item);
    return isEmpty || isReplaced || (call?.date ?? call?.observation_step) < (isHidden(at) ? Infinity : view.oldest);
  });
}

// The items of the turns of which a prompt showed something, as [turn, place, item].
function itemsIn(episode, { turns }) {
  const numbers = turns.flatMap(([first, last]) => Array.from({ length: last - first + 1 }, (_, place) => first + place));
  return numbers.flatMap((at) => episode.turns[at].items.map((item, place) => [at, place, item]));
}

// Whether a number is in one of these ranges, among which there can be messages.
const isWithin = (ranges, number) => ranges.some((each) => Array.isArray(each) && each[0] <= number && number <= each[1]);

// The number of a turn's reply among the messages after the system message, as a compactor's record counts them.
function numberOf(episode, turn) {
  return episode.turns.slice(0, turn).reduce((sum, { items }) => sum + 1 + items.length, episode.head.length - 1);
}

// Whether the picture of a result was left out of a prompt, which shows the newest of the conversation's only.
function isLeftOut(episode, view, at, item) {
  if (!view.pictures) return false;
  if (!episode.picture_numbers) {
    const pictured = itemsIn(episode, { turns: [[0, episode.turns.length - 1]] }).filter(([, , { call }]) => call?.picture);
    episode.picture_numbers = new Map(pictured.map(([turn, place], number) => [`${turn}.${place}`, number]));
  }
  return episode.picture_numbers.get(`${at}.${item}`) < view.pictures;
}

// The messages of the prompt that led to a turn, with the turn of each and whether it was marked; null without a prompt.
function promptParts(episode, words, number) {
  const view = episode.turns[number]?.view;
  if (!view) return null;
  if (isThread(episode)) return threadParts(episode, episode.turns[number]);
  return episode.protocol === "paper"
    ? paperMessages(episode, words, number, view).map((message) => ({ message }))
    : windowParts(episode, words, number, view);
}

// How many pictures a prompt had: those of the results that it showed, neither masked nor left out.
function picturesIn(episode, view) {
  const masked = new Set(markedResults(episode, view).map(([turn, item]) => `${turn}.${item}`));
  const isShown = ([at, item, { call }]) => call?.picture && !masked.has(`${at}.${item}`) && !isLeftOut(episode, view, at, item);
  return itemsIn(episode, view).filter(isShown).length;
}

function windowParts(episode, words, number, view) {
  const manual = number > 0 ? episode.facts[number - 1].manual : null;
  const plain = episode.turns[number].head ?? episode.head; // of its own where the host has changed its part
  const head = manual === null ? plain : withManual(plain, manual);
  const parts = head.map((message) => ({ message }));
  const summary = summaryIn(episode, view);
  const brief = { message: { role: "user", content: `${words.summary}\n${summary}` }, what: "summary" };
  // First turns that stay, and are not part of the run, stand before the summary.
  const front = view.turns.slice(0, -1).filter(([, last]) => last < (view.anchors ?? 0)).length;
  const marks = new Set(markedResults(episode, view).map(([turn, item]) => `${turn}.${item}`));
  const texts = new Map(view.texts ?? []);
  const turnParts = (at) => {
    const turn = episode.turns[at];
    const reply = turn.sent ?? turn.message;
    const message = stepOf(episode, at) < (view.words ?? 0) ? bareReply(reply) : reply;
    const said = { message, turn: at, what: at === view.notes ? "notes" : undefined };
    const answers = turn.items.map((item, index) => {
      const marked = marks.has(`${at}.${index}`);
      const message = messageOf(turn, item, words);
      const plain = isLeftOut(episode, view, at, index) ? { ...message, content: item.call.text } : message;
      return { message: marked ? { ...message, content: words.observation_left } : plain, turn: at, marked };
    });
    return [said, ...answers];
  };
  if (view.messages) {
    // A compactor has rewritten the history: rows of messages by their numbers, and messages of its own.
    const all = [...parts.slice(1), ...episode.turns.slice(0, number).flatMap((_, at) => turnParts(at))];
    const shown = (piece) => (Array.isArray(piece) ? all.slice(piece[0], piece[1] + 1) : { message: piece, what: "strategy" });
    return [parts[0], ...view.messages.flatMap(shown)];
  }
  for (const [place, [first, last]] of view.turns.entries()) {
    if (summary && place === front) parts.push(brief);
    for (let at = first; at <= last; at += 1) {
      if (texts.has(at)) parts.push({ message: { role: "user", content: texts.get(at) }, what: "strategy" });
      parts.push(...turnParts(at));
    }
  }
  return parts;
}

// The step of a turn: the newest observation at its end.
function stepOf(episode, at) {
  episode.steps ??= [];
  for (let number = episode.steps.length; number <= at; number += 1) {
    const shown = episode.turns[number].items.map(({ call }) => call?.observation_step ?? 0);
    episode.steps.push(Math.max(episode.steps[number - 1] ?? 0, ...shown));
  }
  return episode.steps[at];
}

// A reply with its calls alone, where it has calls, and words or reasoning with them.
function bareReply(message) {
  const isWordy = textOf(message) || message.reasoning_content || message.provider_items?.length;
  if (!message.tool_calls?.length || !isWordy) return message;
  const { role, name, tool_calls } = message;
  return { role, content: null, ...(name ? { name } : {}), tool_calls };
}

// Once read, the manual is the last part of the system message.
function withManual(head, manual) {
  const at = head.findIndex((message) => message.role === "system" || message.role === "developer");
  const system = { ...head[at], content: `${textOf(head[at])}\n\n${manual}` };
  return [...head.slice(0, at), system, ...head.slice(at + 1)];
}

function messageOf(turn, item, words) {
  if (item.message) return item.message;
  const { manual, text, picture, position } = item.call;
  return {
    role: "tool",
    content: picture ? [{ type: "text", text }, { type: "image", ...picture }] : manual === true ? words.manual_is_above : text,
    tool_call_id: turn.message.tool_calls[position].id,
  };
}

// The paper's protocol makes every prompt anew: manual, history, observation, question.
function paperMessages(episode, words, number, view) {
  const system = [words.system, ...episode.head.slice(1).map(textOf)];
  const past = [];
  for (let step = view.first; step < view.step; step += 1) {
    past.push(`Player Observation Step ${step}:\n${episode.observations[step]}`);
  }
  if (past.length) {
    const title = `Most recent ${past.length} steps of the player's in-game observation:`;
    system.push([title, ...past].join("\n\n").trim());
  }
  system.push(words.observation + episode.observations[view.step]);
  const messages = system.map((content) => ({ role: "system", content }));
  messages.push({ role: "user", content: words.question });
  if (view.question === 2) {
    messages.push({ role: "assistant", content: textOf(episode.turns[number - 1].message) });
    messages.push({ role: "user", content: words.choice });
  }
  return messages;
}

// The observations by the original's count of steps, in the paper's protocol: those up to the reset's, then one for
// each action.
function observationsOf(episode) {
  const texts = [...episode.first_observations];
  for (const turn of episode.turns) {
    for (const { call } of turn.items) if (call) texts.push(call.text);
  }
  return texts;
}

// An episode out of the page, with what is worked out once when it is opened.
async function openEpisode(key) {
  const { pack } = page.episodes.find((listed) => listed.key === key);
  const episode = (await unpack(`pack-${pack}`))[key];
  episode.turns = rowsOf(episode.turns);
  if (isThread(episode)) openThread(episode);
  episode.facts = runningFacts(episode);
  episode.summaries = episode.turns.flatMap(({ summary }) => (summary ? [summary.text] : []));
  if (episode.protocol === "paper") episode.observations = observationsOf(episode);
  if (episode.drawing.changes) {
    let now = {};
    episode.drawing.states = episode.drawing.changes.map((change) => (now = { ...now, ...change }));
  }
  return episode;
}
