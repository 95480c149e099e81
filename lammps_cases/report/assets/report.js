// The table of cases (sort, filter, group), the copy buttons, and what is shown by the URL: #case=NAME&field=f&step=0&atom=37 a
// case, #find=words&verdict=pass&tag=quick&sort=atoms&down a part of the table, #finding=ID a part of the page.
"use strict";
(() => {
  const list = document.getElementById("list");
  const body = document.querySelector("#cases tbody");
  const find = document.getElementById("find");
  const select = document.getElementById("kind");
  const chips = [...document.querySelectorAll(".chip")];
  const articles = new Map(); // by case, of those unpacked so far
  const parts = new Map([...document.querySelectorAll("script[data-cases]")].flatMap((part) => part.dataset.cases.split("\n").map((name) => [name, part])));
  const tags = document.getElementById("tag");
  const grouped = document.getElementById("grouped");
  const table = document.getElementById("cases");
  const missing = document.getElementById("missing");
  const title = document.title;
  const heading = document.getElementById("list-of-cases");
  const MANY = 40; // rows from which on they are shown in groups
  let rows = [...body.rows]; // in the order of the table
  const prefix = (row) => row.querySelector("a").textContent.split(".")[0];
  const visible = () => rows.filter((row) => row.fits);
  const text = (row) => (row.text ??= `${row.textContent} ${row.dataset.tags ?? ""} ${row.dataset.twin ?? ""}`.toLowerCase());

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
    const ordered = [...select.options].map((option) => option.value).filter((kind) => kinds.has(kind)); // as everywhere
    for (const kind of ordered) cell.append(" ", badge(kind, kinds.get(kind)));
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
      row.fits = fits && words.every((word) => text(row).includes(word));
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

  // ---- what is shown, by the URL

  const asked = () => new URLSearchParams(location.hash.slice(1));
  let listed = ""; // the URL's part of the table as it was left

  function remember() {
    const header = table.querySelector("th[aria-sort]");
    const state = new URLSearchParams();
    for (const [name, value] of [["find", find.value], ["verdict", select.value], ["tag", tags?.value]]) if (value) state.set(name, value);
    if (header && header !== first) state.set("sort", header.textContent.trim());
    if (header && (header === first) !== (header.getAttribute("aria-sort") === "descending")) state.set("down", "");
    listed = state.toString().replace(/=(?=&|$)/g, "");
    if (!list.hidden) history.replaceState(null, "", listed ? `#${listed}` : location.pathname + location.search);
  }

  function restore(state) {
    if (!["find", "verdict", "tag", "sort", "down"].some((name) => state.has(name))) return;
    find.value = state.get("find") ?? "";
    select.value = state.get("verdict") ?? "";
    if (tags) tags.value = state.get("tag") ?? "";
    const header = [...table.tHead.rows[0].cells].find((cell) => cell.textContent.trim() === state.get("sort")) ?? first;
    order(header, (header === first) !== state.has("down"));
    filter();
    heading.scrollIntoView();
  }

  async function opened(name) {
    const part = parts.get(name);
    if (part && !articles.has(name)) {
      const made = document.createElement("template");
      made.innerHTML = await unpacked(part);
      for (const article of made.content.querySelectorAll("article.case")) articles.set(article.dataset.case, article);
      part.after(made.content);
    }
    return articles.get(name);
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
    for (let around = part; around; around = around.parentElement) if (around.tagName === "DETAILS") around.open = true;
    part.scrollIntoView();
  }

  function link(anchor, row) {
    if (row) anchor.href = row.querySelector("a").hash;
    else anchor.removeAttribute("href");
  }

  async function show() {
    const state = asked(), name = state.get("case");
    const article = await opened(name);
    if (asked().get("case") !== name) return; // gone elsewhere while it was unpacked
    list.hidden = Boolean(article);
    document.title = article ? `eos-ref ${article.querySelector("h2").textContent}` : title;
    missing.hidden = !name || Boolean(article);
    missing.textContent = `No case "${name}" in this report`;
    for (const other of articles.values()) {
      if (other !== article && !other.hidden) Plots.remove(other);
      other.hidden = other !== article;
    }
    if (!article) {
      restore(name ? new URLSearchParams({ find: name }) : state); // a case that is not in the page: its name is sought
      target();
      return;
    }
    article.querySelector(".back").href = `#${listed}`;
    const shown = visible();
    const at = shown.findIndex((row) => row.querySelector("a").textContent === article.dataset.case);
    link(article.querySelector(".previous"), shown[at - 1]);
    link(article.querySelector(".next"), at < 0 ? undefined : shown[at + 1]);
    window.scrollTo(0, 0);
    article.querySelector("h2").focus({ preventScroll: true });
    const asks = (name) => state.get(name) ?? undefined;
    Plots.draw(article, { name: asks("field"), step: asks("step"), atom: asks("atom"), show: state.has("step") || state.has("atom") });
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

  const changed = () => {
    filter();
    remember();
  };
  find.addEventListener("input", changed);
  select.addEventListener("change", changed);
  for (const chip of chips) {
    chip.addEventListener("click", () => {
      select.value = select.value === chip.dataset.kind ? "" : chip.dataset.kind;
      changed();
    });
  }
  for (const header of document.querySelectorAll("#cases th")) {
    header.addEventListener("click", () => {
      order(header, header.getAttribute("aria-sort") === "ascending");
      remember();
    });
  }
  tags?.addEventListener("change", changed);
  grouped.addEventListener("change", () => {
    arrange();
    filter();
  });
  for (const button of document.querySelectorAll("button.only")) {
    button.addEventListener("click", () => {
      find.value = button.dataset.finding;
      changed();
      heading.scrollIntoView();
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
  table.addEventListener("click", (event) => {
    const row = event.target.closest("tr[data-kind]");
    if (row && !event.target.closest("a") && getSelection().isCollapsed) location.hash = row.querySelector("a").hash;
  });
  document.addEventListener("click", ({ target }) => {
    const button = target.closest("button.copy, button.pick");
    if (button?.classList.contains("copy")) copy(button);
    else if (button) Plots.draw(button.closest("article"), { name: button.dataset.field, show: true });
  });
  document.addEventListener("pinned", ({ target }) => {
    const { field, step, atom } = target.querySelector(".plots").dataset;
    const given = Object.entries({ case: target.dataset.case, field, step, atom }).filter(([, value]) => value);
    const state = new URLSearchParams(given);
    history.replaceState(null, "", `#${state}`);
  }, true);
  document.addEventListener("keydown", (event) => {
    const typing = event.target.closest("input, select, textarea, .plot, .scroll");
    const article = list.hidden && [...articles.values()].find((one) => !one.hidden);
    if (event.key === "Escape") {
      if (article) location.hash = listed;
      else if (event.target === find) find.blur();
    } else if (event.ctrlKey || event.altKey || event.metaKey || typing) {
      return;
    } else if (event.key === "/" && !article) {
      event.preventDefault();
      find.focus();
    } else if (article && (event.key === "ArrowLeft" || event.key === "ArrowRight")) {
      article.querySelector(event.key === "ArrowLeft" ? ".previous[href]" : ".next[href]")?.click();
    }
  });
  window.addEventListener("hashchange", show);

  const first = document.querySelectorAll("#cases th")[1]; // worst first
  order(first, true);
  filter();
  // The report of an audit is about one deck.
  if (!location.hash && rows.length === 1 && rows[0].dataset.tags === "audit") history.replaceState(null, "", rows[0].querySelector("a").hash);
  show();
})();
