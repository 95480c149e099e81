// The filter of every pair, over its matrix and its list; a link from a cell opens the line it leads to.
"use strict";
for (const part of document.querySelectorAll("section.pair")) {
  const find = part.querySelector(".find");
  if (!find) continue;
  const kind = part.querySelector(".kind"), all = part.querySelector(".all");
  const buttons = [...part.querySelectorAll("button.show")];
  const matrix = [...part.querySelectorAll(".compare-matrix tbody tr")];
  const list = [...part.querySelectorAll(".changes tbody tr")];
  const ofCase = new Map();  // text of all rows of the list that a case has
  for (const row of list) {
    const name = row.cells[0].textContent;
    ofCase.set(name, `${ofCase.get(name) ?? ""} ${row.textContent.toLowerCase()}`);
  }
  const fits = (row) =>
    kind.value ? row.dataset.kinds.split("|").includes(kind.value) : all.checked || !("quiet" in row.dataset);
  const controls = [kind, all];
  const filterList = filterRows({rows: list, find, controls, fits, shown: () => {}});
  const filterMatrix = filterRows({
    rows: matrix, find, controls, fits,
    content: (row) => `${row.cells[0].textContent.toLowerCase()} ${ofCase.get(row.cells[0].textContent) ?? ""}`,
    shown: (count) => {
      for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.word === find.value));
      part.querySelector(".shown").textContent = `${count} of ${matrix.length} cases`;
    },
  });
  for (const button of buttons)
    button.addEventListener("click", () => {
      find.value = find.value === button.dataset.word ? "" : button.dataset.word;
      filterList();
      filterMatrix();
      matrix[0]?.closest(".matrix-box").scrollIntoView({block: "nearest"});
    });
}
window.addEventListener("hashchange", revealRow);
revealRow();
