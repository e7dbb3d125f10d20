// The page: one WebSocket to its own server. All data received are text and numbers and are never
// inserted as markup.
"use strict";
import { Doctor, drawLoop } from "./doctor.js";
import { Files, fillList } from "./files.js";
import { Axes } from "./axes.js";
import { watchKeys } from "./keys.js";
import { Now, fixed, decimals } from "./now.js";
import { Plots, SIGNALS, clockTime, drawStill, number, pretty, readFrame, rem, unitName } from "./plot.js";

const $ = (id) => document.getElementById(id);
const WINDOWS = [[1, "1 s"], [2, "2 s"], [5, "5 s"], [10, "10 s"], [30, "30 s"], [60, "1 min"], [120, "2 min"], [300, "5 min"], [600, "10 min"]];
const MOST_EVENTS = 200, SILENT_S = 3;

const page = {
  socket: null, me: null, operator: false, name: "", names: [], status: null, model: null, retry_ms: 300,
  controller() { return page.name; },
  unit() { return page.status ? page.status.status.unit : "um"; },
  parse(id) {
    const text = $(id).value.trim().replace(",", ".");
    return text === "" ? NaN : Number(text);
  },
  ask(message) {
    if (page.socket && page.socket.readyState === WebSocket.OPEN) page.socket.send(JSON.stringify(message));
    else page.say("not connected: nothing was sent", true);
  },
  say(text, wrong) {
    $("said").textContent = pretty(text);
    $("said").classList.toggle("wrong", Boolean(wrong));
  },
};
window.dehystPage = page; // for inspection from the console

const plots = new Plots(
  { position: $("plot-position"), error: $("plot-error"), trim: $("plot-trim"), volts: $("plot-volts") },
  (first_s, end_s, width_px) => { page.ask({ ask: "past", first_s: Math.max(0, first_s), end_s, width_px }); showMode(); },
);
page.plots = plots;
const files = new Files(page);
const doctor = new Doctor(page);
const axes = new Axes(page, plots, (name) => choose(name));
page.axes = axes;
const now = new Now(page);
page.now = now;

// -- connection ---------------------------------------------------------------------------------

async function begin() {
  let answer;
  try { answer = await fetch(`me?at=${encodeURIComponent(location.origin)}`); } catch { later(); return; }
  if (answer.status === 401) { showLogin(true); return; }
  if (!answer.ok) { pill("link", await answer.text(), false); later(); return; }
  page.me = await answer.json();
  if (page.me.problem) { pill("link", page.me.problem, false); page.say(page.me.problem, true); return; }
  page.operator = page.me.role === "operator";
  showLogin(false);
  $("who").textContent = page.me.open ? (page.operator ? "" : "observer") : `${page.me.name}, ${page.me.role}`;
  $("leave").hidden = page.me.open;
  document.body.classList.toggle("observer", !page.operator);
  for (const item of document.querySelectorAll("#stop, #command button, #command input, #axes-going button, #axes-going input, #file")) item.disabled = !page.operator;
  files.enable();
  doctor.show();
  connect();
}

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const socket = new WebSocket(Object.assign(new URL("stream", location.href), { protocol: scheme, hash: "" }));
  socket.binaryType = "arraybuffer";
  page.socket = socket;
  socket.addEventListener("open", () => { page.retry_ms = 300; if (page.name) { if (held()) askLook(); else look(); } });
  socket.addEventListener("message", (e) => (typeof e.data === "string" ? hear(JSON.parse(e.data)) : frame(e.data)));
  socket.addEventListener("close", () => {
    pill("link", "no connection to the page's server", false);
    document.body.classList.add("stale");
    later();
  });
}

function later() {
  page.retry_ms = Math.min(5000, 1.7 * page.retry_ms);
  setTimeout(begin, page.retry_ms);
}

function showLogin(shown) {
  $("login").hidden = !shown;
  for (const id of ["main", "controller", "state", "stop"]) $(id).hidden = shown;
  if (shown) { pill("link", "not logged in", false); $("login-name").focus(); }
}

$("login").addEventListener("submit", async (e) => {
  e.preventDefault();
  const answer = await fetch("login", {
    method: "POST", body: JSON.stringify({ name: $("login-name").value, password: $("login-password").value }),
  });
  $("login-password").value = "";
  $("login-said").textContent = answer.ok ? "" : await answer.text();
  if (answer.ok) begin();
});
$("leave").addEventListener("click", async () => {
  await fetch("logout", { method: "POST" });
  location.reload();
});

