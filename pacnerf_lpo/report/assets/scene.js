/* Which lines are drawn over the pictures, and a picture enlarged. */
(() => {
  for (const box of document.querySelectorAll("[data-layer]")) box.onchange = () => {
    for (const part of document.querySelectorAll(`g.${box.dataset.layer}`)) part.style.display = box.checked ? "" : "none";
  };
  const figures = [...document.querySelectorAll(".camera figure")], dialog = byId("large");
  let shown = 0;
  function enlarge(number) {
    shown = (number + figures.length) % figures.length;
    byId("large-picture").replaceChildren(figures[shown].querySelector("svg").cloneNode(true));
    byId("large-name").textContent = figures[shown].dataset.caption;
    if (!dialog.open) dialog.showModal();
  }
  figures.forEach((figure, number) => {
    figure.onclick = () => enlarge(number);
    figure.onkeydown = (event) => { if (event.key === "Enter") enlarge(number); };
  });
  byId("back").onclick = () => enlarge(shown - 1);
  byId("next").onclick = () => enlarge(shown + 1);
  byId("close").onclick = () => dialog.close();
  dialog.onkeydown = (event) => {
    if (event.key === "ArrowLeft") enlarge(shown - 1);
    if (event.key === "ArrowRight") enlarge(shown + 1);
  };
  dialog.onclick = (event) => { if (event.target === dialog) dialog.close(); };
})();

/* Cameras, hull, box and ground in space. */
(() => {
  const scene = DATA.space, canvas = byId("space"), context = canvas.getContext("2d");
  const packed = new Uint16Array(Uint8Array.from(atob(scene.points), (c) => c.charCodeAt(0)).buffer);
  const points = Array.from({ length: scene.count }, (_, i) => [0, 1, 2].map((k) => scene.lower[k] + (scene.extent[k] / 65535) * packed[3 * i + k]));
  const [lower, upper] = scene.box, middle = [0, 1, 2].map((k) => (lower[k] + upper[k]) / 2);
  const body = Math.max(...[0, 1, 2].map((k) => upper[k] - lower[k]));
  const every = [lower, upper, ...scene.cameras.map((camera) => camera.centre)];
  const around = [0, 1, 2].map((k) => (Math.min(...every.map((p) => p[k])) + Math.max(...every.map((p) => p[k]))) / 2);
  const reach = Math.max(...every.map((p) => Math.hypot(...around.map((value, k) => p[k] - value))));
  const pivot = [...around];
  const FAR = 3.1;
  let pending = false, close = false;
  const redraw = () => { if (!pending) { pending = true; requestAnimationFrame(() => { pending = false; draw(); }); } };
  const view = space(canvas, pivot, body, FAR * reach, redraw);

  function lines(project, colour, width, segments) {
    context.strokeStyle = colour; context.lineWidth = width;
    for (const [from, to] of segments) view.line(context, project, from, to);
  }

  function drawPoints(project, density) {
    const seen = points.map((p) => project(...p)).filter((p) => p[2] > 0.02).sort((a, b) => b[2] - a[2]);
    if (!seen.length) return;
    const near = seen[seen.length - 1][2], far = seen[0][2], dark = rgb(colourOf("--accent")), light = rgb(colourOf("--surface"));
    for (const [x, y, depth, zoom] of seen) {
      const side = Math.max(scene.cell * zoom * 0.9, 1.2 * density);
      context.fillStyle = mix(dark, light, 0.65 * (depth - near) / Math.max(far - near, 1e-9));
      context.fillRect(x - side / 2, y - side / 2, side, side);
    }
  }

  function drawBox(project, density) {
    const corner = (n) => [0, 1, 2].map((k) => (n >> k & 1 ? upper : lower)[k]);
    const edges = [];
    for (let a = 0; a < 8; a++) for (const bit of [1, 2, 4]) if (!(a & bit)) edges.push([corner(a), corner(a | bit)]);
    lines(project, "#e09000", 1.5 * density, edges);
  }

  function label(project, density, place, text, colour) {
    const [x, y, depth] = project(...place);
    if (depth < 0.05) return;
    context.font = `600 ${12 * density}px system-ui, sans-serif`;
    context.lineWidth = 3 * density; context.strokeStyle = colourOf("--surface"); context.fillStyle = colour;
    context.strokeText(text, x + 5 * density, y - 5 * density);
    context.fillText(text, x + 5 * density, y - 5 * density);
  }

  function drawAxes(project, density) {
    const origin = [middle[0], scene.ground, middle[2]];
    ["#e03a2b", "#1f9d3a", "#4a6cf0"].forEach((colour, k) => {
      const end = origin.map((value, j) => value + (j === k ? scene.axis : 0));
      lines(project, colour, 2 * density, [[origin, end]]);
      label(project, density, end, "xyz"[k], colour);
    });
  }

  function drawCameras(project, density) {
    for (const { name, centre, corners } of scene.cameras) {
      lines(project, colourOf("--muted"), 1.2 * density, corners.flatMap((corner, i) => [[centre, corner], [corner, corners[(i + 1) % 4]]]));
      lines(project, colourOf("--ink"), 2.4 * density, [[corners[0], corners[1]]]);
    }
    for (const { name, centre } of scene.cameras) label(project, density, centre, name, colourOf("--ink"));
  }

  function draw() {
    const [width, height] = view.fit(), project = view.projector(width, height), density = width / (canvas.clientWidth || 800);
    context.clearRect(0, 0, width, height);
    view.ground(context, project, middle, close ? 2 * body : reach, scene.ground);
    drawPoints(project, density);
    drawBox(project, density);
    drawAxes(project, density);
    drawCameras(project, density);
  }

  byId("near").onclick = () => {
    close = !close;
    (close ? middle : around).forEach((value, k) => { pivot[k] = value; });
    view.eye.distance = close ? FAR * 0.7 * body : FAR * reach;
    byId("near").textContent = close ? "show the cameras" : "show the body";
    draw();
  };
  drawings.push(draw);
  draw();
})();

/* Height over time, with free fall, ground and contact. */
(() => {
  const { times, hit, ground, lines } = DATA.height;
  function draw() {
    const colours = ["--series-0", "--series-1", "--series-0", "--series-1"].map(colourOf);
    const series = lines.map((line, i) => ({ ...line, x: times, colour: colours[i], dash: line.dash ? "6 4" : undefined }));
    const end = times[times.length - 1];
    lineChart(byId("height"), { series, height: 300, continuous: true, xLabel: "time [s]", truth: ground, truthLabel: "ground",
      cursor: times[hit], bands: [{ label: "free fall", from: times[0], to: times[hit] }, { label: `contact, frame ${hit}`, from: times[hit], to: end }] });
    byId("height-legend").textContent = "";
    for (const line of series) {
      const item = byId("height-legend").appendChild(document.createElement("span")), key = item.appendChild(document.createElement("span"));
      key.className = "key";
      key.style.background = line.dash ? `repeating-linear-gradient(90deg, ${line.colour} 0 5px, transparent 5px 8px)` : line.colour;
      item.append(line.label);
    }
  }
  drawings.push(draw);
  draw();
})();
