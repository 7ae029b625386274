"use strict";
// A thread of a context manager, which the player shows as an episode without a game: a prompt stands in a turn's place.

const isThread = (episode) => episode.protocol === "thread";

// What each prompt says in short becomes whole: the states of its units, the messages of each, the parts it showed.
function openThread(episode) {
  let units = [];
  for (const turn of episode.turns) {
    const { view } = turn;
    view.states = view.states.flatMap(([state, count]) => Array(count).fill(state));
    units = view.units = [...units.slice(0, view.same), ...view.added];
    view.shown = view.shown.flatMap(([first, last]) => Array.from({ length: last - first + 1 }, (_, at) => first + at));
    turn.fresh = view.added.flat();
  }
}

// The messages of a prompt; those that were not given so are tagged.
function threadParts(episode, { beside, view }) {
  const given = new Set([...view.units.flat(), ...view.shown.slice(0, view.head)]);
  const sent = view.shown.map((at) => ({ message: episode.parts[at], what: given.has(at) ? undefined : "shortened" }));
  return [...beside.map((content) => ({ message: { role: "beside the messages", content } })), ...sent];
}

const UNIT_STATES = { seen: "in this prompt in full", marked: "in this prompt with a line in place of results that left the history", cut: "in this prompt, shortened", dropped: "not in this prompt: it did not fit, or left the history" };

function threadSentence(episode, { states, repaired }) {
  const words = { seen: "showed", marked: "masked the results of", cut: "shortened", dropped: "left out" };
  const parts = Object.entries(words).flatMap(([state, verb]) => {
    const which = inWords(states, state, "unit");
    return which ? [`${verb} ${which}`] : [];
  });
  const mended = repaired ? `; ${plural(repaired, "message")} repaired` : "";
  return `The prompt ${parts.join("; ") || "showed the head alone"}${mended}. A unit is a reply with its results, or one other message.`;
}

const isOver = ({ view }) => view?.reported > view?.cap && view.cap !== null;

// The provider's count beside ours.
function reportedWords({ reported, tokens, cap }) {
  if (reported === null) return "The provider's count of this prompt is not on record.";
  const far = `${number(Math.abs(reported - tokens))} ${reported >= tokens ? "more" : "less"} than here`;
  const over = cap !== null && reported > cap ? ` It is ${number(reported - cap)} OVER THE CAP by that count.` : "";
  return `The provider counted ${plural(reported, "token")}, ${far}.${over}`;
}

function describeThread(episode) {
  const { figures, settings, check, refusals } = episode;
  const counted = figures.counted ? `${number(figures.over)} of ${number(figures.counted)}` : "nothing reported";
  const most = figures.most_above === null ? [] : [["most above our count", number(figures.most_above)], ["its tokens to ours", number(figures.ratio, 3)]];
  return {
    chips: [
      ["prompts", number(figures.prompts)],
      ["prompt tokens", number(figures.tokens)],
      ["largest", `${number(figures.largest)}${figures.cap === null ? "" : ` of ${number(figures.cap)}`}`],
      ["prefix-stable", figures.tokens ? percent(figures.prefix_tokens / figures.tokens) : "–"],
      ["refused", number(figures.refusals)],
      ["over by the provider's count", counted, figures.over ? "failed" : ""],
      ...most,
    ],
    facts: {
      ...Object.fromEntries(Object.entries(settings).map(([name, value]) => [name.replaceAll("_", " "), JSON.stringify(value)])),
      ...(refusals.length ? { refused: refusals.map((parts) => Object.entries(parts).map((pair) => pair.join(" ")).join(", ")).join("; ") } : {}),
      prompts: check.differ.length
        ? `prompts ${check.differ.join(", ")} are NOT what the record's sha256 says`
        : `all ${plural(check.prompts, "prompt")} rebuilt and found to have the record's sha256`,
    },
  };
}

// Marks of the provider's counts over the columns of a prompt's parts.
function reportedMarks(episode, x, y) {
  return episode.turns.flatMap((turn, at) =>
    Number.isInteger(turn.view?.reported) ? [shape("circle", { class: `reported${isOver(turn) ? " over" : ""}`, cx: x.middle(at), cy: y(turn.view.reported), r: 2.5 })] : [],
  );
}
