"use strict";
/* One axis of time: what is shown of one drawing is shown of all. Drag, buttons, or keys + - 0 and arrows. */
const drawings = [];
const whole = document.querySelector("[data-start][data-end]");
const begin = whole ? Number(whole.dataset.start) : 0, end = whole ? Number(whole.dataset.end) : 0;
let first = begin, last = end;

function round_steps(low, top, most) {
  const rough = (top - low) / Math.max(2, Math.min(8, most));
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough * 0.999999);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= top + step * 1e-9; k++) found.push(k * step);
  return [found, Math.max(0, -Math.floor(Math.log10(step) + 1e-9))];
}

function label(text, name, side, at) {
  const made = document.createElement("span");
  if (name) made.className = name;
  made.textContent = text;
  made.style[side] = `${100 * at}%`;
  return made;
}

/* An axis and how to label it for what is shown. */
function relabelled(axis) {
  const original = [...axis.children];
  return () => {
    if (first === begin && last === end) return axis.replaceChildren(...original);
    const [times, digits] = round_steps(first, last, axis.clientWidth / 80);
    axis.replaceChildren(...times.map((t) => label(`${t.toFixed(digits)} s`, "", "left", (t - first) / (last - first))));
  };
}

function show(from, to) {
  const least = Math.min(0.05, end - begin);
  const length = Math.min(Math.max(to - from, least), end - begin);
  first = Math.min(Math.max(from, begin), end - length);
  last = first + length;
  const main = document.querySelector("main");
  main.style.setProperty("--from", (100 * (first - begin)) / (end - begin));
  main.style.setProperty("--len", (100 * length) / (end - begin));
  main.classList.toggle("zoomed", first !== begin || last !== end);
  for (const draw of drawings) draw();
}

for (const axis of document.querySelectorAll(".chart .axis, .lanes .axis")) drawings.push(relabelled(axis));

for (const chart of document.querySelectorAll(".chart")) {
  const plot = chart.querySelector(".plot");
  const svg = plot.querySelector("svg");
  const tools = chart.parentElement.querySelector(".tools");
  const peak = Number(chart.dataset.top), high = Number(chart.dataset.height), unit = chart.dataset.unit;
  const scale = svg.viewBox.baseVal.height / high;
  const levels = chart.querySelector(".levels");
  const wholeLevels = [...levels.children];
  /* The samples of both lines: s from the start, and units below the peak. */
  const points = [];
  for (const line of svg.querySelectorAll(".line")) {
    let x = 0, y = 0;
    for (const [, act, right, down] of line.getAttribute("d").matchAll(/([Ml])(-?\d+) (-?\d+)/g)) {
      x = (act === "M" ? 0 : x) + Number(right);
      y = (act === "M" ? 0 : y) + Number(down);
      points.push([x / 1000, y / scale]);
    }
  }
  /* The part of the height that what is shown needs, with some room; the whole where all is shown. */
  function heights() {
    if (first === begin && last === end) return [0, high];
    let least = high, most = 0;
    for (const [t, y] of points) {
      if (t < first - begin || t > last - begin) continue;
      least = Math.min(least, y);
      most = Math.max(most, y);
    }
    if (most < least) return [0, high];
    const room = Math.max((most - least) * 0.15, high * 0.01);
    return [Math.max(least - room, 0), Math.min(most + room, high)];
  }

  drawings.push(() => {
    const length = last - first;
    const [upper, lower] = heights();
    svg.setAttribute("viewBox",
      [(first - begin) * 1000, upper * scale, length * 1000, (lower - upper) * scale].join(" "));
    chart.dataset.from = first.toFixed(3);
    chart.dataset.to = last.toFixed(3);
    for (const mark of plot.querySelectorAll(".mark")) {
      const at = (Number(mark.dataset.t) - first) / length;
      mark.style.left = `${100 * at}%`;
      mark.style.top = `${(100 * (peak - Number(mark.dataset.y) - upper)) / (lower - upper)}%`;
      mark.hidden = at < 0 || at > 1;
    }
    if (first === begin && last === end) {
      levels.replaceChildren(...wholeLevels);
    } else {
      const [values, places] = round_steps(peak - lower, peak - upper, 5);
      levels.replaceChildren(...values.flatMap((value) => {
        const at = (peak - value - upper) / (lower - upper);
        const text = `${value.toFixed(places)} ${unit}`.replace("-", "\u2212");
        return [label("", "gridline", "top", at), label(text, "level", "top", at)];
      }));
    }
    const note = tools.querySelector("[role=status]");
    note.textContent = first === begin && last === end ? "" : `${first.toFixed(2)} s to ${last.toFixed(2)} s`;
  });

  function scaled(factor, around = (first + last) / 2) {
    show(around - (around - first) * factor, around + (last - around) * factor);
  }

  function moved(share) {
    const by = (last - first) * share;
    const from = Math.min(Math.max(first + by, begin), end - (last - first));
    show(from, from + (last - first));
  }

  const acts = {
    in: () => scaled(0.5), out: () => scaled(2), all: () => show(begin, end),
    left: () => moved(-0.25), right: () => moved(0.25),
    worst: () => { const t = Number(chart.dataset.worst); show(t - 3, t + 3); },
  };
  for (const button of tools.querySelectorAll("button")) {
    button.addEventListener("click", () => acts[button.dataset.act]());
  }
  const keys = { "+": "in", "=": "in", "-": "out", "0": "all", ArrowLeft: "left", ArrowRight: "right" };
  plot.addEventListener("keydown", (event) => {
    const act = keys[event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    acts[act]();
  });

  const timeAt = (event) => {
    const box = plot.getBoundingClientRect();
    const share = Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
    return first + share * (last - first);
  };
  let held = null, band = null;
  plot.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || event.pointerType === "touch") return;
    held = timeAt(event);
    band = document.createElement("div");
    band.className = "selecting";
    plot.append(band);
    plot.setPointerCapture(event.pointerId);
  });
  plot.addEventListener("pointermove", (event) => {
    if (held === null) return;
    const now = timeAt(event), length = last - first;
    band.style.left = `${(100 * (Math.min(held, now) - first)) / length}%`;
    band.style.width = `${(100 * Math.abs(now - held)) / length}%`;
  });
  const released = (event) => {
    if (held === null) return;
    const now = timeAt(event), from = held;
    held = null;
    band.remove();
    if (event.type === "pointerup" && Math.abs(now - from) > (last - first) / 100) {
      show(Math.min(from, now), Math.max(from, now));
    } else if (event.type === "pointerup") {
      document.dispatchEvent(new CustomEvent("seek", { detail: now }));
    }
  };
  plot.addEventListener("pointerup", released);
  plot.addEventListener("pointercancel", released);
  plot.addEventListener("dblclick", () => show(begin, end));
  plot.tabIndex = 0;
  tools.hidden = false;
}
