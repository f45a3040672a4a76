(() => {
  const images = DATA.images, stages = images.stages.length;
  if (!stages) { byId("comparison").remove(); return; }
  const loaded = new Map();

  function sheet(uri, ready) {
    if (!loaded.has(uri)) { const image = new Image(); image.src = uri; loaded.set(uri, image); }
    const image = loaded.get(uri);
    if (image.complete && image.naturalWidth) ready(image); else image.addEventListener("load", () => ready(image), { once: true });
  }

  function paint(id, uri) {
    const canvas = byId(id), frame = shared.frame, view = shared.view;
    sheet(uri, (image) => {
      if (frame !== shared.frame || view !== shared.view) return;
      if (canvas.width !== images.width) { canvas.width = images.width; canvas.height = images.height; }
      const x = (frame % images.columns) * images.width, y = Math.floor(frame / images.columns) * images.height;
      canvas.getContext("2d").drawImage(image, x, y, images.width, images.height, 0, 0, images.width, images.height);
    });
  }

  const rowLabel = (view) => `${view.set === "test" ? "held out" : "training"} ${view.id}`;
  const bands = DATA.contact === null ? [{ label: "no contact", from: 0, to: DATA.frames.length - 1 }]
    : [{ label: "free fall", from: 0, to: DATA.contact }, { label: "contact", from: DATA.contact, to: DATA.frames.length - 1 }].filter((b) => b.label === "contact" || b.to > 0);

  function drawImages() {
    paint("measured", images.measured[shared.view]);
    paint("model", images.model[shared.stage][shared.view]);
    paint("residual", images.residual[shared.stage][shared.view]);
    byId("stage").value = shared.stage; byId("view").value = shared.view; byId("frame").value = shared.frame;
    byId("view-value").textContent = rowLabel(DATA.views[shared.view]);
    byId("frame-value").textContent = `${DATA.frames[shared.frame]} · ${DATA.times[shared.frame].toFixed(3)} s`;
  }

  function drawHeatMap() {
    heatMap(byId("heatmap"), {
      values: DATA.residuals[shared.stage].rms, columns: DATA.frames, bands, selected: [shared.view, shared.frame],
      rows: DATA.views.map((view) => ({ label: rowLabel(view), strong: view.set === "test" })),
      pick: (view, frame) => look({ view, frame }),
    });
  }

  function meanOver(stage, set) {
    const rows = DATA.residuals[stage].rms.filter((_, i) => DATA.views[i].set === set);
    return DATA.frames.map((_, f) => Math.sqrt(rows.reduce((sum, row) => sum + row[f] ** 2, 0) / rows.length));
  }

  function drawTimeline() {
    const series = [], sets = ["train", "test"].filter((set) => DATA.views.some((view) => view.set === set));
    const shown = [...new Set([0, shared.stage])];
    shown.forEach((stage) => sets.forEach((set) => series.push({
      label: `${images.stages[stage]}, ${set === "test" ? "held out" : "training"}`, x: DATA.frames.map((_, f) => f), y: meanOver(stage, set),
      colour: colourOf(set === "test" ? "--series-1" : "--series-0"), dash: stage === shared.stage ? undefined : "2 4",
    })));
    const host = byId("timeline");
    host.textContent = "";
    const chart = host.appendChild(document.createElement("div")), legend = host.appendChild(document.createElement("div"));
    lineChart(chart, { series, bands, height: 250, zero: true, xLabel: "frame", cursor: shared.frame, pick: (frame) => look({ frame }),
      xFormat: (f) => DATA.frames[f] });
    legend.className = "legend";
    for (const line of series) {
      const item = legend.appendChild(document.createElement("span")), key = item.appendChild(document.createElement("span"));
      key.className = "key";
      key.style.background = line.dash ? `repeating-linear-gradient(90deg, ${line.colour} 0 3px, transparent 3px 6px)` : line.colour;
      item.append(line.label);
    }
  }

  images.stages.forEach((label, i) => byId("stage").add(new Option(label, i)));
  byId("view").max = DATA.views.length - 1;
  byId("frame").max = DATA.frames.length - 1;
  byId("stage").onchange = (event) => look({ stage: Number(event.target.value) });
  byId("view").oninput = (event) => look({ view: Number(event.target.value) });
  byId("frame").oninput = (event) => look({ frame: Number(event.target.value) });
  player(byId("play"), 8, () => look({ frame: (shared.frame + 1) % DATA.frames.length }));
  byId("residual-legend").innerHTML = `<span>model darker: matter the video does not show</span>
    <span>−${images.scale}</span><span class="ramp" style="background:linear-gradient(90deg,#cc5c00,#fff,#005cb8)"></span><span>+${images.scale}</span>
    <span>model brighter: matter the model lacks</span>`;
  const held = DATA.views.findIndex((view) => view.set === "test");
  Object.assign(shared, { view: Math.max(held, 0), frame: Math.min(DATA.contact === null ? 0 : DATA.contact + 1, DATA.frames.length - 1) });
  const draw = () => { drawImages(); drawHeatMap(); drawTimeline(); };
  listeners.push(draw);
  drawings.push(draw);
  draw();
})();
