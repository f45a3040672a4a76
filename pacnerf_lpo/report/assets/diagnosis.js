(() => {
  const first = DATA.stages[0], last = DATA.stages[DATA.stages.length - 1], changed = DATA.stages.length > 1;
  const held = (id) => DATA.held_views.includes(id);
  const root = (square) => (square === null ? null : Math.sqrt(Math.max(square, 0)));
  const maps = [["before", first], ...(changed ? [["after", last]] : [])].map(([label, stage]) => [label, stage.excess.map((row) => row.map(root))]);
  const most = Math.max(...maps.flatMap(([, values]) => values.flat()), 0.1);
  const bands = [];
  DATA.phases.forEach((label, frame) => {
    if (!bands.length || bands[bands.length - 1].label !== label) bands.push({ label, from: frame, to: frame + 1 });
    bands[bands.length - 1].to = frame + 1;
  });
  const onAxis = bands.map((band) => ({ ...band, from: band.from - 0.5, to: band.to - 0.5 }));

  const byCamera = DATA.unit === "px";
  document.querySelectorAll(".by-camera").forEach((part) => { if (!byCamera) part.style.display = "none"; });
  const hosts = (byCamera ? maps : []).map(([label]) => {
    const card = byId("heatmaps").appendChild(document.createElement("div"));
    card.className = "card";
    card.appendChild(document.createElement("h3")).textContent = `${changed ? label : "the model"}, by camera and frame [pixels]`;
    return card.appendChild(document.createElement("div"));
  });

  function drawHeatMaps() {
    hosts.forEach((host, i) => heatMap(host, {
      values: maps[i][1], most, unit: "px", columns: DATA.frames, bands, marked: DATA.frames.map((id) => DATA.held_frames.includes(id)),
      rows: DATA.views.map((id) => ({ label: held(id) ? `held out ${id}` : `camera ${id}`, strong: held(id) })),
      selected: [shared.view, shared.frame], pick: (view, frame) => look({ view, frame }),
    }));
  }

  function legend(id, series) {
    byId(id).textContent = "";
    for (const line of series) {
      const item = byId(id).appendChild(document.createElement("span")), key = item.appendChild(document.createElement("span"));
      key.className = "key";
      key.style.background = line.colour;
      if (line.area) Object.assign(key.style, { height: "10px", opacity: 0.35, verticalAlign: "-1px" });
      item.append(line.label);
    }
  }

  function drawTimeline() {
    const x = DATA.frames.map((_, i) => i), series = [{ label: changed ? "before" : "the model", x, y: first.by_frame, colour: colourOf("--warm") }];
    if (changed) series.push({ label: "with the effect", x, y: last.by_frame, colour: colourOf("--accent") });
    lineChart(byId("timeline"), { series, bands: onAxis, range: { x, low: first.band[0], high: first.band[1] }, height: 240, zero: true, xLabel: "frame",
      cursor: shared.frame, pick: (frame) => look({ frame }), xFormat: (f) => DATA.frames[f] });
    legend("timeline-legend", [...series, { label: "the model's own error (90 % of null replicates are below)", colour: colourOf("--muted"), area: true }]);
  }

  function drawCourse() {
    if (!changed) return;
    const x = DATA.errors.map((_, i) => i), line = (label, key, colour) => ({ label, x, y: DATA.errors.map((e) => e[key]), colour: colourOf(colour) });
    const series = [line("fitted data", "fitted", "--series-0"), line("held-out data", "held", "--series-1")];
    lineChart(byId("course"), { series, height: 240, zero: true, xLabel: "added effects" });
    legend("course-legend", series);
    byId("course-legend").append(DATA.errors.map((e, i) => `${i}: ${e.label}`).join(", "));
  }

  function drawForce() {
    const force = DATA.residual_force;
    const series = ["x", "y (up)", "z"].map((label, axis) => ({ label, x: force.times, y: force.mean.map((row) => row[axis]), colour: colourOf(`--series-${axis}`) }));
    lineChart(byId("force-chart"), { series, height: 220, direct: true, continuous: true, xLabel: "time [s]" });
  }

  if (!changed) {
    byId("course").closest(".card").remove();
    byId("heatmaps").append(byId("timeline").closest(".card"));
  }
  if (!(DATA.residual_force || {}).determined) byId("force").remove();
  if (!byId("bounds").querySelector("table")) byId("bounds").remove();
  /* Begin where the first model fails most in held-out data. */
  let worst = -1;
  maps[0][1].forEach((row, view) => row.forEach((value, frame) => {
    if (value !== null && value > worst && (held(DATA.views[view]) || !DATA.held_views.length)) { worst = value; Object.assign(shared, { view, frame }); }
  }));
  const draw = () => { drawHeatMaps(); drawTimeline(); };
  listeners.push(draw);
  drawings.push(draw, drawCourse, ...((DATA.residual_force || {}).determined ? [drawForce] : []));
  drawEverything();
})();
