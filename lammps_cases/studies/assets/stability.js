"use strict";
window.addEventListener("hashchange", revealRow);
revealRow();
