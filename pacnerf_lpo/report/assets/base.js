"use strict";
const DATA = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const shared = { stage: Math.max(0, (DATA.images ? DATA.images.stages.length : 0) - 1), view: 0, frame: 0 };
const listeners = [];

/* Change what is looked at; every linked picture and chart follows. */
function look(change) {
  Object.assign(shared, change);
  for (const listener of listeners) listener();
}

function colourOf(name) { return getComputedStyle(document.documentElement).getPropertyValue(name).trim(); }

function mix(from, to, share) {
  return "rgb(" + from.map((value, i) => Math.round(value + (to[i] - value) * share)).join(",") + ")";
}

function rgb(text) {
  const value = parseInt(text.slice(1), 16);
  return [value >> 16, (value >> 8) & 255, value & 255];
}

function number(value) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) return value.toExponential(1).replace("e+", "e").replace(".0e", "e");
  return String(parseFloat(value.toPrecision(3)));
}

/* The SI prefix of a modulus or viscosity, as [factor, letter]; none for other units. */
function prefix(unit, value) {
  if (!unit.startsWith("Pa")) return [1, ""];
  return [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""]].find(([factor]) => value >= factor) || [1, ""];
}

/* A button that runs `step` several times a second until pressed again. */
function player(button, perSecond, step) {
  let timer = null;
  const stop = () => { clearInterval(timer); timer = null; button.textContent = "▶ play"; };
  button.onclick = () => {
    if (timer !== null) return stop();
    button.textContent = "❚❚ stop";
    timer = setInterval(step, 1000 / perSecond);
  };
}

byId("theme").onclick = () => {
  const root = document.documentElement;
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
  drawEverything();
};
const drawings = [];
function drawEverything() { for (const draw of drawings) draw(); }
addEventListener("resize", drawEverything);
