"use strict";
// Why a turn was in a prompt or not: what it needed, what was free, what would have kept it, and what it said.

// Ask about a turn, which a click on the band does.
function askAbout(turn) {
  shown.asked_about = turn;
  $("why").open = true;
  renderWhy();
  $("why").scrollIntoView({ block: "nearest" });
}

function renderWhy() {
  const { episode, turn: now } = shown;
  const units = isThread(episode) ? episode.turns[now].view.units : null;
  const count = units?.length ?? now;
  const askable = episode.protocol !== "paper" && count > 0;
  $("why").hidden = !askable;
  if (!askable || !$("why").open) return;
  const turn = between(0, shown.asked_about ?? newestGone(episode, now) ?? count - 1, count - 1);
  $("why-turn").max = count - 1;
  $("why-turn").value = turn;
  if (units) {
    $("why-reason").textContent = `Unit ${turn} of the conversation, as it was given, was ${UNIT_STATES[episode.turns[now].view.states[turn]]}.`;
    $("why-said").replaceChildren(...units[turn].map((at) => messageCard({ message: episode.parts[at] })));
    return;
  }
  const { message, items } = episode.turns[turn];
  $("why-reason").textContent = whyWords(episode, now, turn);
  $("why-go").onclick = () => goTo(turn);
  const parts = [{ message }, ...items.map((item) => ({ message: messageOf(episode.turns[turn], item, page.words[episode.prompts]) }))];
  $("why-said").replaceChildren(...parts.filter((part) => part.message).map((part) => messageCard({ ...part, turn })));
}

// The newest of the turns that a prompt did not show.
function newestGone(episode, now) {
  const at = visibility(episode, now).states.lastIndexOf("dropped");
  return at === -1 ? null : at;
}

function whyWords(episode, now, turn) {
  const { states } = visibility(episode, now);
  const size = episode.turns[turn].size;
  const tokens = (count) => (size ? `, ${plural(count, "token")}` : "");
  const isBare = stepOf(episode, turn) < (episode.turns[now].view.words ?? 0);
  const view = episode.turns[now].view;
  const isPlain = episode.turns[turn].items.some((_, item) => isLeftOut(episode, view, turn, item));
  const newest = `only the newest ${plural(episode.budget.newest_pictures ?? 0, "picture")} of the conversation were shown`;
  const words = {
    seen: () =>
      isPlain ? `Turn ${turn} was in this prompt without ${isBare ? "the words of its reply and " : ""}its picture: ${newest}.` :
      isBare
        ? `Turn ${turn} was in this prompt without the words and the reasoning of its reply, which are too old.`
        : `Turn ${turn} was in this prompt in full${tokens(size?.[0])}.`,
    marked: () =>
      isPlain ? `Turn ${turn} was in this prompt, but ${newest}, so a marker stood in the place of its own.` :
      `Turn ${turn} was in this prompt, but what it showed is older than the history of ` +
      `${plural(episode.budget.history, "step")}, so a marker stood in its place${tokens(size?.[1])}` +
      `${size ? ` instead of ${number(size[0])}` : ""}.`,
    notes: () => `Turn ${turn} was kept for the notes in it; a marker stood in place of each of its observations.`,
    pinned: () => `A strategy had pinned turn ${turn}; a marker stood in place of each of its observations.`,
    dropped: () => `${leftWords(episode, now, turn)}${summaryIn(episode, episode.turns[now].view) ? " A summary stood in its place." : ""}`,
  };
  return words[states[turn]]();
}

function leftWords(episode, now, turn) {
  const left = episode.departures?.findLast((gone) => gone.turn === turn && gone.prompt <= now);
  if (!left) return `Turn ${turn} was not in this prompt.`;
  const { prompt, reason, needs, age, free, keeps } = left;
  const { history, prompt_tokens: cap, slack } = episode.budget;
  const begin = `Turn ${turn} left before prompt ${prompt}: `;
  if (reason === "history")
    return (
      `${begin}what it showed was ${plural(age, "step")} old, and the history is ${number(history)}. ` +
      `With a history of ${number(keeps)} it would have stayed${cap === null ? "" : ", if the cap had had room for it"}.`
    );
  if (reason === "pin")
    return `${begin}it had been pinned, as that with the notes or with the current observation, or by a strategy, and no longer was.`;
  if (reason === "choice") return `${begin}the strategy ${episode.budget.strategy} did not choose it.`;
  if (reason === "block")
    return `${begin}older turns had to go, and with a slack of ${slack} a window gives up a block of turns at once, so that it then stands still for a while.`;
  if (slack > 0)
    return (
      `${begin}the window was full. With all its turns that prompt needed ${number(keeps)} tokens of ${number(cap)}, ` +
      `and with a slack of ${slack} a full window gives up a block of turns at once.`
    );
  const room = free >= 0 ? `${number(free)} of ${number(cap)} were free` : "newer turns did not fit either";
  return `${begin}it needed ${plural(needs, "token")}, and ${room}. With a cap of ${number(keeps)} it would have stayed.`;
}
