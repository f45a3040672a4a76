(() => {
  function card(host, title) {
    const element = host.appendChild(document.createElement("div"));
    element.className = "card";
    element.appendChild(document.createElement("h3")).textContent = title;
    return element.appendChild(document.createElement("div"));
  }

  /* Parts of several phases one after the other on one axis: a line for each quantity, a band for each phase. */
  function joined(lines) {
    const series = lines.map((line, i) => ({ label: line.label, x: [], y: [], colour: colourOf(`--series-${i % 4}`) })), bands = [];
    let offset = 0;
    lines[0].parts.forEach(([label], k) => {
      const last = Math.max(...lines.flatMap((line) => (line.parts[k] ? line.parts[k][1] : [0])));
      lines.forEach((line, i) => {
        if (!line.parts[k]) return;
        series[i].x.push(...line.parts[k][1].map((step) => step + offset));
        series[i].y.push(...line.parts[k][2]);
      });
      bands.push({ label, from: offset, to: offset + last + 1 });
      offset += last + 1;
    });
    return { series, bands };
  }

  /* Long noisy curves get a running mean, the raw values stay behind it. */
  function smoothed(series) {
    if (series.y.length < 60) return [series];
    const y = [], share = 2 / (1 + series.y.length / 20);
    series.y.forEach((value, i) => y.push(i ? y[i - 1] + share * (value - y[i - 1]) : value));
    return [{ ...series, faint: true }, { ...series, y }];
  }

  const charts = [];
  for (const chart of DATA.curves.parameters) {
    const [factor, letter] = prefix(chart.unit, Math.max(...chart.lines.flatMap((line) => line.parts.flatMap((part) => part[2]))));
    const title = chart.title + (chart.unit === "1" ? "" : ` [${letter}${chart.unit}]`);
    charts.push([card(byId("parameters"), title), { ...chart, format: (value) => number(value / factor) }]);
  }
  for (const chart of DATA.curves.loss) charts.push([card(byId("losses"), `loss, ${chart.title}`), { ...chart, single: true }]);
  if (!charts.length) { byId("course").remove(); return; }

  function draw() {
    for (const [host, chart] of charts) {
      const { series, bands } = joined(chart.lines);
      lineChart(host, { series: chart.single ? series.flatMap(smoothed) : series, bands: chart.single ? undefined : bands, log: chart.log,
        truth: chart.truth, format: chart.format, xLabel: "iteration", direct: chart.lines.length > 1 });
    }
  }
  drawings.push(draw);
  draw();
})();
