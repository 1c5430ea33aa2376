"use strict";
// The data of the page, elements, and pictures of codes that a table gives colours.

const DATA = JSON.parse(document.getElementById("data").textContent);
const TABLES = {}; // colours of the codes of each layer
for (const layer of ["depth", "confidence", "error", "map"]) TABLES[layer] = DATA.colours[layer].map(rgb);

function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "class") element.className = value;
    else if (name === "background") element.style.background = value;
    else if (name === "colour") { // one of page_colours.py
      element.style.background = `var(--is-${value})`;
      element.style.color = `var(--on-${value})`;
    }
    else element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null)); // strings become text, never markup
  return element;
}

function rgb(hex) {
  return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
}

// Decode a picture of codes, {width, height, deflated}; resolves to {width, height, codes}. It is no image, since
// browsers that hinder fingerprinting change the pixels that a script reads from one.
const decoded = new Map();
function codesOf(picture) {
  if (!decoded.has(picture)) {
    if (decoded.size > 400) decoded.clear();
    decoded.set(picture, inflated(picture));
  }
  return decoded.get(picture);
}

async function inflated({ width, height, deflated }) {
  const bytes = Uint8Array.from(atob(deflated), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const codes = new Uint8Array(await new Response(stream).arrayBuffer());
  for (let n = width; n < codes.length; n += 1) codes[n] += codes[n - width]; // modulo 256
  return { width, height, codes };
}

// Draw codes in their colours on a canvas of their size.
function paint(canvas, picture, colours) {
  canvas.width = picture.width;
  canvas.height = picture.height;
  const context = canvas.getContext("2d");
  const image = context.createImageData(picture.width, picture.height);
  picture.codes.forEach((code, n) => image.data.set([...colours[code], 255], 4 * n));
  context.putImageData(image, 0, 0);
}

// What a code of a layer means, in words.
const READ = {
  depth(code) {
    const [near, far] = DATA.depthRange;
    if (code === 0) return "unknown";
    return code === 255 ? "sky or beyond" : `${(near * (far / near) ** ((code - 1) / 253)).toFixed(1)} m`;
  },
  confidence: (code) => (code / 255).toFixed(2),
  error(code) {
    if (code === 0) return "not scored";
    const percent = `${code < 128 ? "" : "+"}${(100 * Math.expm1((code - 128) / 100)).toFixed(0)} %`;
    return code === 1 ? `${percent} or less` : code === 255 ? `${percent} or more` : percent;
  },
};

const MOVES = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }; // of the point that is read
const STRIDE = 1 / 64; // of the picture's side, of a move

// A figure with a layer of codes: update(picture) shows another one. The mouse reads its values, and so do the arrow keys
// while it has the focus. beside: the figure of another layer, whose reading follows in brackets.
function layerFigure(layer, title, scale, beside = null) {
  const canvas = make("canvas", { "data-layer": layer, role: "img", "aria-label": `${title}; arrow keys read its values`, tabindex: 0 });
  const cross = make("i", { class: "cross", hidden: "" });
  const reading = make("span", { class: "reading" });
  const caption = make("figcaption", {}, make("span", {}, title), reading);
  let shown = null;
  let wanted = null;
  let mouse = null, keys = null; // the points [x, y] under the mouse and of the arrow keys, 0 to 1 each
  const listeners = [];
  const read = () => {
    const point = mouse ?? keys;
    const at = point && readingAt(point), other = point && beside ? beside.readingAt(point) : "";
    reading.textContent = (at ?? "") + (at && other ? ` (${other})` : "");
  };
  const readingAt = ([x, y]) => {
    if (!shown) return "";
    const column = Math.min(shown.width - 1, Math.floor(x * shown.width));
    return READ[layer](shown.codes[Math.min(shown.height - 1, Math.floor(y * shown.height)) * shown.width + column]);
  };
  const readByKeys = (point) => {
    keys = point;
    cross.hidden = !point;
    if (point) {
      [cross.style.left, cross.style.top] = point.map((share) => `${100 * share}%`);
      reading.setAttribute("aria-live", "polite"); // what the mouse reads is not announced
    } else reading.removeAttribute("aria-live");
    read();
  };
  canvas.addEventListener("mousedown", (event) => event.preventDefault()); // a click leaves the keys to the time line
  canvas.addEventListener("mousemove", (event) => {
    mouse = [event.offsetX / canvas.clientWidth, event.offsetY / canvas.clientHeight].map(inside);
    read();
  });
  canvas.addEventListener("mouseleave", () => { mouse = null; read(); });
  canvas.addEventListener("focus", () => readByKeys([0.5, 0.5]));
  canvas.addEventListener("blur", () => readByKeys(null));
  canvas.addEventListener("keydown", (event) => {
    const move = MOVES[event.key];
    if (!move || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation(); // the time line stays where it is
    readByKeys(keys.map((share, axis) => inside(share + STRIDE * move[axis])));
  });
  if (beside) beside.listeners.push(read); // its picture may be decoded later
  const figure = make("figure", {}, caption, make("div", { class: "picture" }, canvas, cross), scale);
  const changed = () => [read, ...listeners].forEach((each) => each());
  return {
    figure, readingAt, listeners,
    update(picture) {
      wanted = picture;
      if (!picture) {
        shown = null;
        canvas.width = canvas.height = 1;
        changed();
        return;
      }
      codesOf(picture).then((codes) => {
        if (wanted !== picture) return; // the time line has moved on
        shown = codes;
        paint(canvas, codes, TABLES[layer]);
        changed();
      });
    },
  };
}

function inside(share) {
  return Math.min(Math.max(share, 0), 1);
}

function bar(layer, codes, labels) {
  const stops = codes.map((code) => DATA.colours[layer][code]).join(", ");
  return make("div", {}, make("div", { class: "scale", background: `linear-gradient(to right, ${stops})` }),
    make("figcaption", {}, ...labels.map((label) => make("span", {}, label))));
}
