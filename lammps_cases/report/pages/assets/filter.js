"use strict";
// Hide the rows that lack a word of the text field, or that the other controls of the page exclude.
function filterRows({rows, find, controls = [], content = (row) => row.textContent.toLowerCase(), fits = () => true, shown}) {
  const contents = new Map(rows.map((row) => [row, content(row)]));
  const filter = () => {
    const words = find.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of rows)
      row.hidden = !(fits(row) && words.every((word) => contents.get(row).includes(word)));
    shown(rows.filter((row) => !row.hidden).length);
  };
  for (const control of [find, ...controls]) control.addEventListener("input", filter);
  filter();
  return filter;
}
// Show the row that the address names, opening what it lies in.
function revealRow() {
  const row = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  for (let part = row; part; part = part.parentElement) if (part.tagName === "DETAILS") part.open = true;
  if (!row) return;
  row.hidden = false;
  row.scrollIntoView({block: row.tagName === "TR" ? "center" : "start"});
}
