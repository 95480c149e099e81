"use strict";
const rows = [...document.querySelectorAll("tr[data-verdict]")];
const find = document.getElementById("find");
const kind = document.getElementById("kind");
const chips = [...document.querySelectorAll(".chip")];
let verdict = "";

function show() {
  const words = find.value.toLowerCase().split(/\s+/).filter(Boolean);
  let shown = 0;
  for (const row of rows) {
    const fits = (!verdict || row.dataset.verdict === verdict)
      && (!kind.value || row.dataset.kind === kind.value)
      && words.every((word) => row.dataset.text.includes(word));
    row.hidden = !fits;
    shown += fits;
  }
  for (const section of document.querySelectorAll("section.part"))
    section.hidden = !section.querySelector("tr[data-verdict]:not([hidden])");
  for (const chip of chips) chip.setAttribute("aria-pressed", String(chip.dataset.kind === verdict));
  document.getElementById("shown").textContent = `${shown} of ${rows.length} claims`;
}

for (const control of [find, kind]) control.addEventListener("input", show);
for (const chip of chips)
  chip.addEventListener("click", () => {
    verdict = verdict === chip.dataset.kind ? "" : chip.dataset.kind;
    show();
  });
show();
