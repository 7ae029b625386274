"use strict";
// The games as a person would like to see them. `draw` gets the state after a step and the steps before it.

const DRAWINGS = { hanoi, bandit, rock_paper_scissors, messenger, crafter, text };

// Returns the elements to show for a step; an empty list where there is nothing to draw.
function draw(episode, step, textures) {
  const { drawing } = episode;
  const paint = DRAWINGS[drawing.kind];
  if (!paint) return observed(episode, step);
  return [paint(drawing, between(0, step, drawing.states.length - 1), textures)].flat();
}

// What the player read at a step, for a game that is not drawn.
function observed(episode, step) {
  const calls = episode.turns.flatMap(({ items }) => items.map(({ call }) => call));
  const read = calls.findLast((call) => call?.observation_step !== undefined && call.observation_step <= step && call.text);
  const first = episode.first_observations.findLast(Boolean);
  const words = read?.text ?? first;
  return words ? [element("pre", { class: "characters" }, words)] : [];
}

function text({ states }, step) {
  return element("pre", { class: "characters" }, states[step].text);
}

// Tower of Hanoi: three rods, and where the latest disk came from.
function hanoi({ states, actions, names }, step) {
  const { rods } = states[step];
  const disks = states[0].rods[0].length;
  const [width, height, floor, thick] = [480, 250, 210, Math.min(34, 130 / disks)];
  const middle = (rod) => 80 + rod * 160;
  const parts = [shape("rect", { class: "wood", x: 10, y: floor, width: width - 20, height: 12, rx: 4 })];
  rods.forEach((stack, rod) => {
    parts.push(
      shape("rect", {
        class: "wood",
        x: middle(rod) - 4,
        y: floor - disks * thick - 34,
        width: 8,
        height: disks * thick + 34,
        rx: 4,
      }),
    );
    parts.push(label(middle(rod), floor + 32, "ABC"[rod], { class: "big", "text-anchor": "middle" }));
    stack.forEach((disk, at) => {
      const size = 44 + (disk * 96) / Math.max(1, disks - 1);
      const y = floor - (at + 1) * thick;
      parts.push(
        shape("rect", {
          class: `disk tone${disk % 6}`,
          x: middle(rod) - size / 2,
          y: y + 1,
          width: size,
          height: thick - 2,
          rx: (thick - 2) / 2,
        }),
      );
      parts.push(label(middle(rod), y + thick / 2 + 4, disk, { class: "on-colour", "text-anchor": "middle" }));
    });
  });
  const before = step > 0 ? states[step - 1].rods : rods;
  const moved = JSON.stringify(before) !== JSON.stringify(rods);
  const say =
    step === 0
      ? "The start: everything has to go to rod C."
      : moved
        ? names[actions[step - 1]]
        : `Not allowed: ${names[actions[step - 1]]}`;
  if (moved) parts.push(arc(before, rods, middle, floor - disks * thick - 40));
  const where = rods.map((stack, rod) => `${"ABC"[rod]}: ${stack.join(", ") || "empty"}`).join("; ");
  return [picture(width, height, `Rods, bottom first. ${where}`, parts), caption(say, step > 0 && !moved)];
}

function arc(before, after, middle, y) {
  const from = after.findIndex((stack, rod) => stack.length < before[rod].length);
  const to = after.findIndex((stack, rod) => stack.length > before[rod].length);
  const [x1, x2] = [middle(from), middle(to)];
  const tip = Math.sign(x2 - x1) * 7;
  return shape("path", {
    class: "arrow",
    d: `M${x1} ${y}C${x1} ${y - 34} ${x2} ${y - 34} ${x2} ${y}m${-tip} -8l${tip} 8l${tip * 0.6} -10`,
  });
}

function caption(words, bad = false) {
  return element("p", { class: bad ? "caption bad" : "caption" }, words);
}

// A strip of small marks, one for each round, newest on the right.
function strip(rounds, lanes, name) {
  const shown = rounds.slice(-50);
  const [left, each, high] = [72, 8, 17];
  const marks = shown.map(({ lane, good, neutral }, at) => {
    const place = { cx: left + at * each + 5, cy: 12 + lane * high, r: 3.3 };
    return shape("circle", { class: neutral ? "mark neutral" : good ? "mark good" : "mark poor", ...place });
  });
  const rows = lanes.map((lane, at) => [
    label(left - 8, 16 + at * high, lane, { class: "tick", "text-anchor": "end" }),
    shape("line", { class: "grid", x1: left, x2: left + 50 * each, y1: 12 + at * high, y2: 12 + at * high }),
  ]);
  return picture(left + 50 * each + 10, lanes.length * high + 6, name, rows, marks);
}

