// The 3-D view of a playback: target in its attitude and light, servicers with axes, camera and burns, ways, zones.
(() => {
  "use strict";
  const { dot } = Scene;
  const canvas = document.getElementById("play-scene");
  if (!canvas) return;
  const view = { yaw: 0.6, pitch: 0.35, zoom: 1, fit: "path" };
  const LEAST_TARGET_PX = 20;
  const LEAST_SERVICER_PX = 6;
  const AMBIENT = 0.3;
  const WAY_POINTS = 700;
  const faces = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
  let ways = null;
  let latest = null;

  const plus = (a, b, factor = 1) => a.map((value, k) => value + factor * b[k]);

  // Places and zones of each servicer at frames of equal distance.
  function waysOf(run) {
    const stride = Math.max(1, Math.ceil(run.time.count / WAY_POINTS));
    return run.servicers.map(({ arrays, zones }) => {
      const at = (frame) => ({ frame, place: arrays.rho_H.row(frame), zone: Playback.zoneOf({ zones, phase: arrays.phase && arrays.phase.numbers[frame] }) });
      const way = [];
      for (let frame = 0; frame < run.time.count; frame += stride) way.push(at(frame));
      way.push(at(run.time.count - 1));
      return way;
    });
  }

  // Scale and middle of the picture: all ways and zones, the servicers of the present instant, or the target alone.
  function fitted(run, seen, eye, width, height) {
    const [low, high] = [[Infinity, Infinity], [-Infinity, -Infinity]];
    const include = (point, around = 0) => [eye.right, eye.up].forEach((direction, k) => {
      const at = dot(direction, point);
      low[k] = Math.min(low[k], at - around);
      high[k] = Math.max(high[k], at + around);
    });
    include([0, 0, 0], (view.fit === "target" ? 1.5 : 1.1) * run.radius);
    if (view.fit === "path") {
      include([0, 0, 0], run.keep_out || 0);
      for (const way of ways) for (const { place } of way) include(place);
    }
    if (view.fit === "now") for (const one of seen.servicers) include(one.place, 2 * (one.side_m || 0.5));
    const size = [high[0] - low[0], high[1] - low[1]].map((one) => Math.max(one, 1e-3));
    const scale = view.zoom * Math.min((width - 90) / size[0], (height - 80) / size[1]);
    const middle = view.zoom > 1.01 && view.fit === "path" ? [0, 0] : [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
    return { scale, middle };
  }

  function paint(run, seen) {
    latest = [run, seen];
    ways = ways || waysOf(run);
    const sheet = Scene.blank(canvas);
    if (!sheet) return;
    const { pen, width, height, named } = sheet;
    const eye = Scene.camera(view);
    const { scale, middle } = fitted(run, seen, eye, width, height);
    const project = (p) => [width / 2 + scale * (dot(eye.right, p) - middle[0]), height / 2 - scale * (dot(eye.up, p) - middle[1]), dot(eye.forward, p)];
    const picture = { pen, project, eye, scale, named, width, height };
    Scene.drawAxes(pen, project, (0.32 * Math.min(width, height)) / scale, named);
    for (const zone of zonesOf(run, seen)) drawZones(picture, zone, seen, run);
    drawWays(picture, run, seen, (depth) => depth < 0);
    const larger = { target: magnified(picture, run), servicer: 1 };
    const bodies = seen.servicers.map((one) => ({ depth: dot(eye.forward, one.place), draw: () => { larger.servicer = drawServicer(picture, one); } }));
    bodies.push({ depth: 0, draw: () => drawTarget(picture, run, seen, larger.target) });
    bodies.sort((a, b) => a.depth - b.depth).forEach((one) => one.draw());
    drawWays(picture, run, seen, (depth) => depth >= 0);
    const believed = seen.servicers.filter((one) => one.believed);
    if (believed.length) drawTargetAxes(picture, run, seen.target, larger.target, null);
    for (const one of believed) drawTargetAxes(picture, run, one.believed, larger.target, one);
    for (const one of seen.servicers) {
      drawEstimate(picture, one);
      const desired = one.row("rho_desired_H") || one.desired;
      if (desired) Scene.mark(pen, project(desired), named("--green"), seen.servicers.length === 1 ? "desired" : "");
    }
    drawSun(picture, seen);
    Scene.drawScale(pen, scale, height, named);
    note(larger, seen.servicers.length);
  }

  // Zones that are in force for any servicer, each once.
  function zonesOf(run, seen) {
    const found = seen.servicers.map(Playback.zoneOf).filter(Boolean);
    if (!found.length && run.keep_out) found.push({ keep_out: [run.keep_out, run.keep_out, run.keep_out], corridor: null });
    return [...new Map(found.map((zone) => [JSON.stringify(zone), zone])).values()];
  }

  // How far along a corridor the servicers come; of one that turns, how far from the target while it is in force.
  function lengthOf({ axis, turns }) {
    const same = (zone) => zone && zone.corridor && zone.corridor.turns && zone.corridor.axis.every((one, k) => one === axis[k]);
    const reached = turns
      ? ways.flat().filter(({ zone }) => same(zone)).map(({ place }) => Math.hypot(...place))
      : ways.flat().map(({ place }) => dot(place, axis));
    return 1.05 * Math.max(...reached, 1);
  }

  function drawZones({ pen, project, eye, scale, named }, { keep_out: radii, corridor }, seen, run) {
    if (Math.max(...radii) > 0) Scene.drawZone(pen, project, eye, radii, scale, named);
    const axis = corridor && Playback.axisOf(corridor, run, seen);
    if (!axis) return;
    const { slope, width } = corridor;
    const length = lengthOf(corridor);
    const aside = Math.abs(axis[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
    const first = plus(aside, axis, -dot(aside, axis)).map((one, _, all) => one / Math.hypot(...all));
    const second = [axis[1] * first[2] - axis[2] * first[1], axis[2] * first[0] - axis[0] * first[2], axis[0] * first[1] - axis[1] * first[0]];
    const rim = (ahead, angle) => {
      const radius = width + ahead * slope;
      return project(plus(plus(axis.map((one) => one * ahead), first, radius * Math.cos(angle)), second, radius * Math.sin(angle)));
    };
    pen.strokeStyle = named("--good");
    pen.fillStyle = named("--good");
    pen.lineWidth = 1;
    pen.globalAlpha = 0.55;
    for (let side = 0; side < 12; side += 1) stroke(pen, [rim(0, (side * Math.PI) / 6), rim(length, (side * Math.PI) / 6)]);
    for (const share of [0, 0.25, 0.5, 0.75, 1]) {
      stroke(pen, Array.from({ length: 37 }, (_, step) => rim(share * length, (step * Math.PI) / 18)));
    }
    pen.globalAlpha = 1;
    const label = rim(0.55 * length, Math.PI / 3);
    pen.fillText("corridor", label[0] + 4, label[1] - 6);
  }

  function stroke(pen, points) {
    pen.beginPath();
    points.forEach(([x, y], index) => (index ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
  }

  // Ways so far in full colour, ways to come pale, of the parts before or behind the target.
  function drawWays({ pen, project, named }, run, seen, wanted) {
    seen.servicers.forEach((one, number) => {
      const past = ways[number].filter(({ frame }) => frame <= seen.now.frame).map(({ place }) => place);
      const coming = ways[number].filter(({ frame }) => frame > seen.now.frame).map(({ place }) => place);
      pen.strokeStyle = named(one.tone);
      for (const [places, alpha, wide, dash] of [[[one.place, ...coming], 0.45, 1.2, [3, 4]], [[...past, one.place], 1, 2.2, []]]) {
        pen.globalAlpha = alpha;
        pen.lineWidth = wide;
        pen.setLineDash(dash);
        let part = [];
        for (const place of [...places.map(project), null]) {
          if (place && wanted(place[2])) { part.push(place); continue; }
          if (place && part.length) part.push(place);
          if (part.length > 1) stroke(pen, part);
          part = [];
        }
      }
      pen.setLineDash([]);
      pen.globalAlpha = 1;
    });
  }

  // Where the flight software believes to be, once that is apart from the truth in this picture.
  function drawEstimate({ pen, project, named }, one) {
    const offset = one.row("estimate_offset_H");
    if (!offset) return;
    const [[x, y], [a, b]] = [project(one.place), project(plus(one.place, offset))];
    if (!(Math.hypot(a - x, b - y) > 5)) return;
    pen.strokeStyle = named(one.tone);
    pen.fillStyle = named("--muted");
    pen.lineWidth = 1.4;
    stroke(pen, [[a, b - 6], [a + 6, b], [a, b + 6], [a - 6, b], [a, b - 6]]);
    Scene.label(pen, "estimate", a + 9, b + 4);
  }

  // Axes of the target: the true ones thin, those by the estimate of a servicer dashed and longer.
  function drawTargetAxes({ pen, project, named }, run, columns, larger, servicer) {
    const length = (servicer ? 1.9 : 1.5) * larger * run.radius;
    const middle = project([0, 0, 0]);
    pen.lineWidth = servicer ? 2 : 1.4;
    pen.setLineDash(servicer ? [6, 4] : []);
    ["--alert", "--good", "--accent"].forEach((hue, k) => {
      const tip = project(columns[k].map((value) => value * length));
      pen.strokeStyle = named(hue);
      pen.fillStyle = named(hue);
      stroke(pen, [middle, tip]);
      if (!servicer && Math.hypot(tip[0] - middle[0], tip[1] - middle[1]) > 14) pen.fillText(`${"xyz"[k]} of T`, tip[0] + 3, tip[1] - 3);
    });
    pen.setLineDash([]);
  }

  // Never so large that the target would fill its keep-out zone.
  const magnified = ({ scale }, run) => Math.max(1, Math.min(LEAST_TARGET_PX / (run.radius * scale), (0.6 * (run.keep_out || Infinity)) / run.radius));

  function drawTarget({ pen, project, eye, named }, run, seen, larger) {
    if (!run.triangles.length) return Scene.mark(pen, project([0, 0, 0]), named("--ink"), "target");
    const sun = seen.sun || [0.5, 0.3, 0.81];
    const facing = [];
    for (const { normal, corners } of run.triangles) {
      const out = Playback.turned(seen.target, normal);
      if (dot(out, eye.forward) <= 0) continue;
      const placed = corners.map((corner) => project(Playback.turned(seen.target, corner).map((one) => larger * one)));
      // Faces in the shade are told apart by a faint light from where the viewer stands.
      const faint = AMBIENT * (0.45 + 0.55 * dot(out, eye.forward));
      facing.push({ placed, depth: placed[0][2] + placed[1][2] + placed[2][2], shade: faint + (1 - AMBIENT) * seen.light * Math.max(0, dot(out, sun)) });
    }
    facing.sort((a, b) => a.depth - b.depth);
    for (const { placed, shade } of facing) fillFace(pen, placed, `hsl(42 ${Math.round(28 + 14 * seen.light)}% ${Math.round(8 + 62 * shade)}%)`);
  }

  function fillFace(pen, points, tone) {
    pen.fillStyle = tone;
    pen.strokeStyle = tone;
    pen.lineWidth = 0.6;
    pen.beginPath();
    points.forEach(([x, y], index) => (index ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.closePath();
    pen.fill();
    pen.stroke();
  }

  // A cube of the servicer's cross-section, its axes, its camera's pyramid as far as the target, and its burn.
  function drawServicer({ pen, project, eye, scale, named }, one) {
    const half = 0.5 * (one.side_m || 0.5);
    const larger = Math.max(1, LEAST_SERVICER_PX / (half * scale));
    const reach = half * larger;
    const [x, y] = project(one.place);
    const tone = named(one.tone);
    if (!one.body) {
      pen.fillStyle = tone;
      pen.fillRect(x - 5, y - 5, 10, 10);
    } else {
      const at = (v) => project(plus(one.place, Playback.turned(one.body, v)));
      if (one.camera) drawCamera(pen, at, one, tone);
      if (one.flag.burning && one.thrust_B) drawBurn(pen, at, one.thrust_B, reach, named);
      for (const normal of faces) {
        const out = Playback.turned(one.body, normal);
        const lean = dot(out, eye.forward);
        if (lean <= 0) continue;
        const [u, v] = normal[0] ? [[0, 1, 0], [0, 0, 1]] : normal[1] ? [[1, 0, 0], [0, 0, 1]] : [[1, 0, 0], [0, 1, 0]];
        const corners = [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([a, b]) => at([0, 1, 2].map((k) => reach * (normal[k] + a * u[k] + b * v[k]))));
        fillFace(pen, corners, `color-mix(in srgb, ${tone} ${Math.round(35 + 60 * lean)}%, black)`);
      }
      for (const [name, axis, hue] of [["x", [1, 0, 0], "--alert"], ["y", [0, 1, 0], "--good"], ["z", [0, 0, 1], "--accent"]]) {
        const tip = at(axis.map((value) => 3 * reach * value));
        pen.strokeStyle = named(hue);
        pen.fillStyle = named(hue);
        pen.lineWidth = 1.6;
        stroke(pen, [[x, y], tip]);
        if (Math.hypot(tip[0] - x, tip[1] - y) > 9) pen.fillText(name, tip[0] + 2, tip[1] - 2);
      }
    }
    pen.fillStyle = tone;
    if (one.name) pen.fillText(one.name, x + 9 + reach * scale, y + 4);
    return larger;
  }

  function drawCamera(pen, at, { camera, place }, tone) {
    const depth = Math.hypot(...place);
    const { R_KB: R } = camera;
    const ray = (u, v) => at([0, 1, 2].map((k) => depth * (R[k] * u + R[3 + k] * v + R[6 + k])));
    const [u, v] = [(0.5 * camera.width) / camera.focal, (0.5 * camera.height) / camera.focal];
    const rim = [[-u, -v], [u, -v], [u, v], [-u, v]].map(([a, b]) => ray(a, b));
    const tip = at([0, 0, 0]);
    pen.fillStyle = tone;
    pen.strokeStyle = tone;
    pen.lineWidth = 0.8;
    pen.globalAlpha = 0.07;
    for (let side = 0; side < 4; side += 1) {
      pen.beginPath();
      [tip, rim[side], rim[(side + 1) % 4]].forEach(([a, b], index) => (index ? pen.lineTo(a, b) : pen.moveTo(a, b)));
      pen.fill();
    }
    pen.globalAlpha = 0.6;
    for (const corner of rim) stroke(pen, [tip, corner]);
    stroke(pen, [...rim, rim[0]]);
    pen.globalAlpha = 1;
  }

  function drawBurn(pen, at, thrust, reach, named) {
    const [tail, tip] = [at(thrust.map((one) => -4.5 * reach * one)), at(thrust.map((one) => 6 * reach * one))];
    const base = at([0, 0, 0]);
    const [dx, dy] = [tip[0] - base[0], tip[1] - base[1]];
    const long = Math.hypot(dx, dy) || 1;
    pen.fillStyle = named("--orange");
    pen.globalAlpha = 0.6;
    pen.beginPath();
    pen.moveTo(base[0], base[1]);
    pen.lineTo(tail[0] - (6 * dy) / long, tail[1] + (6 * dx) / long);
    pen.lineTo(tail[0] + (6 * dy) / long, tail[1] - (6 * dx) / long);
    pen.fill();
    pen.globalAlpha = 1;
    pen.strokeStyle = named("--vermillion");
    pen.fillStyle = named("--vermillion");
    pen.lineWidth = 2.4;
    stroke(pen, [base, tip]);
    stroke(pen, [[tip[0] - (9 * dx - 5 * dy) / long, tip[1] - (9 * dy + 5 * dx) / long], tip, [tip[0] - (9 * dx + 5 * dy) / long, tip[1] - (9 * dy - 5 * dx) / long]]);
    pen.fillText("burn", tip[0] + 6, tip[1] - 5);
  }

  // The Sun stands at the edge of the picture in its direction, hollow while the Earth hides it.
  function drawSun({ pen, eye, named, width, height }, seen) {
    if (!seen.sun) return;
    const [across, up, ahead] = [dot(eye.right, seen.sun), dot(eye.up, seen.sun), dot(eye.forward, seen.sun)];
    const size = Math.hypot(across, up) || 1;
    const away = 1 / Math.hypot(across / size / (0.5 * width - 40), up / size / (0.5 * height - 44));
    const [x, y] = [width / 2 + (away * across) / size, height / 2 - (away * up) / size];
    pen.strokeStyle = named("--orange");
    pen.fillStyle = named("--orange");
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.arc(x, y, 7, 0, 2 * Math.PI);
    if (seen.light > 0.01) pen.fill();
    pen.stroke();
    for (let ray = 0; ray < 8 && seen.light > 0.01; ray += 1) {
      const [c, s] = [Math.cos((ray * Math.PI) / 4), Math.sin((ray * Math.PI) / 4)];
      stroke(pen, [[x + 10 * c, y + 10 * s], [x + 14 * c, y + 14 * s]]);
    }
    const where = Math.abs(ahead) < 0.5 ? "" : ahead > 0 ? ", towards you" : ", away from you";
    const text = seen.light > 0.01 ? `Sun${where}` : "Sun behind the Earth";
    Scene.label(pen, text, x - pen.measureText(text).width / 2, y + 27);
  }

  function note(larger, servicers) {
    const parts = [["target", larger.target], [servicers > 1 ? "servicers" : "servicer", larger.servicer]].filter(([, factor]) => factor > 1.05);
    const text = parts.map(([name, factor]) => `${name} ${Charts.number(factor, 2)} times`).join(", ");
    document.getElementById("play-scale").textContent = text ? `Drawn larger to be seen: ${text}.` : "All to scale.";
  }

  const again = () => { if (latest) paint(...latest); };
  Scene.drag(canvas, view, again);
  for (const button of document.querySelectorAll("[data-play-view]")) {
    button.addEventListener("click", () => {
      const wanted = button.dataset.playView;
      if (Scene.views[wanted]) [view.yaw, view.pitch] = Scene.views[wanted];
      else if (wanted === "closer" || wanted === "farther") view.zoom = Math.min(200, Math.max(0.3, view.zoom * (wanted === "closer" ? 1.6 : 0.625)));
      else [view.fit, view.zoom] = [wanted, 1];
      for (const one of document.querySelectorAll("[data-play-fit]")) one.setAttribute("aria-pressed", String(one.dataset.playView === view.fit));
      again();
    });
  }
  new ResizeObserver(again).observe(canvas);
  for (const name of ["beforeprint", "afterprint"]) window.addEventListener(name, again);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  Playback.onMove(paint);
})();
