(() => {
  const palette = ["--series-0", "--series-2", "--series-3", "--series-1"];

  function card(host, title) {
    const element = host.appendChild(document.createElement("div"));
    element.className = "card";
    element.appendChild(document.createElement("h3")).textContent = title;
    return element.appendChild(document.createElement("div"));
  }

  /* Parts of several phases one after the other on one axis. */
  function joined(parts) {
    let offset = 0;
    const series = [], bands = [];
    parts.forEach(([label, steps, values], i) => {
      series.push({ label, x: steps.map((s) => s + offset), y: values, colour: colourOf(palette[i % palette.length]) });
      bands.push({ label, from: offset, to: offset + Math.max(...steps) });
      offset += Math.max(...steps) + 1;
    });
    return { series, bands };
  }

  const charts = [];
  for (const chart of DATA.curves.parameters) {
    const [factor, letter] = prefix(chart.unit, Math.max(...chart.parts.flatMap((part) => part[2])));
    const title = chart.title + (chart.unit === "1" ? "" : ` [${letter}${chart.unit}]`);
    charts.push([card(byId("parameters"), title), { ...chart, format: (value) => number(value / factor) }]);
  }
  for (const chart of DATA.curves.loss) charts.push([card(byId("losses"), `loss, ${chart.title}`), { ...chart, log: true, single: true }]);
  if (!charts.length) { byId("course").remove(); return; }

  function draw() {
    for (const [host, chart] of charts) {
      const { series, bands } = joined(chart.parts);
      lineChart(host, { series, bands: chart.single ? undefined : bands, log: chart.log, truth: chart.truth, format: chart.format, xLabel: "iteration" });
    }
  }
  drawings.push(draw);
  draw();
})();
