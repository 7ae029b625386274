"use strict";
// A word over all prompts: where it was written, and which prompts could still see it, until it was forgotten.

// For each turn, whether its prompt has the word. A prompt is made of parts, so each part is searched only once.
function promptsWith(episode, word) {
  const has = (text) => text.toLowerCase().includes(word);
  const whole = (at) => (promptParts(episode, page.words[episode.prompts], at) ?? []).some(({ message }) => textsOf(message).some(has));
  if (episode.protocol === "paper" || isThread(episode)) return episode.turns.map((_, at) => whole(at));
  const inHead = has(episode.head.map(textOf).join("\n"));
  const marker = has(page.words[episode.prompts].observation_left);
  const written = writtenIn(episode, has);
  // How many of the turns before each one have the word, in what no view replaces and in observations.
  const sums = { kept: running(written.map(({ kept }) => kept)), seen: running(written.map(({ seen }) => seen.length > 0)) };
  return episode.turns.map(({ view, head }, at) => {
    if (!view) return false;
    // A strategy that changes what turns say is not foreseen here: its prompts are searched as they are.
    if (view.words || view.pictures || view.texts?.length || view.hidden?.length || view.messages) return whole(at);
    const manual = at > 0 ? (episode.facts[at - 1].manual ?? "") : "";
    if ((head ? has(head.map(textOf).join("\n")) : inHead) || has(manual) || has(summaryIn(episode, view))) return true;
    const masks = view.oldest !== undefined || Boolean(view.masked?.length);
    if (masks && marker) return true;
    return view.turns.some(([first, last]) => {
      const count = (sum) => sum[last + 1] - sum[first];
      if (count(sums.kept)) return true;
      if (!count(sums.seen)) return false;
      return !masks || stillSeen(episode, view, written, first, last);
    });
  });
}

// Whether an observation with the word is among those that a view did not replace by a marker.
function stillSeen(episode, view, written, first, last) {
  const marked = new Set(markedResults(episode, view).map(([turn, item]) => `${turn}.${item}`));
  for (let at = first; at <= last; at += 1) {
    if (written[at].seen.some(([item]) => !marked.has(`${at}.${item}`))) return true;
  }
  return false;
}

// What each turn wrote with the word: `kept` in what is never replaced, `seen` in results that age, as [item, date].
function writtenIn(episode, has) {
  return episode.turns.map(({ message, items, fresh }) => {
    if (fresh) return { kept: fresh.some((at) => textsOf(episode.parts[at]).some(has)), seen: [] };
    const said = message ? textsOf(message) : [];
    const dates = items.map(({ call }) => call?.date ?? call?.observation_step);
    const observations = dates.flatMap((date, at) => (date === undefined ? [] : [[at, date]]));
    const others = items.filter(({ call }, at) => dates[at] === undefined && !call?.manual);
    const kept = [...said, ...others.map(({ call, message: other }) => call?.text ?? textOf(other))].some(has);
    return { kept, seen: observations.filter(([at]) => has(items[at].call.text)) };
  });
}

// The texts of a message: its words, and the arguments of its calls.
function textsOf(message) {
  return [textOf(message), ...(message.tool_calls ?? []).map((call) => call.function.arguments)];
}

function running(flags) {
  const sums = [0];
  for (const flag of flags) sums.push(sums.at(-1) + (flag ? 1 : 0));
  return sums;
}

function renderSearch() {
  if (!$("search").open || !shown.episode) return;
  const { episode } = shown;
  const word = $("word").value.trim().toLowerCase();
  $("word-strip").replaceChildren();
  $("word-count").textContent = "";
  if (!word) return;
  const seen = promptsWith(episode, word);
  const written = writtenIn(episode, (text) => text.toLowerCase().includes(word)).map(({ kept, seen: there }) => kept || there.length > 0);
  $("word-count").textContent = wordSentence(word, written, seen);
  const width = 1000 / Math.max(1, seen.length);
  const marks = (flags, y, kind) =>
    flags.flatMap((flag, at) => (flag ? [shape("rect", { class: kind, x: at * width, y, width: Math.max(2, width - 0.5), height: 14 })] : []));
  const strip = picture(1000, 36, $("word-count").textContent, marks(written, 0, "written"), marks(seen, 18, "cell seen"));
  strip.setAttribute("preserveAspectRatio", "none");
  strip.addEventListener("click", (event) => {
    const box = strip.getBoundingClientRect();
    goTo(Math.floor(((event.clientX - box.left) / box.width) * seen.length));
  });
  const names = element("p", { class: "small" }, "above: turns that wrote it; below: turns whose prompt had it; click to go there");
  $("word-strip").replaceChildren(strip, names);
}

function wordSentence(word, written, seen) {
  const count = (flags) => flags.filter(Boolean).length;
  if (!count(written) && !count(seen)) return `No turn has written “${word}”, and no prompt had it.`;
  const by = `${plural(count(written), "turn")} wrote it, ${count(seen)} of ${plural(seen.length, "prompt")} had it`;
  const last = seen.lastIndexOf(true);
  const gone = last >= 0 && last < seen.length - 1 ? `; after turn ${number(last)} no prompt had it any more` : "";
  return `${by}${gone}.`;
}