// -- messages from the server -------------------------------------------------------------------

function hear(said) {
  switch (said.kind) {
    case "controllers": hearControllers(said); break;
    case "status": if (said.name === page.name) showStatus(said); break;
    case "model": if (said.name === page.name) showModel(said); break;
    case "events": if (said.name === page.name) said.events.forEach(addEvent); break;
    case "axes": axes.hear(said); break;
    case "doctor": if (said.name === page.name) doctor.hear(said); break;
    case "question": doctor.question(said); break;
    case "said": page.say(said.text, said.wrong); break;
    default: break;
  }
}

function frame(buffer) {
  const read = readFrame(buffer);
  plots.add(read);
  now.frame(read, SIGNALS);
  $("plot-empty").hidden = true;
}

function pill(id, text, good) {
  const item = $(id);
  item.textContent = text;
  item.className = `pill ${good ? "good" : "bad"}`;
}

function hearControllers(said) {
  if (said.names.join() !== page.names.join()) {
    page.names = said.names;
    $("controller").replaceChildren(...said.names.map((name) => {
      const option = document.createElement("option");
      option.value = option.textContent = name;
      return option;
    }));
    if (page.name) $("controller").value = page.name;
  }
  if (!page.name && said.names.length) {
    const wanted = decodeURIComponent(location.hash.slice(1));
    choose(said.names.includes(wanted) ? wanted : said.names[0]);
  }
  page.problems = said.problems;
  if (!said.names.length) pill("link", said.problems[0] || "no controller", false);
}

function choose(name) {
  page.name = name;
  $("controller").value = name;
  location.hash = encodeURIComponent(name);
  document.title = `${name} · dehyst`;
  $("events").replaceChildren();
  doctor.hear({ reports: [] });
  axes.choose(name);
  files.choose([name, ...(axes.said ? axes.said.axes.map((a) => a.name) : [])]);
  now.clear();
  page.status = null;
  look();
}

// Whether the plots are paused or zoomed, which a new connection must not change.
const held = () => plots.paused || plots.range !== null;

function look() {
  plots.live();
  showMode();
  askLook();
}

function askLook() {
  page.ask({ ask: "look", name: page.name, window_s: plots.window_s, width_px: Math.round(plots.width()) });
}

// -- display ------------------------------------------------------------------------------------

function showStatus(said) {
  page.status = said;
  const s = said.status;
  const silent = said.silent_s > SILENT_S;
  document.body.classList.toggle("stale", silent || !s);
  if (!s) { pill("link", said.problem || "no answer yet", false); return; }
  if (silent) pill("link", `silent for ${Math.round(said.silent_s)} s${said.problem ? `: ${said.problem}` : ""}`, false);
  else pill("link", "connected", true);
  $("state").textContent = said.state;
  $("state").title = said.state === "running" ? `${s.mode} inverse` : "";
  $("state").className = `pill ${said.state.replace(" ", "-")}`;
  const starting = said.state === "starting";
  $("reason").textContent = starting ? "the daemon is starting; it takes commands when it is ready"
    : !["running", "ready"].includes(said.state) && page.why && page.why.state === s.state ? pretty(page.why.text) : "";
  for (const item of document.querySelectorAll("#command button, #axes-going button")) item.disabled = !page.operator || starting;
  const unit = unitName(s.unit), reach = [s.reach_min, s.reach_max], places = decimals(reach);
  plots.setUnit(s.unit, reach);
  for (const item of document.querySelectorAll(".unit")) item.textContent = unit;
  if (plots.paused || plots.range || now.measured === null) {
    const { target, measured } = said, both = target !== null && measured !== null;
    now.take(target, { target, measured, error: both ? measured - target : null, volts: s.volts });
  }
  $("figures").textContent = said.error_rms === null ? "no error: there is no target" : `error, last second: ${fixed(said.error_rms, places)} ${unit} rms, ${fixed(said.error_max, places)} ${unit} at most`;
  const g = s.gateway, axis = g.axes.length > 1 ? said.name.replace(`${g.controller}-`, "") : "";
  $("command-axis").textContent = axis ? `axis ${axis}` : "";
  $("plots-of").textContent = axis ? `Axis ${axis}` : "";
  $("commander").textContent = g.lease_label ? `commanded by ${g.lease_label}` : "nobody commands";
  const known = s.reach_max > s.reach_min;
  $("reach-least").textContent = known ? fixed(s.reach_min, places) : "";
  $("reach-most").textContent = known ? fixed(s.reach_max, places) : "";
  $("reach").textContent = !known ? "" : `reach${axis ? ` of ${axis}` : ""}, ${unit}`;
  const causes = Object.entries(s.missed_by).map(([cause, n]) => `${cause} ${n}`).join(", ");
  fillList($("deadlines"), [
    ["rate", `${number(1e9 / s.period_ns)} Hz, ${s.policy} ${s.priority}`],
    ["samples", String(s.samples)],
    ["missed", `${s.missed}${causes ? ` (${causes})` : ""}`],
    ["wake-up p50, p99, max", `${number(s.wake_us.p50, 3)}, ${number(s.wake_us.p99, 3)}, ${number(s.wake_us.max, 3)} µs`],
    ["step p99, I/O p99", `${number(s.exec_us.p99, 3)}, ${number(s.io_us.p99, 3)} µs`],
    ["actuator", `${s.actuator_ok ? "ok" : "FAILED"}, ${s.actuator_errors} errors`],
    ["sensor", `${s.sensor_ok ? "ok" : "FAILED"}, ${s.sensor_errors} errors`],
    ["telemetry lost", String(said.lost)],
    ...(s.gateway.trial ? [["model on trial", s.gateway.trial]] : []),
  ]);
  showWakeups(said.wakeups);
  showHealth(said, s);
}

