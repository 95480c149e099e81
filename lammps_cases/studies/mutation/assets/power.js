"use strict";
const find = document.getElementById("find");
if (find) {
  const rows = [...document.querySelectorAll("#fault-table tbody tr")];
  const show = () => {
    const words = find.value.toLowerCase().split(/\s+/).filter(Boolean);
    let count = 0;
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = !words.every((word) => text.includes(word));
      count += !row.hidden;
    }
    document.getElementById("shown").textContent = `${count} of ${rows.length}`;
  };
  find.addEventListener("input", show);
  show();
}
