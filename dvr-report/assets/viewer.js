// A small viewer of one coloured mesh: orbit, zoom, pan; colour, shaded, normals, confidence.

const MESH_VERTEX = `#version 300 es
uniform mat4 uProjection, uView;
in vec3 aPosition; in vec3 aNormal; in vec4 aColor; in vec2 aUv;
out vec3 vNormal; out vec3 vEye; out vec4 vColor; out vec2 vUv;
void main() {
  vec4 eye = uView * vec4(aPosition, 1.0);
  vEye = eye.xyz; vNormal = mat3(uView) * aNormal; vColor = aColor; vUv = aUv;
  gl_Position = uProjection * eye;
}`;

// The alpha of a vertex's colour is its confidence; zero is what no view has seen.
const MESH_FRAGMENT = `#version 300 es
precision highp float;
uniform int uMode;
uniform bool uTextured;
uniform sampler2D uTexture;
in vec3 vNormal; in vec3 vEye; in vec4 vColor; in vec2 vUv;
out vec4 color;
vec3 scale(float t) {
  vec3 c[5] = vec3[5](vec3(.549, .176, .016), vec3(.851, .467, .169), vec3(.949, .820, .420), vec3(.498, .753, .545), vec3(.059, .498, .478));
  float at = clamp(t, 0.0, 1.0) * 4.0;
  int i = min(int(at), 3);
  return mix(c[i], c[i + 1], at - float(i));
}
void main() {
  vec3 n = normalize(vNormal);
  vec3 toEye = normalize(-vEye);
  if (!gl_FrontFacing) n = -n;
  float facing = max(dot(n, toEye), 0.0);
  float light = 0.32 + 0.5 * max(dot(n, normalize(vec3(0.35, 0.75, 0.6))), 0.0) + 0.25 * facing;
  if (uMode == 0) color = vec4(uTextured ? texture(uTexture, vUv).rgb : vColor.rgb, 1.0);
  else if (uMode == 1) color = vec4(vec3(0.86, 0.87, 0.90) * light, 1.0);
  else if (uMode == 2) color = vec4(0.5 + 0.5 * n, 1.0);
  else {
    vec3 base = vColor.a < 0.002 ? vec3(0.839, 0.122, 0.612) : scale(vColor.a);
    color = vec4(base * (0.45 + 0.6 * light), 1.0);
  }
}`;

const LINE_VERTEX = `#version 300 es
uniform mat4 uProjection, uView;
in vec3 aPosition;
void main() { gl_Position = uProjection * uView * vec4(aPosition, 1.0); }`;
const LINE_FRAGMENT = `#version 300 es
precision highp float;
uniform vec4 uColor; out vec4 color;
void main() { color = uColor; }`;

const MODES = ["color", "shaded", "normals", "confidence"];
const FIELD_OF_VIEW = 0.6;

