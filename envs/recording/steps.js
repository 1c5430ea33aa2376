"use strict";
// What the page says of a step: what the rover does, and its figures.

// Actions are shares of the rover's limits. It stands below STILL, and turns where its speed is up to TURNING times the
// turn: 0.2 m for each radian.
const STILL = 0.02, TURNING = 0.25;
const STATUS = {
  drive: "drives", turn: "turns in place", look: "looks", recover: "recovers", blind: "sees nothing",
  arrived: "arrived", stuck: "gives up: stuck", no_path: "gives up: no path",
};
const MOTION = { drive: "drives", backwards: "drives backwards", turn: "turns", stand: "stands" }; // without a status
const degrees = (radians) => (radians * 180) / Math.PI;
// An angle [rad], as "12\u00b0 left"; per: "" or "/s".
function sideways(angle, digits, per) {
  const value = degrees(angle).toFixed(digits);
  if (Number(value) === 0) return `0\u00b0${per}`;
  return `${value.replace("-", "")}\u00b0${per} ${angle > 0 ? "left" : "right"}`;
}
const metresPerSecond = (speed) => `${(Math.abs(speed) < 0.005 ? 0 : speed).toFixed(2)} m/s`;
const perSecond = (rate) => sideways(rate, 1, "/s");
const ACTION = [ // its numbers: name, limit of the rover, and how it is written
  ["speed", "max_speed", metresPerSecond], ["turn", "max_yaw_rate", perSecond],
  ["next pan", "pan_limit", (pan) => sideways(pan, 0, "")],
];

// The name in MOTION of what an action does.
function motionOf([speed, turn]) {
  if (Math.hypot(speed, turn) < STILL) return "stand";
  if (Math.abs(speed) <= TURNING * Math.abs(turn)) return "turn";
  return speed < 0 ? "backwards" : "drive";
}

// The name of an outcome's colour, and its words.
function outcomeOf(outcome) {
  return [DATA.outcomes.includes(outcome) ? outcome : "other", outcome.replace(/_/g, " ")];
}

// What the rover does at a step: the name of its colour, and its words.
function statusOf(step) {
  if (Object.hasOwn(STATUS, step.status)) return [step.status, STATUS[step.status]];
  if (step.status) return ["other", step.status];
  if (step.outcome !== "driving") return outcomeOf(step.outcome);
  const motion = motionOf(step.action ?? []);
  return [motion, MOTION[motion]];
}

// The numbers of an action, [name, value] each; in percent where the record lacks the rover's limits.
function actionFacts(action, rover) {
  return action.map((share, n) => {
    const [name, limit, written] = ACTION[n] ?? [n];
    if (limit in rover) return [name, written(share * rover[limit])];
    return [`action: ${name}`, `${(100 * share).toFixed(0)} %`];
  });
}

function depthError(share, compared) {
  if (share === null) return compared ? "nothing in range" : "none, true depth";
  return `${(100 * share).toFixed(1)} %`;
}

// The figures of a step, [name, value, whether it is alarming] each.
// compared: the picture of the depth's error, null if there is none.
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
