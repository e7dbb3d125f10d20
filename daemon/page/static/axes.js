// All axes of a controller: one row per axis, and the path in the plane of two of them.
"use strict";
import { decimals, fixed } from "./now.js";
import { colour, number, rem, unitName } from "./plot.js";

const $ = (id) => document.getElementById(id);
const margin = () => 2.6 * rem(); // around the picture [px]
const LEAST = 0.1; // least span of a picture, of the reach, so that noise at rest stays small

export class Axes {
  constructor(page, plots, choose) {
    this.page = page;
    this.plots = plots;
    this.chosen = choose;
    this.said = null;
    this.number = [];
    this.way = new Map(); // by axis: [targets, readings]
    for (const id of ["plane-x", "plane-y"]) $(id).addEventListener("change", () => this.draw());
    $("axes-going").addEventListener("submit", (e) => { e.preventDefault(); this.go(); });
    $("hold-all").addEventListener("click", () => this.hold());
    new ResizeObserver(() => this.draw()).observe($("plane"));
  }

  // Another axis was chosen; if it belongs to another controller, discard everything.
  choose(name) {
    if (this.said && this.said.axes.some((a) => a.name === name)) { this.list(); return; }
    this.said = null;
    this.number = [];
    this.way.clear();
    for (const id of ["axes", "path", "axes-going"]) $(id).hidden = true;
    $("one").hidden = false;
    $("main").classList.remove("several");
  }

  // Return target, reading and reach of an axis by its name on the bus.
  place(name) {
    const a = this.said && this.said.axes.find((one) => one.name === name);
    return a && a.reach ? [a.target, a.measured, a.reach] : [null, null, [0, 0]];
  }

  // Return the bus names of the axes that the keys move: horizontal, vertical, the remaining one.
  moved() {
    const by = (short) => this.said.axes.find((a) => (a.axis || a.name) === short);
    const across = by($("plane-x").value), up = by($("plane-y").value);
    return [across, up, this.said.axes.find((a) => a !== across && a !== up)].map((a) => a && a.name);
  }

  hear(said) {
    if (!said.axes.some((a) => a.name === this.page.name)) return;
    const names = said.axes.map((a) => a.axis || a.name);
    const fresh = !this.said || this.names().join() !== names.join();
    if (said.anew || fresh) { this.number = []; this.way.clear(); }
    this.said = said;
    this.number.push(...said.number);
    said.axes.forEach((axis, i) => {
      const way = this.way.get(names[i]) || [[], []];
      axis.way.forEach((values, k) => way[k].push(...values));
      this.way.set(names[i], way);
    });
    const kept = Math.round(Math.min(30, this.plots.window_s) / said.point_s);
    const drop = this.number.length - kept;
    if (drop > 0) {
      this.number.splice(0, drop);
      for (const way of this.way.values()) for (const values of way) values.splice(0, drop);
    }
    for (const id of ["axes", "path", "axes-going"]) $(id).hidden = false;
    $("one").hidden = true;
    $("main").classList.add("several");
    if (fresh) { this.offer(names); this.fields(); }
    this.list();
    this.draw();
  }

  names() { return this.said.axes.map((a) => a.axis || a.name); }

  offer(names) {
    [["plane-x", 0], ["plane-y", 1]].forEach(([id, place]) => {
      $(id).replaceChildren(...names.map((name) => {
        const option = document.createElement("option");
        option.value = option.textContent = name;
        return option;
      }));
      $(id).value = names[Math.min(place, names.length - 1)];
    });
  }

  list() {
    const rows = this.said.axes.map((a) => {
      const row = document.createElement("tr"), unit = unitName(a.unit || "");
      row.setAttribute("aria-current", String(a.name === this.page.name));
      const places = a.reach ? decimals(a.reach) : 3;
      const size = (value) => (Number.isFinite(value ?? NaN) ? `${fixed(value, places)} ${unit}` : "–");
      const gap = Number.isFinite(a.target ?? NaN) && Number.isFinite(a.measured ?? NaN) ? a.measured - a.target : null;
      const words = [a.axis || a.name, size(a.measured), a.target === null && a.measured !== null ? "none" : size(a.target),
        size(gap), Number.isFinite(a.volts ?? NaN) ? `${fixed(a.volts, 2)} V` : "–", a.mismatch ? `${a.state}, mismatch` : a.state];
      row.append(...words.map((text) => {
        const cell = document.createElement("td");
        cell.textContent = text;
        return cell;
      }));
      row.title = a.commander ? `commanded by ${a.commander}` : "no client commands it";
      row.addEventListener("click", () => this.chosen(a.name));
      return row;
    });
    $("axes-table").querySelector("tbody").replaceChildren(...rows);
  }

  draw() {
    if (!this.said || $("axes").hidden) return;
    const canvas = $("plane"), dense = window.devicePixelRatio || 1;
    const size = canvas.clientWidth;
    if (!size) return;
    canvas.width = canvas.height = Math.round(size * dense);
    const draw = canvas.getContext("2d");
    draw.scale(dense, dense);
    const right = this.way.get($("plane-x").value), up = this.way.get($("plane-y").value);
    if (!right || !up) return;
    const aimed = right[0].some((v) => v !== null) && up[0].some((v) => v !== null);
    const least = LEAST * Math.max(...this.said.axes.map((a) => (a.reach ? a.reach[1] - a.reach[0] : 0)));
    const [x0, y0, span] = aimed ? bounds([right[0]], [up[0]], least) : bounds(right, up, least);
    const room = size - 1.3 * margin(), scale = room / span;
    const px = (x) => margin() + (x - x0) * scale, py = (y) => 0.3 * margin() + room - (y - y0) * scale;
    this.grid(draw, { x0, y0, span, px, py, size });
    stroke(draw, right[0], up[0], px, py, colour("target"), 3);
    stroke(draw, right[1], up[1], px, py, colour("measured"), 1.25);
    const last = right[1].length - 1;
    if (last >= 0 && right[1][last] !== null && up[1][last] !== null) {
      draw.fillStyle = colour("measured");
      draw.beginPath();
      draw.arc(px(right[1][last]), py(up[1][last]), 4, 0, 2 * Math.PI);
      draw.fill();
    }
    this.drawn = (this.drawn || 0) + 1; // for tests
  }

