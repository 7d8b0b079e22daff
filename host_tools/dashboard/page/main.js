// Puts the page together: what comes from the server goes to the parts that show it.

import { BusTable } from "./bus.js";
import { Chips } from "./chips.js";
import { Control } from "./control.js";
import { Explain } from "./explain.js";
import { Feed } from "./feed.js";
import { keep, recall } from "./kept.js";
import { Map2d } from "./map.js";
import { Now } from "./now.js";
import { $, breakable, clock, element, figures, length, setText } from "./parts.js";
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
const chips = new Chips();
const now = new Now();
let hello = null;
let events = [];
let status = {};
let complaint = "";
let reached = null; // the latest event that a playback has come to

const feed = new Feed({
  link: (isUp) => {
    document.body.dataset.link = isUp ? "up" : "lost";
    showBanner();
  },
  hello: begin,
  history: (times, columns) => {
    store.fill(times, columns);
    if (hello.source === "recording") plots.offerSpan(Infinity);
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
  setText($("where"), `${hello.place ?? `${kinds[hello.source]} ${hello.bus}`}${hello.may_control ? "" : ", looking on"}`);
  document.title = `${scenario?.title || hello.bus} – RRINS`;
  turntable.setGeometry(scenario?.gyros_deg ?? FIRST_GEOMETRY, scenario?.accelerometers_deg ?? FIRST_GEOMETRY);
  table.clear();
  control.begin(hello);
  now.begin(hello);
  explain.begin(hello);
  plots.context = { hasTruth: Boolean(scenario?.has_truth), estimates: scenario?.estimates };
  plots.showChosen();
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

function takeState(state) {
  const firmware = state.firmware;
  table.update(state.messages, store.last);
  turntable.setStates(state.sensors);
  chips.update(state);
  control.sensors = state.sensors;
  control.keepReading();
  now.update(state.troubles, Boolean(firmware));
  Object.assign(plots.context, { mode: firmware?.mode, seconds: store.last - store.first });
  const mode = firmware ? firmware.mode.replaceAll("_", " ").toLowerCase() : "–";
  setText($("mode"), firmware?.mode === "FAULT" ? `FAULT: ${firmware.fault}` : mode);
  const parts = [];
  if (firmware?.scheme_position) parts.push(`position ${firmware.scheme_position}${hello.scenario?.held_deg.length ? ` of ${hello.scenario.held_deg.length}` : ""}`, `cycle ${firmware.scheme_cycle + 1}`);
  setText($("scheme"), parts.join(", ") || "–");
  const isStill = status.phase === "paused" || status.phase === "ended";
  setText($("speed"), isStill ? status.phase : state.speed == null ? "–" : `${figures(state.speed, 3)} ×`);
  document.body.dataset.mode = firmware?.mode ?? "";
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
      element("time", {}, clock(time)), element("span", { class: weight }, SIGNS[weight]), element("span", { class: weight }, ...breakable(text)));
    if (hello.source === "recording") item.onclick = () => control.seek(time);
    const before = [...$("events").children].find((one) => Number(one.dataset.time) <= time);
    $("events").insertBefore(item, before ?? null); // an effect may be known late
  }
  setText($("event-count"), events.length ? String(events.length) : "");
  control.markEvents(events);
}

// Events that the playback has not reached are pale; the latest that it has is in view.
function markLater() {
  const items = [...$("events").children];
  for (const item of items) item.classList.toggle("later", Number(item.dataset.time) > status.at_s + 0.05);
  const latest = items.find((item) => !item.classList.contains("later"));
  if (latest && latest !== reached) $("events").scrollTop += latest.offsetTop - $("events").offsetTop - $("events").scrollTop - 60;
  reached = latest;
}

// ---- tabs, theme, keys

function openTab(name) {
  keep("tab", name);
  for (const [one] of TABS) {
    $(`tab-${one}`).hidden = one !== name;
    document.querySelector(`[data-tab="${one}"]`).setAttribute("aria-selected", one === name);
  }
}
for (const [name, words, key] of TABS)
  $("tabs").append(element("button", { role: "tab", "data-tab": name, title: `key ${key}`, onclick: () => openTab(name) }, words));
openTab(TABS.some(([name]) => name === recall("tab")) ? recall("tab") : "bus");

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  keep("theme", theme, true);
  turntable.restyle();
  plots.restyle();
  map.draw(plots.playedTo ?? Infinity);
}
setTheme(recall("theme", matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light", true));
const toggleTheme = () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
$("theme").onclick = toggleTheme;
$("help-button").onclick = () => $("help").showModal();

// Space pauses what can be paused, else the plots.
function pause() {
  if (!control.togglePause()) plots.hold();
}

const isText = (node) => node.matches("input:not([type=checkbox], [type=range]), select, textarea");
const isPlain = (event) => !(event.ctrlKey || event.metaKey || event.altKey) && !document.querySelector("dialog[open]");

document.addEventListener("keydown", (event) => {
  if (!isPlain(event) || (isText(event.target) && event.key !== " ")) return;
  const span = SPANS[Number(event.key) - 1];
  const tab = TABS.find(([, , key]) => key === event.key);
  const jump = (seconds) => status.at_s != null && control.seek(status.at_s + seconds);
  const actions = {
    " ": () => event.repeat || pause(), p: pause, h: () => plots.hold(), t: toggleTheme, r: () => turntable.resetView(), "?": () => $("help").showModal(),
    ArrowLeft: () => jump(-10), ArrowRight: () => jump(10), Escape: () => plots.enlarge(null),
  };
  if (span) plots.setSpan(span[1]);
  else if (tab) openTab(tab[0]);
  else if (event.key === "Enter" && event.target.matches("input[type=checkbox]")) event.target.click();
  else if (actions[event.key]) actions[event.key]();
  else return;
  event.preventDefault();
}, true);

// A button that has the focus is not pressed by space, which pauses: Enter presses it.
document.addEventListener("keyup", (event) => {
  if (event.key === " " && isPlain(event)) event.preventDefault();
}, true);
