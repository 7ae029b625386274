"use strict";
// Curves over the turns of an episode. They share one axis, so that a moment stands at the same place in each of them;
// a click goes there.

const EDGE = { left: 52, right: 14, top: 10, bottom: 20 };

// Round numbers from at most the lowest to at least the highest, about as many as asked for.
function ticks(low, most, about = 4) {
  const high = most > low ? most : low + 1;
  const rough = (high - low) / about;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((size) => size >= rough);
  const values = [];
  for (let at = Math.floor(low / step) * step; at < high + step * 0.999; at += step) values.push(Number(at.toFixed(10)));
  return values;
}

// The place of a turn on the common axis.
function turnScale(width, count) {
  const inner = width - EDGE.left - EDGE.right;
  const each = inner / Math.max(1, count);
  return {
    middle: (turn) => EDGE.left + (turn + 0.5) * each,
    start: (turn) => EDGE.left + turn * each,
    turn: (x) => between(0, Math.floor((x - EDGE.left) / each), count - 1),
    each,
    count,
  };
}

// Many points on few pixels: of each pixel's points the lowest and the highest are enough.
function thinned(points, most = 1500) {
  if (points.length <= most) return points;
  const size = Math.ceil((2 * points.length) / most);
  const kept = [];
  for (let at = 0; at < points.length; at += size) {
    const bin = points.slice(at, at + size).sort((a, b) => a[1] - b[1]);
    kept.push(...(bin.length > 1 ? [bin[0], bin.at(-1)] : bin).sort((a, b) => a[0] - b[0]));
  }
  return kept;
}

// The place of a value on a chart whose marks go from bottom to top.
function heightScale(marks, height) {
  const [low, high] = [marks[0], marks.at(-1)];
  return (value) => height - EDGE.bottom - ((value - low) / (high - low)) * (height - EDGE.top - EDGE.bottom);
}

function across(kind, width, y) {
  return shape("line", { class: kind, x1: EDGE.left, x2: width - EDGE.right, y1: y, y2: y });
}

// A chart: its marks with their lines, what is drawn, the moment that is shown, and the numbers of the turns.
function chart([width, height], name, marks, x, turn, drawn) {
  const y = heightScale(marks, height);
  const tick = { class: "tick", "text-anchor": "end" };
  const grid = marks.map((mark) => [across("grid", width, y(mark)), label(EDGE.left - 8, y(mark) + 4, number(mark), tick)]);
  const moment = shape("line", { class: "moment", x1: x.middle(turn), x2: x.middle(turn), y1: EDGE.top, y2: height - EDGE.bottom });
  return picture(width, height, name, grid, drawn, moment, turnTicks(x, x.count, height));
}

// A curve: `values` by turn (null where there is none), a `cap` as a line, steps instead of slopes if `stepped`.
function curve(box, { name, values, cap = null, stepped = false, kind, turn }) {
  const [width, height] = [Math.max(320, box.clientWidth), 132];
  const x = turnScale(width, values.length);
  const given = values.flatMap((value, at) => (value === null ? [] : [[at, value]]));
  const all = [...given.map(([, value]) => value), 0, ...(cap === null ? [] : [cap])];
  const marks = ticks(...extent(all));
  const y = heightScale(marks, height);
  const points = thinned(given).map(([at, value]) => [x.middle(at), y(value)]);
  const path = points
    .map(([px, py], at) => (at === 0 ? `M${px} ${py}` : stepped ? `H${px}V${py}` : `L${px} ${py}`))
    .join("");
  const here = values[turn];
  const drawn = [
    points.length ? shape("path", { class: `area ${kind}`, d: `${path}V${y(0)}H${points[0][0]}Z` }) : null,
    shape("path", { class: `curve ${kind}`, d: path }),
    cap === null ? null : across("cap", width, y(cap)),
    here === null || here === undefined ? null : shape("circle", { class: `dot ${kind}`, cx: x.middle(turn), cy: y(here), r: 4 }),
  ];
  box.replaceChildren(chart([width, height], `${name}, by turn; now ${number(here)}`, marks, x, turn, drawn));
  return x;
}

// The ends of a list of numbers; `Math.min(...list)` fails on long lists.
function extent(list) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of list) [low, high] = [Math.min(low, value), Math.max(high, value)];
  return [low, high];
}

function turnTicks(x, count, height) {
  return ticks(0, Math.max(1, count - 1), 10)
    .filter((turn) => turn < count && Number.isInteger(turn))
    .map((turn) => label(x.middle(turn), height - 4, number(turn), { class: "tick", "text-anchor": "middle" }));
}
