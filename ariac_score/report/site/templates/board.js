"use strict";
// The leaderboard sorted and filtered, and the ranking under other numbers: all values stand in the page.
(() => {
  const of = (id) => document.getElementById(id);

  const table = of("board-table");
  if (table) {
    const body = table.tBodies[0], rows = [...body.rows];
    const value = (row, column) => row.cells[column].dataset.v ?? "";
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      const kind = head.dataset.sort;
      if (!kind) return;
      const button = document.createElement("button");
      button.type = "button";
      button.className = "sort";
      button.append(...head.childNodes);
      head.append(button);
      if (!column) head.setAttribute("aria-sort", "ascending");
      button.addEventListener("click", () => {
        const before = head.getAttribute("aria-sort");
        const first = kind === "-1" ? -1 : 1;
        const sign = !before ? first : before === "ascending" ? -1 : 1;
        for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
        head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
        const sorted = rows.map((row, place) => [value(row, column), place, row]).sort(([a, i], [b, j]) => {
          if (a === "" || b === "") return a === b ? i - j : a === "" ? 1 : -1;  // what has no value comes last
          const differ = kind === "text" ? a.localeCompare(b) : Number(a) - Number(b);
          return sign * differ || i - j;
        });
        body.append(...sorted.map(([, , row]) => row));
      });
    });

    const find = of("board-find"), group = of("board-group"), calm = of("board-calm");
    const filter = () => {
      const text = find.value.trim().toLowerCase();
      let shown = 0;
      for (const row of rows) {
        const fits = row.dataset.find.toLowerCase().includes(text)
          && (!group || !group.value || row.dataset.groups.split(" ").includes(group.value))
          && (!calm || !calm.checked || row.dataset.calm === "1");
        row.hidden = !fits;
        shown += fits;
      }
      of("board-count").textContent = shown === rows.length ? "" : `${shown} of ${rows.length} teams`;
    };
    for (const input of [find, group, calm]) if (input) input.addEventListener("input", filter);
    of("board-tools").hidden = false;
  }

  const stored = of("what-if-data");
  if (stored) {
    const { points, steps } = JSON.parse(stored.textContent);
    const levers = [...document.querySelectorAll("#what-if-tools input")];
    const body = of("what-if-table").tBodies[0];
    const rows = [...body.rows], published = rows.map((row) => row.cells[0].textContent);
    const said = of("what-if-said");
    const show = () => {
      levers.forEach((lever, k) => {
        const step = steps[k][lever.value];
        lever.setAttribute("aria-valuetext", step);
        of(`${lever.id}-now`).textContent = step;
      });
      const places = points[levers.map((lever) => lever.value).join(",")];
      body.parentNode.classList.toggle("void", !places);
      // Where the next step along a lever, with the others where they are, gives other ranks.
      const with_ = (at, k, step) => at.map((value, other) => (other === k ? step : value));
      const ranks = (at) => (points[at.join(",")] ?? []).map(([rank]) => rank).join();
      levers.forEach((lever, k) => {
        const at = levers.map((other) => other.value);
        [...lever.parentNode.querySelectorAll(".ticks i")].forEach((mark, step) => {
          const below = ranks(with_(at, k, step)), above = ranks(with_(at, k, step + 1));
          mark.className = below !== above ? "flip" : "";
        });
      });
      if (!places) { said.textContent = "The rules do not allow these values."; return; }
      let moved = 0;
      rows.forEach((row, team) => {
        const [rank, ...amounts] = places[team];
        const now = rank === null ? "–" : String(rank), before = published[team];
        row.cells[0].textContent = now;
        const by = Number(before) - Number(now);
        row.cells[1].textContent = now === before ? before : `${before} ${by > 0 ? "▲" : "▼"}${Math.abs(by) || ""}`;
        row.cells[1].className = now === before ? "moved" : by > 0 ? "moved up" : "moved down";
        moved += now !== before;
        amounts.forEach((amount, k) => { row.cells[3 + k].textContent = amount; });
      });
      // By the rank that was computed; a team without one comes last.
      const order = rows.map((row, team) => [places[team][0] ?? Infinity, team, row]);
      order.sort(([a, i], [b, j]) => (a === b ? i - j : a - b));
      body.append(...order.map(([, , row]) => row));
      said.textContent = moved ? `${moved} of ${rows.length} teams have another rank` : "Ranks are as in the rules";
    };
    for (const lever of levers) lever.addEventListener("input", show);
    of("what-if-reset").addEventListener("click", () => {
      for (const lever of levers) lever.value = lever.dataset.base;
      show();
    });
    of("what-if-tools").hidden = false;
    show();
  }
})();
