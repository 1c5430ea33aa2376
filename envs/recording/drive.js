"use strict";
// One drive or two side by side, and the time line that moves through them.

const STANDING = 1e-7; // [m] between the positions of two steps of the same way, as where the rover turns in place
const SAME_COURSE = 0.1; // [m] by which start, goal and shortest path of two drives of one course may differ
const byId = (id) => document.getElementById(id);
const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

let columns = [];
let by = "time"; // what two drives have in common at a position: time or way
let stops = []; // positions of the time line [s] or [m]
let index = 0;
let timer = null;

// The position of a step on the time line. No two steps of a drive have the same one, so that each can be shown.
function coordinate(drive, n) {
  if (by === "time") return n * drive.stepSeconds;
  let first = n;
  while (first > 0 && drive.steps[first - 1].way === drive.steps[n].way) first -= 1;
  return drive.steps[n].way + (n - first) * STANDING;
}

const moment = (drive, n) => `step ${n}, ${(n * drive.stepSeconds).toFixed(0)} s, ${drive.steps[n].way.toFixed(1)} m driven`;

// The step at which a drive is at a position of the time line: the last one that is not beyond it.
function stepAt(drive, position) {
  let n = 0;
  while (n + 1 < drive.steps.length && coordinate(drive, n + 1) <= position + STANDING / 10) n += 1;
  return n;
}

// The column of a drive: its outcome, and what there is to see and to know at a step.
function driveColumn(drive) {
  const eyes = ["left", "right"].map((side) => make("img", { alt: `${side} eye` }));
  const depth = layerFigure("depth", "depth", bar("depth", [37, 73, 122, 158, 180], ["1 m", "2", "5", "10", "15 m"]));
  const confidence = layerFigure("confidence", "confidence", bar("confidence", [0, 64, 128, 191, 255], ["0", "0.5", "1"]));
  const error = layerFigure("error", "error of the depth", bar("error", [118, 123, 128, 133, 138], ["-10 % nearer", "0", "+10 % farther"]), depth);
  const scored = drive.pictures.error.some((picture) => picture);
  const map = mapPanel(drive);
  const costs = costsPanel(map.emphasise);
  const when = make("h2"), reason = make("p", { class: "reason" }), facts = make("div", { class: "facts" });
  const lookNote = make("p", { class: "note" });
  const figures = [...eyes.map((eye, n) => make("figure", {}, make("figcaption", {}, n ? "right eye" : "left eye"), eye)),
    depth.figure, confidence.figure, ...(scored ? [error.figure] : [])];
  const jump = make("button", { class: "jump", onclick: () => goTo(coordinate(drive, drive.decided.step)) }, `go to step ${drive.decided.step}`);
  const ending = outcomeOf(drive.outcome);
  const element = make("article", {},
    make("div", { class: "head" }, make("h1", {}, drive.name),
      make("span", { class: "badge", colour: ending[0] }, ending[1])),
    make("div", { class: "body" },
      make("div", { class: "panel decided" }, make("p", {}, drive.summary),
        make("p", {}, `Decided at step ${drive.decided.step}: ${drive.decided.why}. `, jump)),
      make("div", { class: "panel" }, when, reason, facts)),
    make("div", { class: "body evidence" },
      make("div", {}, make("div", { class: "panel" }, make("div", { class: scored ? "views three" : "views" }, ...figures), lookNote),
        costs.panel),
      make("div", {}, map.panel)));

  function update(n) {
    const step = drive.steps[n];
    let look = n;
    while (look > 0 && !drive.steps[look].looked) look -= 1;
    eyes.forEach((eye, side) => {
      const uri = drive.pictures[side ? "right" : "left"][look];
      if (uri) eye.src = uri;
    });
    depth.update(drive.pictures.depth[look]);
    confidence.update(drive.pictures.confidence[look]);
    error.update(drive.pictures.error[look]);
    lookNote.textContent = look === n ? "" : `No look at this step: the images are those of step ${look}.`;
    when.textContent = moment(drive, n);
    const [colour, words] = statusOf(step);
    reason.replaceChildren(make("span", { class: "chip", colour }, words), reasonOf(step, n));
    const values = factsOf(step, drive.steps[look], drive.pictures.error[look], drive.rover);
    facts.replaceChildren(...values.map(([name, value, alarm]) =>
      make("div", alarm ? { class: "alarm" } : {}, make("small", {}, name), value)));
    map.update(n);
    costs.update(step);
  }

  function reasonOf(step, n) {
    if (n < drive.steps.length - 1) return step.reason ?? "";
    return step.reason ? `${step.reason}; the drive ended: ${ending[1]}` : "the drive ended here";
  }

  return { drive, element, update, map };
}

