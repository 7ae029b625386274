"use strict";
// Episodes side by side, moved through together step by step: games, actions, observations, what each saw, scores.

// The most that stand side by side.
const MOST_COMPARED = 4;

const compared = { keys: [], episodes: [], names: [], common: "", step: 0 };

// The address `#compare=KEY&with=KEY&step=N` shows two episodes, or more with further `with`; returns whether it does.
async function showComparison(asked) {
  const keys = [asked.get("compare"), ...asked.getAll("with")].slice(0, MOST_COMPARED);
  const isShown = (key) => page.episodes.some((episode) => episode.key === key);
  $("compare").hidden = keys.length < 2 || !keys.every(isShown);
  if ($("compare").hidden) return false;
  stop();
  if (keys.join("\n") !== compared.keys.join("\n")) {
    compared.keys = keys;
    const episodes = await Promise.all(keys.map(openEpisode));
    if (keys !== compared.keys) return true; // another episode was opened meanwhile
    compared.episodes = episodes.map((episode) => ({ ...episode, steps: stepsOf(episode) }));
    nameThem();
    describeComparison();
  }
  const wasHidden = !$("run").hidden || !$("player").hidden;
  $("run").hidden = $("player").hidden = true;
  goToStep(Number.parseInt(asked.get("step") ?? "0", 10) || 0);
  if (wasHidden) takeFocus($("compare-title"));
  return true;
}

// What was played at each step, from 1: what was said, called and answered, and the score after it.
function stepsOf(episode) {
  const steps = [];
  episode.turns.forEach((turn, number) => {
    for (const { call } of turn.items) {
      if (call?.legal) steps[call.step - 1] = { call, turn: number, said: textOf(turn.message ?? {}) };
    }
  });
  return steps;
}

function lastStep() {
  return Math.max(...compared.episodes.map(({ steps }) => steps.length));
}

function goToStep(step) {
  compared.step = between(0, step, lastStep());
  try {
    if (location.protocol !== "about:") history.replaceState(null, "", `${comparisonOf(compared.keys)}&step=${compared.step}${modes()}`);
  } catch {
    // Safari refuses more than a hundred of these in half a minute; the address then lags behind.
  }
  $("compare-slider").max = lastStep();
  $("compare-slider").value = compared.step;
  $("compare-place").textContent = `step ${number(compared.step)} of ${number(lastStep())}`;
  $("compare-sides").replaceChildren(...compared.episodes.map(sideOf));
  letScroll($("compare-sides"));
  renderBands();
  renderScores();
}

// The address of some episodes side by side.
function comparisonOf(keys) {
  const [one, ...others] = keys.map(encodeURIComponent);
  return `#compare=${one}&${others.map((key) => `with=${key}`).join("&")}`;
}

// What each of them could see when it played the step; a click goes to the turn there.
function renderBands() {
  document.querySelectorAll("#compare-sides .side-band").forEach((box, at) => {
    const episode = compared.episodes[at];
    const turn = turnAt(episode);
    const view = episode.turns[turn]?.view;
    if (!view) return;
    const chart = element("div");
    box.replaceChildren(chart, element("p", { class: "small" }, `${plural(view.tokens, "token")}. ${sentence(episode, turn)}`));
    band(chart, episode, turn, (past) => (location.hash = `#episode=${encodeURIComponent(episode.key)}&turn=${past}`));
    if (view.parts) box.append(partsBar(view.parts, "This prompt"));
  });
}

// The turn that played the step that is shown.
function turnAt({ steps }) {
  return steps[Math.min(compared.step, steps.length) - 1]?.turn ?? 0;
}

// --- The episodes ----------------------------------------------------------------------------------------------------

