/* Positions of a flight over time, measured and by the model before and after, and what the models leave. */
(() => {
  const flights = DATA.flights, axes = ["x", "height", "z"], chosen = byId("flight");
  if (!flights.length) return;
  byId("comparison").remove();
  const labels = flights[0].models.length > 1 ? ["before", "with what was found"] : ["the model"], colours = ["--warm", "--accent"];

  function chart(title, series) {
    const card = byId("flight-charts").appendChild(document.createElement("div"));
    card.className = "card";
    card.appendChild(document.createElement("h3")).textContent = title;
    lineChart(card.appendChild(document.createElement("div")), { series, height: 220, continuous: true, xLabel: "time [s]" });
  }

  function draw() {
    const one = flights[chosen.value], x = one.times;
    byId("flight-charts").textContent = "";
    axes.forEach((axis, k) => {
      if (one.measured[k].every((value) => value === null)) return;
      const models = one.models.map((model, i) => ({ label: labels[i], x, y: model[k], colour: colourOf(colours[i]) }));
      const measured = { label: "measured", x, y: one.measured[k], colour: colourOf("--muted"), dots: true };
      chart(`${axis} [m]`, [measured, ...models]);
      chart(`${axis}, measured less model [mm]`, models.map((model) => (
        { ...model, y: model.y.map((value, i) => (one.measured[k][i] === null ? null : 1000 * (one.measured[k][i] - value))) })));
    });
    const legend = byId("flight-legend");
    legend.textContent = "";
    ["measured", ...labels].forEach((label, i) => {
      const item = legend.appendChild(document.createElement("span")), key = item.appendChild(document.createElement("span"));
      key.className = "key";
      key.style.background = colourOf(i ? colours[i - 1] : "--muted");
      item.append(label);
    });
  }

  chosen.onchange = draw;
  drawings.push(draw);
})();
