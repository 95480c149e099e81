"use strict";
const find = document.getElementById("find");
if (find) {
  const rows = [...document.querySelectorAll("#fault-table tbody tr")];
  const shown = (count) => (document.getElementById("shown").textContent = `${count} of ${rows.length}`);
  filterRows({rows, find, shown});
}
