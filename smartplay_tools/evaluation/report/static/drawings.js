"use strict";
// The games as a person would like to see them. `draw` gets the state after a step and the steps before it.

const DRAWINGS = { hanoi, bandit, rock_paper_scissors, messenger, crafter, minecraft, text };

// Returns the elements to show for a step; an empty list where there is nothing to draw.
function draw(episode, step, textures) {
  const { drawing } = episode;
  const paint = DRAWINGS[drawing.kind];
  if (!paint) return [];
  const last = drawing.kind === "minecraft" ? drawing.walk.length - 1 : drawing.states.length - 1;
  return [paint(drawing, between(0, step, last), textures)].flat();
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
    parts.push(shape("rect", { class: "wood", x: middle(rod) - 4, y: floor - disks * thick - 34, width: 8, height: disks * thick + 34, rx: 4 }));
    parts.push(label(middle(rod), floor + 32, "ABC"[rod], { class: "big", "text-anchor": "middle" }));
    stack.forEach((disk, at) => {
      const size = 44 + (disk * 96) / Math.max(1, disks - 1);
      const y = floor - (at + 1) * thick;
      parts.push(shape("rect", { class: `disk tone${disk % 6}`, x: middle(rod) - size / 2, y: y + 1, width: size, height: thick - 2, rx: (thick - 2) / 2 }));
      parts.push(label(middle(rod), y + thick / 2 + 4, disk, { class: "on-colour", "text-anchor": "middle" }));
    });
  });
  const before = step > 0 ? states[step - 1].rods : rods;
  const moved = JSON.stringify(before) !== JSON.stringify(rods);
  const say = step === 0 ? "The start: everything has to go to rod C." : moved ? names[actions[step - 1]] : `Not allowed: ${names[actions[step - 1]]}`;
  if (moved) parts.push(arc(before, rods, middle, floor - disks * thick - 40));
  const where = rods.map((stack, rod) => `${"ABC"[rod]}: ${stack.join(", ") || "empty"}`).join("; ");
  return [picture(width, height, `Rods, bottom first. ${where}`, parts), caption(say, step > 0 && !moved)];
}

function arc(before, after, middle, y) {
  const from = after.findIndex((stack, rod) => stack.length < before[rod].length);
  const to = after.findIndex((stack, rod) => stack.length > before[rod].length);
  const [x1, x2] = [middle(from), middle(to)];
  const tip = Math.sign(x2 - x1) * 7;
  return shape("path", { class: "arrow", d: `M${x1} ${y}C${x1} ${y - 34} ${x2} ${y - 34} ${x2} ${y}m${-tip} -8l${tip} 8l${tip * 0.6} -10` });
}

function caption(words, bad = false) {
  return element("p", { class: bad ? "caption bad" : "caption" }, words);
}

// A strip of small marks, one for each round, newest on the right.
function strip(rounds, lanes, name) {
  const shown = rounds.slice(-50);
  const [left, each, high] = [64, 8, 17];
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
  return element("div", { class: "bar" }, element("span", { class: "name" }, name), element("span", { class: "trough" }, inside), element("span", { class: "figure" }, figure));
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
      element("h4", {}, `Machine ${arm + 1}`, now ? element("span", { class: rewards[step - 1] > 0 ? "coin good" : "coin poor" }, signed(rewards[step - 1])) : null),
      bar("paid", paid.length ? wins / paid.length : 0, paid.length ? `${wins} of ${paid.length}` : "never pulled", "seen"),
      bar("in truth", probability, percent(probability), "truth"),
      element("p", { class: "small" }, `Pays ${signed(reward)}, else costs ${number(reward)}. Total: ${signed(paid.reduce((a, b) => a + b, 0))}.`, arm === best ? " The better one." : ""),
    );
  });
  const good = actions.slice(0, step).filter((arm) => arm === best).length;
  return [
    element("div", { class: "machines" }, machines),
    strip(rounds, ["machine 1", "machine 2"], `The last ${Math.min(50, step)} pulls: filled paid, hollow cost`),
    caption(step ? `${good} of ${plural(step, "pull")} went to the better machine.` : "No machine has been pulled yet."),
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
      element("h4", {}, `${name}`, element("small", {}, `wins ${number(scores[hand])}`)),
      bar("player", step ? count(0, hand) / step : 0, `${count(0, hand)}`, "seen"),
      bar("opponent", step ? count(1, hand) / step : 0, `${count(1, hand)}`, "other"),
      bar("in truth", odds[hand], percent(odds[hand]), "truth"),
    ),
  );
  const marks = rounds.map(({ hands, reward }) => ({ lane: hands[0], good: reward > 0, neutral: hands[0] === hands[1] }));
  return [
    element("div", { class: "duel" }, hand(mine, "player"), element("span", { class: `outcome ${outcome === "won" ? "good" : outcome === "lost" ? "poor" : ""}` }, outcome ? `${outcome}, ${signed(rewards[step - 1])}` : "ready?"), hand(theirs, "opponent")),
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
    [shape("circle", { cx: 20, cy: 48, r: 8 }), shape("circle", { cx: 46, cy: 48, r: 8 }), shape("path", { d: "M25 42L46 10M41 42L20 10" })],
  ];
  const name = which === null ? `${whose}: no hand yet` : `${whose}: ${HANDS[which]}`;
  const drawn = picture(66, 66, name, which === null ? label(33, 42, "?", { class: "big", "text-anchor": "middle" }) : forms[which]);
  drawn.setAttribute("class", `hand ${whose}`);
  return element("figure", { class: "hand-of" }, drawn, element("figcaption", {}, which === null ? whose : `${whose}: ${HANDS[which]}`));
}
