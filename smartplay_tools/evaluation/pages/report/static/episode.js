"use strict";
// What is said of an episode as a whole: its figures, its rules, where something went wrong.

function describeEpisode(episode) {
  $("player").classList.toggle("thread", isThread(episode));
  if (isThread(episode)) {
    const { chips, facts } = describeThread(episode);
    $("episode-title").textContent = document.title = episode.game;
    listChips(chips);
    $("rules").replaceChildren(factList(facts));
    drawMistakes(episode);
    return;
  }
  const result = episode.result;
  $("episode-title").replaceChildren(
    `${episode.game} `,
    element("span", { class: "by" }, `played by ${episode.player ?? "an unnamed player"}`),
  );
  document.title = `${episode.game}, ${episode.player ?? "unnamed"}, seed ${episode.seed}`;
  const isPlayed = !result && Boolean(served?.playing);
  const end = isPlayed ? "figures so far" : result ? result.end_reason.replaceAll("_", " ") : (episode.error ?? "no end is recorded yet");
  const so = result ?? soFar(episode);
  const chips = [
    isPlayed ? ["being played", end, "status running"] : [episode.status, end, `status ${episode.status}`],
    [
      "score",
      number(so.score) +
        (so.normalized_score === null ? "" : ` (${percent(so.normalized_score)} of a human's)`),
    ],
    [
      "steps",
      `${number(so.steps)} of ${number(episode.rollout)}`,
    ],
    ["turns", number(episode.turns.length)],
    ["prompt tokens", number(so.tokens.prompt)],
    ["prefix-stable", so.tokens.prompt ? percent(so.tokens.prefix / so.tokens.prompt) : "–"],
    ["mistakes", number(result ? page.mistakes.reduce((sum, name) => sum + result[name], 0) : mistakes(episode).length)],
    ["seed", String(episode.seed)],
    ...(episode.trial === null ? [] : [["trial", number(episode.trial)]]),
    ...(episode.cost === null ? [] : [["cost", `$${number(episode.cost, 4)}`]]),
  ];
  listChips(chips);
  describeRules(episode);
  drawMistakes(episode);
}

function listChips(chips) {
  const made = ([name, value, kind]) => element("div", { class: `chip ${kind ?? ""}` }, element("dt", {}, name), element("dd", {}, value));
  $("chips").replaceChildren(...chips.map(made));
}

function factList(facts) {
  const rows = Object.entries(facts).map(([name, value]) => element("div", {}, element("dt", {}, name), element("dd", {}, value)));
  return element("dl", { class: "facts" }, rows);
}

// The figures of an episode that has no result yet, as its turns add up to them.
function soFar(episode) {
  const { score = 0, step = 0 } = episode.facts.at(-1) ?? {};
  const views = episode.turns.flatMap(({ request, view }) => [request, view]).filter(Boolean);
  const sum = (name) => views.reduce((total, view) => total + view[name], 0);
  const tokens = { prompt: sum("tokens"), prefix: sum("prefix_tokens") };
  return { score, normalized_score: null, steps: step, tokens };
}

function describeRules(episode) {
  const { check } = episode;
  const proof =
    check.differ === null
      ? `${plural(check.prompts, "prompt")}; too many to check each of them here, \`smartplay-tools replay\` does`
      : check.differ.length
        ? `the prompts of turns ${check.differ.join(", ")} are NOT what the record's sha256 says`
        : `all ${plural(check.prompts, "prompt")} rebuilt and found to have the record's sha256`;
  const facts = {
    budget: typeset(Object.values(episode.limits).join(", ")),
    manual: episode.manual,
    "calls in one message": episode.batch,
    protocol: episode.protocol,
    "context owned by": episode.context,
    engine: episode.engine ?? "the only one",
    options: JSON.stringify(episode.options),
    tokenizer: episode.tokenizer,
    prompts: proof,
    "differs from the paper in":
      Object.entries(episode.result?.deviations ?? {})
        .map(([name, { paper, played }]) => `${name}: ${JSON.stringify(played)} for ${JSON.stringify(paper)}`)
        .join("; ") || "nothing that is recorded",
    versions: Object.entries(episode.result?.versions ?? {})
      .map((pair) => pair.join(" "))
      .join(", "),
  };
  const failure = episode.error
    ? [
        element("p", { class: "caption bad" }, episode.error),
        episode.traceback ? element("pre", {}, episode.traceback) : null,
      ]
    : [];
  $("rules").replaceChildren(factList(facts), ...failure.filter(Boolean));
}

// Marks under the slider where something went wrong.
function drawMistakes(episode) {
  const wrong = mistakes(episode);
  const count = Math.max(1, lastTurn());
  const marks = wrong.map((turn) =>
    shape("rect", { class: "mistake", x: (1000 * turn) / count - 1.5, y: 0, width: 3, height: 8 }),
  );
  const strip = picture(1000, 8, wrong.length ? `Mistakes in ${plural(wrong.length, "turn")}` : "No mistakes", marks);
  strip.setAttribute("preserveAspectRatio", "none");
  $("mistakes").replaceChildren(strip);
  $("next-mistake").disabled = wrong.length === 0;
}

function mistakes(episode) {
  return episode.turns.flatMap((turn, at) => (isMistaken(turn) ? [at] : []));
}

function isMistaken(turn) {
  if (turn.beside) return isOver(turn);
  const idle = turn.items.some(({ by }) => by === "library");
  return idle || (!turn.message && turn.view) || turn.choice?.fallback || turn.items.some(({ call }) => call?.is_error);
}
