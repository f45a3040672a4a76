(() => {
  const canvas = byId("particles"), context = canvas.getContext("2d");
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  let cloud, packed, colours, count, axis;
  function take(found) {
    cloud = found; count = cloud.count;
    packed = new Uint16Array(bytes(cloud.positions).buffer); colours = bytes(cloud.colours);
    axis = [0, 1, 2].map((k) => [cloud.lower[k], cloud.extent[k] / 65535]);
  }
  take(DATA.particles);
  const at = (frame, i, k) => axis[k][0] + axis[k][1] * packed[3 * (frame * count + i) + k];
  const centre = [0, 1, 2].map((k) => cloud.lower[k] + cloud.extent[k] / 2);
  const size = Math.max(...cloud.extent);
  let frame = DATA.frame || 0;

  /* Speed [m/s] between neighbouring frames, or distance from the start [m], of every particle. */
  function measure(kind) {
    const from = kind === "speed" ? Math.max(frame - 1, 0) : 0, to = kind === "speed" && frame === 0 ? Math.min(1, cloud.frames - 1) : frame;
    const span = kind === "speed" ? Math.max(DATA.times[to] - DATA.times[from], 1e-9) : 1;
    const values = new Float32Array(count);
    for (let i = 0; i < count; i++)
      values[i] = Math.hypot(at(to, i, 0) - at(from, i, 0), at(to, i, 1) - at(from, i, 1), at(to, i, 2) - at(from, i, 2)) / span;
    return values;
  }

  /* Cividis, evenly readable with every colour vision. */
  const ramp = [[0, 32, 77], [49, 68, 107], [102, 105, 112], [149, 143, 120], [203, 186, 105], [255, 233, 69]];
  function rampColour(share) {
    const place = Math.min(Math.max(share, 0), 1) * (ramp.length - 1), low = Math.min(Math.floor(place), ramp.length - 2);
    return ramp[low].map((value, k) => value + (ramp[low + 1][k] - value) * (place - low));
  }

  let limits = {};
  function limitOf(kind) {
    if (!(kind in limits)) {
      const now = frame; let most = 0;
      for (frame = 0; frame < cloud.frames; frame++) for (const value of measure(kind)) most = Math.max(most, value);
      frame = now; limits[kind] = most || 1;
    }
    return limits[kind];
  }

  /* Every particle as a small shaded ball into a picture with a depth buffer. */
  function drawBalls(project, width, height) {
    const picture = context.createImageData(width, height), pixels = new Uint32Array(picture.data.buffer);
    const depths = new Float32Array(width * height).fill(Infinity), kind = byId("paint").value;
    const values = kind === "colour" ? null : measure(kind), most = values ? limitOf(kind) : 1;
    for (let i = 0; i < count; i++) {
      const [px, py, depth, zoom] = project(at(frame, i, 0), at(frame, i, 1), at(frame, i, 2));
      if (depth < 0.02) continue;
      const radius = Math.max(cloud.radius * zoom, 0.8), reach = Math.ceil(radius);
      const base = values ? rampColour(values[i] / most) : [colours[3 * i], colours[3 * i + 1], colours[3 * i + 2]];
      for (let v = -reach; v <= reach; v++) for (let u = -reach; u <= reach; u++) {
        const x = Math.round(px) + u, y = Math.round(py) + v, inside = 1 - (u * u + v * v) / (radius * radius);
        if (inside < 0 || x < 0 || y < 0 || x >= width || y >= height) continue;
        const front = Math.sqrt(inside), place = y * width + x, near = depth - front * cloud.radius;
        if (near >= depths[place]) continue;
        depths[place] = near;
        const light = 0.55 + 0.45 * Math.max(0, (-0.45 * u - 0.6 * v) / radius + 0.66 * front);
        pixels[place] = 0xff000000 | (Math.min(base[2] * light, 255) << 16) | (Math.min(base[1] * light, 255) << 8) | Math.min(base[0] * light, 255);
      }
    }
    return picture;
  }

  const layer = document.createElement("canvas");
  function draw() {
    const [width, height] = view.fit();
    if (layer.width !== width || layer.height !== height) { layer.width = width; layer.height = height; }
    context.clearRect(0, 0, width, height);
    const project = view.projector(width, height);
    view.ground(context, project, centre, size, 0);
    layer.getContext("2d").putImageData(drawBalls(project, width, height), 0, 0);
    context.drawImage(layer, 0, 0);
    byId("time").value = frame;
    byId("time-value").textContent = `${DATA.frames[frame]} · ${DATA.times[frame].toFixed(3)} s`;
    drawLegend();
  }

  function drawLegend() {
    const kind = byId("paint").value, legend = byId("particle-legend");
    const shown = count < cloud.of ? `${count} of ${cloud.of} particles shown` : `${count} particles`;
    if (kind === "colour") { legend.textContent = shown; return; }
    const stops = ramp.map((c) => `rgb(${c.join(",")})`).join(",");
    legend.innerHTML = `${shown} <span>0</span><span class="ramp" style="background:linear-gradient(90deg,${stops})"></span>
      <span>${number(limitOf(kind))} ${kind === "speed" ? "m/s" : "m"}</span>`;
  }

  let pending = false;
  const redraw = () => { if (!pending) { pending = true; requestAnimationFrame(() => { pending = false; draw(); }); } };
  const view = space(canvas, centre, size, 2.1 * size, redraw);
  byId("time").max = cloud.frames - 1;
  byId("time").oninput = (event) => { frame = Number(event.target.value); redraw(); };
  byId("paint").onchange = redraw;
  player(byId("run"), 12, () => { frame = (frame + 1) % cloud.frames; redraw(); });
  /* Show other particles in the same space. */
  window.showParticles = (found) => { take(found); limits = {}; redraw(); };
  drawings.push(draw);
  draw();
})();
