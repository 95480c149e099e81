"use strict";
const rows = [...document.querySelectorAll("tr[data-verdict]")];
const kind = document.getElementById("kind");
const chips = [...document.querySelectorAll(".chip")];
let verdict = "";
const filter = filterRows({
  rows,
  find: document.getElementById("find"),
  controls: [kind],
  content: (row) => row.dataset.text,
  fits: (row) => (!verdict || row.dataset.verdict === verdict) && (!kind.value || row.dataset.kind === kind.value),
  shown: (count) => {
    for (const section of document.querySelectorAll("section.part"))
      section.hidden = !section.querySelector("tr[data-verdict]:not([hidden])");
    for (const chip of chips) chip.setAttribute("aria-pressed", String(chip.dataset.kind === verdict));
    document.getElementById("shown").textContent = `${count} of ${rows.length} claims`;
  },
});
for (const chip of chips)
  chip.addEventListener("click", () => {
    verdict = verdict === chip.dataset.kind ? "" : chip.dataset.kind;
    filter();
  });