function showWakeups(counts) {
  const box = $("wakeups");
  while (box.children.length < counts.length) box.append(document.createElement("div"));
  const most = Math.log1p(Math.max(1, ...counts));
  counts.forEach((n, i) => {
    box.children[i].style.height = `${(100 * Math.log1p(n)) / most}%`;
    box.children[i].title = `${page.model ? number(page.model.wakeup_edges_us[i], 3) : ""} µs: ${n}`;
  });
}

function showHealth(said, s) {
  const unit = unitName(s.unit), places = decimals([s.reach_min, s.reach_max]);
  const health = s.gateway.health, wrong = s.gateway.mismatch;
  if (said.state === "starting") { $("health").textContent = "–"; $("health-words").textContent = ""; return; }
  $("health").textContent = health < 0 ? "learning" : number(health, 3);
  $("health-words").textContent = wrong ? `the stage no longer follows its model: ${pretty(wrong)}`
    : health < 0 ? `${number(100 + 100 * health, 2)} % of the required motion seen` : "below 1, the stage follows its model";
  const bar = $("health-bar");
  bar.style.width = `${Math.min(100, 50 * Math.max(0, health))}%`;
  bar.classList.toggle("over", health > 1 || Boolean(wrong));
  const now = said.healths.length ? said.healths[said.healths.length - 1][0] : 0;
  if (said.healths.length > 1) {
    drawStill($("plot-health"), 6.5 * rem(), said.healths.map(([t]) => t - now), [
      { label: "health", colour: "target", y: said.healths.map(([, h]) => Math.max(0, h)) },
      { label: "limit", colour: "warn", y: said.healths.map(() => 1), dash: [4, 4] },
    ], "", { y: { range: (u, low, high) => [0, Math.max(1.2, high || 0)] } });
  }
  fillList($("positioning"), [
    ["trim", s.trimmed ? `${fixed(said.trim, places)} ${unit}${s.trim_frozen ? `, frozen: ${s.trim_frozen.replace(/_/g, " ")}` : ""}` : "open loop"],
    ["learned", s.learned ? `${fixed(said.learned, places)} ${unit}` : "nothing"],
    ["findings", doctor.report ? "below" : "none"],
    ["gauge minus model", `${fixed(s.differs, places)} ${unit}`],
  ]);
}

