// The live plots. Data come as the least and the largest value in each bucket of time and are drawn
// as one stroke a bucket, so that no peak is lost.
"use strict";

const SIGNALS = ["target", "measured", "error", "trim", "learned", "volts"];
const LIVE = 0x31504844;
const KEEP = 6000; // points of a curve
const LAG_S = 0.15; // behind the newest sample, so that the edge moves evenly

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

function axis(extra) {
  return {
    stroke: () => colour("soft"), grid: { stroke: () => colour("line"), width: 1 },
    ticks: { stroke: () => colour("line"), width: 1 }, ...extra,
  };
}

function curve(label, name, more) {
  return { label, stroke: () => colour(name), width: 1.25, ...more, points: { show: false }, value: (u, v) => number(v) };
}

// One binary frame, see dehyst.daemon.page.wire.
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
    this.window_s = 10;
    this.range = null; // [first, end] of a stretch of the past that is shown; null: live
    this.paused = false;
    this.anchor = null;
    this.drawn = 0;
    this.frames = 0; // drawn, for tests
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
    const sync = { key: "time" };
    const one = (place, height, series, label) => new uPlot({
      width: this.width(), height, series: [{ label: "time", value: (u, v) => (v === null ? "-" : clockTime(v, 0.01)) }, ...series],
      scales: { x: { time: true, auto: false } }, legend: { show: series.length > 1 },
      cursor: { sync, drag: { x: true, y: false, setScale: false }, points: { size: 5 } },
      axes: [axis({ values: (u, splits, i, space, step) => splits.map((s) => clockTime(s, step)), space: 80 }),
        axis({ size: 62, label, labelSize: 18, labelGap: 0, values: (u, splits) => splits.map((s) => number(s)) })],
      hooks: { setSelect: [(u) => this.select(u)] },
    }, [[], ...series.map(() => [])], place);
    const p = this.places;
    this.plots = {
      position: one(p.position, this.height(0.34), [curve("target", "target", { width: 3 }), curve("measured", "measured")], `position, ${this.unit}`),
      error: one(p.error, this.height(0.2), [curve("error", "error")], `error, ${this.unit}`),
      trim: one(p.trim, this.height(0.2), [curve("trim", "target"), curve("learned", "measured")], `added, ${this.unit}`),
      volts: one(p.volts, this.height(0.2), [curve("volts", "good")], "drive, V"),
    };
    this.columns = { position: [0, 1], error: [2], trim: [3, 4], volts: [5] };
  }

  width() { return Math.max(200, this.places.position.clientWidth); }

  height(share) { return Math.round(Math.min(380, Math.max(130, window.innerHeight * share))); }

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

  setUnit(unit) {
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
      if (last !== null && t - last > gap_s) { // nothing was heard: nothing is drawn
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

// A plot that stays: x in seconds, curves [{label, colour, y, dash}].
export function drawStill(place, height, x, curves, label, ranges = {}) {
  place.replaceChildren();
  return new uPlot({
    width: Math.max(180, place.clientWidth), height,
    series: [{ label: "s", value: (u, v) => number(v) }, ...curves.map((c) => curve(c.label, c.colour, { dash: c.dash }))],
    scales: { x: { time: false }, ...ranges }, cursor: { drag: { x: false, y: false } },
    legend: { live: false },
    axes: [axis({ values: (u, splits) => splits.map((s) => number(s)) }),
      axis({ size: 54, label, labelSize: 18, labelGap: 0, values: (u, splits) => splits.map((s) => number(s)) })],
  }, [x, ...curves.map((c) => c.y)], place);
}
