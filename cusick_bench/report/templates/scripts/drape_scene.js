"use strict";
/* A draped cloth on its plate in WebGL 2, coloured by a value of each vertex. It is drawn when something has changed. */

const VERTEX_SHADER = `#version 300 es
in vec3 position; in vec3 normal; in float value;
uniform mat4 projection;
out vec3 outward; out vec2 level;  // value times weight, weight: 0 where a vertex has no value
void main() {
  gl_Position = projection * vec4(position, 1.0);
  outward = normal;
  level = value < 0.0 ? vec2(0.0) : vec2(value, 1.0);
}`;

const FRAGMENT_SHADER = `#version 300 es
precision highp float;
in vec3 outward; in vec2 level;
uniform vec3 stops[5]; uniform vec3 plain; uniform float coloured;
out vec4 colour;
void main() {
  vec3 n = normalize(outward);
  float inside = gl_FrontFacing ? 1.0 : 0.72;
  if (!gl_FrontFacing) n = -n;
  float key = max(dot(n, normalize(vec3(-0.62, -0.28, 0.85))), 0.0);
  float light = inside * (0.45 + 0.20 * n.z + 0.45 * key);
  float at = clamp(level.x / max(level.y, 1e-4), 0.0, 1.0) * 4.0;
  int low = min(int(at), 3);
  vec3 scale = mix(stops[low], stops[low + 1], at - float(low));
  colour = vec4(light * mix(plain, scale, level.y * coloured), 1.0);
}`;

const PLAIN = [0.80, 0.78, 0.74];
const PEDESTAL = [0.50, 0.51, 0.53];
const START = { azimuth: -1.2, elevation: 0.55, distance: 0.72 };
const FIELD_OF_VIEW = 0.42;  // [rad]

function subtract(a, b) { return [a[0] - b[0], a[1] - b[1], a[2] - b[2]]; }
function cross(a, b) { return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]; }
function dot(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
function unit(a) { const size = Math.hypot(...a) || 1; return a.map((part) => part / size); }

/* Area-weighted normals of the vertices. */
function vertexNormals(positions, faces) {
  const normals = new Float32Array(positions.length);
  const corner = (at) => positions.subarray(3 * at, 3 * at + 3);
  for (let face = 0; face < faces.length; face += 3) {
    const [a, b, c] = faces.subarray(face, face + 3);
    const across = cross(subtract(corner(b), corner(a)), subtract(corner(c), corner(a)));
    for (const vertex of [a, b, c]) across.forEach((part, axis) => { normals[3 * vertex + axis] += part; });
  }
  return normals;
}

/* Wall of the stand, narrower and lower than the plate, so that it never shows through a cloth of large triangles. */
function pedestal(radius, height, sides = 72) {
  const positions = [], faces = [];
  for (let side = 0; side < sides; side += 1) {
    const angle = 2 * Math.PI * side / sides, x = radius * Math.cos(angle), y = radius * Math.sin(angle);
    const next = (side + 1) % sides;
    positions.push(x, y, -0.08 * radius, x, y, -height);
    faces.push(2 * side, 2 * side + 1, 2 * next, 2 * next, 2 * side + 1, 2 * next + 1);
  }
  return { positions: new Float32Array(positions), faces: new Uint32Array(faces) };
}

class DrapeScene {
  /* Throws where the browser has no WebGL 2. */
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: true, preserveDrawingBuffer: true });
    if (!this.gl) throw new Error("no WebGL 2");
    this.program = this.link();
    this.view = { ...START };
    this.cloth = this.stand = null;
  }

  link() {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX_SHADER], [gl.FRAGMENT_SHADER, FRAGMENT_SHADER]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }

  /* Buffers of one body; `values` in [0, 1] by vertex, below 0 where a vertex has none. */
  body(positions, faces, values) {
    const gl = this.gl, array = gl.createVertexArray(), buffers = [0, 1, 2, 3].map(() => gl.createBuffer());
    gl.bindVertexArray(array);
    const normals = vertexNormals(positions, faces);
    [["position", positions, 3], ["normal", normals, 3], ["value", values, 1]].forEach(([name, data, size], number) => {
      const place = gl.getAttribLocation(this.program, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffers[number]);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
    });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers[3]);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    return { array, buffers, count: faces.length };
  }

  free(body) {
    if (!body) return;
    this.gl.deleteVertexArray(body.array);
    body.buffers.forEach((buffer) => this.gl.deleteBuffer(buffer));
  }

  show(positions, faces, values, stops, plateRadius) {
    const reach = positions.reduce((most, part) => Math.max(most, Math.abs(part)), 0);
    const stand = pedestal(0.93 * plateRadius, 0.65 * reach);
    this.size = reach / 0.15;  // 1 for the release's cloth
    this.stops = stops;
    this.free(this.cloth);
    this.free(this.stand);
    this.cloth = this.body(positions, faces, values);
    this.stand = this.body(stand.positions, stand.faces, new Float32Array(stand.positions.length / 3).fill(-1));
    this.draw();
  }

  turn(azimuth, elevation) {
    this.view.azimuth += azimuth;
    this.view.elevation = Math.min(1.55, Math.max(-0.2, this.view.elevation + elevation));
    this.draw();
  }

  approach(factor) {
    this.view.distance = Math.min(2, Math.max(0.3, this.view.distance * factor));
    this.draw();
  }

  look(view) {
    Object.assign(this.view, view);
    this.draw();
  }

  /* The matrix that takes positions to the screen, by columns. */
  camera() {
    const { azimuth, elevation, distance } = this.view, size = this.size;
    const ray = [Math.cos(azimuth) * Math.cos(elevation), Math.sin(azimuth) * Math.cos(elevation), Math.sin(elevation)];
    const eye = ray.map((part, axis) => size * (distance * part + (axis === 2 ? -0.045 : 0)));
    const right = [-Math.sin(azimuth), Math.cos(azimuth), 0], up = cross(ray, right);
    const aspect = this.canvas.width / this.canvas.height;
    const y = 1 / Math.tan(FIELD_OF_VIEW * Math.max(1, 1.35 / aspect) / 2), x = y / aspect;
    const near = 0.05 * size, far = 4 * size, a = (far + near) / (near - far), b = 2 * far * near / (near - far);
    const [re, ue, fe] = [right, up, ray].map((axis) => -dot(axis, eye));
    const matrix = [0, 1, 2].flatMap((k) => [x * right[k], y * up[k], a * ray[k], -ray[k]]);
    return [...matrix, x * re, y * ue, a * fe + b, -fe];
  }

  draw() {
    if (!this.cloth) return;
    const gl = this.gl, ratio = Math.min(devicePixelRatio || 1, 2);
    this.canvas.width = Math.max(1, Math.round(ratio * this.canvas.clientWidth));
    this.canvas.height = Math.max(1, Math.round(ratio * this.canvas.clientHeight));
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.program);
    const at = (name) => gl.getUniformLocation(this.program, name);
    gl.uniformMatrix4fv(at("projection"), false, this.camera());
    gl.uniform3fv(at("stops"), (this.stops || Array(5).fill(PLAIN)).flat());
    gl.uniform1f(at("coloured"), this.stops ? 1 : 0);
    for (const [body, colour] of [[this.cloth, PLAIN], [this.stand, PEDESTAL]]) {
      gl.uniform3fv(at("plain"), colour);
      gl.bindVertexArray(body.array);
      gl.drawElements(gl.TRIANGLES, body.count, gl.UNSIGNED_INT, 0);
    }
  }
}
