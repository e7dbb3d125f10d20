// The keyboard. Escape stops the stage, and so does Space unless it operates the focused list,
// check box, file field or link; Enter presses a button.
"use strict";

const $ = (id) => document.getElementById(id);
const REPEAT_MS = 100; // shortest interval of steps while a key is held down
const ARROWS = {
  ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowUp: [1, 1], ArrowDown: [1, -1], PageUp: [2, 1], PageDown: [2, -1],
};

// page: operator, name, axes, now; does: the keys' actions by name.
export function watchKeys(page, does) {
  let stepped = 0;

  function step(e) {
    e.preventDefault();
    if (performance.now() - stepped < REPEAT_MS) return;
    stepped = performance.now();
    const [which, sign] = ARROWS[e.key], times = sign * (e.shiftKey ? 10 : 1);
    if (!page.axes.said) { if (which < 2) page.now.step(times); return; }
    const name = page.axes.moved()[which];
    if (name) page.now.step(times, name);
  }

  document.addEventListener("keydown", (e) => {
    if (e.ctrlKey || e.altKey || e.metaKey || $("main").hidden) return;
    const choosing = e.target.closest("select, input[type=checkbox], input[type=file], a");
    if (e.key === "Escape" || (e.key === " " && !choosing)) {
      e.preventDefault();
      if (page.operator && !e.repeat) does.stop();
      return;
    }
    if (e.target.closest("input, select, pre, #events")) return;
    if (e.key in ARROWS) { if (page.operator) step(e); }
    else if (e.key === "p") does.pause();
    else if (e.key === "0") does.look();
    else if (e.key === "g") { e.preventDefault(); $("target").focus(); $("target").select(); }
    else if (e.key === "h" && page.operator) does.hold();
    else if (e.key >= "1" && e.key <= "9") does.show(Number(e.key) - 1);
  });
  // the space bar that stops must not also press the focused button
  document.addEventListener("keyup", (e) => { if (e.key === " " && e.target.closest("button")) e.preventDefault(); });
}
