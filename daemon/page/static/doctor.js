// The doctor's findings, its offer, and the loop of the model in use. Text is never markup.
"use strict";
import { fillList } from "./files.js";
import { clockTime, number, pretty, unitName } from "./plot.js";

const $ = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";
const STATES = {
  working: "examining", found: "found", failed: "inconclusive", waiting: "the offer waits for another trial's end", trial: "the offered model is on trial",
  accepted: "the offered model is in use", returned: "the previous model is in use again", rejected: "rejected",
};

export class Doctor {
  constructor(page) {
    this.page = page; // ask(), operator, controller()
    this.report = null;
    for (const action of ["accept", "reject"]) {
      $(action).addEventListener("click", () => page.ask({ ask: "decide", action, offer: this.report.offer.number }));
    }
    $("question").addEventListener("close", () => {
      if ($("question").returnValue === "yes") {
        page.ask({ ask: "decide", action: "accept", offer: this.asked, confirmed: true });
      }
    });
  }

  hear(said) {
    this.report = said.reports.length ? said.reports[said.reports.length - 1] : null;
    this.show();
  }

  // accepting would cut a trajectory: the operator decides
  question(said) {
    this.asked = said.offer;
    $("question-text").textContent = `${said.text}. Points beyond it are played at the nearest position and flagged.`;
    $("question").returnValue = "no";
    if (!$("question").open) $("question").showModal();
  }

  show() {
    const r = this.report, offer = r && r.offer;
    $("doctor").hidden = !r;
    $("doctor-state").textContent = r ? STATES[r.state] || r.state : "";
    $("doctor-case").textContent = r ? `${clockTime(r.wall_ns * 1e-9, 0)} ${r.case}` : "";
    $("doctor-says").textContent = r ? pretty(r.says) : "";
    $("doctor-effects").replaceChildren(...(r ? r.effects : []).map((effect) => {
      const item = document.createElement("li"), name = document.createElement("b");
      const ties = effect.ambiguous_with.length ? ` (or ${effect.ambiguous_with.join(", ")})` : "";
      name.textContent = `${effect.name}${ties}, ${number(100 * effect.share, 2)} %: `;
      item.append(name, document.createTextNode(pretty(effect.says)));
      return item;
    }));
    fillList($("doctor-figures"), r && r.unit && r.rms_in_use ? [
      ["error of the model in use", `${number(r.rms_in_use, 3)} ${unitName(r.unit)} rms`],
      ["with the effects found", `${number(r.rms_augmented, 3)} ${unitName(r.unit)} rms`],
      ["noise", `${number(r.noise, 3)} ${unitName(r.unit)} rms`],
      ...(r.rms_when_good >= 0 ? [["before the change", `${number(r.rms_when_good, 3)} ${unitName(r.unit)} rms`]] : []),
      ...(offer ? [["offered model, on later telemetry", `${number(offer.rms_in_use, 3)} becomes ${number(offer.rms_offered, 3)} ${unitName(r.unit)}`],
        ...(offer.change ? [["accepting changes", pretty(offer.change)]] : []),
        ["on trial for", `${number(offer.trial_s)} s of motion, at most ${number(offer.trial_limit_s)} s in all`]] : []),
    ] : []);
    $("doctor-next").hidden = !(r && r.experiment.length);
    $("doctor-experiment").textContent = r ? `dehyst ${r.experiment.join(" ")}` : "";
    $("doctor-report").hidden = !(r && r.has_report);
    if (r) $("doctor-report").href = `doctor/${encodeURIComponent(this.page.controller())}/${encodeURIComponent(r.case)}`;
    $("accept").disabled = !(this.page.operator && offer && r.state === "found");
    $("reject").disabled = !(this.page.operator && offer && ["found", "waiting", "trial", "accepted"].includes(r.state));
  }
}

export function drawLoop(place, loop) {
  if (!loop || !loop.drive.length) { place.replaceChildren(); return; }
  const span = (v) => [Math.min(...v), Math.max(...v)];
  const [x0, x1] = span(loop.drive), [y0, y1] = span(loop.displacement);
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 100 100");
  svg.setAttribute("preserveAspectRatio", "none");
  const half = loop.drive.length / 2;
  for (const [from, to] of [[0, half], [half, 2 * half]]) {
    const line = document.createElementNS(SVG, "polyline");
    const points = [];
    for (let i = from; i < to; i += 1) {
      points.push(`${(2 + (96 * (loop.drive[i] - x0)) / (x1 - x0 || 1)).toFixed(2)},${(98 - (96 * (loop.displacement[i] - y0)) / (y1 - y0 || 1)).toFixed(2)}`);
    }
    line.setAttribute("points", points.join(" "));
    svg.append(line);
  }
  place.replaceChildren(svg);
}
