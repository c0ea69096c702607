"use strict";
const kind = document.getElementById("kind");
const words = document.getElementById("words");
const rows = Array.from(document.querySelectorAll("#table tbody tr"));
function show() {
  const wanted = words.value.toLowerCase().split(/\s+/).filter(Boolean);
  let shown = 0;
  for (const row of rows) {
    const marked = !kind.value || row.dataset.marks.split(" ").includes(kind.value);
    const text = row.textContent.toLowerCase();
    row.hidden = !(marked && wanted.every((word) => text.includes(word)));
    shown += !row.hidden;
  }
  document.getElementById("count").textContent = `${shown} of ${rows.length} runs`;
}
document.querySelector(".filters").hidden = false;
kind.addEventListener("change", show);
words.addEventListener("input", show);
show();