// What they have in common, and a name for each of what differs: run, player, budget, game, seed.
function nameThem() {
  const { asked } = compared.episodes[0];
  const varied = Object.keys(asked).filter((name) => areDifferent(compared.episodes.map((episode) => episode.asked[name])));
  const facts = compared.episodes.map((episode) => [
    episode.run ?? "",
    episode.player ?? "unnamed",
    budgetOf(episode, varied),
    episode.game,
    `seed ${episode.seed}`,
    episode.trial === null ? "" : `trial ${episode.trial}`,
  ]);
  const differs = facts[0].map((_, at) => areDifferent(facts.map((list) => list[at])));
  const words = (episode, wanted) => facts[episode].filter((fact, at) => fact && differs[at] === wanted).join(", ");
  compared.common = words(0, false);
  compared.names = compared.keys.map((key, at) => words(at, true) || key);
}

// How an episode's budget differs from the others'; defaults are named only where nothing else differs.
function budgetOf({ asked }, varied) {
  const own = varied.filter((name) => asked[name] !== page.usual[name]);
  const named = own.length ? own : varied.includes("beyond_history") ? ["beyond_history"] : varied;
  return typeset(named.map((name) => asked[name]).join(", "));
}

function areDifferent(values) {
  return values.some((value) => value !== values[0]);
}

function sideOf(episode, at) {
  const step = Math.min(compared.step, episode.steps.length);
  const played = step > 0 ? episode.steps[step - 1] : null;
  const drawn = draw(episode, step, page.textures);
  const address = `#episode=${encodeURIComponent(episode.key)}&turn=${turnAt(episode)}`;
  const over = compared.step > episode.steps.length ? ` (it ended at step ${number(episode.steps.length)})` : "";
  return element(
    "section",
    { class: `card side side${at}`, "aria-label": compared.names[at] },
    element("h2", {}, element("a", { href: address }, compared.names[at])),
    element("p", { class: "small" }, `after step ${number(step)}, score ${number(played?.call.score ?? 0)}${over}`),
    element("div", { class: "side-game" }, drawn.length ? drawn : caption("There is no picture of this game.")),
    element("div", { class: "side-band" }),
    played?.said ? element("pre", { class: "speech" }, played.said) : null,
    played ? callLine(played.call.name, played.call.arguments) : null,
    played ? element("pre", { class: "side-answer" }, played.call.text) : caption("Nothing has been played yet."),
  );
}

function describeComparison() {
  document.title = `Side by side: ${compared.names.join(" and ")}`;
  const [first, sight] = [firstDifference(), firstDifferenceInSight()];
  const part = first ? `They part at step ${number(first)}.` : "They play the same actions and see the same observations.";
  const see = sight ? ` From step ${number(sight)} on their prompts do not reach equally far back.` : "";
  $("compare-lead").textContent = `${compared.common}. ${part}${see}`;
  $("compare-difference").disabled = !first;
  const head = element("tr", {}, element("th", { scope: "col" }, "figure"), ...compared.names.map((name) => element("th", { scope: "col" }, name)));
  const rows = factsOf(...compared.episodes).map(([name, ...values]) =>
    element(
      "tr",
      { class: areDifferent(values) ? "differs" : "" },
      element("th", { scope: "row" }, name),
      ...values.map((value) => element("td", { class: "rules" }, value)),
    ),
  );
  $("compare-facts").replaceChildren(element("thead", {}, head), element("tbody", {}, rows));
}

// The first step at which actions or observations are not the same; null if there is none.
function firstDifference() {
  return firstStep((episode, at) => `${actionAt(episode, at)}\n${episode.steps[at]?.call.text}`);
}

// The first step at which they did not all have the same number of observations in sight.
function firstDifferenceInSight() {
  return firstStep((episode, at) => episode.turns[episode.steps[at]?.turn]?.view?.shown_steps);
}

function firstStep(fact) {
  for (let at = 0; at < lastStep(); at += 1) {
    if (areDifferent(compared.episodes.map((episode) => fact(episode, at)))) return at + 1;
  }
  return null;
}

// The action as the game knows it, where the game was played again; else as it was sent.
function actionAt({ drawing, steps }, at) {
  const action = drawing.actions?.[at];
  return action === undefined ? steps[at]?.call.arguments : drawing.names[action];
}

