// The filter of every pair, over its matrix and its list; a link from a cell opens the line it leads to.
"use strict";
for (const part of document.querySelectorAll("section.pair")) {
  const text = part.querySelector(".find");
  if (!text) continue;
  const kind = part.querySelector(".kind"), all = part.querySelector(".all");
  const matrix = [...part.querySelectorAll(".compare-matrix tbody tr")];
  const list = [...part.querySelectorAll(".changes tbody tr")];
  const contents = new Map();
  for (const row of list) {
    contents.set(row, row.textContent.toLowerCase());
    const name = row.cells[0].textContent;
    contents.set(name, `${contents.get(name) ?? ""} ${contents.get(row)}`);
  }
  const filter = () => {
    const words = text.value.toLowerCase().split(/\s+/).filter(Boolean);
    const fits = (row, content) =>
      (kind.value ? row.dataset.kinds.split("|").includes(kind.value) : all.checked || !("quiet" in row.dataset)) &&
      words.every((word) => content.includes(word));
    for (const row of list) row.hidden = !fits(row, contents.get(row));
    for (const row of matrix) {
      const name = row.cells[0].textContent;
      row.hidden = !fits(row, `${name.toLowerCase()} ${contents.get(name) ?? ""}`);
    }
    const shown = matrix.filter((row) => !row.hidden).length;
    for (const button of part.querySelectorAll("button.show"))
      button.setAttribute("aria-pressed", String(button.dataset.word === text.value));
    part.querySelector(".shown").textContent = `${shown} of ${matrix.length} cases`;
  };
  for (const button of part.querySelectorAll("button.show"))
    button.addEventListener("click", () => {
      text.value = text.value === button.dataset.word ? "" : button.dataset.word;
      filter();
      matrix[0]?.closest(".matrix-box").scrollIntoView({block: "nearest"});
    });
  for (const control of [text, kind, all]) control.addEventListener("input", filter);
  filter();
}
function reveal() {
  const row = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (!row) return;
  row.hidden = false;
  row.scrollIntoView({block: "center"});
}
window.addEventListener("hashchange", reveal);
reveal();
