// A plot as a file: a drawing of what is seen, or its numbers.

import { $, colour, element } from "./parts.js";

const HEAD = 26; // px, of title and legend
const DASHES = { dashed: "7 4", dotted: "2 3" };
const TWICE = 2; // pixels of a PNG for each of the screen

const safe = (text) => String(text).replace(/[&<>"]/g, (sign) => `&#${sign.charCodeAt(0)};`);
const place = (number) => Number(number.toFixed(2));

// Ask as what; then give it to the browser.
export function offer(plot) {
  const { title } = plot.spec;
  const name = title.toLowerCase().replace(/[^a-z]+/g, "_");
  const kinds = [
    ["PNG", async () => download(`${name}.png`, await asPng(plot))],
    ["SVG", () => download(`${name}.svg`, new Blob([asSvg(plot)], { type: "image/svg+xml" }))],
    ["CSV", () => download(`${name}.csv`, new Blob([asCsv(plot)], { type: "text/csv" }))],
  ];
  const dialog = $("save");
  dialog.querySelector("h2").textContent = title;
  dialog.querySelector(".row").replaceChildren(...kinds.map(([words, save]) =>
    element("button", { type: "button", class: "main", onclick: async () => { await save(); dialog.close(); } }, words)));
  dialog.showModal();
}

function download(name, blob) {
  const link = element("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

// The columns behind a plot, as long as they are seen; each has its unit in its name.
export function asCsv({ spec, board }) {
  const { store, view } = board;
  const names = [...new Set(spec.lines.map((one) => one.column))].filter((name) => store.column(name).some((v) => v != null));
  const rows = [["time_s", ...names].join(",")];
  const end = store.at(view[1] + 1e-9);
  for (let k = store.at(view[0]); k < end; k++)
    rows.push([store.times[k].toFixed(4), ...names.map((name) => store.column(name)[k]?.toPrecision(7) ?? "")].join(","));
  return `${rows.join("\n")}\n`;
}

export function asSvg({ chart: u, spec }) {
  const ratio = devicePixelRatio;
  const box = Object.fromEntries(Object.entries(u.bbox).map(([key, value]) => [key, value / ratio]));
  box.top += HEAD;
  const [right, bottom] = [box.left + box.width, box.top + box.height];
  const x = (value) => place(box.left + u.valToPos(value, "x"));
  const y = (value, scale = "y") => place(box.top + u.valToPos(value, scale));
  const parts = [];
  const add = (tag, attributes, text) => parts.push(`<${tag} ${Object.entries(attributes).map(([key, value]) => `${key}="${safe(value)}"`).join(" ")}${text == null ? "/>" : `>${safe(text)}</${tag}>`}`);
  const write = (text, at, anchor, more) => add("text", { x: at[0], y: at[1], "text-anchor": anchor, fill: colour("soft"), ...more }, text);
  add("rect", { width: u.width, height: u.height + HEAD, fill: colour("panel") });
  u.axes.forEach((axis, k) => axis._splits?.forEach((value, n) => {
    const text = axis._values?.[n];
    if (text == null) return;
    if (k === 0) {
      add("path", { d: `M${x(value)} ${box.top}V${bottom}`, stroke: colour("grid") });
      write(text, [x(value), bottom + 15], "middle");
    } else if (k === 1) {
      add("path", { d: `M${box.left} ${y(value)}H${right}`, stroke: colour("grid") });
      write(text, [box.left - 6, y(value) + 4], "end");
    } else write(text, [right + 6, y(value, axis.scale) + 4], "start");
  }));
  parts.push(`<clipPath id="area"><rect x="${box.left}" y="${box.top}" width="${box.width}" height="${box.height}"/></clipPath><g clip-path="url(#area)" fill="none">`);
  spec.lines.forEach((one, k) => {
    if (one.band === 1) add("path", { d: bandOf(u.data[0], u.data[k + 1], u.data[k + 2], x, y), fill: colour(one.ink), "fill-opacity": (one.opacity ?? 14) / 100 });
    const dash = DASHES[one.dash] ? { "stroke-dasharray": DASHES[one.dash] } : {};
    add("path", { d: pathOf(u.data[0], u.data[k + 1], x, (v) => y(v, one.scale), one.step), stroke: colour(one.ink), "stroke-width": one.band || one.thin ? 1 : 1.6, ...dash });
  });
  if (spec.threshold != null) add("path", { d: `M${box.left} ${y(spec.threshold)}H${right}`, stroke: colour("excluded"), "stroke-dasharray": "10 4" });
  parts.push("</g>");
  write(spec.title + (spec.unit ? ` / ${spec.unit.includes("/") ? `(${spec.unit})` : spec.unit}` : ""), [10, 17], "start", { fill: colour("text"), "font-weight": 600 });
  let left = u.width - 12;
  spec.lines.filter((one, k) => one.label && u.data[k + 1].some((v) => v != null)).reverse().forEach((one) => {
    write(one.label, [left, 17], "end", { fill: colour("text") });
    left -= 7 * one.label.length + 8;
    add("path", { d: `M${left - 20} 13H${left - 2}`, stroke: colour(one.ink), "stroke-width": 2, ...(DASHES[one.dash] ? { "stroke-dasharray": DASHES[one.dash] } : {}) });
    left -= 34;
  });
  return `<svg xmlns="http:${"//"}www.w3.org/2000/svg" width="${u.width}" height="${u.height + HEAD}" font-family="system-ui, sans-serif" font-size="11">${parts.join("")}</svg>`;
}

function pathOf(times, values, x, y, isStepped) {
  let path = "";
  let isDrawing = false;
  values.forEach((value, k) => {
    if (value == null) isDrawing = false;
    else {
      const at = `${x(times[k])} ${y(value)}`;
      path += !isDrawing ? `M${at}` : isStepped ? `H${x(times[k])}V${y(value)}` : `L${at}`;
      isDrawing = true;
    }
  });
  return path;
}

function bandOf(times, upper, lower, x, y) {
  const known = times.map((time, k) => k).filter((k) => upper[k] != null && lower[k] != null);
  const there = known.map((k) => `${x(times[k])} ${y(upper[k])}`);
  const back = known.reverse().map((k) => `${x(times[k])} ${y(lower[k])}`);
  return there.length ? `M${there.join("L")}L${back.join("L")}Z` : "";
}

async function asPng(plot) {
  const { width, height } = plot.chart;
  const image = new Image();
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(asSvg(plot))}`;
  await image.decode();
  const canvas = element("canvas", { width: TWICE * width, height: TWICE * (height + HEAD) });
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  return new Promise((settle) => canvas.toBlob(settle, "image/png"));
}
