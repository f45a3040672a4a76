function svgElement(name, attributes, parent, text) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  if (parent) parent.appendChild(element);
  return element;
}

function ticks(low, high, count) {
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw);
  const found = [];
  for (let t = Math.ceil(low / step - 1e-9) * step; t <= high + 1e-9 * step; t += step) found.push(t);
  return found;
}

/* Ticks of a logarithmic axis in log10: whole decades, or 1-2-5 where there are few. */
function logTicks(low, high) {
  const found = [];
  for (let d = Math.floor(low); d <= Math.ceil(high); d++)
    for (const m of high - low > 2.5 ? [1] : [1, 2, 5]) found.push(d + Math.log10(m));
  const inside = found.filter((t) => t >= low - 1e-9 && t <= high + 1e-9);
  if (inside.length > 7) return inside.filter((_, i) => i % Math.ceil(inside.length / 6) === 0);
  return inside.length >= 2 ? inside : ticks(10 ** low, 10 ** high, 3).map(Math.log10);
}

/* Lines over a common x axis.
   options: series [{label, x, y, colour, dash, faint, dots: no line}], bands [{label, from, to}], log, zero, truth (a level), truthLabel, height, xLabel, format(y),
   range: {x, low, high} shaded behind the lines, direct: labels at the ends of the lines, continuous: x is no count, cursor, pick(x). */
function lineChart(host, options) {
  host.textContent = "";
  const width = Math.max(host.clientWidth, 240), height = options.height || 190;
  const left = 58, right = options.continuous ? 60 : options.direct ? 22 : 12, top = options.bands ? 22 : 8, bottom = 34;
  const svg = svgElement("svg", { viewBox: `0 0 ${width} ${height}`, height, role: "img" }, host);
  const scale = options.log ? Math.log10 : (v) => v;
  const usable = (v) => v !== null && isFinite(v) && (!options.log || v > 0);
  const ys = options.series.flatMap((s) => s.y).filter(usable).map(scale);
  if (options.truth !== null && options.truth !== undefined) ys.push(scale(options.truth));
  if (options.range) ys.push(...options.range.high.filter(usable).map(scale));
  if (!ys.length) return;
  let low = Math.min(...ys), high = Math.max(...ys);
  const least = options.log ? 0.1 : Math.max(1e-3, 0.04 * Math.abs(high));
  const pad = Math.max(0.06 * (high - low), 0.5 * (least - (high - low)), 0);
  low = options.zero ? 0 : low - pad; high += pad;
  const xs = options.series.flatMap((s) => s.x), x0 = Math.min(...xs), x1 = Math.max(...xs, x0 + (options.continuous ? 1e-6 : 1));
  const toX = (x) => left + ((x - x0) / (x1 - x0)) * (width - left - right);
  const toY = (y) => top + (1 - (scale(y) - low) / (high - low)) * (height - top - bottom);

  (options.bands || []).forEach((band, i) => {
    const from = toX(Math.max(band.from, x0)), to = toX(Math.min(band.to, x1));
    if (i % 2) svgElement("rect", { class: "phase", x: from, y: top, width: Math.max(to - from, 0), height: height - top - bottom }, svg);
    if (to - from > 5 + 5.8 * band.label.length) svgElement("text", { x: from + 4, y: 13 }, svg, band.label);
  });
  if (options.range) {
    const edge = (ys, back) => options.range.x.map((x, i) => [x, ys[i]]).filter((p) => usable(p[1]))
      .map((p) => `${toX(p[0]).toFixed(1)},${toY(p[1]).toFixed(1)}`)[back ? "reverse" : "slice"]();
    svgElement("polygon", { class: "range", points: [...edge(options.range.high), ...edge(options.range.low, true)].join(" ") }, svg);
  }
  const marks = options.log ? logTicks(low, high) : ticks(low, high, 4);
  for (const tick of marks) {
    const y = top + (1 - (tick - low) / (high - low)) * (height - top - bottom);
    svgElement("line", { class: "axis", x1: left, x2: width - right, y1: y, y2: y }, svg);
    svgElement("text", { x: left - 7, y: y + 4, "text-anchor": "end" }, svg, (options.format || number)(options.log ? 10 ** tick : tick));
  }
  for (const tick of ticks(x0, x1, 5).filter((t) => options.continuous || Number.isInteger(t)))
    svgElement("text", { x: toX(tick), y: height - bottom + 16, "text-anchor": "middle" }, svg, (options.xFormat || (options.continuous ? number : String))(tick));
  if (options.xLabel) svgElement("text", { x: width - right, y: height - 3, "text-anchor": "end" }, svg, options.xLabel);
  if (options.truth !== null && options.truth !== undefined) {
    svgElement("line", { class: "truth", x1: left, x2: width - right, y1: toY(options.truth), y2: toY(options.truth) }, svg);
    const named = options.truthLabel ? { x: left + 6, "text-anchor": "start" } : { x: width - right, "text-anchor": "end" };
    svgElement("text", { ...named, y: toY(options.truth) - 5 }, svg, options.truthLabel || "true");
  }
  const ends = [];
  for (const series of options.series) {
    const points = series.x.map((x, i) => [x, series.y[i]]).filter((p) => usable(p[1]));
    const path = points.map((p, i) => `${i ? "L" : "M"}${toX(p[0]).toFixed(1)},${toY(p[1]).toFixed(1)}`).join("");
    if (series.dots) for (const p of points) svgElement("circle", { cx: toX(p[0]), cy: toY(p[1]), r: 2, fill: series.colour }, svg);
    else svgElement("path", { class: "curve", d: path, stroke: series.colour, "stroke-dasharray": series.dash || "none",
      opacity: series.faint ? 0.3 : 1 }, svg);
    if (points.length) ends.push([toX(points[points.length - 1][0]), toY(points[points.length - 1][1]), series]);
    if (points.length < 25 && !series.dots) for (const p of points) {
      const dot = svgElement("circle", { cx: toX(p[0]), cy: toY(p[1]), r: 2.4, fill: series.colour }, svg);
      svgElement("title", {}, dot, `${series.label}: ${number(p[1])} at ${p[0]}`);
    }
  }
  if (options.direct) labelEnds(svg, ends);
  if (options.cursor !== undefined)
    svgElement("line", { class: "cursor", x1: toX(options.cursor), x2: toX(options.cursor), y1: top, y2: height - bottom }, svg);
  if (options.pick) svg.onclick = (event) => {
    const box = svg.getBoundingClientRect();
    options.pick(Math.round(Math.min(Math.max(x0 + ((event.clientX - box.left) * (width / box.width) - left) / (width - left - right) * (x1 - x0), x0), x1)));
  };
}

