"use strict";
/* The viewer of drapes: choices of cloth, method and colour; turned by dragging, by keys and by buttons. */

const SCALES = {  // colours from low to high, sRGB
  difference: [[0.75, 0.33, 0.02], [0.93, 0.66, 0.42], [0.88, 0.88, 0.88], [0.50, 0.68, 0.90], [0.11, 0.39, 0.72]],
  amount: [[0.27, 0.00, 0.33], [0.23, 0.32, 0.55], [0.13, 0.57, 0.55], [0.37, 0.79, 0.38], [0.99, 0.91, 0.14]],
};
const STEP = 0.15;  // of a key or a button [rad]

function bytesOf(text) { return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)); }

/* Positions [m] of a drape: 16 bits a coordinate, in units of its scale. */
function positionsOf(drape) {
  return Float32Array.from(new Int16Array(bytesOf(drape.vertices).buffer), (part) => part * drape.scale_m);
}

/* Values in [0, 1]; -1 where a vertex has none: its byte is 255. */
function valuesOf(colouring) {
  return Float32Array.from(bytesOf(colouring.values), (byte) => byte === 255 ? -1 : byte / 254);
}

function fill(select, names) {
  const before = select.value;
  select.replaceChildren(...names.map(([value, text]) => new Option(text, value)));
  if (names.some(([value]) => value === before)) select.value = before;
}

class DrapeViewer {
  constructor(root, content) {
    this.root = root;
    this.content = content;
    this.canvas = root.querySelector("canvas");
    this.scene = new DrapeScene(this.canvas);
    [this.cloth, this.method, this.colour] = root.querySelectorAll("select");
    fill(this.cloth, [...new Set(content.drapes.map((drape) => drape.cloth))].map((name) => [name, name]));
    this.cloth.addEventListener("change", () => this.listMethods());
    this.method.addEventListener("change", () => this.listColours());
    this.colour.addEventListener("change", () => this.show());
    this.listenToPointer();
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    for (const button of root.querySelectorAll("button")) button.addEventListener("click", () => this.act(button.value));
    new ResizeObserver(() => this.scene.draw()).observe(this.canvas);
    this.listMethods();
  }

  get drape() { return this.content.drapes[Number(this.method.value)]; }

  listMethods() {
    const methods = this.content.drapes.map((drape, place) => [drape, place]).filter(([drape]) => drape.cloth === this.cloth.value);
    const before = this.method.selectedOptions[0]?.textContent;
    fill(this.method, methods.map(([drape, place]) => [String(place), drape.method]));
    const same = methods.find(([drape]) => drape.method === before);
    if (same) this.method.value = String(same[1]);
    this.listColours();
  }

  listColours() {
    fill(this.colour, [...Object.entries(this.drape.colourings).map(([name, one]) => [name, one.title]), ["plain", "nothing"]]);
    this.show();
  }

  show() {
    const drape = this.drape, colouring = drape.colourings[this.colour.value];
    const positions = positionsOf(drape), faces = new Uint32Array(bytesOf(this.content.meshes[drape.mesh]).buffer);
    const values = colouring ? valuesOf(colouring) : new Float32Array(positions.length / 3);
    const stops = colouring ? SCALES[colouring.scale] : null;
    this.scene.show(positions, faces, values, stops, this.content.plate_radius_m);
    this.explain(drape, colouring, stops);
  }

  explain(drape, colouring, stops) {
    const words = colouring ? colouring.words : drape.words;
    this.root.querySelector("output").textContent = words;
    const name = `${this.canvas.dataset.before}${drape.method}`;  // of a draw, the word before its number
    this.canvas.setAttribute("aria-label", `${name} on ${drape.cloth} in three dimensions. ${words}`);
    const legend = this.root.querySelector(".scale");
    legend.hidden = !colouring;
    if (!colouring) return;
    const colours = stops.map((stop) => `rgb(${stop.map((part) => Math.round(255 * part)).join(" ")})`);
    legend.querySelector(".ramp").style.background = `linear-gradient(to right, ${colours.join(", ")})`;
    legend.querySelector(".low").textContent = colouring.low;
    legend.querySelector(".high").textContent = colouring.high;
  }

  /* Shows the drape of a card. */
  choose(anchor) {
    const place = this.content.drapes.findIndex((drape) => drape.anchor === anchor);
    this.cloth.value = this.content.drapes[place].cloth;
    this.listMethods();
    this.method.value = String(place);
    this.listColours();
    this.root.scrollIntoView();
    this.canvas.focus({ preventScroll: true });
  }

  act(name) {
    const actions = {
      left: () => this.scene.turn(-STEP, 0), right: () => this.scene.turn(STEP, 0),
      up: () => this.scene.turn(0, STEP), down: () => this.scene.turn(0, -STEP),
      closer: () => this.scene.approach(0.87), farther: () => this.scene.approach(1.15),
      above: () => this.scene.look({ azimuth: -Math.PI / 2, elevation: 1.55 }), start: () => this.scene.look(START),
    };
    actions[name]();
  }

  key(event) {
    const keys = {
      ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down",
      "+": "closer", "=": "closer", "-": "farther", Home: "start",
    };
    if (!(event.key in keys) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    this.act(keys[event.key]);
  }

  listenToPointer() {
    let last = null;
    this.canvas.addEventListener("pointerdown", (event) => {
      last = event;
      this.canvas.setPointerCapture(event.pointerId);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!last) return;
      this.scene.turn(-0.01 * (event.clientX - last.clientX), 0.01 * (event.clientY - last.clientY));
      last = event;
    });
    for (const end of ["pointerup", "pointercancel"]) this.canvas.addEventListener(end, () => { last = null; });
    this.canvas.addEventListener("wheel", (event) => {
      if (document.activeElement !== this.canvas) return;  // or nobody could scroll past it
      event.preventDefault();
      this.scene.approach(event.deltaY > 0 ? 1.08 : 0.93);
    }, { passive: false });
  }
}

/* Says that drapes cannot be turned, instead of showing an empty canvas. */
function giveUp(root) {
  root.querySelector(".no-webgl").hidden = false;
  root.querySelector(".stage").hidden = true;
  for (const link of document.querySelectorAll("[data-drape]")) link.hidden = true;
}

/* Starts the viewer when it first comes near the screen, or when a card asks for it. */
function startViewer(root) {
  const content = JSON.parse(document.getElementById("drape-models").textContent);
  let viewer = null, failed = false;
  const start = () => {
    if (viewer || failed) return viewer;
    try {
      viewer = new DrapeViewer(root, content);
    } catch (error) {  // such as a shader that the driver does not link
      failed = true;
      giveUp(root);
      console.error(error);
    }
    return viewer;
  };
  if (!document.createElement("canvas").getContext("webgl2")) {
    giveUp(root);
    return;
  }
  root.querySelector(".stage").hidden = false;
  root.querySelector("canvas").addEventListener("webglcontextlost", () => giveUp(root));
  new IntersectionObserver((entries, observer) => {
    if (!entries.some((entry) => entry.isIntersecting)) return;
    observer.disconnect();
    start();
  }, { rootMargin: "400px" }).observe(root);
  addEventListener("beforeprint", start);
  const known = new Set(content.drapes.map((drape) => drape.anchor));
  for (const link of document.querySelectorAll("[data-drape]")) {
    link.hidden = !known.has(link.dataset.drape);
    link.addEventListener("click", (event) => { event.preventDefault(); start()?.choose(link.dataset.drape); });
  }
}

const viewerRoot = document.getElementById("drapes");
if (viewerRoot) startViewer(viewerRoot);
