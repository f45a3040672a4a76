/* Measured | model before | model after | signed difference, computed here from the outlines; with linked sliders. */
(() => {
  const images = DATA.images, loaded = new Map();
  if (!DATA.views.length) return;
  const names = images.stages.length > 1 ? ["model before", "model with the effect"] : ["model"];
  const panels = ["measured", ...names.map((_, i) => `model-${i}`), "difference"];
  const captions = ["measured", ...names, "difference"];
  const host = byId("pictures");
  host.classList.toggle("three", panels.length === 3);
  panels.forEach((id, i) => {
    const figure = host.appendChild(document.createElement("figure")), canvas = figure.appendChild(document.createElement("canvas"));
    canvas.id = id; canvas.width = images.width; canvas.height = images.height;
    figure.appendChild(document.createElement("figcaption")).textContent = captions[i];
  });

  function sheet(uri) {
    if (!loaded.has(uri)) loaded.set(uri, new Promise((ready) => {
      const image = new Image();
      image.onload = () => ready(image);
      image.src = uri;
    }));
    return loaded.get(uri);
  }

  const scratch = document.createElement("canvas");
  /* The pixels of one frame in the atlas of a view. */
  async function pixels(uri, frame) {
    const image = await sheet(uri), context = scratch.getContext("2d", { willReadFrequently: true });
    scratch.width = images.width; scratch.height = images.height;
    const x = (frame % images.columns) * images.width, y = Math.floor(frame / images.columns) * images.height;
    context.drawImage(image, x, y, images.width, images.height, 0, 0, images.width, images.height);
    return context.getImageData(0, 0, images.width, images.height);
  }

  /* Pixels inside the outline that have a neighbour outside. */
  function outline(matte) {
    const { width, height, data } = matte, inside = (x, y) => data[4 * (y * width + x)] > 127, found = [];
    for (let y = 1; y < height - 1; y++) for (let x = 1; x < width - 1; x++)
      if (inside(x, y) && !(inside(x - 1, y) && inside(x + 1, y) && inside(x, y - 1) && inside(x, y + 1))) found.push(y * width + x);
    return found;
  }

  function shaded(model, line) {
    const shown = new ImageData(model.width, model.height);
    for (let i = 0; i < model.data.length; i += 4) {
      const opacity = model.data[i] / 255;
      shown.data.set([255 - 145 * opacity, 255 - 137 * opacity, 255 - 128 * opacity, 255], i);
    }
    for (const place of line) shown.data.set([208, 0, 111, 255], 4 * place);
    return shown;
  }

  function difference(model, matte) {
    const shown = new ImageData(model.width, model.height), ends = [[204, 92, 0], [0, 92, 184]];
    for (let i = 0; i < model.data.length; i += 4) {
      const signed = (model.data[i] - matte.data[i]) / 255, size = Math.abs(signed) < 0.06 ? 0 : Math.abs(signed), end = ends[signed > 0 ? 0 : 1];
      const ground = 255 - 22 * (matte.data[i] / 255);
      shown.data.set([...end.map((value) => ground + (value - ground) * size), 255], i);
    }
    return shown;
  }

  async function draw() {
    const { view, frame, stage } = shared;
    byId("view").value = view; byId("frame").value = frame; byId("stage").value = stage;
    byId("view-value").textContent = `${DATA.views[view]}${DATA.held_views.includes(DATA.views[view]) ? " (held out)" : ""}`;
    byId("frame-value").textContent = `${DATA.frames[frame]} · ${DATA.times[frame].toFixed(3)} s · ${DATA.phases[frame]}`;
    const measured = await pixels(images.measured[view], frame), matte = await pixels(images.matte[view], frame);
    const models = [];
    for (const model of images.model) models.push(await pixels(model[view], frame));
    if (view !== shared.view || frame !== shared.frame || stage !== shared.stage) return;
    const put = (id, picture) => byId(id).getContext("2d").putImageData(picture, 0, 0), line = outline(matte);
    put("measured", measured);
    models.forEach((model, i) => put(`model-${i}`, shaded(model, line)));
    put("difference", difference(models[stage], matte));
    document.body.dataset.shown = `${view},${frame},${stage}`;
  }

  names.forEach((name, i) => byId("stage").add(new Option(name, i)));
  byId("stage").onchange = (event) => look({ stage: Number(event.target.value) });
  if (names.length < 2) byId("stage-choice").style.display = "none";
  byId("view").max = DATA.views.length - 1;
  byId("frame").max = DATA.frames.length - 1;
  byId("view").oninput = (event) => look({ view: Number(event.target.value) });
  byId("frame").oninput = (event) => look({ frame: Number(event.target.value) });
  player(byId("play"), 8, () => look({ frame: (shared.frame + 1) % DATA.frames.length }));
  listeners.push(draw);
  drawings.push(draw);
})();
