// Relative paths in three dimensions on a canvas: Hill axes, target mesh, keep-out sphere, one line for each run.
const Scene = (() => {
  "use strict";
  const axes = [["x radial", [1, 0, 0]], ["y along-track", [0, 1, 0]], ["z normal", [0, 0, 1]]];
  const views = { free: [0.6, 0.35], plane: [0, 0], along: [Math.PI / 2, 0] };
  const tone = { median: "--blue", worst: "--vermillion", other: "--shade", picked: "--purple" };

  function start(data) {
    const canvas = document.getElementById("scene");
    if (!data || !canvas) return;
    const state = { yaw: 0.6, pitch: 0.35, zoom: 1, picked: null };
    const reach = extent(data);
    const target = triangles(data.target);
    const paint = () => draw(canvas, data, target, reach, state);
    drag(canvas, state, paint);
    pickable(canvas, data, state, paint);
    for (const button of document.querySelectorAll("[data-view]")) {
      button.addEventListener("click", () => {
        const wanted = button.dataset.view;
        if (views[wanted]) [state.yaw, state.pitch] = views[wanted];
        if (wanted === "closer") state.zoom = Math.min(200, state.zoom * 1.6);
        if (wanted === "farther") state.zoom = Math.max(0.3, state.zoom / 1.6);
        if (wanted === "all") state.zoom = 1;
        paint();
      });
    }
    new ResizeObserver(paint).observe(canvas);
    for (const name of ["beforeprint", "afterprint"]) window.addEventListener(name, paint);
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", paint);
    paint();
  }

  let markRun = () => {};

  // A click near a path picks its run, which is told by the event "pickrun"; `markRun` shows the picked run.
  function pickable(canvas, data, state, paint) {
    let begin = null;
    canvas.addEventListener("pointerdown", (event) => { begin = [event.clientX, event.clientY]; });
    canvas.addEventListener("click", (event) => {
      if (!begin || Math.hypot(event.clientX - begin[0], event.clientY - begin[1]) > 5 || !state.project) return;
      const bounds = canvas.getBoundingClientRect();
      const [x, y] = [event.clientX - bounds.left, event.clientY - bounds.top];
      let best = [12, null];
      for (const path of data.paths) for (let i = 0; i < path.points.length; i += 3) {
        const [px, py] = state.project(path.points.slice(i, i + 3));
        const far = Math.hypot(px - x, py - y);
        if (far < best[0]) best = [far, path.run];
      }
      if (best[1] !== null) canvas.dispatchEvent(new CustomEvent("pickrun", { detail: best[1] }));
    });
    markRun = (run) => { state.picked = run; paint(); };
  }

  // Largest distance from the target of any path, so that all fit; `reach_m` where a few of them lead far away.
  function extent(data) {
    let most = data.keep_out_m || 1;
    if (data.reach_m) return Math.max(most, data.reach_m);
    for (const path of data.paths) for (let i = 0; i < path.points.length; i += 3) most = Math.max(most, Math.hypot(path.points[i], path.points[i + 1], path.points[i + 2]));
    return most;
  }

  function triangles(mesh) {
    if (!mesh) return [];
    const corner = (number) => mesh.corners.slice(3 * number, 3 * number + 3);
    const found = [];
    for (let i = 0; i < mesh.triangles.length; i += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => corner(mesh.triangles[i + k]));
      const [u, v] = [[b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]];
      const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      const size = Math.hypot(...normal) || 1;
      found.push({ corners: [a, b, c], normal: normal.map((one) => one / size) });
    }
    return found;
  }

  // Orthographic: directions to the right, up and towards the viewer. Without a turn the orbit plane is seen from its
  // south, y to the right and x up; `pitch` leans the view, `yaw` turns it about the radial axis.
  function camera({ yaw, pitch }) {
    const [sy, cy, sp, cp] = [Math.sin(yaw), Math.cos(yaw), Math.sin(pitch), Math.cos(pitch)];
    return { right: [0, cy, -sy], up: [cp, -sy * sp, -cy * sp], forward: [-sp, -sy * cp, -cy * cp] };
  }

  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  // A cleared canvas in pixels of the page: its pen, its size and the colours of its style; null while it is folded.
  function blank(canvas) {
    const ratio = Math.min(3, (window.devicePixelRatio || 1) * (window.matchMedia("print").matches ? 2 : 1));
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !height) return null;
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const pen = canvas.getContext("2d");
    const style = getComputedStyle(canvas);
    pen.scale(ratio, ratio);
    pen.lineJoin = "round";
    pen.font = "12px system-ui, sans-serif";
    return { pen, width, height, named: (name) => style.getPropertyValue(name).trim() };
  }

  function draw(canvas, data, target, reach, state) {
    const sheet = blank(canvas);
    if (!sheet) return;
    const { pen, width, height, named } = sheet;
    const view = camera(state);
    const length = 0.35 * reach;
    const shown = bounds(data, view, length);
    const scale = state.zoom * Math.min((width - 90) / shown.width, (height - 70) / shown.height);
    const [across, high] = state.zoom > 1.01 ? [0, 0] : shown.center;
    const project = (p) => [
      width / 2 + scale * (dot(view.right, p) - across), height / 2 - scale * (dot(view.up, p) - high), dot(view.forward, p)];
    drawAxes(pen, project, length / state.zoom, named);
    for (const radius of data.spheres_m) if (radius) drawZone(pen, project, view, [radius, radius, radius], scale, named);
    for (const path of data.paths.filter((one) => one.kind === "other")) drawPath(pen, project, path, named);
    drawTarget(pen, project, target, view, named);
    for (const path of data.paths.filter((one) => one.kind !== "other")) drawPath(pen, project, path, named);
    for (const path of data.paths.filter((one) => one.run === state.picked)) drawPath(pen, project, { ...path, kind: "picked" }, named);
    state.project = project;
    pen.fillStyle = named("--muted");
    if (data.beyond) pen.fillText(data.beyond, 14, 18);
    for (const place of data.desired) mark(pen, project(place), named("--green"), `desired, ${away(place)}`);
    for (const path of data.paths.filter((one) => one.kind === "median" && one.points.length)) {
      const start = path.points.slice(0, 3);
      const [x, y] = project(start);
      pen.fillStyle = named("--blue");
      label(pen, `start, ${away(start)}`, x - 30, y - 8);
    }
    drawScale(pen, scale, height, named);
  }

  // Distance of a place from the target, as text.
  const away = (place) => `${Number(Math.hypot(...place).toPrecision(2))} m`;

  // Size and middle of everything shown, axes of a length included, as this view has it, so that the picture is full.
  function bounds(data, view, length) {
    const radius = data.keep_out_m || 1;
    const low = [-radius, -radius];
    const high = [radius, radius];
    const include = (point) => [view.right, view.up].forEach((direction, k) => {
      low[k] = Math.min(low[k], dot(direction, point));
      high[k] = Math.max(high[k], dot(direction, point));
    });
    for (const [, direction] of axes) include(direction.map((one) => one * length));
    const near = (point) => !data.reach_m || Math.hypot(...point) <= data.reach_m;
    for (const path of data.paths) for (let i = 0; i < path.points.length; i += 3) {
      const point = path.points.slice(i, i + 3);
      if (near(point)) include(point);
    }
    return { width: high[0] - low[0], height: high[1] - low[1], center: [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2] };
  }

  function drawAxes(pen, project, length, named) {
    pen.strokeStyle = named("--muted");
    pen.fillStyle = named("--muted");
    pen.lineWidth = 1;
    for (const [name, direction] of axes) {
      const [a, b] = [project([0, 0, 0]), project(direction.map((one) => one * length))];
      pen.beginPath();
      pen.moveTo(a[0], a[1]);
      pen.lineTo(b[0], b[1]);
      pen.stroke();
      if (Math.hypot(b[0] - a[0], b[1] - a[1]) > 24) label(pen, name, b[0] + 4, b[1] - 4);
    }
  }

  // Text that ends inside of the picture.
  function label(pen, text, x, y) {
    pen.fillText(text, Math.max(4, Math.min(x, pen.canvas.clientWidth - pen.measureText(text).width - 4)), Math.max(12, y));
  }

  // Ellipsoid along the axes: its outline, which is an ellipse in every view, and its three principal ellipses.
  function drawZone(pen, project, view, radii, scale, named) {
    const [x, y] = project([0, 0, 0]);
    const spread = (a, b) => radii.reduce((sum, radius, k) => sum + radius * radius * a[k] * b[k], 0);
    const [across, mixed, high] = [spread(view.right, view.right), spread(view.right, view.up), spread(view.up, view.up)];
    const [middle, half] = [0.5 * (across + high), Math.hypot(0.5 * (across - high), mixed)];
    const [long, short] = [Math.sqrt(middle + half), Math.sqrt(Math.max(0, middle - half))];
    pen.strokeStyle = named("--alert");
    pen.fillStyle = named("--alert");
    pen.lineWidth = 1;
    pen.globalAlpha = 0.1;
    pen.beginPath();
    pen.ellipse(x, y, long * scale, short * scale, -0.5 * Math.atan2(2 * mixed, across - high), 0, 2 * Math.PI);
    pen.fill();
    pen.globalAlpha = 0.8;
    pen.stroke();
    pen.globalAlpha = 0.35;
    for (const [i, j] of [[0, 1], [1, 2], [0, 2]]) {
      pen.beginPath();
      for (let step = 0; step <= 48; step += 1) {
        const p = [0, 0, 0];
        p[i] = radii[i] * Math.cos((step * Math.PI) / 24);
        p[j] = radii[j] * Math.sin((step * Math.PI) / 24);
        const [px, py] = project(p);
        if (step) pen.lineTo(px, py); else pen.moveTo(px, py);
      }
      pen.stroke();
    }
    pen.globalAlpha = 1;
    const size = [...new Set(radii)].join(" × ");
    if (short * scale > 30) label(pen, `keep-out ${size} m`, x + 0.72 * short * scale, y - 0.72 * short * scale - 3);
  }

  function drawTarget(pen, project, target, view, named) {
    const light = [0.5, 0.3, 0.81];
    const facing = target.filter((one) => dot(one.normal, view.forward) > 0).map((one) => {
      const corners = one.corners.map(project);
      return { corners, depth: corners[0][2] + corners[1][2] + corners[2][2], shade: 0.45 + 0.5 * Math.max(0, dot(one.normal, light)) };
    });
    facing.sort((a, b) => a.depth - b.depth);
    for (const { corners, shade } of facing) {
      pen.fillStyle = `hsl(42 40% ${Math.round(30 + 50 * shade)}%)`;
      pen.strokeStyle = pen.fillStyle;
      pen.lineWidth = 0.6;
      pen.beginPath();
      corners.forEach(([x, y], index) => (index ? pen.lineTo(x, y) : pen.moveTo(x, y)));
      pen.closePath();
      pen.fill();
      pen.stroke();
    }
    if (!target.length) mark(pen, project([0, 0, 0]), named("--ink"), "target");
  }

  function drawPath(pen, project, path, named) {
    pen.strokeStyle = named(tone[path.kind]);
    pen.globalAlpha = path.kind === "other" ? 0.45 : 1;
    pen.lineWidth = { other: 1, worst: 1.5, median: 2.4, picked: 3.2 }[path.kind];
    pen.beginPath();
    let end = null;
    for (let i = 0; i < path.points.length; i += 3) {
      end = project(path.points.slice(i, i + 3));
      if (i) pen.lineTo(end[0], end[1]); else pen.moveTo(end[0], end[1]);
    }
    pen.stroke();
    if (end && path.kind !== "other") {
      const first = project(path.points.slice(0, 3));
      pen.fillStyle = pen.strokeStyle;
      pen.beginPath();
      pen.arc(first[0], first[1], 4, 0, 2 * Math.PI);
      pen.fill();
      pen.fillRect(end[0] - 4, end[1] - 4, 8, 8);
    }
    pen.globalAlpha = 1;
  }

  function mark(pen, [x, y], color, text) {
    pen.strokeStyle = color;
    pen.fillStyle = color;
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(x - 5, y);
    pen.lineTo(x + 5, y);
    pen.moveTo(x, y - 5);
    pen.lineTo(x, y + 5);
    pen.stroke();
    pen.fillText(text, x + 8, y + 12);
  }

  function drawScale(pen, scale, height, named) {
    const rough = 90 / scale;
    const power = 10 ** Math.floor(Math.log10(rough));
    const length = [1, 2, 5, 10].map((one) => one * power).filter((one) => one <= rough * 1.01).pop() || power;
    pen.strokeStyle = named("--ink");
    pen.fillStyle = named("--ink");
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(14, height - 16);
    pen.lineTo(14 + length * scale, height - 16);
    pen.stroke();
    pen.fillText(`${Number(length.toPrecision(3))} m`, 14, height - 22);
  }

  function drag(canvas, state, paint) {
    let last = null;
    const turn = (across, up) => {
      state.yaw += across;
      state.pitch = Math.max(-1.57, Math.min(1.57, state.pitch + up));
      paint();
    };
    canvas.addEventListener("pointerdown", (event) => {
      last = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!last) return;
      const [dx, dy] = [event.clientX - last[0], event.clientY - last[1]];
      last = [event.clientX, event.clientY];
      turn(dx * 0.008, dy * 0.008);
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { last = null; });
    canvas.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
      if (step) { turn(...step); event.preventDefault(); }
      if (event.key === "+" || event.key === "-") { state.zoom *= event.key === "+" ? 1.25 : 0.8; paint(); }
    });
  }

  return { start, markRun: (run) => markRun(run), blank, views, camera, dot, triangles, drawAxes, drawZone, drawScale, label, mark, drag };
})();
