"use strict";
// The games that happen somewhere: MESSENGER's board, Crafter's land, Minecraft's walk.

// --- MESSENGER -------------------------------------------------------------------------------------------------------

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
  const pieces = places.map((place, role) => (place ? piece(at(place), names[role], `role${role}`, `${names[role]}, the ${ROLES[role]}`) : null));
  const you = avatar ? piece(at(avatar), "you", "you", has_message ? "you, with the message" : "you") : null;
  if (you && has_message) you.append(shape("path", { class: "letter", d: "M8 -20H26V-8H8ZM8 -20L17 -13L26 -20" }));
  const legend = names.map((name, role) =>
    element("li", { class: places[role] ? "" : "gone" }, element("span", { class: `swatch role${role}` }), `${name}: ${ROLES[role]}, ${movements[role]}`),
  );
  const say = step === 0 ? "The start." : `${actions[played[step - 1]]}.`;
  const end = avatar ? (has_message ? "The message is in hand." : "The message is not in hand.") : "The avatar is dead.";
  return [
    picture(cells * size, cells * size, `The board. ${end}`, shape("rect", { class: "board", width: cells * size, height: cells * size }), grid, trail, pieces, you),
    caption(`${say} ${end}`, !avatar),
    element("ul", { class: "legend" }, legend),
  ];
}

function piece([x, y], name, kind, title) {
  const form = shape("path", { class: "figure", d: FIGURES[name] ?? "", transform: "translate(-11 -11) scale(0.92)" });
  return shape("g", { class: `piece ${kind}`, transform: `translate(${x} ${y})` }, shape("circle", { r: 17 }), form, shape("title", {}, title));
}

// --- Crafter ---------------------------------------------------------------------------------------------------------

const VIEW = { columns: 9, rows: 7 };
const LAND = {
  water: "#3f76c8", grass: "#6aa84f", stone: "#8d8f94", path: "#c2a878", sand: "#e5d9a3", tree: "#2e6b34", lava: "#e8641b",
  coal: "#33363b", iron: "#d8a07a", diamond: "#a8f0f0", table: "#8a5a2b", furnace: "#5c5c66",
};

// What the player sees, in Crafter's own textures, and the land it has seen so far.
function crafter(drawing, step, textures) {
  const state = drawing.states[step];
  const view = element("canvas", { class: "pixels", role: "img", width: 9 * textures.side, height: 9 * textures.side, "aria-label": inventory(state, textures) });
  const map = element("canvas", { class: "pixels", role: "img", "aria-label": `The land seen so far; the player is at ${state.at.join(", ")}` });
  paintView(view.getContext("2d"), state, textures);
  paintLand(map, drawing, step, textures);
  const vitals = textures.vitals.map((name, at) => bar(name, state.carried[at] / textures.most, `${state.carried[at]}`, state.carried[at] > 2 ? "seen" : "other"));
  return [
    element("div", { class: "crafter" }, view, element("div", {}, map, element("div", { class: "vitals" }, vitals))),
    caption(`At ${state.at.join(", ")}; ${state.sleeping ? "asleep; " : ""}daylight ${percent(state.daylight)}. ${inventory(state, textures)}`),
  ];
}

function inventory(state, textures) {
  const items = textures.items.map((name, at) => [name.replaceAll("_", " "), state.carried[textures.vitals.length + at]]);
  const held = items.filter(([, amount]) => amount).map(([name, amount]) => `${amount} ${name}`);
  return held.length ? `Carries ${held.join(", ")}.` : "Carries nothing.";
}

