// Draws the views of the page with WebGL 2: turn, move, zoom, layers by role, motions, figures at
// contacts. Nothing is fetched.
for (const root of document.querySelectorAll(".view")) (() => {
  "use strict";
  const canvas = root.querySelector("canvas");
  const labels = root.querySelector(".labels");
  const model = JSON.parse(root.querySelector("script").textContent);
  const CREASE = Math.cos((35 * Math.PI) / 180);
  const FIELD = (32 * Math.PI) / 180, ROOM = 1.08;
  const FRAMED = 2.3, HAND_REACH = 1.05; // of the picture's radius: farther parts, and an arm's, are context
  const BADGE = 19, RINGS = [17, 32, 47, 62], RAYS = 12; // px: numbers apart, and their distances from contacts
  const NEAREST = 0.06, FARTHEST = 1.2; // of the picture's radius: the eye from floors, the target from the middle
  const REACH = 9; // px: what counts as pointed at
  const PLAYED = 2600, SHOWN_STILL = 900; // ms of one round: the motion, then its end
  const OUTLINED = new Set(["object", "support"]);
  const BODIES = new Set(["hand", "object", "support"]);
  const FORCES = new Set(["normal_force", "friction_force", "friction_at_limit", "total_force"]);

  const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const add = (a, b, k = 1) => [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  // A pose is three rows of four numbers.
  const placed = (pose, a) => [0, 4, 8].map((k) => pose[k] * a[0] + pose[k + 1] * a[1] + pose[k + 2] * a[2] + pose[k + 3]);
  const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((x) => x / n); };

  function fail(text) {
    canvas.hidden = true;
    const note = root.querySelector(".fallback");
    note.hidden = false;
    note.textContent = text;
    root.dataset.state = "unavailable";
  }

  async function unpack() {
    const bytes = Uint8Array.from(atob(model.data), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const buffer = await new Response(stream).arrayBuffer();
    const count = model.meshes.reduce((sum, mesh) => sum + mesh.vertices, 0);
    const corners = new Uint16Array(buffer, 0, 3 * count);
    const faces = new Uint32Array(buffer, 4 * Math.ceil((6 * count) / 4));
    let v = 0, f = 0;
    for (const mesh of model.meshes) {
      mesh.points = [];
      for (let i = 0; i < mesh.vertices; i++, v += 3) {
        mesh.points.push([0, 1, 2].map((k) => mesh.low[k] + (mesh.size[k] * corners[v + k]) / 65535));
      }
      mesh.triangles = [];
      for (let i = 0; i < mesh.faces; i++, f += 3) mesh.triangles.push([faces[f], faces[f + 1], faces[f + 2]]);
      mesh.middle = add(mesh.low, mesh.size, 0.5);
      const reach = (mesh.role === "hand" ? HAND_REACH : FRAMED) * model.radius;
      const seen = mesh.points.filter((point) => mesh.framed && Math.hypot(...sub(point, model.center)) < reach);
      near.push(...seen);
      if (mesh.path != null) near.push(...seen.map((point) => placed(model.paths[mesh.path].at(-1), point)));
    }
  }

  // Corners with normals that are smooth but at creases, and the lines of the creases.
  function surface(mesh) {
    const normals = mesh.triangles.map(([a, b, c]) =>
      cross(sub(mesh.points[b], mesh.points[a]), sub(mesh.points[c], mesh.points[a])));
    const units = normals.map(unit);
    const around = mesh.points.map(() => []);
    mesh.triangles.forEach((corners, t) => corners.forEach((corner) => around[corner].push(t)));
    const data = [], lines = [], edges = new Map();
    mesh.triangles.forEach((corners, t) => {
      corners.forEach((corner, k) => {
        let sum = [0, 0, 0];
        for (const other of around[corner]) if (dot(units[other], units[t]) > CREASE) sum = add(sum, normals[other]);
        data.push(...mesh.points[corner], ...unit(sum));
        const next = corners[(k + 1) % 3];
        const key = Math.min(corner, next) + " " + Math.max(corner, next);
        edges.set(key, [...(edges.get(key) || []), t]);
      });
    });
    for (const [key, [first, second]] of edges) {
      if (second !== undefined && dot(units[first], units[second]) > CREASE) continue;
      for (const end of key.split(" ")) lines.push(...mesh.points[end], 0, 0, 0);
    }
    return { data: new Float32Array(data), lines: new Float32Array(lines) };
  }

  const VERTEX = `#version 300 es
    in vec3 point; in vec3 normal; uniform mat4 view; uniform mat4 lens; uniform mat4 pose; out vec3 n;
    void main() { n = mat3(view) * mat3(pose) * normal; gl_Position = lens * view * pose * vec4(point, 1.0); }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    in vec3 n; uniform vec3 color; uniform float alpha; uniform bool lit; out vec4 result;
    void main() {
      float light = 1.0;
      if (lit) {
        vec3 m = normalize(n) * (gl_FrontFacing ? 1.0 : -1.0);
        light = 0.52 + 0.38 * max(dot(m, normalize(vec3(0.35, 0.6, 0.75))), 0.0) + 0.14 * max(m.z, 0.0);
      }
      result = vec4(min(color * light, 1.0) * alpha, alpha);
    }`;

  function program(gl) {
    const made = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    return made;
  }

  function upload(gl, shader, data) {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    for (const [name, offset] of [["point", 0], ["normal", 12]]) {
      const place = gl.getAttribLocation(shader, name);
      if (place < 0) continue;
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 24, offset);
    }
    return { array, count: data.length / 6 };
  }

  // The camera goes around the target; up is against gravity.
  const up = unit(model.up);
  const east = unit(cross(Math.abs(up[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0], up));
  const north = cross(up, east);
  const near = []; // what a view has to hold
  let camera;

  // Looks from a direction, from where all that matters is seen.
  function look(toward) {
    camera = { turn: Math.atan2(dot(toward, north), dot(toward, east)), tilt: Math.asin(dot(toward, up)),
      distance: 1, target: [...model.center] };
    const { right, over, back } = frame();
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    const seen = near.map((point) => [right, over, back].map((axis) => dot(sub(point, model.center), axis)));
    for (const point of seen) for (const k of [0, 1]) {
      low[k] = Math.min(low[k], point[k]);
      high[k] = Math.max(high[k], point[k]);
    }
    const middle = [0, 1].map((k) => 0.5 * (low[k] + high[k]));
    camera.target = add(add(camera.target, right, middle[0]), over, middle[1]);
    const aspect = (canvas.clientWidth / canvas.clientHeight) || 1, tall = slope(aspect);
    camera.distance = Math.max(...seen.map(([x, y, z]) =>
      (ROOM * Math.max(Math.abs(x - middle[0]) / aspect, Math.abs(y - middle[1]))) / tall + z));
    stay();
  }

  // On a narrow stage the field is that of the width.
  const slope = (aspect) => Math.tan(FIELD / 2) * Math.max(1, 1 / aspect);

  // Keeps what matters in view, and the eye above the supports that the object may stand on.
  function stay() {
    const away = sub(camera.target, model.center), far = Math.hypot(...away), most = FARTHEST * model.radius;
    if (far > most) camera.target = add(model.center, away, most / far);
    camera.distance = Math.min(20 * model.radius, Math.max(0.3 * model.radius, camera.distance));
    const above = (point) => Math.min(...model.floors.map((p) => dot(p, point) - p[3]), Infinity);
    for (let k = 0; k < 50 && above(camera.target) < 0; k++) camera.target = add(camera.target, up, 0.05 * model.radius);
    camera.tilt = Math.min(1.55, Math.max(-1.55, camera.tilt));
    while (camera.tilt < 1.55 && above(frame().eye) < NEAREST * model.radius) camera.tilt += 0.01;
  }

  function frame() {
    const flat = Math.cos(camera.tilt);
    let back = add(add([0, 0, 0], east, flat * Math.cos(camera.turn)), north, flat * Math.sin(camera.turn));
    back = add(back, up, Math.sin(camera.tilt));
    const right = unit(cross(up, back));
    return { back, right, over: cross(back, right), eye: add(camera.target, back, camera.distance) };
  }

  function matrices(axes, aspect) {
    const { right, over, back, eye } = axes;
    const view = [];
    for (let k = 0; k < 3; k++) view.push(right[k], over[k], back[k], 0);
    view.push(-dot(right, eye), -dot(over, eye), -dot(back, eye), 1);
    const near = 0.02 * camera.distance, far = camera.distance + 40 * model.radius;
    const tall = slope(aspect);
    const lens = [1 / (tall * aspect), 0, 0, 0, 0, 1 / tall, 0, 0, 0, 0, (far + near) / (near - far), -1,
      0, 0, (2 * far * near) / (near - far), 0];
    return { view, lens, tall };
  }

  // Between the poses of a path.
  function along(path, share) {
    const at = share * (path.length - 1), k = Math.min(Math.floor(at), path.length - 2);
    return path[k].map((x, i) => x + (at - k) * (path[k + 1][i] - x));
  }

  // The motion that the view shows: from rest to its end, again and again, unless the reader wants
  // little motion or stops it; then the slider says where it is.
  const motion = { share: 0, playing: false, since: 0 };

  function player(redraw) {
    const button = root.querySelector("[data-do=play]"), slider = root.querySelector("input[type=range]");
    const calm = matchMedia("(prefers-reduced-motion: reduce)");
    let seen = true;
    const at = (share) => {
      motion.share = share;
      slider.value = share;
      slider.setAttribute("aria-valuetext",
        model.plays ? `${Math.round(1000 * share * model.seconds)} ms` : `${Math.round(100 * share)} %`);
      root.dataset.share = share.toFixed(3);
      redraw();
    };
    const step = (now) => {
      if (!motion.playing || !seen) return;
      // A frame's time may lie a little before the click that asked for it.
      const since = Math.max(0, now - motion.since);
      at(Math.min(1, (since % (PLAYED + SHOWN_STILL)) / PLAYED));
      requestAnimationFrame(step);
    };
    const play = (on) => {
      motion.playing = on;
      button.textContent = on ? "Pause" : "Play";
      button.setAttribute("aria-pressed", on);
      motion.since = performance.now() - (motion.share < 1 ? motion.share * PLAYED : 0);
      if (on) requestAnimationFrame(step);
    };
    button.addEventListener("click", () => play(!motion.playing));
    slider.addEventListener("input", () => { play(false); at(Number(slider.value)); });
    new IntersectionObserver(([entry]) => {
      const again = entry.isIntersecting && !seen;
      seen = entry.isIntersecting;
      if (again && motion.playing) play(true);
    }).observe(canvas);
    calm.addEventListener("change", () => { if (calm.matches) { play(false); at(1); } });
    // A virtual motion is played only when it is asked for.
    at(calm.matches && model.plays ? 1 : 0);
    play(!calm.matches && model.plays);
  }

  // What there is to say of a contact, beside it: pointed at, or reached by the keyboard.
  function tooltip() {
    const tip = root.querySelector(".tip"), stage = root.querySelector(".stage");
    const all = [];
    let told = null;
    const tell = (one) => {
      if (told === one) return;
      if (told) told.label.setAttribute("aria-expanded", "false");
      told = one;
      tip.hidden = !one;
      if (!one) return;
      one.label.setAttribute("aria-expanded", "true");
      tip.replaceChildren(...one.mark.words.map((line, k) => {
        const part = document.createElement(k ? "span" : "b");
        part.textContent = line;
        return part;
      }));
      put();
    };
    const put = () => {
      const [x, y] = told.at, { offsetWidth: wide, offsetHeight: high } = tip;
      const left = Math.max(4, Math.min(x + 24, stage.clientWidth - wide - 4));
      const top = y + 24 + high < stage.clientHeight ? y + 24 : Math.max(4, y - high - 8);
      tip.style.transform = `translate(${left}px, ${top}px)`;
    };
    const between = ([x, y], [[ax, ay], [bx, by]]) => {
      const [dx, dy] = [bx - ax, by - ay];
      const t = Math.max(0, Math.min(1, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1)));
      return Math.hypot(x - ax - t * dx, y - ay - t * dy);
    };
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) return;
      const at = [event.offsetX, event.offsetY];
      let best = null, least = REACH;
      for (const one of all) for (const way of one.ways) {
        const apart = between(at, way);
        if (apart < least) [best, least] = [one, apart];
      }
      tell(best);
    });
    canvas.addEventListener("pointerdown", () => tell(null));
    root.querySelector(".stage").addEventListener("pointerleave", () => {
      if (!labels.contains(document.activeElement)) tell(null);
    });
    labels.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (event.key === "Escape") tell(null);
      if (!step || !all.length) return;
      const now = all.findIndex((one) => one.label === document.activeElement);
      all[(now + step + all.length) % all.length].label.focus();
      event.preventDefault();
    });
    return {
      about(label, mark) {
        const one = { label, mark, at: [0, 0], ways: [] };
        label.type = "button";
        label.tabIndex = all.length ? -1 : 0;
        const words = mark.words.length ? mark.words : [`contact ${mark.text}`];
        one.mark = { ...mark, words };
        label.setAttribute("aria-label", words.join(", "));
        label.setAttribute("aria-expanded", "false");
        for (const kind of ["focus", "pointerenter", "click"]) label.addEventListener(kind, () => tell(one));
        label.addEventListener("focus", () => all.forEach((other) => { other.label.tabIndex = other === one ? 0 : -1; }));
        label.addEventListener("blur", () => tell(null));
        all.push(one);
      },
      place(mark, at, ways) {
        const one = all.find((other) => other.mark.contact === mark.contact);
        one.at = at;
        one.ways = [[at, at], ...ways];
        if (told === one) put();
      },
    };
  }

  // The object stands on it, so it is never between the object and the eye.
  function isBelow(mesh) {
    const object = model.meshes.find((one) => one.role === "object");
    return object && dot(sub(mesh.middle, object.middle), up) < -0.25 * Math.max(...object.size);
  }

  function viewer(gl) {
    const shader = program(gl);
    const place = Object.fromEntries(
      ["view", "lens", "pose", "color", "alpha", "lit"].map((name) => [name, gl.getUniformLocation(shader, name)]));
    for (const mesh of model.meshes) {
      const { data, lines } = surface(mesh);
      mesh.body = upload(gl, shader, data);
      mesh.outline = OUTLINED.has(mesh.role) && lines.length ? upload(gl, shader, lines) : null;
      mesh.points = mesh.triangles = null;
    }
    const tell = tooltip();
    const leaders = root.querySelector(".leaders");
    const marks = model.marks.map((mark) => {
      const label = document.createElement(mark.contact == null ? "span" : "button");
      label.textContent = mark.text;
      label.dataset.role = mark.role;
      if (mark.contact != null) tell.about(label, mark);
      else label.setAttribute("aria-hidden", "true");
      if (mark.contact != null) label.leader = leaders.appendChild(document.createElementNS(leaders.namespaceURI, "line"));
      return labels.appendChild(label);
    });
    const boxes = [...root.querySelectorAll("input[type=checkbox]")];
    let asked = false;

    function draw() {
      asked = false;
      const fine = window.devicePixelRatio || 1;
      const width = canvas.clientWidth, height = canvas.clientHeight;
      if (!width || !height) return;
      canvas.width = Math.round(fine * width);
      canvas.height = Math.round(fine * height);
      gl.viewport(0, 0, canvas.width, canvas.height);
      const axes = frame();
      const { view, lens, tall } = matrices(axes, width / height);
      const style = getComputedStyle(document.documentElement);
      const colorOf = (name) => {
        const hex = style.getPropertyValue("--" + name).trim();
        return [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
      };
      const shown = new Set(boxes.filter((box) => box.checked).flatMap((box) => box.value.split(" ")));
      const visible = model.meshes.filter((mesh) => shown.has(mesh.role));
      const scale = root.querySelector(".scale");
      if (scale) scale.hidden = !shown.has("force_scale");
      const poses = (model.paths || []).map((path) => along(path, motion.share));
      const still = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];
      const poseOf = (mesh) => (mesh.path == null ? still : poses[mesh.path]);
      const put = (mesh) => {
        const p = poseOf(mesh);
        gl.uniformMatrix4fv(place.pose, false, [p[0], p[4], p[8], 0, p[1], p[5], p[9], 0, p[2], p[6], p[10], 0, p[3], p[7], p[11], 1]);
      };
      const paint = (mesh, alpha) => {
        put(mesh);
        gl.uniform3fv(place.color, colorOf(mesh.finger == null ? mesh.role : `finger-${mesh.finger}`));
        gl.uniform1f(place.alpha, alpha);
        gl.bindVertexArray(mesh.body.array);
        gl.drawArrays(gl.TRIANGLES, 0, mesh.body.count);
      };
      gl.clearColor(0, 0, 0, 0);
      gl.depthMask(true);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.useProgram(shader);
      gl.uniformMatrix4fv(place.view, false, view);
      gl.uniformMatrix4fv(place.lens, false, lens);
      gl.uniform1i(place.lit, 1);
      gl.enable(gl.DEPTH_TEST);
      gl.disable(gl.CULL_FACE);
      gl.disable(gl.BLEND);
      gl.depthFunc(gl.LESS);
      // A support between the reader and the object must not hide it.
      const reach = (point) => Math.hypot(...sub(point, axes.eye));
      const hides = (mesh) => reach(mesh.middle) < reach(model.center) - 0.05 * model.radius && !isBelow(mesh);
      const opacity = new Map(visible.map((mesh) =>
        [mesh, mesh.role !== "support" ? mesh.opacity : hides(mesh) ? 0.3 : 1]));
      const solid = visible.filter((mesh) => opacity.get(mesh) >= 1);
      // A surface that a contact ball or an arrow's foot lies in must not flicker through it.
      gl.enable(gl.POLYGON_OFFSET_FILL);
      gl.polygonOffset(1, 1);
      for (const mesh of solid) if (BODIES.has(mesh.role)) paint(mesh, 1);
      gl.disable(gl.POLYGON_OFFSET_FILL);
      for (const mesh of solid) if (!BODIES.has(mesh.role)) paint(mesh, 1);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      gl.depthMask(false);
      // What solid bodies hide of contacts and arrows still shows faintly.
      gl.depthFunc(gl.GREATER);
      for (const mesh of solid) if (!BODIES.has(mesh.role)) paint(mesh, 0.3);
      gl.depthFunc(gl.LEQUAL);
      gl.uniform1i(place.lit, 0);
      for (const mesh of visible) {
        if (!mesh.outline) continue;
        gl.uniform3fv(place.color, colorOf("text"));
        gl.uniform1f(place.alpha, 0.55);
        put(mesh);
        gl.bindVertexArray(mesh.outline.array);
        gl.drawArrays(gl.LINES, 0, mesh.outline.count);
      }
      gl.uniform1i(place.lit, 1);
      const depth = (mesh) => dot(sub(placed(poseOf(mesh), mesh.middle), axes.eye), axes.back);
      gl.enable(gl.CULL_FACE);
      for (const mesh of visible.filter((m) => opacity.get(m) < 1).sort((a, b) => depth(a) - depth(b))) {
        for (const side of [gl.FRONT, gl.BACK]) {
          gl.cullFace(side);
          paint(mesh, 0.6 * opacity.get(mesh));
        }
      }
      const onScreen = (point) => {
        const from = sub(point, axes.eye), deep = -dot(from, axes.back);
        return [(dot(from, axes.right) / (deep * tall)) * 0.5 * height + 0.5 * width,
          (-dot(from, axes.over) / (deep * tall)) * 0.5 * height + 0.5 * height, deep];
      };
      const places = model.marks.map((mark) => onScreen(model.paths && mark.contact != null ? placed(poses[0], mark.at) : mark.at));
      const contacts = places.filter((_, index) => model.marks[index].contact != null);
      const middle = [0, 1].map((k) => contacts.reduce((sum, one) => sum + one[k], 0) / contacts.length);
      const taken = [];
      // A number stands outwards of its contact, or where no other number and no contact is.
      const spot = ([x, y]) => {
        const away = Math.atan2(y - middle[1], x - middle[0]);
        const clear = (at) => taken.every((one) => Math.hypot(one[0] - at[0], one[1] - at[1]) >= BADGE)
          && contacts.every((one) => Math.hypot(one[0] - at[0], one[1] - at[1]) >= 0.6 * BADGE)
          && Math.min(at[0], at[1], width - at[0], height - at[1]) > 0.5 * BADGE;
        let at;
        for (const ring of RINGS) for (let ray = 0; ray < RAYS; ray++) {
          const angle = away + (Math.PI / RAYS) * (ray % 2 ? ray + 1 : -ray);
          at = [x + ring * Math.cos(angle), y + ring * Math.sin(angle)];
          if (clear(at)) return at;
        }
        return at;
      };
      model.marks.forEach((mark, index) => {
        const label = marks[index], [x, y, deep] = places[index], numbered = mark.contact != null;
        label.hidden = deep <= 0 || !shown.has(numbered ? "labels" : mark.role);
        label.dataset.at = `${x} ${y}`;
        const at = numbered ? spot([x, y]) : [x, y];
        label.style.transform = `translate(${at[0]}px, ${at[1]}px) translate(-50%, -50%)`;
        if (!numbered) return;
        taken.push(at);
        label.leader.style.display = label.hidden ? "none" : "";
        for (const [name, value] of Object.entries({ x1: x, y1: y, x2: at[0], y2: at[1] })) label.leader.setAttribute(name, value);
        tell.place(mark, [x, y], visible.filter((m) => m.contact === mark.contact && FORCES.has(m.role)).map((m) =>
          [[x, y], onScreen(placed(poseOf(m), add(mark.at, sub(m.middle, mark.at), 2)))]));
      });
      root.dataset.state = "drawn";
    }

    const redraw = () => { if (!asked) { asked = true; requestAnimationFrame(draw); } };
    boxes.forEach((box) => box.addEventListener("change", redraw));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
    new ResizeObserver(redraw).observe(canvas);
    return redraw;
  }

  function controls(redraw) {
    const changed = () => { stay(); redraw(); };
    const turn = (x, y) => {
      camera.turn -= x;
      camera.tilt += y;
      changed();
    };
    const move = (x, y) => {
      const { right, over } = frame();
      const size = (2 * camera.distance * Math.tan(FIELD / 2)) / canvas.clientHeight;
      camera.target = add(add(camera.target, right, -x * size), over, y * size);
      changed();
    };
    const zoom = (factor) => {
      camera.distance *= factor;
      changed();
    };
    const actions = { closer: () => zoom(0.8), farther: () => zoom(1.25) };
    for (const [name, toward] of Object.entries(model.views)) actions[name] = () => { look(toward); redraw(); };
    root.querySelectorAll(".buttons button").forEach((button) =>
      button.addEventListener("click", actions[button.dataset.do]));
    canvas.addEventListener("keydown", (event) => {
      const arrow = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (arrow && event.shiftKey) move(20 * arrow[0], 20 * arrow[1]);
      else if (arrow) turn(0.08 * arrow[0], 0.08 * arrow[1]);
      else if (event.key === "+" || event.key === "=") zoom(0.85);
      else if (event.key === "-") zoom(1 / 0.85);
      else if (event.key === "Home") actions.fit();
      else return;
      event.preventDefault();
    });
    const fingers = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const last = fingers.get(event.pointerId);
      if (!last) return;
      const [x, y] = [event.clientX - last[0], event.clientY - last[1]];
      const other = [...fingers].find(([id]) => id !== event.pointerId);
      if (other) {
        const apart = (from) => Math.hypot(from[0] - other[1][0], from[1] - other[1][1]) || 1;
        zoom(apart(last) / apart([event.clientX, event.clientY]));
      } else if (event.shiftKey || event.buttons & 6) move(x, y);
      else turn(0.008 * x, 0.008 * y);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
    }
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      // Without a click first the wheel scrolls the page.
      if (!event.ctrlKey && document.activeElement !== canvas) return;
      event.preventDefault();
      zoom(Math.exp(0.0015 * event.deltaY));
    }, { passive: false });
  }

  async function main() {
    const gl = canvas.getContext("webgl2", { antialias: true });
    if (!gl || typeof DecompressionStream === "undefined") {
      fail("This browser offers no WebGL 2, so the scene cannot be drawn here. The tables below list all values.");
      return;
    }
    await unpack();
    look(model.views.fit);
    const redraw = viewer(gl);
    controls(redraw);
    if (model.paths) player(redraw);
    redraw();
  }

  main().catch((error) => fail(`The scene could not be drawn: ${error.message}`));
})();
