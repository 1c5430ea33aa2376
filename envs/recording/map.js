"use strict";
// The navigator's map around the rover, with all motions that it compared.

const AROUND = 9; // [m] shown to each side of the rover
const STEP = 0.1; // [m] between two points of an arc
const LONGEST = 20; // [m] of a motion that is drawn
const DEAR = 2.5; // [m] more cost than the chosen motion's, from which candidates have the same colour

const yawOf = (pose) => Math.atan2(pose[1][0], pose[0][0]);
const placeOf = (pose) => [pose[0][3], pose[1][3], yawOf(pose)];

// Points of a candidate motion from a place [x, y, yaw], as far as it is free.
function motionPoints([x, y, yaw], candidates, n) {
  const heading = yaw + candidates.turn[n];
  const curvature = candidates.curvature[n];
  const points = [];
  for (let s = 0; s <= Math.min(candidates.free[n], LONGEST) + 1e-9; s += STEP) {
    const angle = curvature * s;
    const chord = Math.abs(angle) < 1e-9 ? s : (2 * Math.sin(angle / 2)) / curvature;
    points.push([x + chord * Math.cos(heading + angle / 2), y + chord * Math.sin(heading + angle / 2)]);
  }
  return points;
}

function footprint([x, y, yaw], rover) {
  return [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([a, b]) => {
    const ahead = (a * rover.length) / 2, left = (b * rover.width) / 2;
    return [x + Math.cos(yaw) * ahead - Math.sin(yaw) * left, y + Math.sin(yaw) * ahead + Math.cos(yaw) * left];
  });
}

// Moves points of the true world to where the odometry takes them to be, as the map is drawn in its frame.
function believedFrame(step) {
  const [x, y, yaw] = placeOf(step.pose), [bx, by, byaw] = placeOf(step.believed_pose);
  const c = Math.cos(byaw - yaw), s = Math.sin(byaw - yaw);
  return ([px, py]) => [bx + c * (px - x) - s * (py - y), by + s * (px - x) + c * (py - y)];
}

// Whether the odometry takes the goal of a drive to be somewhere else at a step.
function goalIsAstray(drive, step) {
  const [x, y] = believedFrame(step)(drive.goal);
  return Math.hypot(x - drive.goal[0], y - drive.goal[1]) > DATA.goalAstray;
}

// The last step up to n of which a drive has a map; -1 if there is none.
function mapStep(drive, n) {
  while (n >= 0 && !(drive.pictures.map[n] && drive.steps[n].map)) n -= 1;
  return n;
}

function costColour(extra) {
  const share = Math.min(Math.max(extra / DEAR, 0), 1);
  return `hsl(${Math.round(130 - 125 * share)} 75% ${Math.round(72 - 34 * share)}%)`; // lightness tells them apart too
}

