"use strict";
filterRows({
  rows: [...document.querySelectorAll(".rules tbody tr")],
  find: document.getElementById("find"),
  shown: (count) => { document.getElementById("shown").textContent = `${count} rules`; },
});
revealRow();
