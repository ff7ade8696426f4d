/* The replay: where bodies were, what had to be kept free, and what happened. All numbers are those of the result. */
(() => {
  const replay = document.querySelector(".replay");
  const held = document.getElementById("ariac-score-result");
  const sketch = replay && held ? JSON.parse(held.textContent).measured?.sketch : null;
  if (!sketch) return;
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const main = document.querySelector("main");
  const scrub = replay.querySelector("input[type=range]");
  const play = replay.querySelector("button[data-act=play]");
  const speed = replay.querySelector("select");
  const told = replay.querySelector("output");
  const box = replay.querySelector(".box"); /* the view from above; there may be one from the side as well */
  const strip = replay.querySelector(".strip");
  const moments = [...replay.querySelectorAll(".moments > li")].map((item) => ({
    item, t: Number(item.dataset.t), from: Number(item.dataset.from), to: Number(item.dataset.to),
    violated: item.classList.contains("violated"),
  }));
  const steps = [...document.querySelectorAll("#steps tr[data-from]")];
  let now = begin, playing = 0, touched = false;

  /* The row at or before a time, and how far it is to the next one; nothing before the first and in a hole. */
  function place(series, t) {
    const times = series.t_s;
    if (t < times[0] || t > times[times.length - 1] + 1e-9) return null;
    let low = 0, high = times.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (times[middle] <= t) low = middle; else high = middle - 1;
    }
    const next = Math.min(low + 1, times.length - 1);
    const gap = times[next] - times[low];
    if (gap > 0 && t > times[low] && (series.holes_s || []).includes(times[low])) return null;
    return [low, next, gap > 0 ? (t - times[low]) / gap : 0];
  }

  function between(values, [low, next, share]) {
    if (values[low] === null || values[next] === null) return null;
    return values[low] + share * (values[next] - values[low]);
  }

  const bodies = [...replay.querySelectorAll("[data-route]")].map((marker) => {
    const route = sketch.routes[Number(marker.dataset.route)];
    const view = marker.closest(".box").dataset;
    return { route, id: route.body.split("::")[0], marker, view, at: null };
  });

  const zones = [...replay.querySelectorAll("[data-zone]")].map((named) => {
    const curve = sketch.curves[Number(named.dataset.zone)], [first_id, second_id] = curve.subject.split("/");
    const pair = [first_id, second_id].map((id) => bodies.find((body) => body.id === id));
    let ring = null, line = null;
    if (box && pair[0] && pair[1]) {
      ring = document.createElementNS("http://www.w3.org/2000/svg", "circle");
      line = document.createElementNS("http://www.w3.org/2000/svg", "path");
      line.setAttribute("class", "between");
      box.querySelector("svg").append(ring, line);
    }
    return { curve, pair, ring, line, names: named.textContent };
  });

  function moved(t) {
    for (const body of bodies) {
      const at = place(body.route, t), { across, up, left, top, width, height } = body.view;
      body.at = at && [between(body.route[across], at) - Number(left), Number(top) - between(body.route[up], at)];
      body.marker.hidden = !at;
      if (!at) continue;
      body.marker.style.left = `${(100 * body.at[0]) / Number(width)}%`;
      body.marker.style.top = `${(100 * body.at[1]) / Number(height)}%`;
    }
  }

  /* The distance of each pair against what is required; the ring reaches the other body just where the margin is 0. */
  function kept(t) {
    const words = [];
    for (const zone of zones) {
      const at = place(zone.curve, t);
      const distance = at && between(zone.curve.actual, at), required = at && between(zone.curve.limit, at);
      const known = at && required !== null, broken = known && distance < required;
      if (known) words.push({ broken, text: `${zone.names} ${distance.toFixed(2)} m apart, ${required.toFixed(2)} m required` });
      if (zone.ring) {
        const [one, other] = zone.pair.map((body) => body.at);
        const drawn = known && one && other;
        for (const shape of [zone.ring, zone.line]) shape.style.display = drawn ? "" : "none";
        if (drawn) {
          const apart = Math.hypot(one[0] - other[0], one[1] - other[1]);
          zone.ring.setAttribute("cx", one[0]);
          zone.ring.setAttribute("cy", one[1]);
          zone.ring.setAttribute("r", Math.max(required + apart - distance, 0));
          zone.ring.setAttribute("class", broken ? "zone broken" : "zone");
          zone.line.setAttribute("d", `M${one.join(" ")}L${other.join(" ")}`);
          zone.line.style.display = broken ? "" : "none";
        }
      }
      if (strip && zone === zones[0]) {
        const share = (value) => `${(100 * value) / Number(strip.dataset.farthest)}%`;
        strip.hidden = !known;
        if (known) {
          strip.querySelector(".required").style.width = share(required);
          strip.querySelector(".second").style.left = share(distance);
          strip.classList.toggle("broken", broken);
        }
      }
    }
    words.sort((a, b) => b.broken - a.broken);
    return words.slice(0, 2).map((one) => (one.broken ? `too near: ${one.text}` : one.text)).join("; ");
  }

  function states(t) {
    for (const item of replay.querySelectorAll(".states > li")) {
      const from = item.dataset.from === "" ? begin : Number(item.dataset.from);
      const done = item.dataset.to === "" ? Infinity : Number(item.dataset.to);
      const state = t < from ? "later" : t < done ? "open" : "done";
      item.className = state;
      item.querySelector(".live").textContent = { later: "not announced yet", open: "open", done: "delivered" }[state];
    }
  }

  function seek(t) {
    now = Math.min(Math.max(t, begin), end);
    scrub.value = now;
    main.style.setProperty("--now", (100 * (now - begin)) / (end - begin));
    if (box) moved(now);
    const distance = kept(now);
    states(now);
    const here = moments.filter((one) => one.from <= now + 1e-6 && now <= Math.max(one.to, one.from + (end - begin) / 400));
    for (const one of moments) one.item.classList.toggle("here", here.includes(one));
    for (const row of steps) {
      row.classList.toggle("here", Number(row.dataset.from) <= now + 1e-6 && now <= Number(row.dataset.to) + 1e-6);
    }
    const text = `${now.toFixed(2)} s${distance ? ` · ${distance}` : ""}`;
    told.textContent = text;
    scrub.setAttribute("aria-valuetext", text);
    if (here.length) { /* the list alone: the page stays where its reader is */
      const item = here[0].item, list = item.parentElement, below = item.offsetTop + item.offsetHeight;
      if (item.offsetTop < list.scrollTop) list.scrollTop = item.offsetTop;
      else if (below > list.scrollTop + list.clientHeight) list.scrollTop = below - list.clientHeight;
    }
  }

  function stop() {
    if (playing) (still.matches ? clearInterval : cancelAnimationFrame)(playing);
    playing = 0;
    play.textContent = "Play";
    play.setAttribute("aria-pressed", "false");
  }

  function start() {
    if (!touched || now >= end) seek(begin);
    touched = true;
    play.textContent = "Pause";
    play.setAttribute("aria-pressed", "true");
    if (still.matches) { /* a still picture each second instead of motion */
      playing = setInterval(() => { seek(now + Number(speed.value)); if (now >= end) stop(); }, 1000);
      return;
    }
    let before = performance.now();
    const frame = (at) => {
      seek(now + ((at - before) / 1000) * Number(speed.value));
      before = at;
      playing = now < end ? requestAnimationFrame(frame) : 0;
      if (!playing) stop();
    };
    playing = requestAnimationFrame(frame);
  }

  function step(way) {
    const violations = moments.filter((one) => one.violated).map((one) => one.t).sort((a, b) => a - b);
    const found = way > 0 ? violations.find((t) => t > now + 1e-3) : violations.reverse().find((t) => t < now - 1e-3);
    if (found !== undefined) go(found);
  }

  function go(t) {
    stop();
    touched = true;
    seek(t);
  }

  const acts = { play: () => (playing ? stop() : start()), next: () => step(1), previous: () => step(-1), begin: () => go(begin) };
  for (const button of replay.querySelectorAll("button[data-act]")) button.addEventListener("click", () => acts[button.dataset.act]());
  scrub.addEventListener("input", () => go(Number(scrub.value)));
  replay.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target === speed) return;
    const key = { n: "next", p: "previous", k: "play", " ": event.target.tagName === "BUTTON" ? "" : "play" }[event.key];
    if (!key) return;
    event.preventDefault();
    acts[key]();
  });
  document.addEventListener("seek", (event) => go(event.detail));
  for (const { item, t } of moments) {
    const when = item.querySelector(".when"), button = document.createElement("button");
    button.type = "button";
    button.className = "when";
    button.textContent = when.textContent;
    button.setAttribute("aria-label", `Show ${when.textContent}`);
    button.addEventListener("click", () => go(t));
    when.replaceWith(button);
  }
  for (const drawing of document.querySelectorAll(".chart .plot, .lanes .lane")) {
    const cursor = document.createElement("span");
    cursor.className = "now";
    drawing.append(cursor);
  }
  /* On paper the distance is drawn at its worst moment, as its caption says. */
  if (strip) {
    addEventListener("beforeprint", () => kept(Number(strip.dataset.worstS)));
    addEventListener("afterprint", () => kept(now));
  }
  main.classList.add("replaying");
  for (const part of replay.querySelectorAll("[data-scripted]")) part.hidden = false;
  scrub.disabled = false;
  const dearest = moments.filter((one) => one.violated).find((one) => one.item.hasAttribute("data-worst"));
  seek(dearest ? dearest.t : begin);
})();