const V = {
  add: (a, b) => a.map((x, i) => x + b[i]),
  scaled: (a, s) => a.map((x) => x * s),
  dot: (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
  cross: (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
  unit: (a) => V.scaled(a, 1 / (Math.hypot(...a) || 1)),
};

class Viewer {
  constructor(root) {
    this.root = root;
    this.canvas = root.querySelector("canvas");
    this.mode = 0;
    this.pointers = new Map();
    this.facts = JSON.parse(document.getElementById(root.dataset.mesh + "-facts").textContent);
    root.querySelectorAll("[data-mode]").forEach((button) => button.addEventListener("click", () => this.show(button.dataset.mode)));
    root.querySelector("[data-home]").addEventListener("click", () => this.home());
    this.cameras = root.querySelector("[data-cameras]");
    this.cameras.addEventListener("change", () => this.draw());
    if (!this.facts.cameras) this.cameras.closest("label").hidden = true;
    const file = root.querySelector("[data-whole]");
    if (file) file.addEventListener("change", () => this.choose(file));
    this.ready = Promise.resolve();
    this.gl = this.canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: false });
    if (!this.gl) return this.say("This browser shows no WebGL 2, which the view in 3D needs. mesh.glb opens in Blender, MeshLab and most viewers.");
    if (typeof DecompressionStream === "undefined") return this.say("This browser is too old to unpack the mesh. mesh.glb opens in Blender, MeshLab and most viewers.");
    this.listen();
    this.ready = this.load();
    this.ready.catch((error) => this.say("The mesh cannot be shown: " + error.message));
  }

  say(text) {
    const message = this.root.querySelector(".message");
    message.textContent = text;
    message.hidden = false;
    this.root.dataset.state = "message";
  }

  async load() {
    const source = document.getElementById(this.root.dataset.mesh);
    const mesh = await decodeMesh(source.textContent, this.facts);
    source.textContent = "";
    this.mesh = this.program(MESH_VERTEX, MESH_FRAGMENT);
    this.lines = this.program(LINE_VERTEX, LINE_FRAGMENT);
    if (mesh.uvs) {
      const texture = document.getElementById(this.root.dataset.mesh + "-texture");
      mesh.picture = await this.picture(texture.textContent);
      texture.textContent = "";
    }
    this.take(mesh);
    this.frusta = [false, true].map((heldOut) => this.lineSet(heldOut));
    const [low, high] = [this.facts.low, this.facts.high];
    this.center = V.scaled(V.add(low, high), 0.5);
    this.radius = 1e-6;
    for (let i = 0; i < mesh.positions.length; i += 3) {
      const [x, y, z] = [0, 1, 2].map((axis) => mesh.positions[i + axis] - this.center[axis]);
      this.radius = Math.max(this.radius, Math.hypot(x, y, z));
    }
    this.home();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    this.root.dataset.state = "ready";
  }

  // A picture at a `data:` or `blob:` address.
  async picture(address) {
    const picture = new Image();
    picture.src = address;
    await picture.decode();
    return picture;
  }

  // Hands a mesh to the graphics card, in place of the one that is there.
  take(mesh) {
    const gl = this.gl;
    (this.buffers || []).forEach((buffer) => gl.deleteBuffer(buffer));
    if (this.surface) gl.deleteVertexArray(this.surface);
    this.surface = gl.createVertexArray();
    gl.bindVertexArray(this.surface);
    this.buffers = [
      this.attribute(this.mesh, "aPosition", mesh.positions, 3, gl.FLOAT, false),
      this.attribute(this.mesh, "aNormal", mesh.normals, 3, gl.FLOAT, false),
      this.attribute(this.mesh, "aColor", mesh.colors, 4, gl.UNSIGNED_BYTE, true),
      gl.createBuffer(),
    ];
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers[3]);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, mesh.faces, gl.STATIC_DRAW);
    if (mesh.picture) {
      this.buffers.push(this.attribute(this.mesh, "aUv", mesh.uvs, 2, gl.FLOAT, false));
      this.upload(mesh.picture);
    }
    this.corners = mesh.faces.length;
  }

  upload(picture) {
    const gl = this.gl;
    if (this.texture) gl.deleteTexture(this.texture);
    this.texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    // Texture coordinates point up, rows of the picture run down.
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, true);
    const most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    const [width, height] = [picture.naturalWidth, picture.naturalHeight].map((side) => Math.min(side, most));
    let source = picture;
    if (width < picture.naturalWidth || height < picture.naturalHeight) {
      source = document.createElement("canvas");
      [source.width, source.height] = [width, height];
      source.getContext("2d").drawImage(picture, 0, 0, width, height);
    }
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, source);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    // The padding of charts lasts for so many halvings.
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAX_LEVEL, 3);
    this.root.dataset.texels = String(width);
  }

  choose(input) {
    const [file] = input.files;
    if (!file) return;
    const told = this.root.querySelector(".whole");
    told.textContent = "Reading " + file.name + " ...";
    this.ready = this.ready.then(() => this.whole(file)).then(
      () => { told.textContent = Number(this.root.dataset.faces).toLocaleString("en") + " faces, " + this.root.dataset.texels + " texels along the texture's edge."; },
      (error) => { told.textContent = file.name + " cannot be shown: " + error.message + "."; },
    );
    input.value = "";
  }

  // All faces and texels, of the mesh.glb that the reader chose.
  async whole(file) {
    const mesh = decodeGlb(await file.arrayBuffer(), this.facts.toObject);
    const address = URL.createObjectURL(mesh.texture);
    mesh.picture = await this.picture(address).finally(() => URL.revokeObjectURL(address));
    this.take(mesh);
    this.root.dataset.faces = String(mesh.faces.length / 3);
    this.draw();
  }

  program(vertex, fragment) {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) || "the graphics driver refuses the shader");
    return program;
  }

  attribute(program, name, data, size, type, normalised) {
    const gl = this.gl;
    const place = gl.getAttribLocation(program, name);
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, type, normalised, 0, 0);
    return buffer;
  }

  // The pyramids of the cameras that were trained on, or of those that were not.
  lineSet(heldOut) {
    const gl = this.gl;
    const ends = [];
    for (const camera of this.facts.cameras || []) {
      if (camera.heldOut !== heldOut) continue;
      const point = (i) => camera.points.slice(3 * i, 3 * i + 3);
      for (const [a, b] of [[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [2, 3], [3, 4], [4, 1]]) ends.push(...point(a), ...point(b));
    }
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    this.attribute(this.lines, "aPosition", new Float32Array(ends), 3, gl.FLOAT, false);
    return { array, count: ends.length / 3 };
  }

  home() {
    const up = V.unit(this.facts.up);
    const side = V.unit(V.cross(up, Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
    this.axes = { up, side, front: V.cross(side, up) };
    this.turn = 0.6;
    this.height = 0.35;
    const first = (this.facts.cameras || []).find((camera) => !camera.heldOut);
    if (first) {
      const to = V.unit(V.add(first.points.slice(0, 3), V.scaled(this.center, -1)));
      this.turn = Math.atan2(V.dot(to, this.axes.side), V.dot(to, this.axes.front));
      this.height = Math.max(-1.2, Math.min(1.2, Math.asin(Math.max(-1, Math.min(1, V.dot(to, up))))));
    }
    this.target = this.center;
    this.distance = (this.radius / Math.sin(FIELD_OF_VIEW / 2)) * 0.97;
    this.draw();
  }

  show(mode) {
    this.mode = MODES.indexOf(mode);
    this.root.querySelectorAll("[data-mode]").forEach((button) => button.setAttribute("aria-pressed", String(button.dataset.mode === mode)));
    this.root.querySelectorAll(".legend, .about").forEach((part) => { part.hidden = mode !== "confidence"; });
    this.root.dataset.shown = mode;
    this.draw();
  }

  // Where the camera stands, and its axes.
  frame() {
    const { up, side, front } = this.axes;
    const level = V.add(V.scaled(side, Math.sin(this.turn)), V.scaled(front, Math.cos(this.turn)));
    const back = V.unit(V.add(V.scaled(level, Math.cos(this.height)), V.scaled(up, Math.sin(this.height))));
    const right = V.unit(V.cross(up, back));
    return { back, right, above: V.cross(back, right), eye: V.add(this.target, V.scaled(back, this.distance)) };
  }

  draw() {
    if (this.pending || !this.surface) return;
    this.pending = true;
    requestAnimationFrame(() => { this.pending = false; this.drawNow(); });
  }

  drawNow() {
    const gl = this.gl;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight].map((size) => Math.max(1, Math.round(size * ratio)));
    if (this.canvas.width !== width || this.canvas.height !== height) [this.canvas.width, this.canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    const { back, right, above, eye } = this.frame();
    const view = [right[0], above[0], back[0], 0, right[1], above[1], back[1], 0, right[2], above[2], back[2], 0, -V.dot(right, eye), -V.dot(above, eye), -V.dot(back, eye), 1];
    const aspect = width / height;
    const f = 1 / Math.tan(FIELD_OF_VIEW / 2) * Math.min(1, aspect);
    const near = Math.max(this.distance - 3 * this.radius, this.radius * 0.01), far = this.distance + 12 * this.radius;
    const projection = [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
    const use = (program) => {
      gl.useProgram(program);
      gl.uniformMatrix4fv(gl.getUniformLocation(program, "uView"), false, view);
      gl.uniformMatrix4fv(gl.getUniformLocation(program, "uProjection"), false, projection);
    };
    use(this.mesh);
    gl.uniform1i(gl.getUniformLocation(this.mesh, "uMode"), this.mode);
    gl.uniform1i(gl.getUniformLocation(this.mesh, "uTextured"), this.texture ? 1 : 0);
    gl.bindTexture(gl.TEXTURE_2D, this.texture || null);
    gl.bindVertexArray(this.surface);
    gl.drawElements(gl.TRIANGLES, this.corners, gl.UNSIGNED_INT, 0);
    if (this.cameras.checked) {
      use(this.lines);
      for (const [i, set] of this.frusta.entries()) {
        gl.uniform4fv(gl.getUniformLocation(this.lines, "uColor"), i ? [0.85, 0.28, 0.06, 1] : [0.25, 0.45, 0.85, 1]);
        gl.bindVertexArray(set.array);
        gl.drawArrays(gl.LINES, 0, set.count);
      }
    }
    this.root.dataset.frames = String(Number(this.root.dataset.frames || 0) + 1);
  }

  rotate(dx, dy) {
    this.turn -= dx * 0.008;
    this.height = Math.max(-1.55, Math.min(1.55, this.height + dy * 0.008));
    this.draw();
  }

  pan(dx, dy) {
    const { right, above } = this.frame();
    const step = (2 * this.distance * Math.tan(FIELD_OF_VIEW / 2)) / this.canvas.clientHeight;
    this.target = V.add(this.target, V.add(V.scaled(right, -dx * step), V.scaled(above, dy * step)));
    this.draw();
  }

  zoom(factor) {
    this.distance = Math.max(this.radius * 0.15, Math.min(this.radius * 30, this.distance * factor));
    this.draw();
  }

  listen() {
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = this.pointers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY];
      const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
      if (this.pointers.size === 2) {
        const other = [...this.pointers].find(([id]) => id !== event.pointerId)[1];
        const apart = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]);
        this.zoom(apart(before) / Math.max(apart(now), 1));
        this.pan(dx / 2, dy / 2);
      } else if (event.buttons & 6 || event.shiftKey) this.pan(dx, dy);
      else this.rotate(dx, dy);
      this.pointers.set(event.pointerId, now);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(Math.max(-60, Math.min(60, event.deltaY)) * 0.003));
    }, { passive: false });
    canvas.addEventListener("dblclick", () => this.home());
    const keys = { ArrowLeft: () => this.rotate(-20, 0), ArrowRight: () => this.rotate(20, 0), ArrowUp: () => this.rotate(0, 20), ArrowDown: () => this.rotate(0, -20), "+": () => this.zoom(0.9), "-": () => this.zoom(1.1) };
    canvas.addEventListener("keydown", (event) => {
      if (!keys[event.key]) return;
      event.preventDefault();
      keys[event.key]();
    });
    canvas.addEventListener("webglcontextlost", (event) => { event.preventDefault(); this.say("The graphics driver gave up; load the page again."); });
  }
}
