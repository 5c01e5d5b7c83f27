// Playback of a run: its arrays, its clock and controls, and the words and numbers of the present instant.
const Playback = (() => {
  "use strict";
  const kinds = { float32: Float32Array, uint8: Uint8Array, int16: Int16Array };
  const UNDEFINED = -32768;
  const speeds = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];
  const tones = ["--blue", "--purple", "--orange", "--green", "--vermillion", "--shade"];
  const listeners = [];

  // Rows of a packed array: `row(i)` has its components, NaN where undefined.
  function unpack({ kind, size, data, low, step }) {
    const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
    const numbers = new kinds[kind](bytes.buffer);
    const value = (code, k) => (low ? (code === UNDEFINED ? NaN : low[k] + step[k] * (code + 32767)) : code);
    return { count: numbers.length / size, row: (i) => Array.from(numbers.subarray(i * size, (i + 1) * size), value), numbers };
  }

  const unpackAll = (arrays) => Object.fromEntries(Object.entries(arrays).map(([name, packed]) => [name, unpack(packed)]));

  // Instant: the frame at or before a time, the one after it, and the share of the way between them.
  function instant(run, time) {
    const times = run.time.numbers;
    let [low, high] = [0, times.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= time + 1e-6 * run.tick) low = middle; else high = middle;
    }
    if (times[high] <= time + 1e-6 * run.tick) low = high;
    const next = Math.min(low + 1, times.length - 1);
    const part = next > low ? Math.min(1, Math.max(0, (time - times[low]) / (times[next] - times[low]))) : 0;
    return { time, frame: low, next, part };
  }

  function between(array, now) {
    const after = array.row(now.next);
    return array.row(now.frame).map((value, k) => value + now.part * (after[k] - value));
  }

  // Columns of the matrix that turns body components into those of Hill axes, from scalar-last quaternions.
  function axesOf(array, now) {
    const q = between(array, now);
    const size = Math.hypot(...q);
    const [x, y, z, w] = q.map((one) => one / size);
    return [
      [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
      [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
      [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
    ];
  }

  // Angle between two of those in degrees.
  function angleBetween(first, second) {
    const trace = first.reduce((sum, column, k) => sum + column.reduce((part, value, row) => part + value * second[k][row], 0), 0);
    return (180 / Math.PI) * Math.acos(Math.min(1, Math.max(-1, (trace - 1) / 2)));
  }

  const turned = (columns, v) => [0, 1, 2].map((k) => columns[0][k] * v[0] + columns[1][k] * v[1] + columns[2][k] * v[2]);

  function read(data) {
    const run = {
      ...data, modes: data.modes.map((mode) => mode.replace(/^pointing /, "")), time: unpack(data.time_s), tick: data.tick_s, scene: unpackAll(data.scene), triangles: Scene.triangles(data.target),
      servicers: data.servicers.map((one, index) => ({ ...one, arrays: unpackAll(one.arrays), tone: tones[index % tones.length] })),
    };
    run.last = run.time.numbers[run.time.count - 1];
    run.radius = Math.max(0.2, ...run.triangles.flatMap((one) => one.corners.map((corner) => Math.hypot(...corner))));
    return run;
  }

  // What holds at an instant: light, attitudes, places, flags, phase and mode.
  function sample(run, now) {
    const { q_HT, sun_H, light } = run.scene;
    return {
      now,
      target: q_HT ? axesOf(q_HT, now) : [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
      sun: sun_H ? between(sun_H, now) : null,
      light: light ? light.numbers[now.frame] / 255 : 1,
      servicers: run.servicers.map((one) => {
        const { arrays } = one;
        const bits = arrays.flags.numbers[now.frame];
        const flag = Object.fromEntries(run.flags.map((name, bit) => [name, Boolean((bits >> bit) & 1)]));
        const row = (name) => (arrays[name] ? arrays[name].row(now.frame) : null);
        // Of two lenses that of the frame.
        const camera = arrays.focal_px ? { ...one.camera, focal: row("focal_px")[0] } : one.camera;
        return {
          ...one, camera, flag, row, place: between(arrays.rho_H, now), body: arrays.q_HB ? axesOf(arrays.q_HB, now) : null,
          believed: run.scene.q_HT ? estimate(arrays.q_HT_estimate, now) : null,
          phase: arrays.phase ? arrays.phase.numbers[now.frame] : null, mode: arrays.mode ? arrays.mode.numbers[now.frame] : null,
        };
      }),
    };
  }

  // Axes of the target by a servicer's estimate; null without one, and before it is found.
  function estimate(array, now) {
    const found = array ? axesOf(array, now) : null;
    return found && found.flat().every(Number.isFinite) ? found : null;
  }

  const zoneOf = (one) => one.zones && one.zones[Math.min(one.phase || 0, one.zones.length - 1)];
  // Axis of a corridor in Hill axes; null of one that turns with a target whose attitude was not kept.
  const axisOf = (corridor, run, seen) => (corridor.turns ? run.scene.q_HT && turned(seen.target, corridor.axis) : corridor.axis) || null;
  const seconds = (time) => `${Number(time.toFixed(time % 1 ? 1 : 0))} s`;

  function boxWords(flag) {
    if (!flag.box_present) return ["none", ""];
    if (flag.box_outlier) return flag.box_accepted ? ["false, accepted", "alert"] : ["false, rejected", "good"];
    return flag.box_accepted ? ["accepted", "good"] : ["rejected", "open"];
  }

  function lightWords({ sun, light }) {
    if (!sun) return ["not recorded", ""];
    if (light > 0.99) return ["sunlit", "good"];
    return light < 0.01 ? ["Earth\u2019s shadow", "alert"] : [`penumbra, ${Math.round(100 * light)} % of the Sun`, "open"];
  }

  // Title, text and class of what is said of a servicer.
  function words(run, state, one) {
    const known = (name) => one.arrays[name] !== undefined;
    const value = (name, unit, digits = 4) => `${Charts.number(one.row(name)[0], digits)} ${unit}`;
    const lines = [["Range", `${Charts.number(Math.hypot(...one.row("rho_H")), 5)} m`, ""]];
    if (one.phase !== null && run.phases.length) lines.unshift(["Phase", run.phases[one.phase], one.phase >= run.phases.length - 1 ? "alert" : ""]);
    if (one.mode !== null) lines.push(["Pointing", run.modes[one.mode], one.flag.burning ? "alert" : ""]);
    lines.push(["Navigation", one.flag.nav_confident ? "confident" : "not confident", one.flag.nav_confident ? "good" : "alert"]);
    lines.push(["Light on the target", ...lightWords(state)]);
    lines.push(["Light for the camera", one.flag.observable ? "usable" : "not usable", one.flag.observable ? "good" : "open"]);
    lines.push(["Box", ...boxWords(one.flag)]);
    if (known("landmarks")) lines.push(["Landmarks found", String(one.row("landmarks")[0]), ""]);
    if (known("q_HT_estimate")) lines.push(["Attitude of the target", one.believed ? `known, off by ${Charts.number(angleBetween(one.believed, state.target), 3)}\u00b0` : "not known", one.believed ? "good" : "open"]);
    for (const [name, title, unit] of [
      ["formation_error_m", "Formation error", "m"], ["nav_relative_error_m", "Navigation error", "m"],
      ["pointing_error_deg", "Boresight off the target", "\u00b0"], ["delta_v_m_s", "Delta-v so far", "m/s"],
    ]) if (known(name)) lines.push([title, value(name, unit), ""]);
    return lines;
  }

  function showWords(run, state, chosen) {
    const place = document.getElementById("play-state");
    const lines = words(run, state, state.servicers[chosen]);
    while (place.children.length < lines.length) {
      const entry = place.appendChild(document.createElement("div"));
      entry.append(document.createElement("dt"), document.createElement("dd"));
    }
    lines.forEach(([title, text, tone], index) => {
      const [head, body] = place.children[index].children;
      if (head.textContent !== title) head.textContent = title;
      if (body.textContent !== text) body.textContent = text;
      body.className = tone;
    });
  }

  function start(data) {
    const slider = document.getElementById("play-slider");
    if (!data || !slider) return;
    const run = read(data);
    const state = { time: 0, playing: false, chosen: 0, speed: speeds.find((one) => one * 45 >= run.last) || speeds.at(-1), used: false };
    const button = document.getElementById("play-button");
    const speed = document.getElementById("play-speed");
    const pick = document.getElementById("play-servicer");
    let [clock, waiting] = [0, false];

    function show() {
      waiting = false;
      const seen = sample(run, instant(run, state.time));
      slider.value = state.time;
      const one = seen.servicers[state.chosen];
      const short = [one.phase !== null && run.phases[one.phase], one.mode !== null && run.modes[one.mode]].filter(Boolean).join(", ");
      document.getElementById("play-time").textContent = seconds(run.time.numbers[seen.now.frame]);
      document.getElementById("play-words").textContent = short;
      slider.setAttribute("aria-valuetext", `${seconds(state.time)}, ${short}`);
      showWords(run, seen, state.chosen);
      for (const paint of listeners) paint(run, seen, state.chosen);
    }
    // Once for all charts that are drawn in a row.
    const ask = () => { if (!waiting) { waiting = true; setTimeout(show, 0); } };

    function seek(time) {
      state.time = Math.min(run.last, Math.max(run.time.numbers[0], time));
      show();
    }

    function advance(stamp) {
      if (!state.playing) return;
      seek(state.time + state.speed * Math.min(0.25, (stamp - clock) / 1000));
      clock = stamp;
      if (state.time >= run.last) play(false); else requestAnimationFrame(advance);
    }

    function play(wanted) {
      state.playing = wanted;
      state.used = true;
      button.textContent = wanted ? "\u275a\u275a" : "\u25b6";
      button.setAttribute("aria-label", wanted ? "Pause" : "Play");
      if (!wanted) return;
      if (state.time >= run.last) state.time = run.time.numbers[0];
      clock = performance.now();
      requestAnimationFrame(advance);
    }

    Object.assign(slider, { min: run.time.numbers[0], max: run.last, step: "any" });
    slider.addEventListener("input", () => { play(false); seek(Number(slider.value)); });
    button.addEventListener("click", () => play(!state.playing));
    for (const one of speeds) speed.add(new Option(`${one} ×`, one, false, one === state.speed));
    speed.addEventListener("change", () => { state.speed = Number(speed.value); });
    if (pick) pick.addEventListener("change", () => { state.chosen = Number(pick.value); ask(); });
    document.addEventListener("seek", (event) => { state.used = true; seek(event.detail); });
    document.addEventListener("repaint", ask);
    listenToKeys(run, state, seek, play);
    for (const one of document.querySelectorAll("[data-seek]")) {
      one.addEventListener("click", () => { state.used = true; seek(Number(one.dataset.seek)); });
    }
    const asked = /^#t=([\d.]+)$/.exec(window.location.hash);
    seek(asked ? Number(asked[1]) : 0);
  }

  // Space plays, arrows step by a tick, or by a hundredth of the run with Shift; on the page once the player was used.
  function listenToKeys(run, state, seek, play) {
    document.addEventListener("keydown", (event) => {
      const { target, key } = event;
      const inside = target.closest && target.closest(".transport, .player");
      if (event.ctrlKey || event.metaKey || event.altKey || !(inside || (target === document.body && state.used))) return;
      if (key === " " && !["BUTTON", "SELECT"].includes(target.tagName)) {
        play(!state.playing);
      } else if (target.tagName !== "CANVAS" && target.tagName !== "SELECT" && ["ArrowLeft", "ArrowRight"].includes(key)) {
        const step = event.shiftKey ? run.last / 100 : run.tick;
        play(false);
        seek(state.time + (key === "ArrowRight" ? step : -step));
      } else if (target.id === "play-slider" && (key === "Home" || key === "End")) {
        seek(key === "Home" ? 0 : run.last);
      } else return;
      event.preventDefault();
    });
  }

  return { start, between, turned, zoneOf, axisOf, boxWords, onMove: (paint) => listeners.push(paint) };
})();