// The strip of a drive: what it did, its clearance and its depth error, over the position.
function drawStrip(canvas, drive) {
  const ratio = window.devicePixelRatio || 1;
  const width = (canvas.width = Math.round(canvas.clientWidth * ratio)), height = (canvas.height = Math.round(64 * ratio));
  const context = canvas.getContext("2d");
  const end = stops[stops.length - 1] || 1;
  const x = (position) => (position / end) * (width - 2);
  const last = drive.steps.length - 1;
  drive.steps.forEach((step, n) => {
    const from = x(coordinate(drive, n)), to = n < last ? x(coordinate(drive, n + 1)) : from + 3 * ratio;
    context.fillStyle = style(`--is-${statusOf(step)[0]}`);
    context.fillRect(from, 0, Math.max(to - from, ratio), 13 * ratio);
  });
  const curve = (values, most, colour) => {
    context.strokeStyle = colour;
    context.lineWidth = 1.6 * ratio;
    context.beginPath();
    values.forEach(([position, value], k) => {
      const y = height - 15 * ratio - (Math.min(value, most) / most) * (height - 32 * ratio);
      context[k ? "lineTo" : "moveTo"](x(position), y);
    });
    context.stroke();
  };
  const points = (value) => drive.steps.map((step, n) => [coordinate(drive, n), value(step)]).filter((point) => point[1] !== null);
  curve(points((step) => step.clearance), 3, style("--clear"));
  const errors = points((step) => step.abs_rel);
  curve(errors, 0.2, style("--error"));
  context.font = `${11 * ratio}px system-ui, sans-serif`;
  const words = [["clearance, 0 to 3 m", "--clear"]];
  if (errors.length) words.push(["depth error, 0 to 20 %", "--error"]);
  const cell = columns.some((other) => other.drive.cell !== drive.cell) ? `, ${drive.cell}` : "";
  if (columns.length > 1) words.unshift([`${drive.driver}, ${drive.perception}${cell}`, "--ink"]);
  let left = 2;
  for (const [text, colour] of words) {
    context.fillStyle = style(colour);
    context.fillText(text, left, height - 3.5 * ratio);
    left += context.measureText(text).width + 16 * ratio;
  }
  const mark = x(coordinate(drive, drive.decided.step));
  context.fillStyle = style("--accent");
  context.fillRect(mark - ratio, 0, 2 * ratio, height - 15 * ratio);
  const flag = "decided", across = context.measureText(flag).width + 8 * ratio;
  const start = mark + across > width ? mark - across : mark;
  context.fillRect(start, 13 * ratio, across, 14 * ratio);
  context.fillStyle = style("--on-accent");
  context.fillText(flag, start + 4 * ratio, 24 * ratio);
  context.fillStyle = style("--ink");
  const here = x(stops[index]);
  context.fillRect(here - ratio, 0, 2.4 * ratio, height - 15 * ratio);
}

function show() {
  const position = stops[index];
  columns.forEach((column) => column.update(stepAt(column.drive, position)));
  columns.forEach((column) => drawStrip(column.strip, column.drive));
  byId("position").value = index;
  const inWords = (drive, n) => `${moment(drive, n)}: ${statusOf(drive.steps[n])[1]}`;
  byId("position").setAttribute("aria-valuetext", columns.map(({ drive }) => inWords(drive, stepAt(drive, position))).join("; "));
  byId("now").textContent = by === "time" ? `${position.toFixed(0)} s` : `${position.toFixed(1)} m driven`;
  if (columns.length === 1) byId("now").textContent = moment(columns[0].drive, stepAt(columns[0].drive, position));
}

function moveTo(n) {
  index = Math.min(Math.max(n, 0), stops.length - 1);
  show();
}

function goTo(position) {
  let nearest = 0;
  stops.forEach((stop, n) => { if (Math.abs(stop - position) < Math.abs(stops[nearest] - position)) nearest = n; });
  moveTo(nearest);
}

