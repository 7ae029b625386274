"use strict";
// Two episodes side by side, moved through together step by step: games, actions, observations, scores.

const compared = { keys: [], episodes: [], step: 0 };

// The address `#compare=KEY&with=KEY&step=N` shows two episodes; returns whether it does.
async function showComparison(asked) {
  const keys = [asked.get("compare"), asked.get("with")];
  const known = (key) => page.episodes.some((episode) => episode.key === key);
  $("compare").hidden = !keys.every(known);
  if ($("compare").hidden) return false;
  stop();
  if (keys.join("\n") !== compared.keys.join("\n")) {
    compared.keys = keys;
    const episodes = await Promise.all(keys.map(openEpisode));
    if (keys !== compared.keys) return true; // somebody has gone on meanwhile
    compared.episodes = episodes.map((episode) => ({ ...episode, steps: stepsOf(episode) }));
    describeComparison();
  }
  const wasHidden = !$("run").hidden || !$("player").hidden;
  $("run").hidden = $("player").hidden = true;
  goToStep(Number.parseInt(asked.get("step") ?? "0", 10) || 0);
  if (wasHidden) $("compare-title").focus();
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
  const [one, other] = compared.keys.map(encodeURIComponent);
  try {
    if (location.protocol !== "about:") history.replaceState(null, "", `#compare=${one}&with=${other}&step=${compared.step}`);
  } catch {
    // Safari refuses more than a hundred of these in half a minute; the address then lags behind.
  }
  $("compare-slider").max = lastStep();
  $("compare-slider").value = compared.step;
  $("compare-place").textContent = `step ${number(compared.step)} of ${number(lastStep())}`;
  $("compare-sides").replaceChildren(...compared.episodes.map(sideOf));
  renderScores();
}

// --- The two of them -------------------------------------------------------------------------------------------------

function nameOf(episode) {
  const run = episode.run ? `${episode.run} ` : "";
  return `${run}${episode.player ?? "unnamed"}, ${episode.game}, seed ${episode.seed}`;
}

function sideOf(episode, at) {
  const step = Math.min(compared.step, episode.steps.length);
  const played = step > 0 ? episode.steps[step - 1] : null;
  const drawn = draw(episode, step, page.textures);
  const turn = played?.turn ?? 0;
  const address = `#episode=${encodeURIComponent(episode.key)}&turn=${turn}`;
  const over = compared.step > episode.steps.length ? ` (it ended at step ${number(episode.steps.length)})` : "";
  return element(
    "section",
    { class: `card side side${at}`, "aria-label": nameOf(episode) },
    element("h2", {}, element("a", { href: address }, nameOf(episode))),
    element("p", { class: "small" }, `after step ${number(step)}, score ${number(played?.call.score ?? 0)}${over}`),
    element("div", { class: "side-game" }, drawn.length ? drawn : caption("There is no picture of this game.")),
    played?.said ? element("pre", { class: "speech" }, played.said) : null,
    played ? callLine(played.call.name, played.call.arguments) : null,
    played ? element("pre", { class: "side-answer" }, played.call.text) : caption("Nothing has been played yet."),
  );
}

function describeComparison() {
  const { episodes } = compared;
  document.title = `Side by side: ${episodes.map(nameOf).join(" and ")}`;
  const first = firstDifference();
  $("compare-lead").textContent = first
    ? `They part at step ${number(first)}.`
    : "They play the same actions and see the same observations.";
  $("compare-difference").disabled = !first;
  const head = element("tr", {}, element("th", {}, ""), ...episodes.map((one) => element("th", { scope: "col" }, nameOf(one))));
  const rows = factsOf(...episodes).map(([name, ...values]) =>
    element(
      "tr",
      { class: values[0] === values[1] ? "" : "differs" },
      element("th", { scope: "row" }, name),
      ...values.map((value) => element("td", { class: "rules" }, value)),
    ),
  );
  $("compare-facts").replaceChildren(element("thead", {}, head), element("tbody", {}, rows));
}

// The first step at which actions or observations are not the same; null if there is none.
function firstDifference() {
  const [one, other] = compared.episodes;
  for (let at = 0; at < lastStep(); at += 1) {
    if (actionAt(one, at) !== actionAt(other, at) || one.steps[at]?.call.text !== other.steps[at]?.call.text) return at + 1;
  }
  return null;
}

// The action as the game knows it, where the game was played again; else as it was sent.
function actionAt({ drawing, steps }, at) {
  const action = drawing.actions?.[at];
  return action === undefined ? steps[at]?.call.arguments : drawing.names[action];
}