// A horizontal bar with a name before it and a figure after it.
function bar(name, share, figure, kind) {
  const inside = element("span", { class: `fill ${kind}` });
  inside.style.width = `${between(0, 100 * share, 100)}%`;
  return element(
    "div",
    { class: "bar" },
    element("span", { class: "name" }, name),
    element("span", { class: "trough" }, inside),
    element("span", { class: "figure" }, figure),
  );
}

// Two-armed bandit: what each machine has paid, and what it really pays.
function bandit({ states, actions, rewards }, step) {
  const { arms, best } = states[0];
  const rounds = actions.slice(0, step).map((arm, at) => ({ lane: arm, good: rewards[at] > 0 }));
  const machines = arms.map(([probability, reward], arm) => {
    const paid = rewards.slice(0, step).filter((_, at) => actions[at] === arm);
    const wins = paid.filter((one) => one > 0).length;
    const now = step > 0 && actions[step - 1] === arm;
    return element(
      "div",
      { class: now ? "machine now" : "machine" },
      element(
        "h3",
        {},
        `Machine ${arm + 1}`,
        now
          ? element("span", { class: rewards[step - 1] > 0 ? "coin good" : "coin poor" }, signed(rewards[step - 1]))
          : null,
      ),
      bar(
        "paid",
        paid.length ? wins / paid.length : 0,
        paid.length ? `${wins} of ${paid.length}` : "never pulled",
        "seen",
      ),
      bar("in truth", probability, percent(probability), "truth"),
      element(
        "p",
        { class: "small" },
        `Pays ${signed(reward)}, else costs ${number(reward)}. Total: ${signed(paid.reduce((a, b) => a + b, 0))}.`,
        arm === best ? " The better one." : "",
      ),
    );
  });
  const good = actions.slice(0, step).filter((arm) => arm === best).length;
  return [
    element("div", { class: "machines" }, machines),
    strip(rounds, ["machine 1", "machine 2"], `The last ${Math.min(50, step)} pulls: filled paid, hollow cost`),
    caption(
      step ? `${good} of ${plural(step, "pull")} went to the better machine.` : "No machine has been pulled yet.",
    ),
  ];
}

function signed(value) {
  return value > 0 ? `+${number(value)}` : number(value);
}

const HANDS = ["Rock", "Paper", "Scissor"];

// Rock, Paper, Scissors: the round, both players' tallies, and the opponent's true habits.
function rock_paper_scissors({ states, rewards }, step) {
  const { odds, scores, best } = states[0];
  const rounds = states.slice(1, step + 1).map(({ hands }, at) => ({ hands, reward: rewards[at] }));
  const [mine, theirs] = step ? states[step].hands : [null, null];
  const outcome = step ? (mine === theirs ? "a tie" : rewards[step - 1] > 0 ? "won" : "lost") : null;
  const count = (who, hand) => rounds.filter(({ hands }) => hands[who] === hand).length;
  const rows = HANDS.map((name, hand) =>
    element(
      "div",
      { class: "machine" },
      element("h3", {}, `${name}`, element("small", {}, `wins ${number(scores[hand])}`)),
      bar("player", step ? count(0, hand) / step : 0, `${count(0, hand)}`, "seen"),
      bar("opponent", step ? count(1, hand) / step : 0, `${count(1, hand)}`, "other"),
      bar("in truth", odds[hand], percent(odds[hand]), "truth"),
    ),
  );
  const marks = rounds.map(({ hands, reward }) => ({
    lane: hands[0],
    good: reward > 0,
    neutral: hands[0] === hands[1],
  }));
  return [
    element(
      "div",
      { class: "duel" },
      hand(mine, "player"),
      element(
        "span",
        { class: `outcome ${outcome === "won" ? "good" : outcome === "lost" ? "poor" : ""}` },
        outcome ? `${outcome}, ${signed(rewards[step - 1])}` : "ready?",
      ),
      hand(theirs, "opponent"),
    ),
    element("div", { class: "machines three" }, rows),
    strip(marks, HANDS, "The player's last hands: filled won, hollow lost, grey tied"),
    caption(`The best hand here is ${HANDS[best]}; ${count(0, best)} of ${plural(step, "round")} were played with it.`),
  ];
}

// A hand as a picture: a stone, a sheet, a pair of scissors.
function hand(which, whose) {
  const forms = [
    [shape("path", { d: "M14 44C10 28 22 14 36 16S58 26 54 42 20 56 14 44Z" })],
    [shape("path", { d: "M18 10H42L52 20V56H18ZM42 10V20H52" }), shape("path", { d: "M25 30H45M25 38H45M25 46H38" })],
    [
      shape("circle", { cx: 20, cy: 48, r: 8 }),
      shape("circle", { cx: 46, cy: 48, r: 8 }),
      shape("path", { d: "M25 42L46 10M41 42L20 10" }),
    ],
  ];
  const name = which === null ? `${whose}: no hand yet` : `${whose}: ${HANDS[which]}`;
  const drawn = picture(
    66,
    66,
    name,
    which === null ? label(33, 42, "?", { class: "big", "text-anchor": "middle" }) : forms[which],
  );
  drawn.setAttribute("class", `hand ${whose}`);
  return element(
    "figure",
    { class: "hand-of" },
    drawn,
    element("figcaption", {}, which === null ? whose : `${whose}: ${HANDS[which]}`),
  );
}

