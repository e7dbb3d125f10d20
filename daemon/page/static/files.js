// A file that is dropped: a trajectory to look at before it is played, a recording to identify or
// diagnose. The server's process does the work; this asks how far it is.
"use strict";
import { drawPath } from "./axes.js";
import { drawStill, number } from "./plot.js";

const $ = (id) => document.getElementById(id);
const POLL_MS = 700;

export function fillList(list, rows) {
  list.replaceChildren(...rows.flatMap(([term, text]) => {
    const dt = document.createElement("dt"), dd = document.createElement("dd");
    dt.textContent = term;
    dd.textContent = text;
    return [dt, dd];
  }));
}

export class Files {
  constructor(page) {
    this.page = page; // controller(), ask(), say(), operator
    this.file = null;
    this.job = null;
    const drop = $("drop");
    for (const kind of ["dragover", "dragenter"]) {
      drop.addEventListener(kind, (e) => { e.preventDefault(); drop.classList.add("over"); });
    }
    for (const kind of ["dragleave", "drop"]) drop.addEventListener(kind, () => drop.classList.remove("over"));
    drop.addEventListener("drop", (e) => { e.preventDefault(); this.take(e.dataTransfer.files[0]); });
    // a file that misses its place must not replace the page
    for (const kind of ["dragover", "drop"]) window.addEventListener(kind, (e) => e.preventDefault());
    $("file").addEventListener("change", () => this.take($("file").files[0]));
    for (const kind of ["trajectory", "identify", "diagnose"]) {
      $(`as-${kind}`).addEventListener("click", () => this.send(kind));
    }
    $("play").addEventListener("click", () => {
      this.page.ask({ ask: "play", job: this.job.number, take_over: $("take-over").checked });
    });
  }

  take(file) {
    this.file = file || null;
    this.enable();
    if (file) {
      $("job").hidden = false;
      this.clear(`${file.name}, ${number(file.size / 1e6, 3)} MB: what is it for?`);
    }
  }

  enable() {
    for (const kind of ["trajectory", "identify", "diagnose"]) {
      $(`as-${kind}`).disabled = !this.file || !this.page.operator;
    }
  }

  clear(text) {
    $("job-text").textContent = text;
    $("job-share").value = 0;
    for (const id of ["preview", "job-said", "job-report", "job-model"]) $(id).hidden = true;
  }

  async send(kind) {
    this.clear("sending");
    const query = new URLSearchParams({ controller: this.page.controller(), file: this.file.name });
    try {
      const answer = await fetch(`upload/${kind}?${query}`, { method: "POST", body: this.file });
      if (!answer.ok) throw new Error(await reason(answer));
      this.show(await answer.json());
    } catch (error) {
      this.clear(error.message);
    }
  }

  async show(job) {
    this.job = job;
    while (job.state === "waiting" || job.state === "working") {
      $("job-text").textContent = `${job.file}: ${job.text}`;
      $("job-share").value = job.share;
      await new Promise((done) => setTimeout(done, POLL_MS));
      if (this.job.number !== job.number) return;
      try {
        const answer = await fetch(`job/${job.number}`);
        if (!answer.ok) throw new Error(await reason(answer));
        job = this.job = await answer.json();
      } catch (error) {
        this.clear(error.message);
        return;
      }
    }
    $("job-share").value = job.state === "done" ? 1 : 0;
    $("job-text").textContent = `${job.file}: ${job.text}`;
    if (job.state !== "done") return;
    if (job.kind === "trajectory") this.preview(job);
    else {
      $("job-said").hidden = false;
      $("job-said").textContent = job.result.said;
    }
    for (const what of ["report", "model"]) {
      $(`job-${what}`).hidden = !job[what];
      $(`job-${what}`).href = `job/${job.number}/${what}`;
    }
  }

  restyle() { if (!$("preview").hidden) this.draw(this.job.result); }

  draw(r) {
    const line = (y) => r.t_s.map(() => y), axes = Object.entries(r.axes || {});
    $("preview-plane").hidden = axes.length < 2;
    if (axes.length) {
      const colours = ["target", "measured", "warn"];
      const curves = axes.map(([name, one], i) => ({ label: name, colour: colours[i % 3], y: one.target }));
      drawStill($("plot-preview"), 170, r.t_s, curves, this.page.unit());
      if (axes.length > 1) {
        const [[right, x], [up, y]] = axes;
        drawPath($("preview-plane"), [right, up], x.target, y.target, this.page.unit());
      }
      return;
    }
    drawStill($("plot-preview"), 170, r.t_s, [
      { label: "target", colour: "target", y: r.target },
      { label: "reach", colour: "warn", y: line(r.reach[0]), dash: [4, 4] },
      { label: "reach", colour: "warn", y: line(r.reach[1]), dash: [4, 4] },
    ], this.page.unit());
  }

  preview(job) {
    const r = job.result;
    $("preview").hidden = false;
    this.draw(r);
    const several = Object.entries(r.axes || {});
    fillList($("preview-figures"), [
      ["length", `${number(r.duration_s)} s, ${r.points} points`],
      ...(several.length ? several.flatMap(([name, one]) => this.figures(one, `${name}: `)) : this.figures(r, "")),
    ]);
    $("play").textContent = several.length ? `play on ${several.map(([name]) => name).join(", ")}` : "play";
    $("play").disabled = r.outside > 0 || !this.page.operator;
  }

  // Reach and slew of one axis.
  figures(r, whose) {
    const unit = this.page.unit();
    return [
      [`${whose}from, to`, `${number(r.least)} to ${number(r.most)} ${unit}`],
      [`${whose}reach`, r.outside === 0 ? "inside" : `${number(100 * r.outside, 3)} % of the points are outside ${number(r.reach[0])} to ${number(r.reach[1])} ${unit}: it is not played`],
      [`${whose}fastest drive`, `${number(r.fastest, 3)} of ${number(r.slew, 3)} ${r.drive_unit}/s allowed`],
      [`${whose}slew`, r.too_fast === 0 ? "never limited" : `held back in ${number(100 * r.too_fast, 2)} % of the time`],
    ];
  }
}

async function reason(answer) {
  const text = await answer.text();
  try { return JSON.parse(text).detail || text; } catch { return text || `refused (${answer.status})`; }
}
