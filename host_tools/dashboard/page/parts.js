// Small pieces of the page: elements, numbers in words, colours of the theme.

export const $ = (id) => document.getElementById(id);

export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name === "class") made.className = value;
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value != null) made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

// Text whose long names may break behind each part.
export const breakable = (text) => text.split(/(?<=_)/).flatMap((part) => [part, element("wbr")]);

export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

export const colour = (name) =>
  getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

// A length in the unit that fits: 3.1 mm, 12.4 m, 2.21 km.
export function length(metres) {
  if (metres == null || Number.isNaN(metres)) return "–";
  const size = Math.abs(metres);
  if (size >= 1000) return `${figures(metres / 1000, 3)} km`;
  if (size < 0.1 && size > 0) return `${figures(metres * 1000, 3)} mm`;
  return `${figures(metres, 3)} m`;
}

// Seconds as a clock: 0:09.4, 12:05.1, 1:02:45.0.
export function clock(seconds, decimals = 1) {
  if (seconds == null) return "–";
  const rounded = Number(seconds.toFixed(decimals));
  const [h, m] = [Math.floor(rounded / 3600), Math.floor((rounded % 3600) / 60)];
  const s = (rounded % 60).toFixed(decimals).padStart(decimals ? 3 + decimals : 2, "0");
  return h ? `${h}:${String(m).padStart(2, "0")}:${s}` : `${m}:${s}`;
}

const MOST_PARITY = 40.95; // the bus carries no more

// A parity over its threshold: 0.17, 40.95 or more.
export const parityWords = (ratio) => `${ratio.toFixed(2)}${ratio >= MOST_PARITY - 1e-6 ? " or more" : ""}`;

// A time span as in `rrins monitor`: 5 ms, 2.3 s, 812 s, 3.1 h.
export function span(seconds) {
  if (seconds < 0.9995) return `${(1000 * seconds).toFixed(0)} ms`;
  if (seconds < 9999.5) return `${seconds.toFixed(seconds < 99.95 ? 1 : 0)} s`;
  return `${(seconds / 3600).toFixed(1)} h`;
}

export function figures(value, digits = 4) {
  if (value == null || Number.isNaN(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(2);
  const decimals = Math.max(0, digits - 1 - Math.floor(Math.log10(size)));
  return value.toFixed(Math.min(decimals, 6));
}

const UNITS = [
  ["_deg_per_sqrt_h", "°/√h"], ["_ug_per_sqrt_hz", "µg/√Hz"], ["_dph_per_min", "°/h per min"],
  ["_ug_per_min", "µg per min"], ["_dph", "°/h"], ["_dps", "°/s"], ["_mps", "m/s"], ["_ug", "µg"],
  ["_percent", "%"], ["_ppm", "ppm"], ["_arcsec", "″"], ["_deg", "°"], ["_ms", "ms"], ["_m", "m"], ["_s", "s"],
];

// A key of a scenario as words with its unit: "bias / (°/h)".
export function keyWords(key) {
  for (const [ending, unit] of UNITS) {
    if (key.endsWith(ending)) {
      const words = key.slice(0, -ending.length).replaceAll("_", " ");
      return `${words || "for"} / ${unit.includes("/") || unit.includes(" ") ? `(${unit})` : unit}`;
    }
  }
  return key.replaceAll("_", " ");
}
