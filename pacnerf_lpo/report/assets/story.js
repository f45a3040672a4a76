(() => {
  /* Show a step of the history, where its motion was kept. */
  function choose(number) {
    const step = DATA.steps[number];
    if (!step) return;
    byId("name").textContent = `Step ${number}: ${step.name}`;
    byId("shown").innerHTML = step.html;
    showParticles(step.particles);
    for (const row of document.querySelectorAll("#steps tr")) row.classList.toggle("now", row.dataset.go === `step=${number}`);
  }
  byId("steps").onclick = (event) => {
    const row = event.target.closest("[data-go]");
    if (row) choose(Number(row.dataset.go.split("=")[1]));
  };
  for (const row of document.querySelectorAll("#steps tr"))
    if (!(row.dataset.go.split("=")[1] in DATA.steps)) { row.removeAttribute("data-go"); row.style.opacity = 0.6; }
  choose(DATA.current);
})();
