// One run of a campaign, picked anywhere, is marked in every chart and table and has a panel of its own.
const Runs = (() => {
  "use strict";
  const SVG = "http://www.w3.org/2000/svg";
  let known = null;
  let rows = new Map();
  let traces = null;
  let picked = null;
  let panel = null;
  let beside = [];

  // Values of a channel (runs x samples) from their codes; null where there is none.
  function decoded({ low, high, log, codes }) {
    const bytes = Uint8Array.from(atob(codes), (one) => one.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    const found = new Float32Array(bytes.length / 2);
    for (let index = 0; index < found.length; index += 1) {
      const code = view.getUint16(2 * index, true);
      const share = code / 65534;
      found[index] = code === 65535 ? NaN : log ? low * (high / low) ** share : low + share * (high - low);
    }
    return found;
  }

  function traceOf(channel, run) {
    if (!traces || !traces.channels[channel] || !rows.has(run)) return null;
    const stored = traces.channels[channel];
    if (stored.codes) traces.channels[channel] = { values: decoded(stored) };
    const count = traces.time_s.length;
    return traces.channels[channel].values.subarray(rows.get(run) * count, (rows.get(run) + 1) * count);
  }

  function valueOf(metric, run) {
    const values = known.values[metric];
    const value = values && rows.has(run) ? values[rows.get(run)] : null;
    return value === undefined ? null : value;
  }

  const within = (place, low, high) => Math.min(Math.max(place, low), high);

  function add(parent, name, attributes, text) {
    const made = parent.appendChild(document.createElementNS(SVG, name));
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text) made.textContent = text;
    return made;
  }

  // The picked run in a chart: a line at its value, its course over time, or a ring about its point.
  function overlay(place, group, { x, y, box, traces: drawn }) {
    const chart = place.dataset.chart || "";
    group.ownerSVGElement.classList.toggle("picks", /^(histogram-|envelope-|port$)/.test(chart) || place.id === "scatter-chart");
    if (picked === null) return;
    if (chart.startsWith("histogram-")) {
      const value = valueOf(chart.slice(10), picked);
      if (value === null) return;
      const at = within(x.to(value), box.left, box.right).toFixed(1);
      add(group, "line", { x1: at, x2: at, y1: box.top, y2: box.bottom });
      add(group, "path", { d: `M${at} ${box.bottom}l-5 8h10z`, class: "solid" });
    } else if (chart.startsWith("envelope-")) {
      const values = traceOf(chart.slice(9), picked);
      if (!values) return;
      let text = "";
      let open = false;
      traces.time_s.forEach((time, index) => {
        const value = values[index];
        const inside = Number.isFinite(value) && (!y.log || value > 0) && x.to(time) >= box.left - 1 && x.to(time) <= box.right + 1;
        if (inside) text += `${open ? "L" : "M"}${x.to(time).toFixed(1)} ${within(y.to(value), box.top, box.bottom).toFixed(1)}`;
        open = inside;
      });
      if (text) add(group, "path", { d: text });
    } else if (chart === "port") {
      const point = portPoints(x, y, drawn).find(({ run }) => run === picked);
      if (point) add(group, "circle", { cx: point.at[0].toFixed(1), cy: point.at[1].toFixed(1), r: 7 });
    } else if (place.id === "scatter-chart") {
      const [metric, input] = [valueOf(place.dataset.metric, picked), place.inputs && place.inputs[rows.get(picked)]];
      if (metric === null || typeof input !== "number") return;
      add(group, "circle", { cx: x.to(input).toFixed(1), cy: within(y.to(metric), box.top, box.bottom).toFixed(1), r: 7 });
    }
  }

  // Runs at a place of a chart, the first one to be marked.
  function at(place, { x, y, traces: drawn }, left, top) {
    const chart = place.dataset.chart || "";
    if (chart.startsWith("histogram-")) return inBar(chart.slice(10), drawn[0], x.from(left));
    if (chart.startsWith("envelope-")) return nearest(chart.slice(9), x, y, left, top);
    if (place.id === "scatter-chart") return nearestPoint(drawn[0], x, y, left, top);
    if (chart === "port") {
      const far = ({ at: [across, down] }) => Math.hypot(across - left, down - top);
      return portPoints(x, y, drawn).filter((one) => far(one) < 20).sort((a, b) => far(a) - far(b)).map(({ run }) => run);
    }
    return [];
  }

  // Runs whose points are in the figure of the port, and where.
  function portPoints(x, y, drawn) {
    return drawn.filter(({ text }) => text).flatMap(({ text, x: across, y: up }) => text.map((run, index) => ({ run, at: [x.to(across[index]), y.to(up[index])] })));
  }

  function inBar(metric, bars, value) {
    const values = known.values[metric];
    if (!values) return [];
    const last = bars.x.length - 1;
    let bar = bars.x.findIndex((middle, index) => Math.abs(value - middle) <= bars.width[index] / 2);
    if (bar < 0) bar = value < bars.x[0] ? 0 : value > bars.x[last] ? last : -1;
    if (bar < 0) return [];
    const low = bar === 0 ? -Infinity : bars.x[bar] - bars.width[bar] / 2;
    const high = bar === last ? Infinity : bars.x[bar] + bars.width[bar] / 2;
    return known.ids.filter((run) => { const one = valueOf(metric, run); return one !== null && one >= low && one <= high; })
      .sort((a, b) => Math.abs(valueOf(metric, a) - value) - Math.abs(valueOf(metric, b) - value));
  }

  function nearest(channel, x, y, left, top) {
    if (!traces || !traces.channels[channel]) return [];
    const time = x.from(left);
    const sample = traces.time_s.reduce((best, one, index) => (Math.abs(one - time) < Math.abs(traces.time_s[best] - time) ? index : best), 0);
    const distance = (run) => {
      const value = traceOf(channel, run)[sample];
      return Number.isFinite(value) && (!y.log || value > 0) ? Math.abs(y.to(value) - top) : Infinity;
    };
    const [first] = known.ids.map((run) => [distance(run), run]).sort((a, b) => a[0] - b[0]);
    return first && first[0] < 40 ? [first[1]] : [];
  }

  function nearestPoint(points, x, y, left, top) {
    let best = [400, null];
    points.x.forEach((value, index) => {
      if (typeof value !== "number" || typeof points.y[index] !== "number") return;
      const far = (x.to(value) - left) ** 2 + (y.to(points.y[index]) - top) ** 2;
      if (far < best[0]) best = [far, known.ids[index]];
    });
    return best[1] === null ? [] : [best[1]];
  }

  function state(run) {
    if (known.failed[run]) return known.failed[run];
    return known.unjudged.includes(run) ? "not judged" : "completed";
  }

  function button(text, action, className = "") {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = text;
    made.className = className;
    made.addEventListener("click", action);
    return made;
  }

  function element(name, className, text = "") {
    const made = document.createElement(name);
    made.className = className;
    made.textContent = text;
    return made;
  }

  function showPanel() {
    if (!panel) {
      panel = document.body.appendChild(element("aside", "run-panel"));
      panel.setAttribute("aria-live", "polite");
    }
    const head = element("p", "run-head");
    head.append(element("strong", "", `Run ${picked}`), element("span", known.failed[picked] ? "bad" : "", state(picked)));
    const values = element("ul", "run-values");
    for (const { name, text, limit, at_most: atMost } of known.required) {
      const value = valueOf(name, picked);
      const broken = value === null || (atMost ? value > limit : value < limit);
      values.append(element("li", broken ? "bad" : "", `${text}: ${value === null ? "no value" : Charts.number(value)}`));
    }
    const tools = element("p", "run-tools");
    if (known.kept.includes(picked)) tools.append(button("over time", () => Sections.open("run")));
    const code = element("code", "", known.command.replaceAll(known.placeholder, String(picked)));
    tools.append(code);
    Tables.addCopy(code);
    panel.replaceChildren(button("\u00d7", () => mark(null), "close"), head, values);
    if (beside.length > 1) {
      const others = element("p", "run-others", `${beside.length} runs here: `);
      for (const run of beside.slice(0, 30)) others.append(button(String(run), () => mark(run, beside), run === picked ? "run here" : "run"));
      if (beside.length > 30) others.append(` and ${beside.length - 30} more`);
      panel.append(others);
    }
    panel.append(tools);
    panel.hidden = false;
    panel.querySelector(".close").setAttribute("aria-label", "close");
  }

  // Marks a run everywhere, or none; `others` are the runs at the same place.
  function mark(run, others = []) {
    if (!known || (run !== null && !rows.has(run))) return;
    [picked, beside] = [run, others];
    for (const row of document.querySelectorAll("tr[data-pick], button.run[data-pick]")) {
      row.classList.toggle("marked", Number(row.dataset.pick) === run);
    }
    Charts.remark();
    Scene.markRun(run);
    if (run === null) { if (panel) panel.hidden = true; return; }
    const pick = document.getElementById("pick-run");
    if (pick && [...pick.options].some((one) => one.value === String(run))) {
      pick.value = String(run);
      pick.dispatchEvent(new Event("change"));
    }
    showPanel();
  }

  function start(data) {
    if (!data.runs || document.body.classList.contains("brief")) return;
    known = data.runs;
    rows = new Map(known.ids.map((run, index) => [run, index]));
    traces = known.traces;
    Charts.onMark(overlay, (place, plot, left, top) => {
      const found = at(place, plot, left, top);
      if (found.length) mark(found[0], found);
    });
    document.addEventListener("click", (event) => {
      const place = event.target.closest("[data-pick]");
      if (!place || (place.tagName === "TR" && event.target.closest("button:not(.run), a, code, summary, select"))) return;
      mark(Number(place.dataset.pick));
    });
    document.addEventListener("keydown", (event) => { if (event.key === "Escape") mark(null); });
    const scene = document.getElementById("scene");
    if (scene) scene.addEventListener("pickrun", (event) => mark(event.detail));
  }

  return { start, mark, value: valueOf, get ids() { return known ? known.ids : []; } };
})();
