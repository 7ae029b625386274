"use strict";
// The player: one episode, turn by turn. `shown` is what stands on the page; everything else follows from it.

const shown = { episode: null, asked: null, turn: 0, step: null, timer: null, asked_about: null, beside: null };

async function showEpisode(key, turn) {
  stop();
  shown.asked = key;
  if (shown.episode?.key !== key) {
    const episode = await openEpisode(key);
    if (shown.asked !== key) return; // another episode was opened meanwhile
    shown.asked_about = shown.beside = null;
    useEpisode(episode);
  }
  $("run").hidden = true;
  $("player").hidden = false;
  goTo(turn ?? 0);
}

// Show an episode, without changing its turn.
function useEpisode(episode) {
  shown.episode = episode;
  const tokens = episode.turns.map(({ view }) => view?.tokens ?? 0);
  episode.mostTokens = extent([0, ...tokens])[1];
  describeEpisode(episode);
  $("episode-before").disabled = !besideEpisode(-1);
  $("episode-after").disabled = !besideEpisode(1);
  renderSearch();
}

function lastTurn() {
  return Math.max(0, shown.episode.turns.length - 1);
}

// Go to a turn; `step` shows the game after one of its calls instead of after all of them.
function goTo(turn, step = null) {
  shown.turn = between(0, turn, lastTurn());
  shown.step = step;
  try {
    // Inside of a notebook the page has no address of its own.
    if (location.protocol !== "about:") history.replaceState(null, "", `#episode=${encodeURIComponent(shown.episode.key)}&turn=${shown.turn}${document.body.classList.contains("bare") ? "&bare" : ""}`);
  } catch {
    // Safari refuses more than a hundred of these in half a minute; the address then lags behind.
  }
  render();
}

function render() {
  const { episode, turn } = shown;
  const facts = episode.facts[turn] ?? { step: 0 };
  $("slider").max = lastTurn();
  $("slider").value = turn;
  const where = `${number(turn)} of ${number(lastTurn())}`;
  const place = isThread(episode) ? `prompt ${where}` : `turn ${where}, step ${number(facts.step)}`;
  $("slider").setAttribute("aria-valuetext", place);
  $("place").textContent = place;
  if (!isThread(episode)) {
    renderGame();
    renderTurn();
  }
  renderContext();
  renderCurves();
}

function renderGame() {
  const { episode, turn } = shown;
  const step = shown.step ?? episode.facts[turn]?.step ?? 0;
  const drawn = draw(episode, step, page.textures);
  const played = episode.turns[turn]?.items.find(({ call }) => call?.legal && call.step === step)?.call;
  $("game-step").textContent = `after step ${number(step)}, score ${number(played?.score ?? episode.facts[turn]?.score ?? 0)}`;
  $("game").replaceChildren(
    ...(drawn.length ? drawn : [element("p", { class: "caption" }, "There is no picture of this game.")]),
  );
  $("source").textContent = episode.drawing.source;
}

function renderContext() {
  const { episode, turn } = shown;
  const view = episode.turns[turn]?.view;
  $("context-body").hidden = !view;
  $("no-context").hidden = Boolean(view);
  if (!view) {
    $("no-context").textContent =
      episode.context === "host"
        ? "The host owns the context of this episode: what its model saw is not on record."
        : "No prompt led to this turn.";
    return;
  }
  $("gauge").replaceChildren(...gauge(episode, turn));
  band($("band"), episode, turn, askAbout);
  const drawn = new Set(["head", ...visibility(episode, turn).states, summaryIn(episode, view) ? "summary" : ""]);
  for (const item of $("states").children) item.hidden = !drawn.has(item.firstElementChild.classList.item(1));
  $("sentence").textContent = sentence(episode, turn);
  $("allowed").classList.toggle("bad", isThread(episode) && isOver(episode.turns[turn]));
  const allowed = isThread(episode)
    ? reportedWords(view)
    : view.max_tokens === null
      ? "A reply of any length was allowed."
      : `The reply was allowed ${plural(view.max_tokens, "token")}.`;
  const [cap, used] = [episode.budget.episode_tokens ?? null, episode.facts[turn].spent];
  const spent = cap === null ? "" : ` Spent after this turn: ${number(used)} of ${number(cap)} tokens.`;
  const money = episode.turns[turn].spent;
  const cost = money === undefined ? "" : ` Costs so far: ${number(money, 6)} of ${number(episode.budget.episode_cost, 6)}.`;
  $("allowed").textContent = allowed + spent + cost;
  renderWhy();
  renderPrompt();
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
  const all = partsInAll(episode);
  const cap = episode.budget.prompt_tokens;
  const plain = { name: "Tokens of the prompt", values: tokens, cap, kind: "tokens", turn };
  clickable($("tokens"), all ? stack($("tokens"), episode, turn) : curve($("tokens"), plain));
  $("parts").hidden = !all;
  if (all) $("parts").replaceChildren(partsBar(all, "All prompts together"), partsTable(episode, turn));
  clickable($("map"), windowMap($("map"), episode, turn));
}

// --- Moving ----------------------------------------------------------------------------------------------------------

function play() {
  if (shown.timer) return stop();
  if (shown.turn >= lastTurn()) goTo(0);
  shown.timer = setInterval(() => (shown.turn < lastTurn() ? goTo(shown.turn + 1) : stop()), Number($("pace").value));
  labelPlay("⏸", "Pause");
}

function stop() {
  clearInterval(shown.timer);
  shown.timer = null;
  labelPlay("▶", "Play");
}

function labelPlay(sign, name) {
  fill($("play"), { "aria-label": name }, []).textContent = sign;
}

function goToMistake(direction) {
  const wrong = mistakes(shown.episode);
  const target = direction > 0 ? wrong.find((turn) => turn > shown.turn) : wrong.findLast((turn) => turn < shown.turn);
  if (target !== undefined) goTo(target);
}

// The address of the episode before or after this one; null if there is none.
function besideEpisode(direction) {
  if (served) return neighbour(direction) ?? null;
  const keys = page.episodes.map((episode) => episode.key);
  const at = keys.indexOf(shown.episode.key) + direction;
  return at in keys ? `#episode=${encodeURIComponent(keys[at])}&turn=0` : null;
}

function goToEpisode(direction) {
  const address = besideEpisode(direction);
  if (address?.startsWith("#")) location.hash = address;
  else if (address) location.assign(address);
}