function paintView(pen, state, textures) {
  const side = textures.side;
  const put = (name, column, row, share = 1) => {
    const at = textures.places[name] ?? textures.places.unknown;
    const [x, y] = [(at % textures.columns) * side, Math.floor(at / textures.columns) * side];
    const rest = (side * (1 - share)) / 2;
    pen.drawImage(textures.sheet, x, y, side, side, column * side + rest, row * side + rest, side * share, side * share);
  };
  [...state.ground].forEach((letter, at) => {
    if (letter !== ".") put(materialOf(letter, textures), at % VIEW.columns, Math.floor(at / VIEW.columns));
  });
  for (const [texture, column, row] of state.things) put(texture, column, row);
  // The night without its grain: darker, and blue.
  pen.fillStyle = state.sleeping ? "rgba(0, 0, 16, 0.75)" : `rgba(0, 16, 64, ${0.75 * (1 - state.daylight)})`;
  pen.fillRect(0, 0, VIEW.columns * side, VIEW.rows * side);
  pen.fillStyle = "#101014";
  pen.fillRect(0, VIEW.rows * side, VIEW.columns * side, 2 * side);
  let slot = 0;
  [...textures.vitals, ...textures.items].forEach((name, at) => {
    if (!state.carried[at]) return;
    const [column, row] = [slot % VIEW.columns, VIEW.rows + Math.floor(slot / VIEW.columns)];
    put(name, column, row, 0.8);
    put(`${state.carried[at]}`, column + 0.2, row + 0.2, 0.6);
    slot += 1;
  });
}

function materialOf(letter, textures) {
  return textures.materials[letter.charCodeAt(0) - 97];
}

// The land seen so far. It is painted step by step and kept, so that going on costs one step and not all of them.
function paintLand(canvas, drawing, step, textures) {
  if (!drawing.land || drawing.land.step > step) drawing.land = unseenLand(drawing.states);
  const { land, states } = drawing;
  while (land.step < step) {
    land.step += 1;
    paintSeen(land, states[land.step], textures);
  }
  canvas.width = canvas.height = land.canvas.width;
  const pen = canvas.getContext("2d");
  pen.drawImage(land.canvas, 0, 0);
  pen.fillStyle = "#ffffff";
  pen.fillRect(states[step].at[0] + land.x, states[step].at[1] + land.y, 1, 1);
}

// Large enough for what the whole episode gets to see, so that the map does not jump while one plays.
function unseenLand(states) {
  const [west, east] = extent(states.map(({ at }) => at[0]));
  const [north, south] = extent(states.map(({ at }) => at[1]));
  const side = Math.max(east - west, south - north) + VIEW.columns + 4;
  const [x, y] = [west + east, north + south].map((sum) => Math.floor((side - 1 - sum) / 2));
  return { canvas: element("canvas", { width: side, height: side }), x, y, step: -1 };
}

function paintSeen(land, { ground, at }, textures) {
  const pen = land.canvas.getContext("2d");
  for (let cell = 0; cell < ground.length; cell += 1) {
    if (ground[cell] === ".") continue;
    pen.fillStyle = LAND[materialOf(ground[cell], textures)];
    const [column, row] = [cell % VIEW.columns, Math.floor(cell / VIEW.columns)];
    pen.fillRect(at[0] - 4 + column + land.x, at[1] - 3 + row + land.y, 1, 1);
  }
}

// --- Minecraft -------------------------------------------------------------------------------------------------------

const BIOMES = {
  OCEAN: "#3b6fb6", DEEP_OCEAN: "#274f8a", FROZEN_OCEAN: "#9fb9d8", RIVER: "#5b93d6", FROZEN_RIVER: "#b9d2ea", BEACH: "#efe2ae",
  STONE_BEACH: "#a9a9a4", COLD_BEACH: "#e3e0cf", PLAINS: "#a5c96a", FOREST: "#4d8f3f", BIRCH_FOREST: "#7db56a", ROOFED_FOREST: "#2f6428",
  TAIGA: "#3f7a66", COLD_TAIGA: "#86b0a3", SWAMPLAND: "#5f7046", JUNGLE: "#2f9e2b", SAVANNA: "#bdb25f", DESERT: "#e9c46a",
  EXTREME_HILLS: "#8b8b8b", ICE_PLAINS: "#e6f0f5", ICE_SPIKES: "#b4dcf2", MUSHROOM_ISLAND: "#a9809b",
};
const HEADINGS = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"];

