// Puts the page together: what comes from the server goes to the parts that show it.

import { BusTable } from "./bus.js";
import { Control } from "./control.js";
import { Explain } from "./explain.js";
import { Feed } from "./feed.js";
import { Map2d } from "./map.js";
import { $, clock, element, figures, length, setText } from "./parts.js";
import { Plots, SPANS } from "./plots.js";
import { Store } from "./store.js";
import { Tour } from "./tour.js";
import { Turntable } from "./turntable.js";

const PLOT_MS = 100;
const MAP_MS = 250;
const TABS = [["bus", "Bus", "b"], ["control", "Faults & modes", "f"], ["codes", "Diagnosis", "c"], ["troubles", "Now", "w"]];
const SIGNS = { bad: "✕", warning: "!", good: "✓", order: "»", note: "·" };
const FIRST_GEOMETRY = [[180, 0], [70.5288, 0], [70.5288, 120], [70.5288, 240]];

const store = new Store();
const turntable = new Turntable();
const plots = new Plots(store);
const map = new Map2d(store);
let hello = null;
let events = [];
let status = {};
let complaint = "";

const feed = new Feed({
  link: (isUp) => {
    document.body.dataset.link = isUp ? "up" : "lost";
    showBanner();
  },
  hello: begin,
  history: (times, columns) => {
    store.fill(times, columns);
    if (hello.source === "recording") plots.setSpan(Infinity);
    else if (times.length) takeRow(times.at(-1), columns.map((column) => column.at(-1)));
    dirty();
  },
  row: (time, row) => {
    if (hello.source === "recording") plots.playedTo = time;
    else store.add(time, row);
    takeRow(time, row);
    dirty();
  },
  state: takeState,
  status: takeStatus,
  events: takeEvents,
  message: (message) => table.message(message),
  report: (report) => control.report(report),
});
const table = new BusTable(feed);
const control = new Control(feed);
const explain = new Explain(feed, plots, store);
new Tour(feed, store);
control.complain = (text) => {
  complaint = text;
  showBanner();
  setTimeout(() => { complaint = ""; showBanner(); }, 8000);
};

function begin(message) {
  hello = message;
  store.clear(hello.columns);
  plots.playedTo = null;
  const scenario = hello.scenario;
  setText($("title"), scenario?.title || hello.name || hello.bus);
  const kinds = { rehearsal: "rehearsal on", bus: "watching", recording: "recording" };
  setText($("where"), `${kinds[hello.source]} ${hello.bus}${hello.may_control ? "" : ", looking on"}`);
  document.title = `${scenario?.title || hello.bus} – RRINS`;
  turntable.setGeometry(scenario?.gyros_deg ?? FIRST_GEOMETRY, scenario?.accelerometers_deg ?? FIRST_GEOMETRY);
  table.clear();
  control.begin(hello);
  explain.begin(hello);
  chipStates = "";
}

// ---- rows, thirty times a second

function takeRow(time, row) {
  const value = (name) => row[store.place[name]];
  const pose = { inner: value("inner_deg"), outer: value("outer_deg"), roll: value("roll_deg"), pitch: value("pitch_deg"), heading: value("heading_deg") };
  turntable.setPose(pose);
  const angle = (degrees) => (Number.isNaN(degrees) ? "–" : `${degrees.toFixed(2)}°`);
  setText($("angles"), `inner ${angle(pose.inner)}  outer ${angle(pose.outer)}`);
  setText($("time"), clock(time));
  const error = Math.hypot(value("error_east_m"), value("error_north_m"));
  setText($("error"), length(error));
  const load = value("bus_load_percent");
  setText($("load"), load == null || Number.isNaN(load) ? "–" : `${load.toFixed(1)} %`);
}

let isDirty = false;
let plottedMs = 0;
let mappedMs = 0;
function dirty() {
  isDirty = true;
}

function frame(nowMs) {
  turntable.draw();
  if (isDirty && nowMs - plottedMs >= PLOT_MS && !document.hidden) {
    plottedMs = nowMs;
    isDirty = false;
    if (!plots.isHeld) plots.draw();
    if (!turntable.isAsked) requestAnimationFrame(() => turntable.load()); // these are on the screen
    if (nowMs - mappedMs >= MAP_MS) {
      mappedMs = nowMs;
      map.draw(plots.playedTo ?? Infinity);
    }
  }
  requestAnimationFrame(frame);
}
requestAnimationFrame(frame);

// ---- the state, four times a second

let chipStates = "";
function takeState(state) {
  table.update(state.messages);
  turntable.setStates(state.sensors);
  showChips(state.sensors);
  showParity(state.parity);
  control.keepReading();
  const firmware = state.firmware;
  const mode = firmware ? firmware.mode.replaceAll("_", " ").toLowerCase() : "–";
  setText($("mode"), firmware?.mode === "FAULT" ? `FAULT: ${firmware.fault}` : mode);
  const parts = [];
  if (firmware?.scheme_position) parts.push(`position ${firmware.scheme_position}${hello.scenario?.held_deg.length ? ` of ${hello.scenario.held_deg.length}` : ""}`, `cycle ${firmware.scheme_cycle + 1}`);
  setText($("scheme"), parts.join(", ") || "–");
  const isStill = status.phase === "paused" || status.phase === "ended";
  setText($("speed"), isStill ? status.phase : state.speed == null ? "–" : `${figures(state.speed, 3)} ×`);
  showTroubles(state.troubles);
  document.body.dataset.mode = firmware?.mode ?? "";
}

