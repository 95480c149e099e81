// The table of cases (sort, filter), the way to one case by the URL (#case=NAME), the copy buttons.
"use strict";
(() => {
  const list = document.getElementById("list");
  const body = document.querySelector("#cases tbody");
  const find = document.getElementById("find");
  const select = document.getElementById("kind");
  const chips = [...document.querySelectorAll(".chip")];
  const articles = new Map([...document.querySelectorAll("article.case")].map((a) => [a.dataset.case, a]));
  const visible = () => [...body.rows].filter((row) => !row.hidden);

  function filter() {
    const words = find.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of body.rows) {
      const kindFits = !select.value || row.dataset.kind === select.value;
      row.hidden = !(kindFits && words.every((word) => row.dataset.text.includes(word)));
    }
    for (const chip of chips) chip.setAttribute("aria-pressed", String(chip.dataset.kind === select.value));
    document.getElementById("shown").textContent = `${visible().length} of ${body.rows.length} shown`;
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
    const rows = [...body.rows].map((row) => [key(row), row]).sort((a, b) => compare(a[0], b[0]));
    body.append(...rows.map(([, row]) => row));
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
    if (!article) return;
    const rows = visible();
    const at = rows.findIndex((row) => row.querySelector("a").textContent === article.dataset.case);
    link(article.querySelector(".previous"), rows[at - 1]);
    link(article.querySelector(".next"), at < 0 ? undefined : rows[at + 1]);
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
  body.addEventListener("click", (event) => {
    const row = event.target.closest("tr");
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
