// The charts: which columns each shows, and how.

import { figures } from "./parts.js";

// column: what the server calls it; label: in the legend; ink: a colour of the theme. decimals: of a
// chart's values; three digits without.
const line = (column, label, ink, dash = "solid", more = {}) => ({ column, label, ink, dash, ...more });
const three = (sigma, ink) => [
  { column: sigma, label: "", ink, dash: "dotted", factor: 3, band: 1 },
  { column: sigma, label: "", ink, dash: "dotted", factor: -3, band: -1 },
];
const around = (value, sigma, ink) => [
  { column: sigma, around: value, label: "", ink, dash: "dotted", factor: 3, band: 1, opacity: 4 },
  { column: sigma, around: value, label: "", ink, dash: "dotted", factor: -3, band: -1 },
];
const BIAS_INKS = ["east", "north", "third", "sound", "up", "suspect"];

// Truth is not on the bus.
const noTruth = ({ hasTruth }) => (hasTruth ? "No navigation output yet" : "The truth is not known: name the scenario");

export const CHARTS = [
  {
    id: "position", title: "Position error", unit: "m", empty: noTruth, sigma: "dotted: ±3σ",
    lines: [line("error_east_m", "east", "east"), line("error_north_m", "north", "north", "dashed"),
      ...three("sigma_east_m", "east"), ...three("sigma_north_m", "north"),
      line("horizontal_protection_m", "protection level", "third", "dashed", { step: true, optional: true })],
  },
  {
    id: "velocity", title: "Velocity error", unit: "m/s", empty: noTruth, sigma: "dotted: ±3σ",
    lines: [line("error_east_mps", "east", "east"), line("error_north_mps", "north", "north", "dashed"),
      ...three("sigma_east_mps", "east"), ...three("sigma_north_mps", "north")],
  },
  {
    id: "attitude", title: "Attitude", unit: "°", decimals: 3, empty: () => "No navigation output yet", angles: true,
    lines: [line("roll_deg", "roll", "east"), line("pitch_deg", "pitch", "north", "dashed"),
      line("heading_deg", "heading", "third", "solid", { scale: "heading", centred: true })],
  },
  {
    id: "estimator", title: "Estimated gyro biases", unit: "°/h", sigma: "dotted: ±3σ",
    empty: ({ estimates }) => (estimates === false ? "The estimator of this scenario is off" : "No estimate on the bus yet"),
    lines: BIAS_INKS.flatMap((ink, k) => [
      line(`gyro_bias_${k + 1}_dph`, `G${k + 1}`, ink, "solid", { step: true, optional: true }),
      ...around(`gyro_bias_${k + 1}_dph`, `sigma_gyro_bias_${k + 1}_dph`, ink)]),
  },
  {
    id: "angles", title: "Table angles", unit: "°", decimals: 2, empty: () => "No axis has been heard yet", note: "within a turn; dotted: position of the scheme", angles: "turns",
    lines: [line("inner_deg", "inner", "east", "solid", { wraps: true }), line("outer_deg", "outer", "north", "dashed", { wraps: true }),
      line("inner_goal_deg", "", "east", "dotted", { step: true, thin: true, wraps: true }),
      line("outer_goal_deg", "", "north", "dotted", { step: true, thin: true, wraps: true })],
  },
  {
    id: "parity", title: "Parity / threshold", unit: "", least: [0, 1.25], threshold: 1,
    empty: ({ mode, seconds }) => (mode && seconds > 3 ? "The firmware compares no sensors" : "No parity has been reported yet"),
    lines: [line("gyro_parity", "gyros", "east", "solid", { step: true, points: ["G", "gyro_suspect", "gyro_window_log2"], lacks: "gyro_redundant" }),
      line("accelerometer_parity", "accelerometers", "north", "dashed", { step: true, points: ["A", "accelerometer_suspect", "accelerometer_window_log2"], lacks: "accelerometer_redundant" })],
  },
  {
    id: "load", title: "Load", unit: "%", least: [0, 10],
    lines: [line("bus_load_percent", "bus", "east"), line("firmware_load_percent", "firmware", "north", "dashed", { optional: true }),
      line("lateness_ms", "lateness", "third", "dotted", { scale: "ms", optional: true })],
  },
];

export const ANGLE_STEPS = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 3, 5, 10, 15, 30, 45, 90, 180];
const [LOWEST, TURN] = [-45, 360]; // the table stands at multiples of 90°: it wraps between two

export const wrapped = (degrees, lowest = LOWEST) => lowest + ((((degrees - lowest) % TURN) + TURN) % TURN);

// Angles within a turn; where two neighbours wrap, the line is broken.
export function turned(column, lowest = LOWEST) {
  let before = null;
  return column.map((value) => {
    if (value == null) return (before = null);
    const angle = wrapped(value, lowest);
    const jumps = before != null && Math.abs(angle - before) > TURN / 2;
    before = angle;
    return jumps ? null : angle;
  });
}

// Where a turn begins in whose middle most of the angles are.
export function lowestOf(column) {
  let [east, north] = [0, 0];
  for (const value of column) {
    if (value == null) continue;
    east += Math.sin((value * Math.PI) / 180);
    north += Math.cos((value * Math.PI) / 180);
  }
  return Math.round((Math.atan2(east, north) * 180) / Math.PI) - TURN / 2;
}

export function rangeOf({ least, angles }) {
  return (u, low, high) => {
    if (low == null || high == null) return least ?? [-1, 1];
    let [a, b] = [low, high];
    if (angles && b - a < 0.004) return [a - 0.002, b + 0.002];
    if (angles === "turns" && b - a > 90) return [Math.min(LOWEST, a), Math.max(LOWEST + TURN, b)];
    if (least) [a, b] = [Math.min(a, least[0]), Math.max(b, least[1])];
    const margin = (b - a) * 0.06 || Math.abs(a) * 0.1 || 0.001;
    return [least && a === least[0] ? a : a - margin, b + margin];
  };
}

// Labels of an axis, with the decimals that its step needs; a single one with its own.
export function labels(splits) {
  const step = splits.length > 1 ? Math.abs(splits[1] - splits[0]) : Math.abs(splits[0]) || 1;
  const decimals = [0, 1, 2, 3, 4, 5, 6].find((n) => Math.abs(step * 10 ** n - Math.round(step * 10 ** n)) < 1e-6) ?? 6;
  return splits.map((value) => (Math.abs(value) >= 1e6 ? figures(value, 3) : (Math.abs(value) < step / 1e6 ? 0 : value).toFixed(decimals)));
}
