"use strict";
// What the page says of a step: what the rover does, and its figures.

// Shares of the rover's limits, as actions have them: speeds below which it stands, and speed beside the turn with which
// it turns, within 0.2 m for each radian.
const STILL = 0.02, TURNING = 0.25;
const STATUS = {
  drive: ["#6a9a62", "drives"], turn: ["#5a86b8", "turns in place"], look: ["#b9a05a", "looks"], recover: ["#c9743c", "recovers"],
  blind: ["#555", "sees nothing"], arrived: ["#2a9d5c", "arrived"], stuck: [DATA.colours.outcomes.stuck, "gives up: stuck"],
  no_path: [DATA.colours.outcomes.no_path, "gives up: no path"],
};
const MOTION = { // of drivers that say no status
  drive: ["#6a9a62", "drives"], backwards: ["#a8628f", "drives backwards"], turn: ["#5a86b8", "turns"], stand: ["#8d8578", "stands"],
};
const degrees = (radians) => (radians * 180) / Math.PI;
// An angle [rad], as "12\u00b0 left"; per: "" or "/s".
function sideways(angle, digits, per) {
  const value = degrees(angle).toFixed(digits);
  return Number(value) === 0 ? `0\u00b0${per}` : `${value.replace("-", "")}\u00b0${per} ${angle > 0 ? "left" : "right"}`;
}
const metresPerSecond = (speed) => `${(Math.abs(speed) < 0.005 ? 0 : speed).toFixed(2)} m/s`;
const perSecond = (rate) => sideways(rate, 1, "/s");
const ACTION = [ // its numbers: name, limit of the rover, and how it is written
  ["speed", "max_speed", metresPerSecond], ["turn", "max_yaw_rate", perSecond],
  ["next pan", "pan_limit", (pan) => sideways(pan, 0, "")],
];

// What an action does.
function motionOf([speed, turn]) {
  if (Math.hypot(speed, turn) < STILL) return MOTION.stand;
  if (Math.abs(speed) <= TURNING * Math.abs(turn)) return MOTION.turn;
  return speed < 0 ? MOTION.backwards : MOTION.drive;
}

// The colour and the words of what the rover does at a step.
function statusOf(step) {
  if (step.status) return Object.hasOwn(STATUS, step.status) ? STATUS[step.status] : ["#888", step.status];
  if (step.outcome === "driving") return motionOf(step.action ?? []);
  return [DATA.colours.outcomes[step.outcome] ?? "#555", step.outcome.replace(/_/g, " ")];
}

// The numbers of an action, [name, value] each; in percent where the record lacks the rover's limits.
function actionFacts(action, rover) {
  return action.map((share, n) => {
    const [name, limit, written] = ACTION[n] ?? [n];
    return limit in rover ? [name, written(share * rover[limit])] : [`action: ${name}`, `${(100 * share).toFixed(0)} %`];
  });
}

function depthError(share, compared) {
  if (share === null) return compared ? "nothing in range" : "none, true depth";
  return `${(100 * share).toFixed(1)} %`;
}

// The figures of a step, [name, value, whether it is alarming] each; compared: the picture of the depth's error, if any.
function factsOf(step, look, compared, rover) {
  const facts = [], { action, command } = step;
  if (action && command) facts.push(["speed", metresPerSecond(command.speed)], ["turn", perSecond(command.yaw_rate)]);
  else if (action) facts.push(...actionFacts(action, rover));
  facts.push(["mast", sideways(step.pan, 0, "")], ["to the goal", `${step.distance.toFixed(1)} m`],
    ["clearance", step.clearance >= 3 ? "over 3 m" : `${step.clearance.toFixed(2)} m`, step.clearance < 0.1],
    ["contact", step.contact === "obstacle" ? "wheel on a rock" : step.contact, step.contact !== "none"],
    ["tilt", `${step.tilt_deg.toFixed(0)}\u00b0`, step.tilt_deg > 20],
    ["depth error", depthError(look.abs_rel, compared), look.abs_rel > 0.1]);
  const astray = Math.hypot(step.pose[0][3] - step.believed_pose[0][3], step.pose[1][3] - step.believed_pose[1][3]);
  if (astray > 0.005) facts.push(["odometry off by", `${astray.toFixed(2)} m`, astray > 0.5]);
  if (step.risk_level) facts.push(["risk level", String(step.risk_level), true]);
  return facts;
}