function showModel(said) {
  page.model = said;
  const m = said.model, l = said.limits;
  drawLoop($("model-loop"), m && m.loop);
  if (!m) { fillList($("model"), [["model", "not known yet"]]); return; }
  const v = m.validity, u = unitName(m.drive_unit), y = unitName(m.displacement_unit);
  fillList($("model"), [
    ["operators", `${m.operators}, ${m.rate_dependent ? "rate-dependent" : "static"}`],
    ["saturation", `degree ${m.saturation}`],
    ["blocks", m.blocks.map((b) => `${b.kind} (${b.place})`).join(", ") || "none"],
    ["valid for", `${number(v.drive_min)} to ${number(v.drive_max)} ${u}`],
    ["up to", [v.rate_max && `${number(v.rate_max)} ${u}/s`, v.band_hz && `${number(v.band_hz)} Hz`].filter(Boolean).join(", ") || "not known"],
    ["error of the fit", `${number(m.fit.rms, 3)} ${y} rms`],
    ["error on held-out data", `${number(m.fit.holdout_rms, 3)} ${y} rms`],
    ["from", [m.source, m.created, ...m.recordings].filter(Boolean).join(", ") || "not known"],
    ["limits", l ? `${number(l.min_v)} to ${number(l.max_v)} V, ${number(l.slew_v_per_s)} V/s` : "not known"],
  ]);
}

function addEvent(event) {
  const item = document.createElement("li"), time = document.createElement("time"), code = document.createElement("b");
  time.textContent = clockTime(event.wall_s, 1);
  time.dateTime = new Date(event.wall_s * 1000).toISOString();
  code.textContent = event.code;
  item.className = `level-${Number(event.level)}`;
  item.append(time, code, document.createTextNode(pretty(event.text)));
  $("events").prepend(item);
  while ($("events").children.length > MOST_EVENTS) $("events").lastChild.remove();
  page.why = { state: event.code, text: event.text };
}

// -- controls -----------------------------------------------------------------------------------

WINDOWS.forEach(([seconds, text], i) => {
  const button = document.createElement("button");
  button.textContent = text;
  button.title = `key ${i + 1}`;
  button.addEventListener("click", () => { plots.window_s = seconds; look(); });
  $("windows").append(button);
});

function showMode() {
  [...$("windows").children].forEach((b, i) => b.setAttribute("aria-pressed", String(WINDOWS[i][0] === plots.window_s && !plots.range)));
  $("pause").setAttribute("aria-pressed", String(plots.paused));
  $("live").hidden = !plots.paused && !plots.range;
}

function pause() {
  if (held()) look();
  else { plots.pause(true); showMode(); }
}

const commands = {
  stop() { now.stepped = null; page.ask({ ask: "stop" }); },
  release() { now.stepped = null; page.ask({ ask: "stop", at_once: true }); },
  hold() { page.ask({ ask: "hold", seconds: page.parse("seconds") || 10, take_over: $("take-over").checked }); },
  go() {
    const value = page.parse("target"), seconds = page.parse("seconds");
    if (!Number.isFinite(value)) { page.say("the set-point must be a number", true); return; }
    if (!(seconds > 0)) { page.say("the time must be a number of seconds above 0", true); return; }
    now.stepped = { name: page.name, value, at: performance.now() };
    page.ask({ ask: "go", value, seconds, take_over: $("take-over").checked });
  },
};

$("pause").addEventListener("click", pause);
$("live").addEventListener("click", look);
$("more").addEventListener("change", () => {
  for (const name of ["trim", "volts"]) plots.places[name].hidden = !$("more").checked;
  plots.remake();
  $("more").blur();
});
$("take-over").addEventListener("change", () => $("take-over").blur());
$("controller").addEventListener("change", () => { choose($("controller").value); $("controller").blur(); });
$("jog-up").addEventListener("click", () => now.step(1));
$("jog-down").addEventListener("click", () => now.step(-1));
$("going").addEventListener("submit", (e) => { e.preventDefault(); commands.go(); });
for (const name of ["stop", "release", "hold"]) $(name).addEventListener("click", commands[name]);
$("theme").addEventListener("click", () => {
  const root = document.documentElement;
  root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
  localStorage.setItem("theme", root.dataset.theme);
  plots.remake();
  axes.draw();
  files.restyle();
});
watchKeys(page, { ...commands, pause, look, show: (i) => { if (WINDOWS[i]) { plots.window_s = WINDOWS[i][0]; look(); } } });
let resized;
window.addEventListener("resize", () => { clearTimeout(resized); resized = setTimeout(() => { plots.remake(); axes.draw(); files.restyle(); if (page.name && !held()) look(); }, 400); });

begin();