// The walk from above, north up, on the land where that is known.
function minecraft(drawing, step) {
  const { walk } = drawing;
  const known = walk.filter((place) => place);
  const frame = drawing.rows
    ? [...drawing.corner, drawing.rows[0].length * drawing.spacing, drawing.rows.length * drawing.spacing]
    : around(known);
  const line = (from, to) => walk.slice(from, to + 1).filter((place) => place).map(([x, , z]) => `${x},${z}`).join(" ");
  const here = walk.slice(0, step + 1).findLast((place) => place) ?? known[0];
  const unit = Math.max(frame[2], frame[3]) / 100;
  const start = known[0];
  const turned = HEADINGS.indexOf(here[3]) * 45;
  const drawn = shape(
    "svg",
    { viewBox: frame.join(" "), role: "img", class: "map", "aria-label": `The walk, seen from above: at ${number(here[0])}, ${number(here[2])}, facing ${here[3]}` },
    drawing.rows ? shape("image", { x: frame[0], y: frame[1], width: frame[2], height: frame[3], href: landPicture(drawing), preserveAspectRatio: "none" }) : shape("rect", { class: "board", x: frame[0], y: frame[1], width: frame[2], height: frame[3] }),
    shape("polyline", { class: "walk ahead", points: line(step, walk.length), "stroke-width": unit * 0.5 }),
    shape("polyline", { class: "walk rim", points: line(0, step), "stroke-width": unit * 1.5 }),
    shape("polyline", { class: "walk", points: line(0, step), "stroke-width": unit * 0.8 }),
    shape("circle", { class: "start", cx: start[0], cy: start[2], r: unit * 1.4, "stroke-width": unit * 0.5 }),
    shape("path", { class: "here", d: "M0 -3L2.2 2.4L0 1.300L-2.2 2.4Z", "stroke-width": 0.4, transform: `translate(${here[0]} ${here[2]}) scale(${unit}) rotate(${turned})` }),
  );
  const legend = (drawing.biomes ?? []).map((name) => {
    const swatch = element("span", { class: "swatch" });
    swatch.style.background = BIOMES[name];
    const goal = drawing.goal.includes(name);
    return element("li", { class: goal ? "goal" : "" }, swatch, name.toLowerCase().replaceAll("_", " "), goal ? " (the goal)" : "");
  });
  const far = walk.slice(1, step + 1).reduce((sum, place, at) => sum + (place && walk[at] ? Math.hypot(place[0] - walk[at][0], place[2] - walk[at][2]) : 0), 0);
  const say = `At ${number(here[0], 0)}, ${number(here[2], 0)}, ${number(here[1], 0)} high, facing ${here[3]}; ${number(far, 0)} blocks walked. North is up; the map is ${number(frame[2], 0)} blocks wide.`;
  return [drawn, caption(say), legend.length ? element("ul", { class: "legend" }, legend) : null].filter(Boolean);
}

function around(places) {
  const [west, east] = extent(places.map((place) => place[0]));
  const [north, south] = extent(places.map((place) => place[2]));
  const side = Math.max(east - west, south - north, 40) * 1.2;
  return [(west + east - side) / 2, (north + south - side) / 2, side, side];
}

// The land as a picture of one pixel for each square, painted once.
function landPicture(drawing) {
  if (!drawing.picture) {
    const canvas = element("canvas", { width: drawing.rows[0].length, height: drawing.rows.length });
    const pen = canvas.getContext("2d");
    drawing.rows.forEach((row, y) =>
      [...row].forEach((letter, x) => {
        pen.fillStyle = BIOMES[drawing.biomes[letter.charCodeAt(0) - 97]] ?? "#888888";
        pen.fillRect(x, y, 1, 1);
      }),
    );
    drawing.picture = canvas.toDataURL();
  }
  return drawing.picture;
}
