// The live plots. Data arrive as the smallest and the largest value in each bucket of time and are
// drawn as one stroke per bucket, so that no peak is lost.
"use strict";

export const SIGNALS = ["target", "measured", "error", "trim", "learned", "volts"];
const LIVE = 0x31504844;
const STEPS_S = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600]; // intervals of time labels
const KEEP = 6000; // points kept per curve
const LAG_S = 0.15; // delay of the edge after the newest sample, so that it moves evenly

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

export function clockTime(seconds, step) {
  const d = new Date(seconds * 1000);
  const two = (n) => String(n).padStart(2, "0");
  const text = `${two(d.getHours())}:${two(d.getMinutes())}:${two(d.getSeconds())}`;
  return step < 1 ? `${text}.${String(d.getMilliseconds()).padStart(3, "0").slice(0, step < 0.1 ? 3 : 1)}` : text;
}

export function number(value, digits = 4) {
  return value === null || value === undefined || !Number.isFinite(value) ? "-" : String(Number(value.toPrecision(digits)));
}

// Units in their usual spelling; messages use ASCII.
export const unitName = (unit) => (unit === "um" ? "µm" : unit === "v" ? "V" : unit);
export const pretty = (text) => text.replace(/\bum\b/g, "µm").replace(/(\d) us\b/g, "$1 µs");

// Return the page's font size [px], which grows with the screen and scales the charts.
export const rem = () => parseFloat(getComputedStyle(document.documentElement).fontSize);

function axis(extra) {
  return {
    font: `${Math.round(0.8 * rem())}px system-ui, sans-serif`, labelFont: `600 ${Math.round(0.8 * rem())}px system-ui, sans-serif`,
    stroke: () => colour("soft"), grid: { stroke: () => colour("line"), width: 1 },
    ticks: { stroke: () => colour("line"), width: 1 }, ...extra,
  };
}

function curve(label, name, more) {
  const { width = 1.25, ...others } = more || {};
  return { label, stroke: () => colour(name), width: (width * rem()) / 15, ...others, points: { show: false }, value: (u, v) => number(v) };
}

// Decode one binary frame, see dehyst.daemon.page.wire.
export function readFrame(buffer) {
  const head = new DataView(buffer);
  const u32 = (at) => head.getUint32(at, true), f64 = (at) => head.getFloat64(at, true);
  const n = u32(4), first_s = f64(16), bucket_s = f64(24), offset_s = f64(32);
  const offsets = new Int32Array(buffer, 40, n);
  const values = new Float32Array(buffer, 40 + 4 * n, 2 * n * SIGNALS.length);
  return { live: u32(0) === LIVE, n, anew: u32(8) !== 0, first_s, bucket_s, offset_s, offsets, values };
}

export class Plots {
  constructor(places, zoomed) {
    this.places = places; // by name: position, error, trim, volts
    this.zoomed = zoomed;
    this.unit = "um";
    this.reach = [0, 0];
    this.window_s = 10;
    this.range = null; // [first, end] of the past interval shown; null: live
    this.paused = false;
    this.anchor = null;
    this.drawn = 0;
    this.frames = 0; // number drawn, for tests
    this.reset();
    this.make();
    new ResizeObserver(() => this.fit()).observe(places.position);
    const frame = () => { this.tick(); requestAnimationFrame(frame); };
    requestAnimationFrame(frame);
  }

  reset() {
    this.x = [];
    this.y = SIGNALS.map(() => []);
    this.offset_s = null;
    this.fresh = true;
  }

  make() {
    const sync = { key: "time" }, em = rem(), unit = unitName(this.unit);
    // time labels appear only below the last chart; all charts are aligned
    const one = (place, share, series, label, least) => new uPlot({
      width: this.width(), height: this.height(share),
      series: [{ label: "time", value: (u, v) => (v === null ? "" : clockTime(v, 0.01)) }, ...series],
      scales: { x: { time: true, auto: false }, y: { range: (u, low, high) => atLeast(low, high, least()) } },
      legend: { show: series.length > 1 },
      cursor: { sync, drag: { x: true, y: false, setScale: false }, points: { size: 0.4 * em } },
      axes: [axis({ values: (u, splits, i, space, step) => splits.map((s) => (this.last() === place ? clockTime(s, step) : "")),
        incrs: STEPS_S, space: 6 * em, size: () => (this.last() === place ? 2.2 * em : 0.5 * em) }),
        axis({ size: 4.2 * em, label, labelSize: 1.2 * em, labelGap: 0, space: 2 * em, values: (u, splits) => splits.map((s) => number(s)) })],
      hooks: { setSelect: [(u) => this.select(u)] },
    }, [[], ...series.map(() => [])], place);
    const p = this.places, span = () => Math.abs(this.reach[1] - this.reach[0]);
    this.plots = {
      position: one(p.position, 0.3, [curve("target", "target", { width: 3 }), curve("measured", "measured")], `position, ${unit}`, () => 0.05 * span()),
      error: one(p.error, 0.16, [curve("error", "error")], `error, ${unit}`, () => 0.02 * span()),
      trim: one(p.trim, 0.16, [curve("trim", "target"), curve("learned", "measured")], `added, ${unit}`, () => 0.02 * span()),
      volts: one(p.volts, 0.16, [curve("volts", "good")], "drive, V", () => 1),
    };
    this.columns = { position: [0, 1], error: [2], trim: [3, 4], volts: [5] };
  }

