// The figures of "What this is for, in pictures": precomputed runs, moved by the reader's hand.
"use strict";
(() => {
  const here = document.currentScript.src;
  const data = window.rrinsFigures;
  const make = (tag, more = {}, ...children) => {
    const made = Object.assign(document.createElement(tag), more);
    made.append(...children);
    return made;
  };
  const shown = (value, digits = 3) => (value === 0 ? "0" : Number(value.toPrecision(digits)).toLocaleString("en", { maximumFractionDigits: 6 }));
  const rootColours = { text: "foreground-primary", soft: "foreground-secondary", line: "background-border", sky: "background-secondary", accent: "brand-primary" };
  const fixed = { metal: "#9aa7b3", "metal-dark": "#6c7a87", ground: "#b9c3cc", east: "#3b82c4", north: "#d2761e", excluded: "#d2441e", sound: "#00875f", suspect: "#d99000", absent: "#8a97a3", saturated: "#d99000" };
  const themed = []; // what is drawn anew in another theme

  function takeColours() {
    const now = getComputedStyle(document.body);
    for (const [name, of] of Object.entries(rootColours)) document.documentElement.style.setProperty(`--${name}`, now.getPropertyValue(`--color-${of}`));
    for (const [name, value] of Object.entries(fixed)) document.documentElement.style.setProperty(`--${name}`, value);
  }
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

  function slider(words, range, on) {
    const input = make("input", { type: "range", ...range });
    const says = make("output");
    const tell = () => { says.textContent = on(Number(input.value)); };
    input.addEventListener("input", tell);
    return { node: make("label", {}, words, input, says), tell, input };
  }

  function chart(place, lines, labels, mark) {
    let plot;
    const build = () => {
      plot?.destroy();
      const axis = { stroke: colour("soft"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line"), size: 4 } };
      plot = new uPlot({
        width: Math.max(200, place.clientWidth), height: 230, scales: { x: { time: false } }, legend: { show: lines().length > 2, live: false },
        axes: [{ ...axis, label: labels[0], labelSize: 20, size: 34 }, { ...axis, label: labels[1], labelSize: 20, size: 56 }],
        series: [{ label: labels[0] }, ...labels.slice(2).map(([label, ink, dash]) => ({ label, stroke: colour(ink), width: 2, dash, points: { show: false } }))],
        cursor: { y: false },
        hooks: { draw: [(u) => {
          const x = mark?.();
          if (x == null) return;
          const at = u.valToPos(x, "x", true);
          u.ctx.fillStyle = colour("text");
          u.ctx.fillRect(at - 1, u.bbox.top, 2, u.bbox.height);
        }] },
      }, lines(), place);
    };
    build();
    themed.push(build);
    new ResizeObserver(() => plot.setSize({ width: Math.max(200, place.clientWidth), height: 230 })).observe(place);
    return { again: () => plot.setData(lines()), redraw: () => plot.redraw(false) };
  }

  const size = (run) => run.east_m.map((east, k) => Math.hypot(east, run.north_m[k]));
  const at = (run, seconds) => {
    const k = run.time_s.findIndex((time) => time >= seconds);
    return k < 0 ? run.time_s.length - 1 : k;
  };

  const figures = {
    rotate(root) {
      const { turning, resting } = data;
      const [rests, turns] = [size(resting), size(turning)];
      const times = resting.time_s;
      const atRest = times.map((_, k) => rests[k]);
      const withTurns = times.map((time) => turns[at(turning, time)]);
      let now = 300;
      let playing = null;
      let table = null;
      const place = make("div", { className: "chart" });
      const box = make("div", { className: "scene-box" }, make("canvas", { id: "scene" }), make("div", { id: "scene-note" }));
      const says = make("p", { className: "says" });
      const play = make("button", { type: "button", textContent: "▶ play" });
      root.append(make("div", { className: "pair" }, box, place));
      const plot = chart(place, () => [times, atRest, withTurns], ["time / s", "position error / m", ["at rest", "north", [6, 4]], ["turning", "east"]], () => now);
      const hand = slider("time", { min: 0, max: 1590, step: 2, value: now }, (value) => {
        now = value;
        const k = at(turning, now);
        table?.setPose({ inner: turning.inner_deg[k], outer: turning.outer_deg[k], roll: 0, pitch: 0, heading: 0 });
        plot.redraw();
        says.textContent = `After ${now} s the table at rest is ${shown(rests[at(resting, now)])} m off, the turning one ${shown(turns[k])} m. Inner axis at ${shown(turning.inner_deg[k], 4)}°, outer axis at ${shown(turning.outer_deg[k], 4)}°.`;
        return `${now} s`;
      });
      play.onclick = () => {
        if (playing) { clearInterval(playing); playing = null; play.textContent = "▶ play"; return; }
        play.textContent = "❚❚ stop";
        playing = setInterval(() => { hand.input.value = (now + 2) % 1590; hand.tell(); }, 50);
      };
      root.append(make("div", { className: "hand" }, hand.node, play), says);
      hand.tell();
      import(new URL("dashboard/scene.js", here)).then(({ Scene }) => {
        table = new Scene();
        table.setGeometry({ gyros: data.axes_deg, accelerometers: data.axes_deg });
        themed.push(() => table.build());
        hand.tell();
        const draw = () => { table.draw(); requestAnimationFrame(draw); };
        draw();
      }).catch(() => { document.getElementById("scene-note").textContent = "The table in three dimensions needs a page that a server gives, not a file."; });
    },

    parity(root) {
      const axes = data.axes_deg.map(([polar, azimuth]) => [polar, azimuth].map((angle) => (angle * Math.PI) / 180)).map(([a, b]) => [Math.sin(a) * Math.cos(b), Math.sin(a) * Math.sin(b), Math.cos(a)]);
      const rate = [1, 0.5, 0.3];
      const fault = [0, 0, 0, 0];
      const bars = make("div", { className: "bars" });
      const says = make("p", { className: "says" });
      const draw = () => {
        const read = axes.map((axis, k) => axis.reduce((sum, part, i) => sum + part * rate[i], 0) + fault[k]);
        const sum = read.reduce((total, one) => total + one, 0);
        const rows = [...read.map((value, k) => [`gyro ${k + 1} reads`, value, fault[k] !== 0]), ["their sum", sum, Math.abs(sum) > 0.05]];
        bars.replaceChildren(...rows.map(([words, value, isOff]) => {
          const bar = make("b");
          bar.style.left = `${50 + Math.min(0, value) * 8}%`;
          bar.style.width = `${Math.abs(value) * 8}%`;
          return make("div", { className: isOff ? "off" : "" }, make("span", {}, words), make("i", {}, bar), make("span", {}, `${value.toFixed(2)} °/s`));
        }));
        says.textContent = Math.abs(sum) <= 0.05 ? "The sum is zero, whatever the vehicle does: the readings agree." : `The sum is ${sum.toFixed(2)} °/s: one of the four is wrong. Which one, a table that turns will show.`;
      };
      const hands = ["x", "y", "z"].map((name, i) => slider(`turn about ${name}`, { min: -3, max: 3, step: 0.1, value: rate[i] }, (value) => { rate[i] = value; draw(); return `${value.toFixed(1)} °/s`; }));
      hands.push(slider("error of gyro 3", { min: -2, max: 2, step: 0.1, value: 0 }, (value) => { fault[2] = value; draw(); return `${value.toFixed(1)} °/s`; }));
      root.append(bars, make("div", { className: "hand" }, ...hands.map((hand) => hand.node)), says);
      hands.forEach((hand) => hand.tell());
    },

    schuler(root) {
      const run = data.schuler;
      let bias = 50;
      let now = 42;
      const place = make("div", { className: "chart" });
      const says = make("p", { className: "says" });
      root.append(place);
      const minutes = run.time_s.map((time) => time / 60);
      const [G, R] = [9.8, 6.37e6];
      const rule = () => run.time_s.map((time) => -Math.sign(-run.east_m[40]) * ((bias * 1e-6 * G * R) / G) * (1 - Math.cos(Math.sqrt(G / R) * time)));
      const plot = chart(place, () => [minutes, run.east_m.map((east) => (east * bias) / run.bias_ug), rule()], ["time / min", "error to the east / m", ["run", "east"], ["bias · R / g · (1 − cos ωt)", "north", [6, 4]]], () => now);
      const tell = () => {
        const east = (run.east_m[at(run, 60 * now)] * bias) / run.bias_ug;
        says.textContent = `${bias} µg push the position to ${shown(Math.abs((2 * bias * 1e-6 * R)))} m at most, after 42 minutes, and back to the beginning after 84. Now: ${shown(east)} m. Without the curvature of the Earth it would be ${shown(0.5 * bias * 1e-6 * G * (60 * now) ** 2)} m.`;
      };
      const hands = [
        slider("accelerometer bias", { min: 0, max: 200, step: 5, value: bias }, (value) => { bias = value; plot.again(); tell(); return `${value} µg`; }),
        slider("time", { min: 0, max: 178, step: 1, value: now }, (value) => { now = value; plot.redraw(); tell(); return `${value} min`; }),
      ];
      root.append(make("div", { className: "hand" }, ...hands.map((hand) => hand.node)), says);
      hands.forEach((hand) => hand.tell());
    },

    frame(root) {
      const { frame } = data;
      const kinds = [["CRC of data ID and payload", "#d2441e"], ["alive counter", "#8e6bb0"], ["status", "#6a9a3b"], ["gyro increment", "#3b82c4"], ["accelerometer increment", "#d2761e"]];
      const kindOf = (bit) => (bit < 8 ? 0 : bit < 12 ? 1 : bit < 16 ? 2 : bit < 40 ? 3 : 4);
      const crc8 = (octets) => octets.reduce((sum, octet) => {
        let crc = sum ^ octet;
        for (let k = 0; k < 8; k++) crc = crc & 0x80 ? ((crc << 1) ^ 0x1d) & 0xff : crc << 1;
        return crc;
      }, 0);
      const right = (word) => crc8([frame.data_id & 0xff, frame.data_id >> 8, ...Array.from({ length: 7 }, (_, k) => Number((word >> BigInt(8 * (k + 1))) & 0xffn))]);
      let [rate, force, counter, flipped] = [2, 9.8, 7, new Set()];
      const bytes = make("div", { className: "bytes" });
      const says = make("p", { className: "says" });
      const raw = (value, scale) => BigInt.asUintN(24, BigInt(Math.round(value / scale)));
      const draw = () => {
        let word = (BigInt(counter) << 8n) | (raw((rate * Math.PI) / 180 / frame.rate_hz, frame.gyro[1]) << BigInt(frame.gyro[0])) | (raw(force / frame.rate_hz, frame.accelerometer[1]) << BigInt(frame.accelerometer[0]));
        word |= BigInt(right(word));
        for (const bit of flipped) word ^= 1n << BigInt(bit);
        bytes.replaceChildren(...Array.from({ length: 8 }, (_, k) => {
          const octet = Number((word >> BigInt(8 * k)) & 0xffn);
          const bits = make("div", { className: "bits" }, ...Array.from({ length: 8 }, (__, n) => {
            const bit = 8 * k + 7 - n;
            return make("button", { type: "button", className: flipped.has(bit) ? "flipped" : "", title: `bit ${bit}: ${kinds[kindOf(bit)][0]}; click to flip it`, textContent: String((octet >> (7 - n)) & 1), onclick: () => { flipped.has(bit) ? flipped.delete(bit) : flipped.add(bit); draw(); } });
          }));
          const node = make("div", {}, make("strong", {}, octet.toString(16).padStart(2, "0")), bits);
          node.style.setProperty("--kind", kinds[kindOf(8 * k + (k === 1 ? 0 : 4))][1]);
          return node;
        }));
        const [is, want] = [Number(word & 0xffn), right(word)];
        const read = [[frame.gyro, (180 / Math.PI) * frame.rate_hz, "°/s"], [frame.accelerometer, frame.rate_hz, "m/s²"]].map(([[shift, scale], factor, unit]) => `${shown(Number(BigInt.asIntN(24, word >> BigInt(shift))) * scale * factor, 5)} ${unit}`);
        says.textContent = is === want ? `The CRC 0x${is.toString(16).padStart(2, "0")} holds. The firmware takes ${read.join(" and ")}.` : `The CRC says 0x${is.toString(16).padStart(2, "0")}, the payload 0x${want.toString(16).padStart(2, "0")}: the firmware drops the frame (it would have read ${read.join(" and ")}), counts it, and bridges the epoch.`;
      };
      const hands = [
        slider("rate along the gyro", { min: -30, max: 30, step: 0.5, value: rate }, (value) => { rate = value; draw(); return `${value.toFixed(1)} °/s`; }),
        slider("specific force", { min: -20, max: 20, step: 0.1, value: force }, (value) => { force = value; draw(); return `${value.toFixed(1)} m/s²`; }),
        slider("counter", { min: 0, max: 14, step: 1, value: counter }, (value) => { counter = value; draw(); return String(value); }),
      ];
      const names = make("div", { className: "names" }, ...kinds.map(([words, ink]) => {
        const mark = make("i");
        mark.style.setProperty("--kind", ink);
        return make("span", {}, mark, words);
      }));
      root.append(bytes, names, make("div", { className: "hand" }, ...hands.map((hand) => hand.node)), says);
      hands.forEach((hand) => hand.tell());
    },
  };

  document.addEventListener("DOMContentLoaded", () => {
    takeColours();
    for (const root of document.querySelectorAll("[data-figure]")) {
      root.replaceChildren();
      figures[root.dataset.figure](root);
    }
    const again = () => { takeColours(); themed.forEach((build) => build()); };
    new MutationObserver(again).observe(document.body, { attributeFilter: ["data-theme"] });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  });
})();
