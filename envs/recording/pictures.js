"use strict";
// The data of the page, elements, and pictures whose pixels are codes that a table gives colours.

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

// Decode a picture of codes; resolves to {width, height, codes}.
const decoded = new Map();
function codesOf(uri) {
  if (!decoded.has(uri)) {
    if (decoded.size > 400) decoded.clear();
    decoded.set(uri, new Promise((resolve, reject) => {
      const image = new Image();
      image.onload = () => {
        const canvas = document.createElement("canvas");
        canvas.width = image.width;
        canvas.height = image.height;
        const context = canvas.getContext("2d", { willReadFrequently: true });
        context.drawImage(image, 0, 0);
        const pixels = context.getImageData(0, 0, image.width, image.height).data;
        resolve({ width: image.width, height: image.height, codes: pixels.filter((_, n) => n % 4 === 0) });
      };
      image.onerror = () => reject(new Error("a picture of the record is broken"));
      image.src = uri;
    }));
  }
  return decoded.get(uri);
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

// A figure with a layer of codes: update(uri) shows another one, and the mouse reads its values.
// beside: the figure of another layer, whose reading follows in brackets.
function layerFigure(layer, title, scale, beside = null) {
  const canvas = make("canvas", { "data-layer": layer, role: "img", "aria-label": title });
  const reading = make("span");
  const caption = make("figcaption", {}, make("span", {}, title), reading);
  let shown = null;
  let wanted = null;
  canvas.addEventListener("mousemove", (event) => {
    if (!shown) return;
    const column = Math.floor((event.offsetX / canvas.clientWidth) * shown.width);
    const row = Math.floor((event.offsetY / canvas.clientHeight) * shown.height);
    const n = Math.min(shown.codes.length - 1, row * shown.width + column);
    reading.textContent = beside ? `${readingAt(n)} (${beside.readingAt(n)})` : readingAt(n);
  });
  canvas.addEventListener("mouseleave", () => { reading.textContent = ""; });
  const figure = make("figure", {}, caption, canvas, scale);
  const readingAt = (n) => (shown ? READ[layer](shown.codes[n]) : "");
  return {
    figure, readingAt,
    update(uri) {
      wanted = uri;
      if (!uri) {
        shown = null;
        canvas.width = canvas.height = 1;
        return;
      }
      codesOf(uri).then((picture) => {
        if (wanted !== uri) return; // the time line has moved on
        shown = picture;
        paint(canvas, picture, TABLES[layer]);
      });
    },
  };
}

function bar(layer, codes, labels) {
  const stops = codes.map((code) => DATA.colours[layer][code]).join(", ");
  return make("div", {}, make("div", { class: "scale", background: `linear-gradient(to right, ${stops})` }),
    make("figcaption", {}, ...labels.map((label) => make("span", {}, label))));
}
