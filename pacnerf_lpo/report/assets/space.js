/* A look into space that is turned by dragging and zoomed by the wheel; lengths in metres, y up.
   centre: what is turned around, size: of what is looked at, distance: of the eye, redraw(): called after every change. */
function space(canvas, centre, size, distance, redraw) {
  const eye = { yaw: 0.6, pitch: 0.35, distance };

  /* A function from a point to its place on the canvas, its depth and the pixels of a metre there. */
  function projector(width, height) {
    const [sy, cy, sp, cp] = [Math.sin(eye.yaw), Math.cos(eye.yaw), Math.sin(eye.pitch), Math.cos(eye.pitch)];
    const focal = 1.25 * Math.min(width, height * 1.3);
    return (x, y, z) => {
      const [dx, dy, dz] = [x - centre[0], y - centre[1], z - centre[2]];
      const right = cy * dx - sy * dz, toward = sy * dx + cy * dz;
      const up = cp * dy - sp * toward, depth = eye.distance - (cp * toward + sp * dy);
      return [width / 2 + focal * right / depth, height / 2 - focal * up / depth, depth, focal / depth];
    };
  }

  /* A line between two points; nothing where a part of it is behind the eye. */
  function line(context, project, from, to) {
    const ends = [project(...from), project(...to)];
    if (ends.some((p) => p[2] < 0.05)) return;
    context.beginPath(); context.moveTo(ends[0][0], ends[0][1]); context.lineTo(ends[1][0], ends[1][1]); context.stroke();
  }

  /* Squares on the ground around a point. */
  function ground(context, project, around, extent, height) {
    context.strokeStyle = colourOf("--line"); context.lineWidth = 1;
    const step = 10 ** Math.round(Math.log10(extent / 4)), reach = Math.ceil(0.9 * extent / step);
    const [cx, cz] = [Math.round(around[0] / step), Math.round(around[2] / step)];
    for (let k = -reach; k <= reach; k++) {
      line(context, project, [(cx + k) * step, height, (cz - reach) * step], [(cx + k) * step, height, (cz + reach) * step]);
      line(context, project, [(cx - reach) * step, height, (cz + k) * step], [(cx + reach) * step, height, (cz + k) * step]);
    }
  }

  /* Give the canvas as many pixels as it shows; returns width and height. */
  function fit() {
    const density = Math.min(devicePixelRatio || 1, 1.5), wide = canvas.clientWidth || 800;
    const width = Math.round(wide * density), height = Math.round(Math.min(Math.max(wide * 0.56, 300), 560) * density);
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    return [width, height];
  }

  canvas.onpointerdown = (event) => canvas.setPointerCapture(event.pointerId);
  canvas.onpointermove = (event) => {
    if (!event.buttons) return;
    eye.yaw -= event.movementX * 0.008;
    eye.pitch = Math.min(Math.max(eye.pitch + event.movementY * 0.008, 0.03), 1.5);
    redraw();
  };
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    eye.distance = Math.min(Math.max(eye.distance * Math.exp(event.deltaY * 0.001), 0.6 * size), Math.max(8 * size, 2 * distance));
    redraw();
  }, { passive: false });
  return { eye, projector, line, ground, fit };
}