// MESSENGER.

const ROLES = ["enemy", "message", "goal", "decoy message", "decoy goal"];
const FIGURES = {
  airplane: "M12 2l2 8 8 4v2l-8-2-1 5 3 2v1l-4-1-4 1v-1l3-2-1-5-8 2v-2l8-4z",
  mage: "M12 2L6 15H18ZM3 17H21L19 20H5Z",
  dog: "M5 4L9 7H15L19 4V13C19 18 15 21 12 21S5 18 5 13Z",
  bird: "M3 13C7 13 8 7 13 7A4 4 0 0 1 19 9L22 10L19 12C18 17 13 19 9 18L4 20L7 16C5 16 4 15 3 13Z",
  fish: "M2 12C6 6 13 6 17 11L22 7V17L17 13C13 18 6 18 2 12Z",
  scientist: "M10 3H14V9L20 19Q20.5 21 19 21H5Q3.500 21 4 19L10 9Z",
  thief: "M2 8H22V12C22 16 17 17 14 14H10C7 17 2 16 2 12Z",
  ship: "M11 3H13V13H20L17 19H7L4 13H11ZM14 4L19 11H14Z",
  ball: "M12 3A9 9 0 1 0 12 21A9 9 0 1 0 12 3ZM4 12H20M12 4V20",
  robot: "M5 8H19V20H5ZM11 3H13V8H11ZM8 11V14H11V11ZM13 11V14H16V11Z",
  queen: "M3 7L8 12L12 4L16 12L21 7L19 19H5Z",
  sword: "M19 3L21 5L11 15L13 17L12 18L9 16L5 20L4 19L8 15L6 12L7 11L9 13Z",
  you: "M12 3A4 4 0 1 1 12 11A4 4 0 1 1 12 3ZM4 21C4 15 8 13 12 13S20 15 20 21Z",
};

// A board of 10 x 10 cells; places are in half cells.
function messenger({ states, names: actions, actions: played }, step) {
  const { places, names, movements, avatar, has_message } = states[step];
  const [cells, size] = [10, 40];
  const at = ([x, y]) => [(x / 2 + 0.5) * size, (y / 2 + 0.5) * size];
  const grid = Array.from({ length: cells + 1 }, (_, line) => [
    shape("line", { class: "grid", x1: line * size, x2: line * size, y1: 0, y2: cells * size }),
    shape("line", { class: "grid", y1: line * size, y2: line * size, x1: 0, x2: cells * size }),
  ]);
  const trail = states.slice(Math.max(0, step - 8), step).map((state, age, all) => {
    if (!state.avatar) return null;
    const [cx, cy] = at(state.avatar);
    return shape("circle", { class: "trail", cx, cy, r: 4, opacity: (age + 1) / (all.length + 1) });
  });
  const pieces = places.map((place, role) =>
    place ? piece(at(place), names[role], `role${role}`, `${names[role]}, the ${ROLES[role]}`) : null,
  );
  const you = avatar ? piece(at(avatar), "you", "you", has_message ? "you, with the message" : "you") : null;
  if (you && has_message) you.append(shape("path", { class: "letter", d: "M8 -20H26V-8H8ZM8 -20L17 -13L26 -20" }));
  const legend = names.map((name, role) =>
    element(
      "li",
      { class: places[role] ? "" : "gone" },
      element("span", { class: `swatch role${role}` }),
      `${name}: ${ROLES[role]}, ${movements[role]}`,
    ),
  );
  const say = step === 0 ? "The start." : `${actions[played[step - 1]]}.`;
  const end = avatar
    ? has_message
      ? "The message is in hand."
      : "The message is not in hand."
    : "The avatar is dead.";
  return [
    picture(
      cells * size,
      cells * size,
      `The board. ${end}`,
      shape("rect", { class: "board", width: cells * size, height: cells * size }),
      grid,
      trail,
      pieces,
      you,
    ),
    caption(`${say} ${end}`, !avatar),
    element("ul", { class: "legend" }, legend),
  ];
}

function piece([x, y], name, kind, title) {
  const form = shape("path", { class: "figure", d: FIGURES[name] ?? "", transform: "translate(-11 -11) scale(0.92)" });
  return shape(
    "g",
    { class: `piece ${kind}`, transform: `translate(${x} ${y})` },
    shape("circle", { r: 17 }),
    form,
    shape("title", {}, title),
  );
}
