"use strict";
// The picture of a turn: what stands on the page about it, the game, the turn and the context band, as a PNG.
// A copy of these elements that brings its style along is put into an SVG image, which a canvas can paint.

// What the picture takes over of an element's style; the rest follows from its kind.
const STYLE = [
  ...["display", "box-sizing", "width", "height", "margin", "padding", "border-top", "border-right", "border-bottom", "border-left"],
  ...["border-radius", "background-color", "color", "opacity", "font-family", "font-size", "font-weight", "line-height"],
  ...["font-variant-numeric", "text-align", "text-decoration", "list-style"],
  ...["white-space", "overflow-wrap", "grid-template-columns", "gap", "flex", "flex-wrap", "align-items", "justify-content"],
  ...["image-rendering", "vertical-align", "border-collapse", "border-spacing", "fill", "fill-rule", "stroke", "stroke-width", "stroke-dasharray", "stroke-linecap"],
  ...["stroke-linejoin", "text-anchor"],
];
const UNDRAWN = "button, label, .copies";
const [SHOT_EDGE, SHOT_SCALE] = [24, 2];

// A copy of an element as it looks now; null for what a picture does not show.
function lookOf(node) {
  if (node.nodeType === Node.TEXT_NODE) return node.cloneNode();
  if (node.nodeType !== Node.ELEMENT_NODE || node.hidden || node.matches(UNDRAWN)) return null;
  const look = node instanceof HTMLCanvasElement ? element("img", { src: node.toDataURL() }) : node.cloneNode(false);
  const style = getComputedStyle(node);
  for (const name of STYLE) look.style.setProperty(name, style.getPropertyValue(name));
  look.style.overflow = style.overflow === "visible" ? "visible" : "hidden"; // nothing scrolls in a picture
  look.append(...[...node.childNodes].map(lookOf).filter(Boolean));
  return look;
}

// XML has no place for lone halves of characters and for most control characters, which a model may write.
function asXml(node) {
  const xml = new XMLSerializer().serializeToString(node).toWellFormed();
  return xml.replace(/[\u0000-\u0008\u000b\u000c\u000e-\u001f\ufffe\uffff]/g, "\ufffd");
}

// The turn that is shown, as on the page: the game beside the turn, or above it where there is no room.
function snapshot() {
  const isNarrow = $("band").clientWidth < 700;
  return painted([["episode-title"], ["place"], ...(isNarrow ? [["game"], ["said", "answers"]] : [["game", "said", "answers"]]), ["band"], ["sentence"]], $("band"));
}

// Rows of elements on a canvas, as wide as an element of the page and with the ground of its card.
async function painted(rows, measure) {
  const ground = getComputedStyle(($("game") ?? measure).closest(".card"));
  const [width, isNarrow] = [measure.clientWidth, measure.clientWidth < 700];
  const box = element("div");
  let height = 0;
  for (const ids of rows) {
    const parts = ids.map($).filter((part) => part.clientHeight);
    const [first, ...others] = parts.map(lookOf);
    for (const look of [first, ...others]) Object.assign(look.style, { display: look.style.display === "grid" ? "grid" : "block", margin: "0" });
    const row = element("div", {}, first, ...(first && others.length ? [element("div", {}, ...others)] : []));
    Object.assign(row.style, { display: "flex", gap: "32px", alignItems: "flex-start", marginBottom: "12px" });
    const highs = parts.map((part) => part.getBoundingClientRect().height);
    height += 12 + (isNarrow ? highs.reduce((sum, high) => sum + high, 0) : Math.max(highs[0] ?? 0, highs.slice(1).reduce((sum, high) => sum + high, 0)));
    if (parts.length) box.append(row);
  }
  box.style.color = ground.color;
  const [wide, high] = [width + 2 * SHOT_EDGE, height + 2 * SHOT_EDGE];
  const frame = `<svg xmlns="${SVG}" width="${wide}" height="${high}"><foreignObject x="${SHOT_EDGE}" y="${SHOT_EDGE}" width="${wide - 2 * SHOT_EDGE}" height="${high}">${asXml(box)}</foreignObject></svg>`;
  const image = new Image();
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(frame)}`;
  await image.decode();
  const canvas = element("canvas", { width: wide * SHOT_SCALE, height: high * SHOT_SCALE });
  const pen = canvas.getContext("2d");
  pen.fillStyle = ground.backgroundColor;
  pen.fillRect(0, 0, canvas.width, canvas.height);
  pen.drawImage(image, 0, 0, canvas.width, canvas.height);
  return canvas;
}

// Copy the picture; where a page may not, it is saved as a file.
async function copyPicture(button, paint = snapshot, name = `${shown.episode.game}-turn-${shown.turn}.png`) {
  const words = button.textContent;
  try {
    const canvas = await paint();
    try {
      const made = new Promise((resolve) => canvas.toBlob(resolve));
      await navigator.clipboard.write([new ClipboardItem({ "image/png": made })]);
      button.textContent = "copied";
    } catch {
      element("a", { href: canvas.toDataURL(), download: name }).click();
      button.textContent = "saved";
    }
  } catch {
    button.textContent = "not possible here";
  }
  setTimeout(() => (button.textContent = words), 1200);
}
