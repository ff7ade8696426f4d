/* The screen: what the server says of each cell, drawn as it comes. Nothing is computed here but where to draw it. */
(() => {
  const SVG = "http://www.w3.org/2000/svg", WINDOW_S = 60;
  const main = document.querySelector("main"), offline = document.querySelector(".offline");
  const cells = [...document.querySelectorAll(".cell")];
  const views = new Map(cells.map((cell) => [cell.dataset.cell, { cell, box: null, lines: new Map() }]));

  function put(node, text) { if (node.textContent !== text) node.textContent = text; }
  function make(name, values, text) {
    const node = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(values)) node.setAttribute(key, value);
    if (text !== undefined) node.textContent = text;
    return node;
  }
  function item(kind, ...parts) {
    const node = document.createElement("li");
    node.className = kind;
    for (const [name, css, text] of parts) {
      const part = document.createElement(name);
      part.className = css;
      part.textContent = text;
      node.append(part);
    }
    return node;
  }
  function clock(s) { const m = Math.floor(s / 60); return `${m}:${String(Math.floor(s % 60)).padStart(2, "0")}`; }

  function score(cell, state) {
    const said = state.score;
    const number = cell.querySelector(".number"), range = cell.querySelector(".range");
    const bar = cell.querySelector(".interval"), ends = cell.querySelector(".ends");
    const known = said.least !== undefined, settled = known && said.least === said.most;
    number.classList.toggle("none", !known && said.task === undefined);
    put(number, known ? (settled ? said.most : said.so_far ?? `${said.least} – ${said.most}`) : said.task ?? said.why);
    const late = !state.ended && state.t - state.judged_s > 5 ? `, judged up to ${clock(state.judged_s)}` : "";
    put(range, known && !settled ? `${said.least} to ${said.most} possible${late}` : said.task ? said.why : "");
    if (settled) put(range, said.possible ? `of ${said.possible}` : "");
    bar.hidden = ends.hidden = !known;
    if (!known) return;
    const values = [said.least, said.most, said.so_far ?? said.least].map(Number);
    const low = Math.min(0, values[0]), high = Math.max(Number(said.possible ?? values[1]), values[1], low + 1e-9);
    const at = (value) => (100 * (value - low)) / (high - low);
    const open = bar.querySelector(".open"), mark = bar.querySelector(".mark");
    open.hidden = settled;
    open.style.left = `${at(values[0])}%`;
    open.style.width = `${at(values[1]) - at(values[0])}%`;
    mark.style.left = `${at(settled ? values[1] : values[2])}%`;
    put(ends.querySelector(".low"), String(low));
    put(ends.querySelector(".high"), said.possible ? `${said.possible} at most` : values[1].toFixed(2));
  }

  function strip(cell, state) {
    const figure = cell.querySelector(".strip"), said = state.strip, value = figure.querySelector(".value");
    const rows = said ? said.rows.filter((row) => row[0] >= state.t - WINDOW_S) : [];
    figure.querySelector(".nothing").hidden = rows.length > 0;
    put(figure.querySelector(".pair"), said ? `${said.subject.replace("/", " and ")}: ${said.check}` : "Separation");
    const [actual, limit, beyond] = ["actual", "limit", "beyond"].map((name) => figure.querySelector(`path.${name}`));
    const end = Math.max(state.t, rows.length ? rows[rows.length - 1][0] : 0);
    const most = Math.max(...rows.flatMap((row) => [row[1], row[2]]), 0.1) * 1.1;
    const low = Math.min(0, ...rows.map((row) => Math.min(row[1], row[2])));
    const x = (t) => (600 * (1 - (end - t) / WINDOW_S)).toFixed(1);
    const y = (v) => (200 * (1 - (v - low) / (most - low))).toFixed(1);
    const paths = ["", "", ""];
    let before = null;
    for (const [t, a, b] of rows) {
      const joined = before !== null && t - before[0] < 1; /* in a gap nobody knows */
      paths[0] += `${joined ? "L" : "M"}${x(t)} ${y(a)}`;
      paths[1] += `${joined ? "L" : "M"}${x(t)} ${y(b)}`;
      if (joined && a < b && before[1] < before[2]) {
        paths[2] += `M${x(before[0])} ${y(before[1])}L${x(t)} ${y(a)}L${x(t)} ${y(b)}L${x(before[0])} ${y(before[2])}Z`;
      }
      before = [t, a, b];
    }
    [actual, limit, beyond].forEach((path, i) => path.setAttribute("d", paths[i]));
    const now = rows[rows.length - 1], fresh = now && end - now[0] < 1, broken = fresh && now[1] < now[2];
    put(value, fresh ? `${now[1].toFixed(2)} m, required ${now[2].toFixed(2)} m${broken ? " – too near" : ""}` : rows.length && !state.ended ? "not seen now" : "");
    value.classList.toggle("broken", Boolean(broken));
    put(figure.querySelector(".level.top"), rows.length ? `${most.toFixed(1)} m` : "");
    put(figure.querySelector(".level.bottom"), rows.length ? `${low.toFixed(0)} m` : "");
  }

  /* The protective zone: the ring around the robot reaches the human just where the margin is 0. */
  const UNITS = 100; /* to the metre: browsers enlarge letters that are small in units of a drawing */
  function plan(view, state) {
    const svg = view.cell.querySelector(".floor svg"), about = view.cell.querySelector(".about");
    const distances = state.now.filter((one) => one.unit === "m" && !one.at_most && one.subject.includes("/"));
    let places = state.places, drawn = "from above, in m";
    if (!places.length && distances.length) { /* no positions are recorded: the nearest pair on a line */
      const nearest = distances[0], [first, second] = nearest.subject.split("/");
      places = [[first, first.includes("human") ? "human" : "robot", 0, 0], [second, second.includes("robot") ? "robot" : "human", nearest.actual, 0]];
      drawn = "no positions are recorded: how far the two are apart";
    }
    if (!places.length && state.ended && svg.firstChild) { put(about, "as it was seen last"); return; }
    svg.replaceChildren();
    put(about, places.length ? drawn : "no positions and no distances at this moment");
    if (!places.length) { svg.setAttribute("viewBox", "0 0 10 5"); return; }
    const at = new Map(places.map(([body, kind, x, y]) => [body, { body, kind, x: UNITS * x, y: -UNITS * y }]));
    const rings = [];
    const pairs = new Set();
    for (const one of distances) {
      if (pairs.has(one.subject)) continue;
      pairs.add(one.subject);
      const [a, b] = one.subject.split("/").map((body) => nearest(at, body));
      if (a && b) rings.push({ a, b, broken: one.margin < 0, r: Math.max(Math.hypot(a.x - b.x, a.y - b.y) - UNITS * one.margin, 0) });
    }
    const worst = rings.slice(0, 3);
    const grow = (box, x, y, r) => [Math.min(box[0], x - r), Math.min(box[1], y - r), Math.max(box[2], x + r), Math.max(box[3], y + r)];
    let box = [Infinity, Infinity, -Infinity, -Infinity];
    for (const one of at.values()) box = grow(box, one.x, one.y, 1.2 * UNITS);
    for (const ring of worst.slice(0, 1)) box = grow(box, ring.a.x, ring.a.y, ring.r);
    const old = view.box; /* it grows at once, and never shrinks: what stands still looks so */
    view.box = old && old.kind === drawn ? Object.assign(growTo(old.at, box), { kind: drawn }) : { at: box, kind: drawn };
    const [left, top, right, bottom] = view.box.at, wide = right - left, high = bottom - top, size = Math.max(wide, high * 1.5) / 42;
    svg.setAttribute("viewBox", `${left} ${top} ${wide} ${high}`);
    for (const ring of worst) {
      svg.append(make("circle", { cx: ring.a.x, cy: ring.a.y, r: ring.r, class: ring.broken ? "zone broken" : "zone" }));
      svg.append(make("path", { d: `M${ring.a.x} ${ring.a.y}L${ring.b.x} ${ring.b.y}`, class: "between" }));
    }
    for (const one of at.values()) {
      const link = one.body.includes("::"), r = link ? size / 2 : size, kind = ["robot", "human"].includes(one.kind) ? one.kind : "other";
      svg.append(kind === "human" ? make("circle", { cx: one.x, cy: one.y, r, class: `body ${kind}` })
        : make("rect", { x: one.x - r, y: one.y - r, width: 2 * r, height: 2 * r, class: `body ${kind}` }));
    }
    for (const one of at.values()) {
      if (one.body.includes("::")) continue;
      const right_side = one.x > left + 0.6 * wide;
      const name = make("text", { x: one.x + (right_side ? -1.5 : 1.5) * size, y: one.y - 0.8 * size, "stroke-width": size / 2,
        "text-anchor": right_side ? "end" : "start" }, one.body.replaceAll("_", " "));
      name.style.fontSize = `${2.2 * size}px`;
      svg.append(name);
    }
  }
  function growTo(a, b) { return { at: [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.max(a[2], b[2]), Math.max(a[3], b[3])] }; }
  function nearest(at, body) { return at.get(body) ?? [...at.values()].find((one) => one.body.startsWith(`${body}::`)); }

  function fill(list, none, nodes) {
    none.hidden = nodes.length > 0;
    list.replaceChildren(...nodes);
  }

  function orders(cell, state) {
    const box = cell.querySelector(".orders");
    const key = JSON.stringify(state.orders);
    if (box.dataset.key === key) return;
    box.dataset.key = key;
    fill(box.querySelector("ol"), box.querySelector(".none"), state.orders.map((one) => {
      const done = one.handed.length >= Math.max(one.tasks, 1);
      const words = one.handed.map((h) => `handed in at ${clock(h.t)}${h.words ? ` ${h.words}` : ""}${h.contents.length ? `: ${h.contents.join(", ")}` : ""}`);
      const announced = one.announced === null ? "" : `announced at ${clock(one.announced)}; `;
      const parts = `${one.parts} part${one.parts === 1 ? "" : "s"}`;
      return item(done ? "done" : "open", ["b", "", `${done ? "✓ " : "○ "}${one.name}`], ["span", "earned", done ? `+${one.earned}` : parts],
        ["small", "soft", announced + (words.length ? words.join("; ") : "nothing handed in yet")]);
    }));
  }

  function ledger(view, state) {
    const box = view.cell.querySelector(".lines"), list = box.querySelector("ol");
    const key = JSON.stringify(state.ledger);
    if (box.dataset.key === key) return;
    const first = box.dataset.key === undefined;
    box.dataset.key = key;
    const nodes = state.ledger.map((one) => {
      const node = item(one.kind, ["span", "at", one.t === null ? "" : clock(one.t)], ["span", "what", one.text], ["span", "amount", one.amount]);
      if (!first && !view.lines.has(one.id)) { node.classList.add("new"); setTimeout(() => node.classList.remove("new"), 3000); }
      view.lines.set(one.id, true);
      return node;
    });
    put(box.querySelector(".none"), state.final ? "nothing gained or lost" : "nothing gained or lost yet");
    fill(list, box.querySelector(".none"), nodes.reverse()); /* the latest on top */
  }

  function unseen(cell, state) {
    const box = cell.querySelector(".not-seen"), key = state.unseen.join("\n");
    if (box.dataset.key === key) return;
    box.dataset.key = key;
    const more = state.unseen.length - 1; /* a wall shows one of each cell */
    box.querySelector("ul").toggleAttribute("data-more", more > 0);
    if (more > 0) box.querySelector("ul").dataset.more = `and ${more} more`;
    fill(box.querySelector("ul"), box.querySelector(".none"), state.unseen.map((text) => item("", ["span", "", text])));
  }

  function show(state) {
    const view = views.get(state.name);
    if (!view) return;
    const cell = view.cell, link = cell.querySelector(".link"), said = cell.querySelector(".said");
    cell.classList.remove("waiting");
    put(cell.querySelector(".time"), clock(state.t));
    link.className = `link${state.ended ? (state.final ? " ended final" : " ended") : state.connected ? "" : " gone"}`;
    put(link, state.ended ? (state.final ? "final" : "ended, being scored") : state.connected ? "live" : "source gone");
    link.title = state.ended || state.source;
    said.className = `said ${state.verdict.kind}`;
    put(said.querySelector("span"), state.verdict.text.replace(/(\d) (m|s|N)\b/g, "$1\u00a0$2")); /* a number keeps its unit */
    score(cell, state);
    strip(cell, state);
    plan(view, state);
    orders(cell, state);
    ledger(view, state);
    unseen(cell, state);
  }

  /* A wall shows all cells, or the one that the address names. */
  function focus() {
    const number = Number((location.hash.match(/^#cell-(\d+)$/) ?? [])[1] ?? (cells.length === 1 ? 1 : 0));
    main.classList.toggle("focused", number > 0 && cells.length > 1);
    cells.forEach((cell, i) => cell.classList.toggle("full", i + 1 === number));
  }
  addEventListener("hashchange", focus);
  addEventListener("keydown", (event) => {
    if (event.altKey || event.ctrlKey || event.metaKey || cells.length === 1) return;
    if (event.key === "Escape") location.hash = "";
    if (/^[1-9]$/.test(event.key) && Number(event.key) <= cells.length) location.hash = `cell-${event.key}`;
  });
  focus();

  const events = new EventSource("events");
  events.onmessage = (event) => { offline.hidden = true; show(JSON.parse(event.data)); };
  events.onerror = () => { offline.hidden = [...views.values()].every((view) => view.cell.querySelector(".link.final")); };
})();
