"use strict";
// A link to a row opens what it lies in.
function reveal() {
  const row = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  for (let part = row; part; part = part.parentElement) if (part.tagName === "DETAILS") part.open = true;
  if (row) row.scrollIntoView({block: row.tagName === "TR" ? "center" : "start"});
}
window.addEventListener("hashchange", reveal);
reveal();

const table = document.getElementById("input-table");
if (table) {
  const text = document.getElementById("input-text");
  const result = document.getElementById("input-result");
  const rows = [...table.tBodies[0].rows];
  const filter = () => {
    const words = text.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of rows) {
      const content = row.textContent.toLowerCase();
      row.hidden = (result.value && row.dataset.result !== result.value) || words.some((word) => !content.includes(word));
    }
    document.getElementById("input-shown").textContent = `${rows.filter((row) => !row.hidden).length} of ${rows.length}`;
  };
  text.addEventListener("input", filter);
  result.addEventListener("change", filter);
}
