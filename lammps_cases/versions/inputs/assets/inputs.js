"use strict";
window.addEventListener("hashchange", revealRow);
revealRow();

const result = document.getElementById("input-result");
const rows = [...document.getElementById("input-table").tBodies[0].rows];
filterRows({
  rows,
  find: document.getElementById("input-text"),
  controls: [result],
  fits: (row) => !result.value || row.dataset.result === result.value,
  shown: (count) => (document.getElementById("input-shown").textContent = `${count} of ${rows.length}`),
});
