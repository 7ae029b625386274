"use strict";
// The games that happen in a large world: Crafter's land, Minecraft's walk.

// --- Crafter ---------------------------------------------------------------------------------------------------------

const VIEW = { columns: 9, rows: 7 };
const LAND = {
  water: "#3f76c8",
  grass: "#6aa84f",
  stone: "#8d8f94",
  path: "#c2a878",
  sand: "#e5d9a3",
  tree: "#2e6b34",
  lava: "#e8641b",
  coal: "#33363b",
  iron: "#d8a07a",
  diamond: "#a8f0f0",
  table: "#8a5a2b",
  furnace: "#5c5c66",
};

// What the player sees, in Crafter's own textures, and the land it has seen so far.
function crafter(drawing, step, textures) {
  const state = drawing.states[step];
  const view = element("canvas", {
    class: "pixels",
    role: "img",
    width: 9 * textures.side,
    height: 9 * textures.side,
    "aria-label": inventory(state, textures),
  });
  const map = element("canvas", {
    class: "pixels",
    role: "img",
    "aria-label": `The land seen so far; the player is at ${state.at.join(", ")}`,
  });
  paintView(view.getContext("2d"), state, textures);
  paintLand(map, drawing, step, textures);
  const vitals = textures.vitals.map((name, at) =>
    bar(name, state.carried[at] / textures.most, `${state.carried[at]}`, state.carried[at] > 2 ? "seen" : "other"),
  );
  return [
    element("div", { class: "crafter" }, view, element("div", {}, map, element("div", { class: "vitals" }, vitals))),
    caption(
      `At ${state.at.join(", ")}; ${state.sleeping ? "asleep; " : ""}daylight ${percent(state.daylight)}. ${inventory(state, textures)}`,
    ),
  ];
}

function inventory(state, textures) {
  const items = textures.items.map((name, at) => [
    name.replaceAll("_", " "),
    state.carried[textures.vitals.length + at],
  ]);
  const held = items.filter(([, amount]) => amount).map(([name, amount]) => `${amount} ${name}`);
  return held.length ? `Carries ${held.join(", ")}.` : "Carries nothing.";
}

function paintView(pen, state, textures) {
  const side = textures.side;
  const put = (name, column, row, share = 1) => {
    const at = textures.places[name] ?? textures.places.unknown;
    const [x, y] = [(at % textures.columns) * side, Math.floor(at / textures.columns) * side];
    const rest = (side * (1 - share)) / 2;
    pen.drawImage(
      textures.sheet,
      x,
      y,
      side,
      side,
      column * side + rest,
      row * side + rest,
      side * share,
      side * share,
    );
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

// Large enough for everything that the episode sees, so that the map does not jump during play.
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
  OCEAN: "#3b6fb6",
  DEEP_OCEAN: "#274f8a",
  FROZEN_OCEAN: "#9fb9d8",
  RIVER: "#5b93d6",
  FROZEN_RIVER: "#b9d2ea",
  BEACH: "#efe2ae",
  STONE_BEACH: "#a9a9a4",
  COLD_BEACH: "#e3e0cf",
  PLAINS: "#a5c96a",
  FOREST: "#4d8f3f",
  BIRCH_FOREST: "#7db56a",
  ROOFED_FOREST: "#2f6428",
  TAIGA: "#3f7a66",
  COLD_TAIGA: "#86b0a3",
  SWAMPLAND: "#5f7046",
  JUNGLE: "#2f9e2b",
  SAVANNA: "#bdb25f",
  DESERT: "#e9c46a",
  EXTREME_HILLS: "#8b8b8b",
  ICE_PLAINS: "#e6f0f5",
  ICE_SPIKES: "#b4dcf2",
  MUSHROOM_ISLAND: "#a9809b",
};
const HEADINGS = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"];

// The walk from above, north up, on the land where that is known.
function minecraft(drawing, step) {
  const { walk, spacing, corner, rows } = drawing;
  const places = walk.filter((place) => place);
  const frame = rows ? [...corner, rows[0].length * spacing, rows.length * spacing] : around(places);
  const here = walk.slice(0, step + 1).findLast((place) => place) ?? places[0];
  const [x, y, z] = here.map((coordinate) => (typeof coordinate === "number" ? number(coordinate, 0) : coordinate));
  const place = `At ${x}, ${z}, ${y} high, facing ${here[3]}`;
  const far = number(blocksWalked(walk, step), 0);
  const map = picture(
    ...frame.slice(2),
    `The walk, seen from above. ${place}`,
    land(drawing, frame),
    trace(walk, step, here, frame),
  );
  map.setAttribute("viewBox", frame.join(" "));
  map.setAttribute("class", "map");
  const say = `${place}; ${far} blocks walked. North is up; the map is ${number(frame[2], 0)} blocks wide.`;
  return [map, caption(say), ...(rows ? [biomeLegend(drawing)] : [])];
}

function land(drawing, [x, y, width, height]) {
  const size = { x, y, width, height };
  if (!drawing.rows) return shape("rect", { class: "board", ...size });
  return shape("image", { href: landPicture(drawing), preserveAspectRatio: "none", ...size });
}

// The way so far, the way to come, the start, and where the player stands and looks.
function trace(walk, step, here, frame) {
  const unit = Math.max(frame[2], frame[3]) / 100;
  const line = (kind, from, to, width) => {
    const places = walk.slice(from, to + 1).filter((place) => place);
    const points = places.map(([x, , z]) => `${x},${z}`).join(" ");
    return shape("polyline", { class: `walk ${kind}`, points, "stroke-width": unit * width });
  };
  const [cx, , cy] = walk.find((place) => place);
  const turned = `translate(${here[0]} ${here[2]}) scale(${unit}) rotate(${HEADINGS.indexOf(here[3]) * 45})`;
  return [
    line("ahead", step, walk.length, 0.5),
    line("rim", 0, step, 1.5),
    line("past", 0, step, 0.8),
    shape("circle", { class: "start", cx, cy, r: unit * 1.4, "stroke-width": unit * 0.5 }),
    shape("path", { class: "here", d: "M0 -3L2.2 2.4L0 1.3L-2.2 2.4Z", "stroke-width": 0.4, transform: turned }),
  ];
}

function blocksWalked(walk, step) {
  let far = 0;
  for (let at = 1; at <= step; at += 1) {
    const [from, to] = [walk[at - 1], walk[at]];
    if (from && to) far += Math.hypot(to[0] - from[0], to[2] - from[2]);
  }
  return far;
}

function biomeLegend({ biomes, goal }) {
  const entries = biomes.map((name) => {
    const swatch = element("span", { class: "swatch" });
    swatch.style.background = BIOMES[name];
    const words = name.toLowerCase().replaceAll("_", " ");
    return goal.includes(name)
      ? element("li", { class: "goal" }, swatch, `${words} (the goal)`)
      : element("li", {}, swatch, words);
  });
  return element("ul", { class: "legend" }, entries);
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