function showChips(sensors) {
  const now = JSON.stringify(sensors);
  if (now === chipStates) return;
  chipStates = now;
  const chips = [];
  for (const [kind, letter] of [["gyros", "G"], ["accelerometers", "A"]])
    sensors[kind].forEach((state, k) =>
      chips.push(element("div", { class: "chip", "data-state": state, "data-sensor": `${letter}${k + 1}` }, element("b", {}, `${letter}${k + 1}`), state, element("i", { class: "bar" }, element("i")))));
  $("chips").replaceChildren(...chips);
  $("chips").style.gridTemplateColumns = `repeat(${Math.min(8, Math.max(4, sensors.gyros.length))}, minmax(0, 1fr))`;
}

// How far each sensor is from being suspected: the parity, by the one sensor it points at the most.
function showParity(parity) {
  for (const [kind, letter] of [["gyros", "G"], ["accelerometers", "A"]]) {
    const [ratio, suspect, seconds] = parity[kind] ?? [0, 0, 0];
    const chips = document.querySelectorAll(`.chip[data-sensor^="${letter}"]`);
    chips.forEach((chip, k) => {
      const isIt = suspect === k + 1;
      chip.lastChild.hidden = !parity[kind];
      chip.lastChild.firstChild.style.width = `${isIt ? Math.min(100, 50 * ratio) : 0}%`;
      chip.title = isIt ? `the parity in ${seconds} s, ${ratio.toFixed(2)} × its threshold, points at this one the most; the mark is the threshold` : "";
    });
  }
}

function showTroubles(troubles) {
  const tab = $("tab-troubles");
  const now = troubles.join("\n");
  if (tab.dataset.now === now && tab.firstChild) return;
  tab.dataset.now = now;
  const lines = troubles.length ? troubles.map((text) => element("div", { class: "active" }, `! ${text}`)) : [element("p", {}, "✓ nothing is wrong on the bus")];
  tab.replaceChildren(element("div", { class: "stack" }, ...lines));
  const button = document.querySelector('[data-tab="troubles"]');
  setText(button, troubles.length ? `Now (${troubles.length})` : "Now");
}

function takeStatus(message) {
  status = message;
  document.body.dataset.phase = message.phase;
  control.setStatus(message);
  if (hello?.source === "recording") markLater();
  showBanner();
}

function showBanner() {
  const banner = $("banner");
  const isLost = document.body.dataset.link === "lost";
  const words = isLost ? "The server does not answer. What you see is the last that came; trying again …"
    : complaint || (["starting", "failed", "ended"].includes(status.phase) ? status.words : "");
  banner.className = isLost || complaint || status.phase === "failed" ? "bad" : "";
  banner.hidden = !words;
  setText(banner, words);
}

// ---- events

function takeEvents(message) {
  if (message.anew) {
    events = [];
    $("events").replaceChildren();
  }
  for (const event of message.events) {
    events.push(event);
    const [time, text, weight] = event;
    const item = element("li", { class: hello.source === "recording" ? "jump" : "", "data-time": time },
      element("time", {}, clock(time)), element("span", { class: weight }, SIGNS[weight]), element("span", { class: weight }, text));
    if (hello.source === "recording") item.onclick = () => control.seek(time);
    $("events").prepend(item);
  }
  setText($("event-count"), events.length ? String(events.length) : "");
  control.markEvents(events);
}

function markLater() {
  for (const item of $("events").children) item.classList.toggle("later", Number(item.dataset.time) > status.at_s + 0.05);
}

// ---- tabs, theme, keys

function openTab(name) {
  for (const [one] of TABS) {
    $(`tab-${one}`).hidden = one !== name;
    document.querySelector(`[data-tab="${one}"]`).setAttribute("aria-selected", one === name);
  }
}
for (const [name, words, key] of TABS)
  $("tabs").append(element("button", { role: "tab", "data-tab": name, title: key, onclick: () => openTab(name) }, words));
openTab("bus");

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  try {
    localStorage.setItem("rrins-theme", theme);
  } catch { /* a browser that keeps nothing */ }
  turntable.restyle();
  plots.restyle();
  map.draw(plots.playedTo ?? Infinity);
}
let kept = null;
try {
  kept = localStorage.getItem("rrins-theme");
} catch { /* a browser that keeps nothing */ }
setTheme(kept ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
const toggleTheme = () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
$("theme").onclick = toggleTheme;
$("help-button").onclick = () => $("help").showModal();

document.addEventListener("keydown", (event) => {
  if (event.target.matches("input:not([type=checkbox]), select, textarea") || (event.key === " " && event.target.matches("input, button, summary")) || event.ctrlKey || event.metaKey || event.altKey) return;
  const span = SPANS[Number(event.key) - 1];
  const tab = TABS.find(([, , key]) => key === event.key);
  const actions = {
    " ": () => plots.hold(), t: toggleTheme, r: () => turntable.resetView(), p: () => control.togglePause(), "?": () => $("help").showModal(),
    ArrowLeft: () => status.at_s != null && control.seek(status.at_s - 10), ArrowRight: () => status.at_s != null && control.seek(status.at_s + 10),
  };
  if (span) plots.setSpan(span[1]);
  else if (tab) openTab(tab[0]);
  else if (actions[event.key]) actions[event.key]();
  else return;
  event.preventDefault();
});