// What was asked for, then what came of it; the rules only where they differ.
function factsOf(...episodes) {
  const limit = (value) => (value === null || value === undefined ? "no limit" : String(value));
  const of = (name, value) => [name, ...episodes.map(value)];
  const figures = [
    of("end", ({ result, status }) => result?.end_reason.replaceAll("_", " ") ?? status),
    of("score", ({ result }) => number(result?.score)),
    of("steps", ({ steps }) => number(steps.length)),
    of("turns", ({ turns }) => number(turns.length)),
    of("prompt tokens", ({ result }) => number(result?.tokens.prompt)),
    ...page.parts.flatMap((part, at) => {
      const row = of(`tokens of ${page.partWords[part]}`, (episode) => number(partsInAll(episode)?.[at]));
      return row.slice(1).every((value) => value === "0" || value === "–") ? [] : [row];
    }),
    of("reply tokens", ({ result }) => number(result?.tokens.reply)),
    of("mistakes", (episode) => number(mistakes(episode).length)),
    of("cost", ({ cost }) => (cost === null || cost === undefined ? "–" : `$${number(cost, 4)}`)),
  ];
  const rules = ["game", "seed", "player", "engine", "manual", "batch", "protocol", "context", "tokenizer"].map((name) =>
    of(name, (episode) => limit(episode[name])),
  );
  const budget = Object.keys(episodes[0].limits).filter((name) => areDifferent(episodes.map(({ limits }) => limits[name])));
  const limits = of("budget", (episode) => typeset(budget.map((name) => episode.limits[name]).join(", ")));
  const versions = Object.keys(Object.assign({}, ...episodes.map(({ result }) => result?.versions))).map((name) =>
    of(`version of ${name}`, ({ result }) => result?.versions[name] ?? "–"),
  );
  return [...figures, ...[...rules, limits, ...versions].filter(([, ...values]) => areDifferent(values))];
}

// --- Scores ----------------------------------------------------------------------------------------------------------

function renderScores() {
  const box = $("compare-scores");
  const [width, height] = [Math.max(320, box.clientWidth), 160];
  const x = turnScale(width, lastStep() + 1);
  const scores = compared.episodes.map(({ steps }) => [0, ...steps.map(({ call }) => call.score)]);
  const marks = ticks(...extent([0, ...scores.flat()]));
  const y = heightScale(marks, height);
  const line = (values, at) => {
    const points = thinned(values.map((value, step) => [step, value])).map(([step, value]) => [x.middle(step), y(value)]);
    const path = points.map(([px, py], place) => (place === 0 ? `M${px} ${py}` : `H${px}V${py}`)).join("");
    return shape("path", { class: `curve side${at}`, d: path });
  };
  box.onclick = (event) => goToStep(x.turn(event.clientX - box.getBoundingClientRect().left));
  const name = `Scores by step: ${compared.names.join(", and ")}`;
  box.replaceChildren(chart([width, height], name, marks, x, compared.step, scores.map(line)));
  $("compare-legend").replaceChildren(
    ...compared.names.map((name, at) => element("li", {}, element("span", { class: `stroke side${at}` }), name)),
  );
}

// --- Choosing --------------------------------------------------------------------------------------------------------

function picked() {
  return [...document.querySelectorAll("#episodes .pick:checked")].map((box) => box.closest("tr").dataset.key);
}

function connectComparison() {
  const buttons = {
    "compare-difference": () => goToStep(firstDifference()),
    "compare-picked": () => {
      location.hash = comparisonOf(picked());
    },
  };
  for (const [id, action] of Object.entries(buttons)) $(id).addEventListener("click", action);
  $("compare-slider").addEventListener("input", () => goToStep(Number($("compare-slider").value)));
  for (const box of document.querySelectorAll("#episodes .pick"))
    box.addEventListener("change", () => {
      const count = picked().length;
      $("compare-picked").disabled = count < 2 || count > MOST_COMPARED;
      $("compare-picked").title = count > MOST_COMPARED ? `At most ${MOST_COMPARED} are compared.` : "";
    });
  window.addEventListener("resize", () => $("compare").hidden || [renderBands(), renderScores()]);
}
