"use strict";
// The table that shows why a motion was chosen: costs by part, the chosen one first.

const OTHERS = 6; // candidates beside the chosen one
const PARTS = {
  way: "length up to where the motion is compared", ground: "extra cost of its ground", onward: "path from there to the goal",
  heading: "turn towards it", bend: "its curvature", change: "change of the curvature", turn: "turn in place",
  unseen: "turn in place over unseen ground",
};

function motionName(candidates, n) {
  const turn = candidates.turn[n], curvature = candidates.curvature[n];
  const side = (value) => (value > 0 ? "left" : "right");
  if (turn) return `turn ${Math.abs((turn * 180) / Math.PI).toFixed(0)}\u00b0 ${side(turn)}`;
  return Math.abs(curvature) < 0.05 ? "straight on" : `arc ${side(curvature)}, ${(1 / Math.abs(curvature)).toFixed(1)} m`;
}

// A panel with the table: update(step) fills it; emphasise(n) is called with the candidate under the mouse or in focus, or null.
function costsPanel(emphasise) {
  const body = make("div", { class: "costs" });
  let focused = null; // the rank of the row in focus, also while no motions are compared
  let replacing = false;
  const replace = (...content) => {
    replacing = true;
    body.replaceChildren(...content);
    replacing = false;
  };
  const panel = make("div", { class: "panel last" }, make("h2", {}, "why this motion: costs in metres of easy ground"), body);

  function update(step) {
    const { candidates, chosen } = step;
    if (!candidates) {
      replace(make("p", { class: "note" }, "No motions were compared at this step."));
      return;
    }
    const free = candidates.cost.map((cost, n) => n).filter((n) => candidates.cost[n] !== null)
      .sort((a, b) => candidates.cost[a] - candidates.cost[b]);
    const closed = candidates.cost.length - free.length;
    const shut = `${closed} of ${candidates.cost.length} motions are not free far enough`;
    if (!free.length) {
      replace(make("p", { class: "note" }, `${shut}: nothing could be chosen.`));
      return;
    }
    const first = chosen ?? free[0];
    const rows = [first, ...free.filter((n) => n !== first)].slice(0, OTHERS + 1);
    const names = Object.keys(PARTS).filter((name) => rows.some((n) => candidates.parts[name][n] > 0.004));
    const head = make("tr", {}, make("th", {}, "motion"), make("th", { title: "how far it is free" }, "free"),
      ...names.map((name) => make("th", { title: PARTS[name] }, name)), make("th", {}, "cost"), make("th", {}, "more than chosen"));
    const table = make("table", {}, make("thead", {}, head), make("tbody", {}, ...rows.map((n) => row(candidates, n, first, names))));
    replace(table, make("p", { class: "note" },
      `${shut}. Red: the part that speaks most against a motion. Point at a row, or move to it by the Tab key, to see it on the map.`));
    const elsewhere = document.activeElement && document.activeElement !== document.body;
    if (focused !== null && !elsewhere) body.querySelectorAll("tr.row")[Math.min(focused, rows.length - 1)].focus({ preventScroll: true });
  }

  function row(candidates, n, first, names) {
    const worse = names.map((name) => candidates.parts[name][n] - candidates.parts[name][first]);
    const worst = n === first ? -1 : worse.indexOf(Math.max(...worse));
    const cells = names.map((name, k) => make("td", k === worst ? { class: "worse" } : {}, candidates.parts[name][n].toFixed(2)));
    const cost = candidates.cost[n], least = candidates.cost[first]; // null only in records that read_drive refuses
    const against = worst >= 0 && worse[worst] > 0 ? ` (${names[worst]} +${worse[worst].toFixed(2)})` : "";
    const shown = () => emphasise(n), hidden = () => emphasise(null);
    const entered = (event) => { focused = [...body.querySelectorAll("tr.row")].indexOf(event.currentTarget); shown(); };
    const left = () => { if (!replacing) focused = null; hidden(); };
    return make("tr", {
      class: n === first ? "row chosen" : "row", tabindex: 0, onmouseenter: shown, onmouseleave: hidden, onfocus: entered, onblur: left,
    },
      make("td", {}, motionName(candidates, n)), make("td", {}, `${candidates.free[n].toFixed(1)} m`), ...cells,
      make("td", {}, cost === null ? "-" : cost.toFixed(2)),
      make("td", {}, n === first ? "chosen" : least === null ? "-" : `+${(cost - least).toFixed(2)}${against}`));
  }

  return { panel, update };
}
