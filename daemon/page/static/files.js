// Dropped files: a trajectory to check before it is played, a recording to identify or diagnose.
// A process of the server does the work; this polls its progress.
"use strict";
import { drawPath } from "./axes.js";
import { drawStill, number, pretty, rem, unitName } from "./plot.js";

const $ = (id) => document.getElementById(id);
const POLL_MS = 700;
const EARLIER = 6; // number of earlier results shown; the server keeps twelve files

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
    this.turn = 0; // counts requests, so that a late answer to an earlier one is not shown
    this.checked = null; // the trajectory whose preview is shown
    this.shown = null; // the recording whose result is shown
    const drop = $("drop");
    for (const kind of ["dragover", "dragenter"]) {
      drop.addEventListener(kind, (e) => { e.preventDefault(); drop.classList.add("over"); });
    }
    for (const kind of ["dragleave", "drop"]) drop.addEventListener(kind, () => drop.classList.remove("over"));
    drop.addEventListener("drop", (e) => { e.preventDefault(); this.take(e.dataTransfer.files[0]); });
    // a file dropped elsewhere must not replace the page
    for (const kind of ["dragover", "drop"]) window.addEventListener(kind, (e) => e.preventDefault());
    $("file").addEventListener("change", () => this.take($("file").files[0]));
    for (const kind of ["trajectory", "identify", "diagnose"]) {
      $(`as-${kind}`).addEventListener("click", () => this.send(kind));
    }
    $("play").addEventListener("click", () => {
      if (this.checked) this.page.ask({ ask: "play", job: this.checked.number, take_over: $("take-over").checked });
    });
  }

  take(file) {
    this.file = file || null;
    this.enable();
    $("job").hidden = !file;
    this.clear(file ? `${file.name}, ${number(file.size / 1e6, 3)} MB: what is it for?` : "");
  }

  enable() {
    for (const kind of ["trajectory", "identify", "diagnose"]) {
      $(`as-${kind}`).disabled = !this.file || !this.page.operator;
    }
  }

  // Remove the result for another file or another controller; the result of a recording moves to
  // the list of earlier ones.
  clear(text) {
    this.turn += 1;
    this.checked = null;
    this.keep(this.shown);
    this.shown = null;
    $("job-text").textContent = text;
    $("job-share").value = 0;
    for (const id of ["preview", "job-said", "job-report", "job-model", "job-share"]) $(id).hidden = true;
    $("main").classList.remove("previewing");
    return this.turn;
  }

  // Another controller is shown: a preview is valid only for the controller it was made for.
  choose(names) {
    if (this.checked && !names.includes(this.checked.controller)) {
      this.clear(this.file ? `${this.file.name}: check it again for ${this.page.controller()}` : "");
    }
  }

  async send(kind) {
    const turn = this.clear(`${this.file.name}: sending`);
    $("job-share").hidden = false;
    const query = new URLSearchParams({ controller: this.page.controller(), file: this.file.name });
    try {
      let job = await answered(fetch(`upload/${kind}?${query}`, { method: "POST", body: this.file }));
      const wanted = () => turn === this.turn || kind !== "trajectory";
      while (wanted() && (job.state === "waiting" || job.state === "working")) {
        if (turn === this.turn) {
          $("job-text").textContent = `${job.file}: ${job.text}`;
          $("job-share").value = job.share;
        }
        await new Promise((done) => setTimeout(done, POLL_MS));
        if (wanted()) job = await answered(fetch(`job/${job.number}`));
      }
      if (turn !== this.turn) this.keep(job);
      if (turn === this.turn) this.show(job);
    } catch (error) {
      if (turn === this.turn) this.clear(error.message);
    }
  }

  show(job) {
    $("job-share").hidden = true;
    $("job-text").textContent = `${job.file}: ${pretty(job.text)}`;
    if (job.state !== "done") return;
    if (job.kind === "trajectory") this.preview(job);
    else {
      this.shown = job;
      $("job-said").hidden = false;
      $("job-said").textContent = pretty(job.result.said);
    }
    for (const what of ["report", "model"]) {
      $(`job-${what}`).hidden = !job[what];
      $(`job-${what}`).href = `job/${job.number}/${what}`;
    }
  }

  // Keep the result of an earlier recording in the list below the present file.
  keep(job) {
    if (!job || job.kind === "trajectory" || job.state !== "done") return;
    const one = document.createElement("details"), said = document.createElement("pre");
    const head = document.createElement("summary"), links = document.createElement("p");
    head.textContent = `${job.file}: ${job.kind}`;
    said.textContent = pretty(job.result.said);
    for (const [what, text] of [["report", "report"], ["model", "model.toml"]]) {
      if (!job[what]) continue;
      const link = document.createElement("a");
      link.textContent = text;
      link.href = `job/${job.number}/${what}`;
      if (what === "report") [link.target, link.rel] = ["_blank", "noopener"];
      links.append(link, " ");
    }
    one.append(head, said, links);
    $("earlier").prepend(one);
    while ($("earlier").children.length > EARLIER) $("earlier").lastChild.remove();
  }

  restyle() { if (this.checked) this.draw(this.checked.result); }

  draw(r) {
    const line = (y) => r.t_s.map(() => y), axes = Object.entries(r.axes || {});
    $("preview-plane").hidden = axes.length < 2;
    if (axes.length) {
      const colours = ["target", "measured", "good"];
      const curves = axes.map(([name, one], i) => ({ label: name, colour: colours[i % 3], y: one.target }));
      drawStill($("plot-preview"), 19 * rem(), r.t_s, curves, this.page.unit());
      if (axes.length > 1) {
        const [[right, x], [up, y]] = axes;
        drawPath($("preview-plane"), [right, up], x.target, y.target, this.page.unit());
      }
      return;
    }
    drawStill($("plot-preview"), 14 * rem(), r.t_s, [
      { label: "target", colour: "target", y: r.target },
      { label: "reach", colour: "warn", y: line(r.reach[0]), dash: [4, 4] },
      { colour: "warn", y: line(r.reach[1]), dash: [4, 4] },
    ], this.page.unit());
  }

  preview(job) {
    const r = job.result;
    this.checked = job;
    $("preview").hidden = false;
    $("main").classList.add("previewing");
    this.draw(r);
    const several = Object.entries(r.axes || {});
    fillList($("preview-figures"), [
      ["length", `${number(r.duration_s)} s, ${r.points} points`],
      ...(several.length ? several.flatMap(([name, one]) => this.shortly(one, name)) : this.figures(r)),
    ]);
    $("play").textContent = `play ${job.file}${several.length ? ` on ${several.map(([name]) => name).join(", ")}` : ""}`;
    $("play").disabled = r.outside > 0 || !this.page.operator;
  }

  // Reach and slew rate of the only axis, one line each.
  figures(r) {
    const unit = unitName(this.page.unit());
    return [
      ["range", `${number(r.least)} to ${number(r.most)} ${unit}`],
      ["reach", within(r, unit)],
      ["fastest drive", `${number(r.fastest, 3)} of ${number(r.slew, 3)} ${unitName(r.drive_unit)}/s allowed`],
      ["slew", slowed(r)],
    ];
  }

  // Reach and slew rate of one of several axes, in two lines.
  shortly(r, name) {
    const unit = unitName(this.page.unit());
    return [
      [name, `${number(r.least)} to ${number(r.most)} ${unit}, ${r.outside === 0 ? "inside the reach" : within(r, unit)}`],
      [`${name}, drive`, `${number(r.fastest, 3)} of ${number(r.slew, 3)} ${unitName(r.drive_unit)}/s, ${slowed(r)}`],
    ];
  }
}

const within = (r, unit) => (r.outside === 0 ? "inside"
  : `${number(100 * r.outside, 3)} % of the points are outside ${number(r.reach[0])} to ${number(r.reach[1])} ${unit}: it cannot be played`);
const slowed = (r) => (r.too_fast === 0 ? "never limited" : `the limit slows it for ${number(100 * r.too_fast, 2)} % of the time`);

// Return the JSON of a response, or throw an error with the server's text.
async function answered(asked) {
  const answer = await asked;
  if (!answer.ok) throw new Error(pretty(await reason(answer)));
  return answer.json();
}

async function reason(answer) {
  const text = await answer.text();
  try { return JSON.parse(text).detail || text; } catch { return text || `refused (${answer.status})`; }
}