  // Return the lowest visible chart.
  last() {
    const shown = Object.values(this.places).filter((place) => !place.hidden);
    return shown[shown.length - 1];
  }

  width() { return Math.max(200, this.places.position.clientWidth); }

  height(share) { return Math.round(Math.min(26 * rem(), Math.max(8 * rem(), window.innerHeight * share))); }

  fit() {
    if (this.width() === this.plots.position.width) return;
    for (const plot of Object.values(this.plots)) plot.setSize({ width: this.width(), height: plot.height });
    this.fresh = true;
  }

  remake() {
    for (const plot of Object.values(this.plots)) plot.destroy();
    this.make();
    this.fresh = true;
  }

  // Set unit and reach of the shown axis; scaled to the reach, noise at rest stays small.
  setUnit(unit, reach) {
    this.reach = reach;
    if (unit === this.unit) return;
    this.unit = unit;
    this.remake();
  }

  add(frame) {
    if (frame.live && (this.paused || this.range)) return;
    if (frame.anew || !frame.live) this.reset();
    if (this.offset_s === null) this.offset_s = frame.offset_s;
    const start = frame.first_s + this.offset_s, half = frame.bucket_s / 2;
    let last = this.x.length ? this.x[this.x.length - 1] : null;
    const gap_s = Math.max(0.5, 6 * frame.bucket_s);
    for (let i = 0; i < frame.n; i++) {
      const t = start + frame.offsets[i] * frame.bucket_s;
      if (last !== null && t <= last) continue;
      if (last !== null && t - last > gap_s) { // a gap in the data is not bridged
        this.x.push(last + half / 2);
        for (const y of this.y) y.push(null);
      }
      this.x.push(t, t + half);
      for (let s = 0; s < SIGNALS.length; s++) {
        const least = frame.values[2 * s * frame.n + i], largest = frame.values[(2 * s + 1) * frame.n + i];
        if (Number.isNaN(least)) this.y[s].push(null, null);
        else this.y[s].push(least, largest);
      }
      last = t + half;
    }
    if (frame.live && this.x.length > 2 * KEEP) {
      const drop = this.x.length - KEEP;
      this.x.splice(0, drop);
      for (const y of this.y) y.splice(0, drop);
    }
    if (frame.live && last !== null) {
      const anchor = last - performance.now() / 1000;
      const off = this.anchor === null ? Infinity : Math.abs(anchor - this.anchor);
      this.anchor = off > 0.5 + 3 * frame.bucket_s ? anchor : this.anchor + 0.05 * (anchor - this.anchor);
      this.lag_s = LAG_S + frame.bucket_s;
    }
    this.fresh = true;
  }

  newest() { return this.x.length ? this.x[this.x.length - 1] : null; }

  tick() {
    if (!this.x.length) return;
    let [first, end] = this.range || [0, 0];
    if (!this.range) {
      if (this.paused && !this.fresh) return;
      end = this.paused ? this.stopped : performance.now() / 1000 + this.anchor - this.lag_s;
      first = end - this.window_s;
      const moved = (end - this.drawn) / this.window_s * this.width();
      if (!this.fresh && Math.abs(moved) < 1) return;
    } else if (!this.fresh) return;
    this.drawn = end;
    for (const [name, plot] of Object.entries(this.plots)) {
      if (this.places[name].hidden) continue;
      plot.batch(() => {
        if (this.fresh) plot.setData([this.x, ...this.columns[name].map((s) => this.y[s])], false);
        plot.setScale("x", { min: first, max: end });
      });
    }
    this.fresh = false;
    this.frames += 1;
  }

  pause(paused) {
    this.paused = paused;
    this.stopped = this.drawn;
    this.fresh = true;
  }

  live() {
    this.paused = false;
    this.range = null;
    this.anchor = null;
    this.reset();
  }

  select(plot) {
    const { left, width } = plot.select;
    if (width < 6 || this.offset_s === null) return;
    const range = [plot.posToVal(left, "x"), plot.posToVal(left + width, "x")];
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.range = range;
    this.fresh = true;
    this.zoomed(range[0] - this.offset_s, range[1] - this.offset_s, Math.round(this.width()));
  }
}

// Return a range of values about their middle that spans at least `least`.
export function atLeast(low, high, least) {
  if (low === null || high === null) return [-(least || 1) / 2, (least || 1) / 2];
  const span = 1.1 * Math.max(high - low, least), middle = (low + high) / 2;
  return span > 0 ? [middle - span / 2, middle + span / 2] : [low - 1, high + 1];
}

// Draw a static plot: x in seconds, curves [{label, colour, y, dash}]; a curve without a label is
// not in the legend.
export function drawStill(place, height, x, curves, label, scales = {}) {
  const em = rem();
  place.replaceChildren();
  return new uPlot({
    width: Math.max(180, place.clientWidth), height,
    series: [{ label: "s", class: "quiet" }, ...curves.map((c) => curve(c.label || "", c.colour, { dash: c.dash, class: c.label ? "named" : "quiet" }))],
    scales: { x: { time: false }, ...scales }, cursor: { drag: { x: false, y: false } },
    legend: { live: false, show: curves.some((c) => c.label) },
    axes: [axis({ size: 2.2 * em, space: 4 * em, values: (u, splits) => splits.map((s) => `${number(s)} s`) }),
      axis({ size: 3.6 * em, label: label && unitName(label), labelSize: 1.2 * em, labelGap: 0, space: 1.8 * em, values: (u, splits) => splits.map((s) => number(s)) })],
  }, [x, ...curves.map((c) => c.y)], place);
}
