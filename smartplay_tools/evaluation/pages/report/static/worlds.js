"use strict";
// Crafter: what the player sees, and the land that it has seen so far.

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
