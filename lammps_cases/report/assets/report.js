// The table of cases (sort, filter, group), the way to a case or a finding by the URL (#case=NAME), the copy buttons.
"use strict";
(() => {
  const list = document.getElementById("list");
  const body = document.querySelector("#cases tbody");
  const find = document.getElementById("find");
  const select = document.getElementById("kind");
  const chips = [...document.querySelectorAll(".chip")];
  const articles = new Map([...document.querySelectorAll("article.case")].map((a) => [a.dataset.case, a]));
  const tags = document.getElementById("tag");
  const grouped = document.getElementById("grouped");
  const table = document.getElementById("cases");
  const MANY = 40; // rows from which on they are shown in groups
  let rows = [...body.rows]; // in the order of the table
  const prefix = (row) => row.querySelector("a").textContent.split(".")[0];
  const visible = () => rows.filter((row) => row.fits);

  // ---- groups: cases by the first part of their name, each in a part of the table that opens and closes

  function badge(kind, number) {
    const made = document.createElement("span");
    made.className = `verdict v-${kind.replaceAll(" ", "-")}`;
    made.textContent = `${number} ${kind}`;
    return made;
  }

  function group(name, members) {
    const part = document.createElement("tbody");
    part.className = "group";
    const cell = part.insertRow().insertCell();
    cell.colSpan = table.tHead.rows[0].cells.length;
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = name;
    button.addEventListener("click", () => open(!found.open));
    cell.append(button);
    const count = document.createElement("span");
    cell.append(count);
    const kinds = new Map();
    for (const row of members) kinds.set(row.dataset.kind, (kinds.get(row.dataset.kind) ?? 0) + 1);
    for (const [kind, number] of kinds) cell.append(" ", badge(kind, number));
    const open = (is) => {
      found.open = is;
      filter();
    };
    const found = { part, members, button, count, open: members.some((row) => "bad" in row.dataset) };
    return found;
  }

  const names = [...new Set(rows.map(prefix))];
  const groups = new Map(names.map((name) => [name, group(name, rows.filter((row) => prefix(row) === name))]));
  grouped.checked = rows.length > MANY;
  document.getElementById("grouping").hidden = names.length < 2;

  function arrange() {
    for (const { part } of groups.values()) part.remove();
    if (!grouped.checked) {
      body.append(...rows);
      return;
    }
    for (const name of new Set(rows.map(prefix))) {
      const { part } = groups.get(name);
      part.append(...rows.filter((row) => prefix(row) === name));
      table.append(part);
    }
  }

  function filter() {
    const words = find.value.toLowerCase().split(/\s+/).filter(Boolean);
    const tag = tags?.value;
    const all = !words.length && !select.value && !tag;
    for (const row of rows) {
      const fits = (!select.value || row.dataset.kind === select.value) && (!tag || row.dataset.tags?.split("\n").includes(tag));
      row.fits = fits && words.every((word) => row.dataset.text.includes(word));
      row.hidden = !row.fits || (grouped.checked && all && !groups.get(prefix(row)).open);
    }
    for (const { part, members, button, count, open } of groups.values()) {
      const fitting = members.filter((row) => row.fits).length;
      part.hidden = !fitting;
      button.setAttribute("aria-expanded", String(!all || open));
      count.textContent = fitting < members.length ? ` ${fitting} of ${members.length}` : ` ${fitting}`;
    }
    for (const chip of chips) chip.setAttribute("aria-pressed", String(chip.dataset.kind === select.value));
    document.getElementById("shown").textContent = `${visible().length} of ${rows.length} cases`;
  }

  function order(header, descending) {
    const column = header.cellIndex;
    const numeric = "numeric" in header.dataset;
    const key = (row) => {
      const cell = row.cells[column];
      const text = cell.dataset.v ?? cell.textContent.trim();
      return numeric && text !== "" ? Number(text) : text;
    };
    const compare = (a, b) => {
      if (a === "" || b === "") return (a === "") - (b === ""); // empty cells last, whichever way
      const sign = numeric ? (a > b) - (a < b) : a.localeCompare(b, "en", { numeric: true });
      return descending ? -sign : sign;
    };
    const keyed = rows.map((row) => [key(row), row]).sort((a, b) => compare(a[0], b[0]));
    rows = keyed.map(([, row]) => row);
    arrange();
    for (const other of header.parentNode.cells) other.removeAttribute("aria-sort");
    header.setAttribute("aria-sort", descending ? "descending" : "ascending");
  }

  function wanted() {
    const match = /^#case=(.*)$/.exec(location.hash);
    try {
      return match && articles.get(decodeURIComponent(match[1]));
    } catch {
      return undefined; // a malformed %-sequence names no case
    }
  }

  function target() {
    // The browser looked for it while the list was hidden.
    let part;
    try {
      part = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    } catch {
      return;
    }
    if (!part) return;
    if (part.tagName === "DETAILS") part.open = true;
    part.scrollIntoView();
  }

  function link(anchor, row) {
    if (row) anchor.href = row.querySelector("a").hash;
    else anchor.removeAttribute("href");
  }

  function show() {
    const article = wanted();
    list.hidden = Boolean(article);
    for (const other of articles.values()) {
      if (other !== article && !other.hidden) Plots.remove(other);
      other.hidden = other !== article;
    }
    if (!article) {
      target();
      return;
    }
    const shown = visible();
    const at = shown.findIndex((row) => row.querySelector("a").textContent === article.dataset.case);
    link(article.querySelector(".previous"), shown[at - 1]);
    link(article.querySelector(".next"), at < 0 ? undefined : shown[at + 1]);
    window.scrollTo(0, 0);
    article.querySelector("h2").focus({ preventScroll: true });
    Plots.draw(article);
  }

  async function copy(button) {
    const code = button.parentNode.querySelector("code");
    try {
      await navigator.clipboard.writeText(code.textContent);
      button.textContent = "Copied";
    } catch {
      getSelection().selectAllChildren(code); // no clipboard here: leave the text selected for Ctrl-C
      button.textContent = "Selected";
    }
    setTimeout(() => (button.textContent = "Copy"), 1500);
  }

  find.addEventListener("input", filter);
  select.addEventListener("change", filter);
  for (const chip of chips) {
    chip.addEventListener("click", () => {
      select.value = select.value === chip.dataset.kind ? "" : chip.dataset.kind;
      filter();
    });
  }
  for (const header of document.querySelectorAll("#cases th")) {
    header.addEventListener("click", () => order(header, header.getAttribute("aria-sort") === "ascending"));
  }
  tags?.addEventListener("change", filter);
  grouped.addEventListener("change", () => {
    arrange();
    filter();
  });
  for (const button of document.querySelectorAll("button.only")) {
    button.addEventListener("click", () => {
      find.value = button.dataset.finding;
      filter();
      table.scrollIntoView();
    });
  }
  const allKnown = document.getElementById("all-known");
  function fold(folded) {
    document.querySelector("table.known tbody.more").hidden = folded;
    allKnown.setAttribute("aria-expanded", String(!folded));
    allKnown.textContent = folded ? `Show ${allKnown.dataset.number} more, of medium and low severity` : "Show the severe ones alone";
  }
  allKnown?.addEventListener("click", () => fold(allKnown.getAttribute("aria-expanded") === "true"));
  if (allKnown) fold(true);
  for (const button of document.querySelectorAll("button.pick")) {
    button.addEventListener("click", () => Plots.draw(button.closest("article"), { name: button.dataset.field, show: true }));
  }
  table.addEventListener("click", (event) => {
    const row = event.target.closest("tr[data-kind]");
    if (row && !event.target.closest("a") && getSelection().isCollapsed) location.hash = row.querySelector("a").hash;
  });
  for (const button of document.querySelectorAll("button.copy")) button.addEventListener("click", () => copy(button));
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && list.hidden) location.hash = "";
  });
  window.addEventListener("hashchange", show);

  order(document.querySelectorAll("#cases th")[1], true); // worst first
  filter();
  show();
})();