// What was asked for, then what came of it; the rules only where they differ.
function factsOf(one, other) {
  const limit = (value) => (value === null || value === undefined ? "no limit" : String(value));
  const of = (name, value) => [name, value(one), value(other)];
  const figures = [
    of("end", ({ result, status }) => result?.end_reason.replaceAll("_", " ") ?? status),
    of("score", ({ result }) => number(result?.score)),
    of("steps", ({ steps }) => number(steps.length)),
    of("turns", ({ turns }) => number(turns.length)),
    of("prompt tokens", ({ result }) => number(result?.tokens.prompt)),
    of("reply tokens", ({ result }) => number(result?.tokens.reply)),
    of("mistakes", (episode) => number(mistakes(episode).length)),
    of("cost", ({ cost }) => (cost === null || cost === undefined ? "–" : `$${number(cost, 4)}`)),
  ];
  const rules = ["game", "seed", "player", "engine", "manual", "batch", "protocol", "context", "tokenizer"].map((name) =>
    of(name, (episode) => limit(episode[name])),
  );
  const budget = Object.keys(one.limits).filter((name) => one.limits[name] !== other.limits[name]);
  const limits = of("budget", (episode) => budget.map((name) => episode.limits[name]).join(", "));
  const versions = Object.keys({ ...one.result?.versions, ...other.result?.versions }).map((name) =>
    of(`version of ${name}`, ({ result }) => result?.versions[name] ?? "–"),
  );
  return [...figures, ...[...rules, limits, ...versions].filter(([, a, b]) => a !== b)];
}

// --- Scores ----------------------------------------------------------------------------------------------------------

function renderScores() {
  const box = $("compare-scores");
  const [width, height] = [Math.max(320, box.clientWidth), 160];
  const x = turnScale(width, lastStep() + 1);
  const scores = compared.episodes.map(({ steps }) => [0, ...steps.map(({ call }) => call.score)]);
  const marks = ticks(...extent([0, ...scores.flat()]));
  const [low, high] = [marks[0], marks.at(-1)];
  const y = (value) => height - EDGE.bottom - ((value - low) / (high - low)) * (height - EDGE.top - EDGE.bottom);
  const line = (values, at) => {
    const points = thinned(values.map((value, step) => [step, value])).map(([step, value]) => [x.middle(step), y(value)]);
    const path = points.map(([px, py], place) => (place === 0 ? `M${px} ${py}` : `H${px}V${py}`)).join("");
    return shape("path", { class: `curve side${at}`, d: path });
  };
  const drawn = picture(
    width,
    height,
    `Scores by step: ${compared.episodes.map(nameOf).join(", and ")}`,
    marks.map((mark) => [
      shape("line", { class: "grid", x1: EDGE.left, x2: width - EDGE.right, y1: y(mark), y2: y(mark) }),
      label(EDGE.left - 8, y(mark) + 4, number(mark), { class: "tick", "text-anchor": "end" }),
    ]),
    scores.map(line),
    shape("line", {
      class: "moment",
      x1: x.middle(compared.step),
      x2: x.middle(compared.step),
      y1: EDGE.top,
      y2: height - EDGE.bottom,
    }),
    turnTicks(x, lastStep() + 1, height),
  );
  box.onclick = (event) => goToStep(x.turn(event.clientX - box.getBoundingClientRect().left));
  box.replaceChildren(drawn);
  $("compare-legend").replaceChildren(
    ...compared.episodes.map((episode, at) =>
      element("li", {}, element("span", { class: `stroke side${at}` }), nameOf(episode)),
    ),
  );
}

// --- Choosing --------------------------------------------------------------------------------------------------------

function picked() {
  return [...document.querySelectorAll("#episodes .pick:checked")].map((box) => box.closest("tr").dataset.key);
}

function connectComparison() {
  const buttons = {
    "compare-first": () => goToStep(0),
    "compare-previous": () => goToStep(compared.step - 1),
    "compare-next": () => goToStep(compared.step + 1),
    "compare-last": () => goToStep(lastStep()),
    "compare-difference": () => goToStep(firstDifference()),
    "compare-picked": () => {
      const [one, other] = picked().map(encodeURIComponent);
      location.hash = `#compare=${one}&with=${other}`;
    },
  };
  for (const [id, action] of Object.entries(buttons)) $(id).addEventListener("click", action);
  $("compare-slider").addEventListener("input", () => goToStep(Number($("compare-slider").value)));
  for (const box of document.querySelectorAll("#episodes .pick"))
    box.addEventListener("change", () => {
      $("compare-picked").disabled = picked().length !== 2;
    });
  window.addEventListener("resize", () => $("compare").hidden || renderScores());
}

const COMPARISON_KEYS = {
  ArrowLeft: (event) => goToStep(compared.step - (event.shiftKey ? 10 : 1)),
  ArrowRight: (event) => goToStep(compared.step + (event.shiftKey ? 10 : 1)),
  Home: () => goToStep(0),
  End: () => goToStep(lastStep()),
  Escape: () => (location.hash = ""),
};