/* Names at the ends of lines, pushed apart where they would overlap. */
function labelEnds(svg, ends) {
  let last = -Infinity;
  for (const [x, y, series] of ends.sort((a, b) => a[1] - b[1])) {
    last = Math.max(y, last + 12);
    svgElement("text", { x: x + 5, y: last + 4 }, svg, series.label).style.fill = series.colour;
  }
}

/* Cells of a table as colours: values[row][column], null where there is none; rows carry a label; bands lie over the columns.
   most: value of the full colour, unit: of the values, marked: columns with a strong label. */
function heatMap(host, options) {
  host.textContent = "";
  const rows = options.values.length, columns = options.values[0].length;
  const width = Math.max(host.clientWidth, 240), left = 86, top = 22, bottom = 50;
  const cellWidth = (width - left - 2) / columns, cellHeight = Math.max(12, Math.min(22, 240 / rows));
  const height = top + rows * cellHeight + bottom;
  const svg = svgElement("svg", { viewBox: `0 0 ${width} ${height}`, height, role: "img" }, host);
  const most = options.most || Math.max(...options.values.flat());
  const empty = rgb(colourOf("--surface")), full = rgb(colourOf("--warm"));
  for (const band of options.bands)
    if (band.to === undefined || (band.to - band.from) * cellWidth > 2 + 5.8 * band.label.length)
      svgElement("text", { x: left + band.from * cellWidth + 2, y: 13 }, svg, band.label);
  options.values.forEach((row, i) => {
    const text = svgElement("text", { x: left - 8, y: top + (i + 0.5) * cellHeight + 4, "text-anchor": "end" }, svg, options.rows[i].label);
    if (options.rows[i].strong) text.style.fill = colourOf("--ink");
    row.forEach((value, j) => {
      const cell = svgElement("rect", { class: "cell", x: left + j * cellWidth + 0.5, y: top + i * cellHeight + 0.5, width: cellWidth - 1,
        height: cellHeight - 1, fill: value === null ? "none" : mix(empty, full, Math.min(value / most, 1)) }, svg);
      svgElement("title", {}, cell, `${options.rows[i].label}, frame ${options.columns[j]}: ${value === null ? "not seen" : number(value)}`);
      cell.onclick = () => options.pick(i, j);
    });
  });
  for (const band of options.bands.slice(1))
    svgElement("line", { class: "cursor", x1: left + band.from * cellWidth, x2: left + band.from * cellWidth, y1: 4, y2: top + rows * cellHeight }, svg);
  const [row, column] = options.selected;
  svgElement("rect", { x: left + column * cellWidth, y: top + row * cellHeight, width: cellWidth, height: cellHeight, fill: "none",
    stroke: colourOf("--ink"), "stroke-width": 2 }, svg);
  options.columns.forEach((label, j) => {
    if (j % Math.ceil(columns / 14) !== 0) return;
    const text = svgElement("text", { x: left + (j + 0.5) * cellWidth, y: height - bottom + 16, "text-anchor": "middle" }, svg, label);
    if (options.marked && options.marked[j]) text.style.fill = colourOf("--ink");
  });
  svgElement("text", { x: width - 2, y: height - 20, "text-anchor": "end" }, svg, "frame");
  for (let k = 0; k < 40; k++)
    svgElement("rect", { x: left + k * 3, y: height - 14, width: 3.2, height: 8, fill: mix(empty, full, k / 39) }, svg);
  svgElement("text", { x: left - 8, y: height - 6, "text-anchor": "end" }, svg, "0");
  svgElement("text", { x: left + 128, y: height - 6 }, svg, `${number(most)} ${options.unit || "rms"}`);
}
