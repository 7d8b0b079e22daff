// The track against the truth, seen from above; its error is magnified so that it can be seen.

import { $, colour, length } from "./parts.js";

const NICE = [1, 2, 5];

function nice(size) {
  const power = 10 ** Math.floor(Math.log10(size));
  return power * (NICE.findLast((step) => step * power <= size) ?? 1);
}

export class Map2d {
  constructor(store) {
    this.store = store;
    this.canvas = $("map");
    new ResizeObserver(() => this.draw()).observe(this.canvas.parentElement);
  }

  draw(until = Infinity) {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    const ratio = devicePixelRatio;
    if (this.canvas.width !== width * ratio || this.canvas.height !== height * ratio) {
      this.canvas.width = width * ratio;
      this.canvas.height = height * ratio;
    }
    const ctx = this.canvas.getContext("2d");
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.fillStyle = colour("panel");
    ctx.fillRect(0, 0, width, height);
    const end = this.store.at(until + 1e-9);
    const [x, y, tx, ty] = ["east_m", "north_m", "true_east_m", "true_north_m"].map((name) => this.store.column(name));
    const hasTruth = tx.some((v) => v != null);
    const points = [];
    const extent = { low: [0, 0], high: [0, 0], error: 0, moved: 0 };
    const step = Math.max(1, Math.floor(end / 3000));
    for (let k = end - 1; k >= 0; k -= step) {
      if (x[k] == null) continue;
      const truth = hasTruth ? [tx[k], ty[k]] : [0, 0];
      const error = [x[k] - truth[0], y[k] - truth[1]];
      points.push([truth, error]);
      extent.error = Math.max(extent.error, Math.hypot(...error));
      extent.moved = Math.max(extent.moved, Math.hypot(...truth));
    }
    if (!points.length) {
      ctx.fillStyle = colour("faint");
      ctx.textAlign = "center";
      ctx.font = "13px system-ui, sans-serif";
      ctx.fillText("No navigation output yet", width / 2, height / 2);
      $("map-note").textContent = "";
      return;
    }
    const factor = extent.moved > 1 && extent.error > 0 ? Math.max(1, nice((0.12 * extent.moved) / extent.error)) : 1;
    const shown = points.map(([truth, error]) => [truth, [truth[0] + factor * error[0], truth[1] + factor * error[1]]]);
    for (const pair of shown)
      for (const point of pair)
        for (const k of [0, 1]) {
          extent.low[k] = Math.min(extent.low[k], point[k]);
          extent.high[k] = Math.max(extent.high[k], point[k]);
        }
    const span = Math.max(extent.high[0] - extent.low[0], ((extent.high[1] - extent.low[1]) * width) / height, 0.01);
    const scale = (width - 60) / span / 1.05;
    const fitted = Math.min(scale, (height - 50) / Math.max(extent.high[1] - extent.low[1], 1e-3));
    const middle = [0, 1].map((k) => (extent.low[k] + extent.high[k]) / 2);
    const place = ([east, north]) => [width / 2 + (east - middle[0]) * fitted, height / 2 - (north - middle[1]) * fitted];
    this.drawGrid(ctx, width, height, fitted, middle);
    if (hasTruth) this.drawTrack(ctx, shown.map((pair) => place(pair[0])), colour("soft"), [], 3);
    this.drawTrack(ctx, shown.map((pair) => place(pair[1])), colour("east"), hasTruth && extent.moved > 1 ? [7, 4] : [], 1.7);
    const truth = place(shown[0][0]);
    const here = place(shown[0][1]);
    if (hasTruth) this.drawPoint(ctx, truth, colour("soft"), true);
    this.drawPoint(ctx, here, colour("east"), false);
    this.drawScale(ctx, width, height, fitted);
    const many = factor > 1 ? `, its error × ${factor}` : "";
    $("map-note").textContent = hasTruth ? `○ truth  ● navigated${many}` : "● navigated, from its first place";
  }

  drawGrid(ctx, width, height, scale, middle) {
    const step = nice(90 / scale);
    ctx.strokeStyle = colour("grid");
    ctx.lineWidth = 1;
    ctx.beginPath();
    for (let k = Math.ceil((middle[0] - width / 2 / scale) / step); k * step < middle[0] + width / 2 / scale; k++) {
      const x = width / 2 + (k * step - middle[0]) * scale;
      ctx.moveTo(x, 0);
      ctx.lineTo(x, height);
    }
    for (let k = Math.ceil((middle[1] - height / 2 / scale) / step); k * step < middle[1] + height / 2 / scale; k++) {
      const y = height / 2 - (k * step - middle[1]) * scale;
      ctx.moveTo(0, y);
      ctx.lineTo(width, y);
    }
    ctx.stroke();
  }

  drawTrack(ctx, points, ink, dash, size) {
    ctx.strokeStyle = ink;
    ctx.lineWidth = size;
    ctx.lineJoin = "round";
    ctx.setLineDash(dash);
    ctx.beginPath();
    points.forEach(([x, y], k) => (k ? ctx.lineTo(x, y) : ctx.moveTo(x, y)));
    ctx.stroke();
    ctx.setLineDash([]);
  }

  drawPoint(ctx, [x, y], ink, isHollow) {
    ctx.beginPath();
    ctx.arc(x, y, isHollow ? 7 : 4.5, 0, 2 * Math.PI);
    ctx.lineWidth = 2;
    ctx.strokeStyle = ctx.fillStyle = ink;
    if (isHollow) ctx.stroke();
    else ctx.fill();
  }

  drawScale(ctx, width, height, scale) {
    const size = nice(110 / scale);
    const left = 12;
    const y = height - 12;
    ctx.strokeStyle = ctx.fillStyle = colour("text");
    ctx.lineWidth = 1.5;
    ctx.beginPath();
    ctx.moveTo(left, y - 5);
    ctx.lineTo(left, y);
    ctx.lineTo(left + size * scale, y);
    ctx.lineTo(left + size * scale, y - 5);
    ctx.stroke();
    ctx.font = "11px system-ui, sans-serif";
    ctx.textAlign = "left";
    ctx.fillText(length(size), left + 5, y - 5);
    ctx.textAlign = "center";
    ctx.fillText("N", width - 16, 16);
    ctx.beginPath();
    ctx.moveTo(width - 16, 20);
    ctx.lineTo(width - 20, 34);
    ctx.lineTo(width - 16, 31);
    ctx.lineTo(width - 12, 34);
    ctx.closePath();
    ctx.fill();
  }
}