// Whether two drives are of one course, as envs.report judges it.
function ofOneCourse(a, b) {
  const [one, other] = [a.shortest_path, b.shortest_path];
  const near = ([x, y], [u, v]) => Math.hypot(x - u, y - v) <= SAME_COURSE;
  const length = (way) => way.slice(1).reduce((sum, [x, y], n) => sum + Math.hypot(x - way[n][0], y - way[n][1]), 0);
  if (!near(a.goal, b.goal) || a.obstacles.length !== b.obstacles.length) return false;
  if (!one.length || !other.length) return one.length === other.length;
  return near(one[0], other[0]) && Math.abs(length(one) - length(other)) <= SAME_COURSE;
}

function layOut() {
  const all = columns.flatMap(({ drive }) => drive.steps.map((_, n) => coordinate(drive, n)));
  stops = [...new Set(all)].sort((a, b) => a - b);
  const met = new Map(columns.flatMap(({ drive }) => drive.steps.map((step) => statusOf(step).toReversed())));
  const entries = [...met].map(([words, colour]) => make("span", {}, make("i", { colour }), words));
  byId("statuses").replaceChildren(...entries);
  byId("position").max = stops.length - 1;
  byId("sync").hidden = columns.length < 2;
  byId("beside").hidden = columns.length > 1;
  byId("apart").hidden = columns.every(({ drive }) => ofOneCourse(columns[0].drive, drive));
  document.body.classList.toggle("pair", columns.length > 1);
}

function addDrive(drive) {
  const column = driveColumn(drive);
  column.strip = make("canvas", { title: "drag to move through the drive" });
  const scrub = (event) => goTo((event.offsetX / column.strip.clientWidth) * (stops[stops.length - 1] || 1));
  column.strip.addEventListener("pointerdown", (event) => { column.strip.setPointerCapture(event.pointerId); scrub(event); });
  column.strip.addEventListener("pointermove", (event) => { if (event.buttons) scrub(event); });
  columns.push(column);
  byId("strips").append(column.strip);
  byId("drives").append(column.element);
}

function play() {
  const playing = timer !== null;
  clearInterval(timer);
  timer = playing ? null : setInterval(() => (index + 1 < stops.length ? moveTo(index + 1) : play()), 250);
  byId("play").textContent = playing ? "play" : "pause";
}

function decidedStep() {
  goTo(coordinate(columns[0].drive, columns[0].drive.decided.step));
}

// No letters: speech input would trigger them by mistake (WCAG 2.1.4).
const KEYS = {
  ArrowLeft: () => moveTo(index - 1), ArrowRight: () => moveTo(index + 1), PageUp: () => moveTo(index - 10),
  PageDown: () => moveTo(index + 10), Home: () => moveTo(0), End: () => moveTo(stops.length - 1), " ": play, Enter: decidedStep,
};
const CONTROLS = "button, input:not([type=range])";
document.addEventListener("keydown", (event) => {
  const act = KEYS[event.key];
  if (event.ctrlKey || event.metaKey || event.altKey || !act) return;
  if ([" ", "Enter"].includes(event.key) && event.target.matches(CONTROLS)) return; // it presses that
  if (event.key.startsWith("Arrow") && event.target.matches("input[type=radio]")) return; // it chooses another one
  event.preventDefault();
  act();
});
byId("position").addEventListener("input", (event) => moveTo(Number(event.target.value)));
byId("back").addEventListener("click", KEYS.ArrowLeft);
byId("on").addEventListener("click", KEYS.ArrowRight);
byId("play").addEventListener("click", play);
window.addEventListener("resize", show);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show); // for the colours of the time line
document.querySelectorAll("input[name=sync]").forEach((choice) => choice.addEventListener("change", () => {
  const before = stepAt(columns[0].drive, stops[index]);
  by = choice.value;
  layOut();
  goTo(coordinate(columns[0].drive, before));
}));
byId("other").addEventListener("change", async (event) => {
  const [file] = event.target.files, before = columns.length;
  if (!file) return; // the choice was cancelled
  try {
    const data = JSON.parse(new DOMParser().parseFromString(await file.text(), "text/html").getElementById("data").textContent);
    if (data.format !== DATA.format) {
      alert("This page is of another version. Run envs.report on the folders of both drives.");
      return;
    }
    addDrive(data.drives[0]);
    layOut();
    moveTo(Math.min(index, stops.length - 1));
  } catch {
    columns.splice(before).forEach((column) => [column.strip, column.element].forEach((part) => part.remove()));
    layOut();
    moveTo(Math.min(index, stops.length - 1));
    alert("This file is no page of a recorded drive.");
  } finally {
    event.target.value = ""; // so that the same file can be chosen again, once it is mended
  }
});

DATA.drives.forEach(addDrive);
layOut();
show();
