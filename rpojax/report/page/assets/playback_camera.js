// What the camera of a servicer sees at an instant: the target in its light, and boxes, in the frame and close up.
(() => {
  "use strict";
  const { dot } = Scene;
  const NEAREST_M = 0.1;
  // Of the shade, in the Earth's shadow and what sunlight adds to it, so that the outline can be made out.
  const [DARKEST, SCATTERED] = [0.05, 0.1];
  const tones = { outline: "#e8edf3", accepted: "#2fd6a3", rejected: "#ff8a3d", false: "#ff6fae", expected: "#6cb8ff", landmark: "#ffe14d" };
  const places = { frame: document.getElementById("play-frame"), close: document.getElementById("play-close") };
  if (!places.frame) return;

  const unit = (v) => v.map((one) => one / Math.hypot(...v));

  // Triangles that face the camera, in pixels, the farthest first.
  function projected(run, seen, one) {
    if (!one.body || !one.camera) return [];
    const { R_KB: R, focal, width, height } = one.camera;
    const rows = [0, 3, 6].map((k) => Playback.turned(one.body, [R[k], R[k + 1], R[k + 2]]));
    const found = [];
    for (const { normal, corners } of run.triangles) {
      const out = Playback.turned(seen.target, normal);
      const lines = corners.map((corner) => Playback.turned(seen.target, corner).map((value, k) => value - one.place[k]));
      if (dot(out, lines[0]) >= 0) continue;
      const inCamera = lines.map((line) => rows.map((row) => dot(row, line)));
      if (inCamera.some(([, , depth]) => depth < NEAREST_M)) continue;
      const lit = seen.light * Math.max(0, seen.sun ? dot(out, seen.sun) : 0.7);
      found.push({
        points: inCamera.map(([x, y, depth]) => [0.5 * width + (focal * x) / depth, 0.5 * height + (focal * y) / depth]),
        depth: inCamera[0][2] + inCamera[1][2] + inCamera[2][2],
        shade: DARKEST + SCATTERED * seen.light * (0.4 - 0.6 * dot(out, unit(lines[0]))) + (1 - DARKEST - SCATTERED) * lit,
      });
    }
    return found.sort((a, b) => b.depth - a.depth);
  }

  // Boxes as left, top, width, height, with what they are.
  function boxesOf(one) {
    const boxes = [];
    const row = (name) => { const found = one.row(name); return found && found.every(Number.isFinite) ? found : null; };
    const [outline, box, expected, gate] = ["outline_px", "box_px", "expected_px", "gate_px"].map(row);
    if (outline) boxes.push({ box: outline, tone: tones.outline, dash: [5, 3], text: "true" });
    if (expected) {
      const [x, y, side] = expected;
      boxes.push({ box: [x - side / 2, y - side / 2, side, side], tone: tones.expected, dash: [2, 2], text: "expected" });
      if (gate) boxes.push({ box: [x - gate[0], y - gate[1], 2 * gate[0], 2 * gate[1]], tone: tones.expected, dash: [], text: "gate", cross: true });
    }
    if (box && one.flag.box_present) {
      const kind = one.flag.box_outlier ? "false" : one.flag.box_accepted ? "accepted" : "rejected";
      boxes.push({ box, tone: tones[kind], dash: [], text: Playback.boxWords(one.flag)[0], wide: 2 });
    }
    return boxes;
  }

  // Places in the frame of the landmarks that were found.
  function landmarksOf(one) {
    const numbers = one.row("landmarks_px") || [];
    const found = [];
    for (let i = 0; i < numbers.length; i += 2) if (Number.isFinite(numbers[i])) found.push([numbers[i], numbers[i + 1]]);
    return found;
  }

  // Left, top, right and bottom of the projected target.
  function extent(faces) {
    const points = faces.flatMap((face) => face.points);
    return points.reduce(([left, top, right, low], [x, y]) => [Math.min(left, x), Math.min(top, y), Math.max(right, x), Math.max(low, y)], [Infinity, Infinity, -Infinity, -Infinity]);
  }

  // Close-up: a square around the target, or else around the expected or the measured box.
  function closeWindow(one, faces) {
    let [left, top, right, low] = extent(faces);
    if (!faces.length) {
      const around = boxesOf(one).reverse().find(({ text }) => text !== "gate");
      if (!around) return { left: 0, top: 0, side: Math.max(one.camera.width, one.camera.height) };
      [left, top, right, low] = [around.box[0], around.box[1], around.box[0] + around.box[2], around.box[1] + around.box[3]];
    }
    const side = Math.max(1.8 * Math.max(right - left, low - top), 8);
    return { left: (left + right - side) / 2, top: (top + low - side) / 2, side };
  }

  function whereabouts(one, faces) {
    if (!one.body) return "no attitudes were recorded";
    if (!faces.length) return "the target is behind the camera";
    const [left, top, right, low] = extent(faces);
    if (right < 0 || low < 0 || left > one.camera.width || top > one.camera.height) return "outside of the frame";
    return "";
  }

  function draw(canvas, one, faces, window_, shape, close) {
    const ratio = Math.min(3, (window.devicePixelRatio || 1) * (window.matchMedia("print").matches ? 2 : 1));
    canvas.style.aspectRatio = String(shape);
    const [width, height] = [canvas.clientWidth, canvas.clientWidth / shape];
    if (!width) return;
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    pen.fillStyle = "#07090d";
    pen.fillRect(0, 0, width, height);
    const scale = width / window_.side;
    const to = ([x, y]) => [(x - window_.left) * scale, (y - window_.top) * scale];
    for (const { points, shade } of faces) {
      const tone = `hsl(42 ${Math.round(10 + 30 * shade)}% ${Math.round(4 + 72 * shade)}%)`;
      Object.assign(pen, { fillStyle: tone, strokeStyle: tone, lineWidth: 0.6 });
      pen.beginPath();
      points.map(to).forEach(([x, y], index) => (index ? pen.lineTo(x, y) : pen.moveTo(x, y)));
      pen.closePath();
      pen.fill();
      pen.stroke();
    }
    pen.font = "11px system-ui, sans-serif";
    const [frameLeft, frameTop] = to([0, 0]);
    pen.strokeStyle = "#5f6b7c";
    pen.lineWidth = 1.5;
    pen.strokeRect(frameLeft, frameTop, one.camera.width * scale, one.camera.height * scale);
    boxesOf(one).forEach((each, index) => drawBox(pen, each, to, scale, close, index, width));
    pen.strokeStyle = tones.landmark;
    pen.lineWidth = 1.4;
    for (const [x, y] of landmarksOf(one).map(to)) {
      pen.beginPath();
      pen.arc(x, y, close ? 4 : 2, 0, 2 * Math.PI);
      pen.stroke();
    }
    pen.fillStyle = "#aeb8c6";
    pen.textAlign = "center";
    pen.fillText(whereabouts(one, faces), width / 2, height - 12);
    pen.textAlign = "left";
    if (close) drawPixels(pen, scale, width, height);
  }

  function drawBox(pen, { box, tone, dash, text, wide = 1.2, cross }, to, scale, close, index, width) {
    const [x, y] = to(box);
    const [w, h] = [box[2] * scale, box[3] * scale];
    pen.strokeStyle = tone;
    pen.fillStyle = tone;
    pen.lineWidth = wide;
    pen.setLineDash(dash);
    pen.strokeRect(x, y, w, h);
    pen.setLineDash([]);
    if (cross) {
      const [cx, cy] = [x + w / 2, y + h / 2];
      for (const [dx, dy] of [[5, 0], [0, 5]]) {
        pen.beginPath();
        pen.moveTo(cx - dx, cy - dy);
        pen.lineTo(cx + dx, cy + dy);
        pen.stroke();
      }
    }
    // Labels of the close-up stand in its corners, where they do not cover each other.
    if (!close) return;
    const right = index % 2 === 1;
    pen.textAlign = right ? "right" : "left";
    pen.fillText(text, right ? width - 8 : 8, 16 + 14 * (index >> 1));
    pen.textAlign = "left";
  }

  function drawPixels(pen, scale, width, height) {
    const length = [1, 2, 5, 10, 20, 50, 100, 200, 500].filter((one) => one * scale < 0.3 * width).pop() || 1;
    pen.strokeStyle = "#aeb8c6";
    pen.fillStyle = "#aeb8c6";
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(8, height - 8);
    pen.lineTo(8 + length * scale, height - 8);
    pen.stroke();
    pen.fillText(`${length} px`, 8, height - 13);
  }

  let latest = null;
  function paint(run, seen, chosen) {
    latest = [run, seen, chosen];
    const one = seen.servicers[chosen];
    if (!one.camera) return;
    const faces = projected(run, seen, one);
    const { width, height } = one.camera;
    const margin = 0.02 * width;
    draw(places.frame, one, faces, { left: -margin, top: -margin, side: width + 2 * margin }, (width + 2 * margin) / (height + 2 * margin), false);
    draw(places.close, one, faces, closeWindow(one, faces), 1, true);
  }

  const again = () => { if (latest) paint(...latest); };
  for (const place of Object.values(places)) new ResizeObserver(again).observe(place);
  for (const name of ["beforeprint", "afterprint"]) window.addEventListener(name, again);
  Playback.onMove(paint);
})();
