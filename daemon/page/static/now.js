// The present position in large digits, and single steps by button or arrow key.
"use strict";
import { unitName } from "./plot.js";

const $ = (id) => document.getElementById(id);
const TEXT_MS = 200; // interval of updates; faster ones could not be read
const RECENT_MS = 1500; // within this time a step starts from the target of the step before

// Return the number of decimal places that resolve a few ten-thousandths of the reach.
export function decimals(reach) {
  const span = Math.abs(reach[1] - reach[0]);
  return span > 0 && Number.isFinite(span) ? Math.min(6, Math.max(0, 3 - Math.floor(Math.log10(span / 2)))) : 3;
}

export function fixed(value, places) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = Math.abs(value).toFixed(places);
  return value < 0 && Number(text) !== 0 ? `−${text}` : text;
}

export class Now {
  constructor(page) {
    this.page = page; // name, status, ask(), say(), parse()
    this.clear();
  }

  clear() {
    this.aim = this.target = this.measured = this.error = this.volts = null;
    this.stepped = null;
    this.shown = 0;
  }

  reach() {
    const s = this.page.status && this.page.status.status;
    return s ? [s.reach_min, s.reach_max] : [0, 0];
  }

  // Take a live frame: show the means of its newest buckets, so that the figures belong to the same
  // times; a step starts from the newest target.
  frame(f, signals) {
    if (!f.live || !f.n) return;
    const mean = (signal) => {
      const s = signals.indexOf(signal);
      let sum = 0, n = 0;
      for (let i = Math.max(0, f.n - 20); i < f.n; i++) {
        const v = (f.values[2 * s * f.n + i] + f.values[(2 * s + 1) * f.n + i]) / 2;
        if (Number.isFinite(v)) { sum += v; n += 1; }
      }
      return n ? sum / n : null;
    };
    const newest = f.values[(2 * signals.indexOf("target") + 1) * f.n + f.n - 1];
    const aim = Number.isFinite(newest) ? newest : null;
    this.take(aim, { target: aim === null ? null : mean("target"), measured: mean("measured"), error: mean("error"), volts: mean("volts") });
  }

  // aim: the newest target, or null.
  take(aim, { target, measured, error, volts }) {
    this.aim = aim;
    this.target = target;
    this.measured = measured;
    this.error = aim === null ? null : error;
    this.volts = volts;
    this.show();
  }

  show() {
    const now = performance.now();
    if (now - this.shown < TEXT_MS || !this.page.status) return;
    this.shown = now;
    const reach = this.reach(), places = decimals(reach), error = this.error;
    $("now-measured").textContent = fixed(this.measured, places);
    $("now-target").textContent = fixed(this.target, places);
    $("now-error").textContent = error !== null && error > 0 ? `+${fixed(error, places)}` : fixed(error, places);
    $("now-volts").textContent = fixed(this.volts, 2);
    this.mark(reach);
  }

  mark([least, most]) {
    const at = (value) => Math.min(1, Math.max(0, (value - least) / (most - least || 1)));
    for (const [name, value] of [["reading", this.measured], ["aim", this.target]]) {
      const mark = document.querySelector(`#reach-bar .${name}`);
      mark.hidden = value === null || !Number.isFinite(value);
      mark.style.left = `${100 * at(value)}%`;
    }
  }

  // Move an axis by steps; times: the number of steps.
  step(times, name = this.page.name) {
    const size = this.page.parse("step"), seconds = this.page.parse("seconds");
    if (!(size > 0)) { this.page.say("the step must be a number above 0", true); return; }
    const [target, measured, reach] = name === this.page.name
      ? [this.aim, this.measured, this.reach()] : this.page.axes.place(name);
    const recent = this.stepped && this.stepped.name === name && performance.now() - this.stepped.at < RECENT_MS;
    const from = recent ? this.stepped.value : (target ?? measured);
    if (from === null || from === undefined) { this.page.say("there is neither a target nor a reading to step from", true); return; }
    const value = Math.min(reach[1], Math.max(reach[0], from + times * size));
    const end = times > 0 ? reach[1] : reach[0], ahead = Math.sign(times) * (end - from);
    if (ahead < 1e-6 * (reach[1] - reach[0])) { // telemetry has single precision
      this.page.say(`${fixed(end, decimals(reach))} ${unitName(this.page.unit())} is the end of the reach`, true);
      return;
    }
    this.stepped = { name, value, at: performance.now() };
    if (name === this.page.name) $("target").value = String(Number(value.toFixed(decimals(reach) + 1)));
    this.page.ask({ ask: "go", name, value, seconds: seconds > 0 ? seconds : 10, take_over: $("take-over").checked });
  }
}
