"use strict";
// What all other scripts build on: making elements, unpacking data, printing numbers.
// Text that came out of a record is only ever set as text, never as markup.

const SVG = "http://www.w3.org/2000/svg";

function $(id) {
  return document.getElementById(id);
}

// Ask the server: its answer, or in words what went wrong, with it or on the way to it.
async function request(path, options) {
  try {
    const answer = await fetch(path, options);
    return answer.ok ? { answer: await answer.json() } : { problem: await answer.text() };
  } catch {
    return { problem: "The server cannot be reached. Try again once there is a connection." };
  }
}

// Within another page the focus stays where it is: moving it would scroll that page.
function takeFocus(target) {
  if (window.parent === window) target?.focus();
}

function fill(made, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== ""));
  return made;
}

// An HTML element; its children are elements or plain text.
function element(tag, attributes = {}, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

// The same for the elements of an SVG picture.
function shape(tag, attributes = {}, ...children) {
  return fill(document.createElementNS(SVG, tag), attributes, children);
}

// A picture with a name for screen readers.
function picture(width, height, name, ...children) {
  const attributes = { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": name };
  return shape("svg", attributes, ...children);
}

function label(x, y, text, attributes = {}) {
  return shape("text", { x, y, ...attributes }, String(text));
}

// Data are in the page as gzipped JSON in base64, and are unpacked when they are needed.
async function unpack(id) {
  const bytes = Uint8Array.from(atob($(id).textContent), (character) => character.charCodeAt(0));
  const plain = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(plain).json();
}

// Rows out of their columns, which are shorter: a column has the numbers of its rows, null for all, and the values.
function rowsOf(packed) {
  if (Array.isArray(packed)) return packed;
  const rows = Array.from({ length: packed.rows }, () => []);
  for (const [name, [numbers, values]] of Object.entries(packed.columns)) {
    rowsOf(values).forEach((value, at) => rows[numbers?.[at] ?? at].push([name, value]));
  }
  return rows.map((fields) => Object.fromEntries(fields));
}

function number(value, digits = 2) {
  if (value === null || value === undefined) return "–";
  return value.toLocaleString("en", { maximumFractionDigits: digits }).replace("-", "−");
}

// Words that are written for terminals, with the sign of print.
function typeset(words) {
  return words.replaceAll("<=", "≤");
}

// A text that scrolls is reached with the keyboard.
function letScroll(box) {
  for (const text of box.querySelectorAll("pre")) if (text.scrollHeight > text.clientHeight + 1) text.tabIndex = 0;
}

function percent(share) {
  return `${number(100 * share, 0)} %`;
}

function plural(count, word) {
  return `${number(count)} ${word}${count === 1 ? "" : "s"}`;
}

function between(low, value, high) {
  return Math.max(low, Math.min(value, high));
}

// "3", "3 and 4", "3 to 9": a range of numbers in words.
function range(first, last) {
  if (first === last) return `${first}`;
  return last === first + 1 ? `${first} and ${last}` : `${first} to ${last}`;
}

function toggleTheme() {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const now = document.documentElement.dataset.theme ?? (dark ? "dark" : "light");
  document.documentElement.dataset.theme = now === "dark" ? "light" : "dark";
}

// Copy a text and say so on the button for a moment.
async function copy(button, text) {
  const words = button.textContent;
  try {
    await navigator.clipboard.writeText(text);
    button.textContent = "copied";
  } catch {
    button.textContent = "not allowed here";
  }
  setTimeout(() => (button.textContent = words), 1200);
}