  grid(draw, at) {
    grid(draw, at, $("plane-x").value, $("plane-y").value, this.said.axes[0].unit || "");
  }

  // Make one field per axis, so that all move at once; an axis with an empty field stays.
  fields() {
    $("axes-targets").replaceChildren(...this.said.axes.map((a) => {
      const label = document.createElement("label"), field = document.createElement("input");
      field.inputMode = "decimal";
      field.autocomplete = "off";
      field.dataset.name = a.name;
      label.append(`${a.axis || a.name} `, field);
      return label;
    }));
  }

  go() {
    const wanted = [...$("axes-targets").querySelectorAll("input")].filter((f) => f.value.trim() !== "");
    const values = wanted.map((f) => Number(f.value.replace(",", ".")));
    const wrong = wanted.findIndex((f, i) => !Number.isFinite(values[i]));
    if (wrong >= 0) { this.page.say(`${wanted[wrong].value} is not a number`, true); return; }
    wanted.forEach((f, i) => this.page.ask({
      ask: "go", name: f.dataset.name, value: values[i], seconds: Number($("seconds").value) || 10,
      take_over: $("take-over").checked,
    }));
  }

  hold() {
    this.page.ask({ ask: "hold", seconds: Number($("seconds").value) || 10, everywhere: true, take_over: $("take-over").checked });
  }
}

// Draw a path to be played in the plane of two axes: names, [x], [y], unit.
export function drawPath(canvas, [right, up], x, y, unit) {
  const dense = window.devicePixelRatio || 1, size = canvas.clientWidth;
  if (!size) return;
  canvas.width = canvas.height = Math.round(size * dense);
  const draw = canvas.getContext("2d");
  draw.scale(dense, dense);
  const [x0, y0, span] = bounds([x], [y], 0);
  const room = size - 1.3 * margin(), scale = room / span;
  const px = (v) => margin() + (v - x0) * scale, py = (v) => 0.3 * margin() + room - (v - y0) * scale;
  grid(draw, { x0, y0, span, px, py, size }, right, up, unit);
  stroke(draw, x, y, px, py, colour("target"), 1.5);
}

function grid(draw, { x0, y0, span, px, py, size }, right, up, unit) {
  const step = tick(span);
  draw.strokeStyle = colour("line");
  draw.fillStyle = colour("soft");
  draw.font = `${Math.round(0.8 * rem())}px system-ui, sans-serif`;
  draw.lineWidth = 1;
  draw.textAlign = "center";
  for (let x = step * Math.ceil(x0 / step); x <= x0 + span; x += step) {
    line(draw, px(x), py(y0), px(x), py(y0 + span));
    draw.fillText(number(x, 3), px(x), py(y0) + rem());
  }
  draw.fillText(`${right}, ${unitName(unit)}`, px(x0 + span / 2), size - 3);
  draw.textAlign = "right";
  for (let y = step * Math.ceil(y0 / step); y <= y0 + span; y += step) {
    line(draw, px(x0), py(y), px(x0 + span), py(y));
    if (py(y) > 1.4 * rem()) draw.fillText(number(y, 3), px(x0) - 5, py(y) + 4); // the name is above
  }
  draw.textAlign = "left";
  draw.fillText(`${up}, ${unitName(unit)}`, 4, 0.7 * rem());
}

// Return the square that contains all points: [left, bottom, side]; smallest: its least side.
function bounds(right, up, smallest) {
  const one = (way) => {
    let least = Infinity, most = -Infinity;
    for (const values of way) for (const v of values) if (v !== null) { least = Math.min(least, v); most = Math.max(most, v); }
    return least > most ? [0, 0] : [least, most];
  };
  const [x0, x1] = one(right), [y0, y1] = one(up);
  const span = 1.16 * (Math.max(smallest, x1 - x0, y1 - y0) || 1);
  return [(x0 + x1 - span) / 2, (y0 + y1 - span) / 2, span];
}

function tick(span) {
  const rough = span / 5, ten = 10 ** Math.floor(Math.log10(rough));
  return ten * [1, 2, 5, 10].find((f) => f * ten >= rough);
}

function line(draw, x0, y0, x1, y1) {
  draw.beginPath();
  draw.moveTo(x0, y0);
  draw.lineTo(x1, y1);
  draw.stroke();
}

function stroke(draw, x, y, px, py, style, width) {
  draw.strokeStyle = style;
  draw.lineWidth = width;
  draw.lineJoin = "round";
  draw.beginPath();
  let pen = false;
  for (let i = 0; i < x.length; i++) {
    if (x[i] === null || y[i] === null) { pen = false; continue; }
    if (pen) draw.lineTo(px(x[i]), py(y[i]));
    else draw.moveTo(px(x[i]), py(y[i]));
    pen = true;
  }
  draw.stroke();
}