// A panel with the map: update(n) draws step n, emphasise(candidate) lays one of its motions on top.
function mapPanel(drive) {
  const canvas = make("canvas", { "data-layer": "map", role: "img", "aria-label": "map" });
  const truth = make("input", { type: "checkbox", checked: "" });
  const whole = make("input", { type: "checkbox" });
  const note = make("span");
  const keepsMap = mapStep(drive, drive.steps.length - 1) >= 0;
  const panel = make("div", { class: "panel map" },
    make("h2", {}, keepsMap ? "map of the navigator, north up" : "map, north up"),
    make("div", { class: "tools" }, make("label", {}, truth, " true rocks and shortest path"),
      make("label", {}, whole, " whole course"), note), canvas, mapLegend(drive));
  let current = 0, emphasised = null, wanted = null;

  function view(step) {
    const [x, y] = placeOf(step.believed_pose);
    if (!whole.checked) return { x, y, half: AROUND };
    const points = [drive.goal, believedFrame(step)(drive.goal), ...drive.steps.map((other) => placeOf(other.pose))];
    const xs = points.map((p) => p[0]), ys = points.map((p) => p[1]);
    const middle = (values) => (Math.min(...values) + Math.max(...values)) / 2;
    const reach = (values) => (Math.max(...values) - Math.min(...values)) / 2 + 4;
    return { x: middle(xs), y: middle(ys), half: Math.max(reach(xs), reach(ys)) };
  }

  // ground: the picture of the map, or null; lies: where it lies
  function draw(ground, lies) {
    const step = drive.steps[current];
    const size = Math.max(200, Math.round(canvas.clientWidth * (window.devicePixelRatio || 1)));
    canvas.width = canvas.height = size;
    const context = canvas.getContext("2d");
    const { x: cx, y: cy, half } = view(step);
    const scale = size / (2 * half);
    const at = ([x, y]) => [(x - cx) * scale + size / 2, size / 2 - (y - cy) * scale];
    const line = (points, style, width, dash = []) => {
      if (points.length < 2) return;
      context.setLineDash(dash.map((d) => d * scale));
      context.strokeStyle = style;
      context.lineWidth = width * (size / 560);
      context.beginPath();
      points.forEach((point, n) => context[n ? "lineTo" : "moveTo"](...at(point)));
      context.stroke();
      context.setLineDash([]);
    };
    const circle = (point, radius, style, width, fill = null) => {
      context.beginPath();
      context.arc(...at(point), radius * scale, 0, 7);
      if (fill) { context.fillStyle = fill; context.fill(); }
      context.strokeStyle = style;
      context.lineWidth = width * (size / 560);
      context.stroke();
    };
    context.fillStyle = DATA.colours.map[0];
    context.fillRect(0, 0, size, size);
    context.lineCap = context.lineJoin = "round";
    if (ground) {
      const small = document.createElement("canvas");
      paint(small, ground, TABLES.map);
      const { west, south, cell, cells } = lies;
      context.imageSmoothingEnabled = false;
      const [left, top] = at([west, south + cell * cells]);
      context.drawImage(small, left, top, cell * cells * scale, cell * cells * scale);
    }
    const believed = believedFrame(step);
    if (truth.checked) {
      line(drive.shortest_path.map(believed), "rgba(250, 235, 150, .55)", 4);
      for (const [x, y, diameter] of drive.obstacles) circle(believed([x, y]), diameter / 2, "#fff", 1.2, "rgba(20, 16, 14, .35)");
    }
    line(drive.steps.slice(0, current + 1).map((other) => believed(placeOf(other.pose))), "#8fd0ff", 2.2);
    if (step.path) line(step.path, "rgba(255, 255, 255, .85)", 1.6, [0.12, 0.3]);
    const place = placeOf(step.believed_pose);
    if (step.candidates) drawCandidates(step, place, line);
    const goal = believed(drive.goal);
    circle(goal, DATA.goalRadius, "#59c8ff", 2.5);
    if (goalIsAstray(drive, step)) circle(drive.goal, DATA.goalRadius, "#d9a4ff", 2.5);
    const corners = footprint(place, drive.rover);
    line([...corners, corners[0]], step.contact === "none" ? "#fff" : "#ff4b3a", 2.6);
    line([place, [place[0] + Math.cos(place[2]), place[1] + Math.sin(place[2])]], "#fff", 2.6);
    const metres = half > 15 ? 10 : 5;
    context.fillStyle = "#fff";
    context.fillRect(size - 14 - metres * scale, size - 16, metres * scale, 3);
    context.font = `${Math.round(size / 42)}px system-ui, sans-serif`;
    context.fillText(`${metres} m`, size - 14 - metres * scale, size - 22);
  }

  function drawCandidates(step, place, line) {
    const { candidates, chosen } = step;
    const best = Math.min(...candidates.cost.filter((cost) => cost !== null));
    const order = candidates.cost.map((cost, n) => n).sort((a, b) => (candidates.cost[b] ?? 1e9) - (candidates.cost[a] ?? 1e9));
    for (const n of order) {
      const points = motionPoints(place, candidates, n), cost = candidates.cost[n];
      if (cost === null) line(points, "rgba(20, 16, 14, .75)", 1.2);
      else line(candidates.turn[n] ? points.slice(0, 13) : points, costColour(cost - best), candidates.turn[n] ? 1.1 : 1.7,
        candidates.turn[n] ? [0.25, 0.18] : []);
    }
    for (const [n, style] of [[emphasised, "#ffe14d"], [chosen, "#fff"]]) {
      if (n === null || n === undefined) continue;
      const points = motionPoints(place, candidates, n);
      line(points, "#1a1512", 6.5);
      line(points, style, 3.8);
    }
  }

  function update(n) {
    current = n;
    emphasised = null;
    redraw();
  }

  function redraw() {
    const from = mapStep(drive, current), picture = drive.pictures.map[from];
    wanted = picture;
    if (from < 0) note.textContent = keepsMap ? "no map yet" : "this driver keeps no map";
    else note.textContent = from === current ? "" : `No map at this step: it is that of step ${from}.`;
    if (!picture) draw(null);
    else codesOf(picture).then((ground) => { if (wanted === picture) draw(ground, drive.steps[from].map); });
  }

  truth.addEventListener("change", redraw);
  whole.addEventListener("change", redraw);
  window.addEventListener("resize", redraw);
  return { panel, update, emphasise(n) { emphasised = n; redraw(); } };
}

// The colours under the map, of what the record holds: other drivers than the navigator keep no map and plan nothing.
function mapLegend(drive) {
  const colours = DATA.colours.map, any = (holds) => drive.steps.some(holds);
  const ground = [[colours[1], "free"], [colours[200], "costly"], [colours[220], "too near to an obstacle"],
    [colours[250], "blocked"], [colours[0], "not seen"]];
  const compared = [[costColour(0), "least cost"], [costColour(DEAR), `costs ${DEAR} m more`], ["#14100e", "not free"]];
  const white = [...(any((step) => step.candidates) ? ["chosen motion"] : []),
    ...(any((step) => step.path) ? ["planned path (dashed)"] : []), "rover"];
  const entries = [...(any((step) => step.map) ? ground : []), ["#fff", white.join(", ")],
    ...(any((step) => step.candidates) ? compared : []), ["#8fd0ff", "driven"], ["#59c8ff", "goal"],
    ...(any((step) => goalIsAstray(drive, step)) ? [["#d9a4ff", "goal by odometry"]] : []),
    ["#ff4b3a", "rover in contact"], ["#faeb96", "shortest path"], ["#fff", "rocks (rings)"]];
  return make("div", { class: "legend" }, ...entries.map(([colour, words]) => make("span", {}, make("i", { background: colour }), words)));
}
