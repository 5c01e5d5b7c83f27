// Charts as SVG from figures in plotly's format, of which this draws the part that the report uses: lines, bands, stacked
// areas, bars, points, straight shapes with labels; linear, logarithmic and categorical axes, or two of one scale; two
// plots side by side.
const Charts = (() => {
  "use strict";
  const SVG = "http://www.w3.org/2000/svg";
  // Colours that change with the theme. Others are shown as they are.
  const themed = {
    "#1a2433": "var(--ink)", "#5b6776": "var(--muted)", "#0072B2": "var(--blue)", "#D55E00": "var(--vermillion)",
    "#009E73": "var(--green)", "#8a97a8": "var(--shade)", "#E69F00": "var(--orange)", "#CC79A7": "var(--purple)",
  };
  const dashes = { dash: "7 4", dot: "2 3", dashdot: "7 3 2 3" };
  const shown = new Map();
  const tip = document.createElement("div");
  tip.className = "tip";
  tip.hidden = true;

  const color = (name) => themed[name] || name;
  // Fills are given with their opacity, "rgba(0, 114, 178, 0.13)".
  function filling(name) {
    const found = /^rgba\((\d+), (\d+), (\d+), ([\d.]+)\)$/.exec(name);
    if (!found) return { fill: color(name) };
    const hex = `#${found.slice(1, 4).map((part) => Number(part).toString(16).padStart(2, "0")).join("")}`;
    const same = Object.keys(themed).find((one) => one.toLowerCase() === hex);
    return { fill: same ? themed[same] : hex, "fill-opacity": found[4] };
  }
  const wait = (value) => (value === undefined || value === null);

  function node(parent, name, attributes, text) {
    const made = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) if (!wait(value)) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    parent.appendChild(made);
    return made;
  }

  function number(value, digits = 4) {
    if (wait(value)) return "\u2013";
    if (value === 0) return "0";
    const size = Math.abs(value);
    if (size < 1e-4 || size >= 1e7) return value.toExponential(Math.max(0, digits - 2)).replace(/\.?0*e\+?/, "e");
    return String(Number(value.toPrecision(size >= 1e4 ? Math.max(digits, 7) : digits)));
  }

  // Texts for hovering: %{y:.4g}, %{x} and %{text} of a point, line breaks as <br>.
  function filled(template, values) {
    return template.replace(/<extra>.*$/, "").replace(/%\{(\w+)(?::\.(\d)([a-z]))?\}/g, (_, key, digits, kind) => {
      const value = values[key];
      if (typeof value !== "number") return wait(value) ? "" : String(value);
      return kind === "f" ? value.toFixed(Number(digits)) : number(value, digits ? Number(digits) : 5);
    }).replaceAll("<br>", "\n").replaceAll("&lt;", "<").replaceAll("&amp;", "&");
  }

  function linearTicks(low, high, count) {
    const rough = (high - low) / Math.max(1, count);
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 2.5, 5, 10].map((factor) => factor * power).find((one) => one >= rough * 0.999);
    const ticks = [];
    for (let index = Math.ceil(low / step - 1e-9); index * step <= high + 1e-9 * step; index += 1) ticks.push(index * step);
    return ticks.map((value) => Number(value.toPrecision(12)));
  }

  function logTicks(low, high) {
    const factors = high / low < 3e3 ? [1, 2, 5] : [1];
    const ticks = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power += 1) {
      for (const factor of factors) ticks.push(factor * 10 ** power);
    }
    const stride = factors.length === 1 ? Math.ceil(ticks.length / 8) : 1;
    return ticks.filter((value, index) => value >= low * 0.9999 && value <= high * 1.0001 && index % stride === 0);
  }

  // Scale of an axis: `to` maps values to places between `start` and `end`.
  function scale(axis, values, start, end, count) {
    if (axis.type === "category") {
      const names = [...new Set(values)];
      const step = (end - start) / Math.max(1, names.length);
      return { names, step: Math.abs(step), ticks: names, to: (name) => start + (names.indexOf(name) + 0.5) * step, text: (name) => name };
    }
    const log = axis.type === "log";
    const usable = values.filter((value) => typeof value === "number" && (!log || value > 0));
    let [low, high] = axis.range ? axis.range.map((value) => (log ? 10 ** value : value)) : usable.reduce(
      ([least, most], value) => [Math.min(least, value), Math.max(most, value)], [Infinity, -Infinity]);
    if (!axis.range && !(low <= high)) [low, high] = log ? [1, 10] : [0, 1];
    if (!axis.range && !log && axis.rangemode === "tozero") [low, high] = [Math.min(0, low), Math.max(0, high)];
    if (low === high) [low, high] = log ? [low / 2, high * 2] : [low - (Math.abs(low) * 0.1 || 1), high + (Math.abs(high) * 0.1 || 1)];
    if (!axis.range && axis.pad) {
      const room = axis.pad * (log ? Math.log(high / low) : high - low);
      const keepsZero = axis.rangemode === "tozero";
      low = log ? low * Math.exp(-room) : low - (keepsZero && low === 0 ? 0 : room);
      high = log ? high * Math.exp(room) : high + (keepsZero && high === 0 ? 0 : room);
    }
    const share = log ? (value) => Math.log(value / low) / Math.log(high / low) : (value) => (value - low) / (high - low);
    const suffix = axis.ticksuffix || "";
    return {
      low, high, log, ticks: log ? logTicks(low, high) : linearTicks(Math.min(low, high), Math.max(low, high), count),
      to: (value) => start + share(value) * (end - start), text: (value) => number(value, 6) + suffix,
      from: (place) => {
        const part = (place - start) / (end - start);
        return log ? low * (high / low) ** part : low + part * (high - low);
      },
    };
  }

  function pathOf(xs, ys, x, y, shape, back = []) {
    let text = "";
    let open = false;
    let last = 0;
    for (let index = 0; index < xs.length; index += 1) {
      if (wait(ys[index]) || wait(xs[index])) { open = false; continue; }
      const across = x.to(xs[index]).toFixed(1);
      const up = y.to(ys[index]).toFixed(1);
      if (open && shape === "hv") text += `L${across} ${last}`;
      text += `${open ? "L" : "M"}${across} ${up}`;
      [open, last] = [true, up];
    }
    for (const [place, value] of back) if (!wait(value)) text += `L${x.to(place).toFixed(1)} ${y.to(value).toFixed(1)}`;
    return text + (back.length ? "Z" : "");
  }

  // Values of stacked areas summed up, each on those before it.
  function stacked(traces) {
    let below = null;
    return traces.map((trace) => {
      if (!trace.stackgroup) return trace;
      const base = below || trace.y.map(() => 0);
      const sum = trace.y.map((value, index) => value + base[index]);
      below = sum;
      return { ...trace, y: sum, base, own: trace.y };
    });
  }

  function layoutOf(figure, view) {
    const layout = { ...figure.layout, xaxis: { ...figure.layout.xaxis }, yaxis: { ...figure.layout.yaxis } };
    if (view.range) layout.xaxis = { ...layout.xaxis, range: layout.xaxis.type === "log" ? view.range.map(Math.log10) : view.range };
    return layout;
  }

  function extent(traces, axis, horizontalBars) {
    const values = [];
    for (const trace of traces) {
      const isValue = trace.type === "bar" && (axis === "y") !== (trace.orientation === "h");
      if (isValue) values.push(0);
      const widths = trace.type === "bar" && axis === "x" && trace.width;
      for (let index = 0; index < trace[axis].length; index += 1) {
        const value = trace[axis][index];
        if (widths) values.push(value - widths[index] / 2, value + widths[index] / 2);
        else values.push(value);
      }
      if (trace.base && axis === "y" && !horizontalBars) values.push(0);
    }
    return values;
  }

  function drawAxes(root, x, y, box, layout, xAxis, first) {
    const { left, right, top, bottom } = box;
    const grid = node(root, "g", { class: "grid" });
    for (const value of x.ticks) {
      const place = x.to(value).toFixed(1);
      if (!x.names) node(grid, "line", { x1: place, x2: place, y1: top, y2: bottom });
      // The last text ends at the edge of the picture at the latest.
      const half = 3.4 * x.text(value).length;
      node(root, "text", { x: Math.min(place, right + 10 - half), y: bottom + 16, "text-anchor": "middle", class: "tick" }, x.text(value));
    }
    for (const value of y.ticks) {
      const place = y.to(value).toFixed(1);
      if (!y.names) node(grid, "line", { x1: left, x2: right, y1: place, y2: place });
      if (first) node(root, "text", { x: left - 6, y: Number(place) + 4, "text-anchor": "end", class: "tick" }, y.text(value));
    }
    node(root, "path", { d: `M${left} ${top}V${bottom}H${right}`, class: "axis" });
    const title = xAxis.title && xAxis.title.text;
    // A title that is wider than its plot is cut to its first word.
    const fitting = title && 6.4 * title.length > right - left ? title.split(/[ ,]/)[0] : title;
    if (title) node(root, "text", { x: (left + right) / 2, y: bottom + 33, "text-anchor": "middle", class: "axis-title" }, fitting);
  }

  function drawTrace(root, trace, before, x, y) {
    const line = trace.line || {};
    if (trace.type === "bar") return drawBars(root, trace, x, y);
    if (trace.mode === "markers") {
      const marker = trace.marker || {};
      const group = node(root, "g", { fill: color(marker.color), "fill-opacity": marker.opacity });
      trace.x.forEach((value, index) => {
        if (wait(value) || wait(trace.y[index])) return;
        node(group, "circle", { cx: x.to(value).toFixed(1), cy: y.to(trace.y[index]).toFixed(1), r: (marker.size || 5) / 2 });
      });
      return;
    }
    if (trace.base) {
      const back = trace.x.map((place, index) => [place, trace.base[index]]).reverse();
      node(root, "path", { d: pathOf(trace.x, trace.y, x, y, "", back), fill: color(trace.fillcolor), "fill-opacity": 0.85 });
    } else if (trace.fill === "tonexty" && before) {
      const back = before.x.map((place, index) => [place, before.y[index]]).reverse();
      node(root, "path", { d: pathOf(trace.x, trace.y, x, y, "", back), ...filling(trace.fillcolor) });
    }
    if (line.width) {
      node(root, "path", {
        d: pathOf(trace.x, trace.y, x, y, line.shape), fill: "none", stroke: color(line.color), "stroke-width": line.width,
        "stroke-dasharray": dashes[line.dash], "stroke-linejoin": "round",
      });
    }
  }

  function drawBars(root, trace, x, y) {
    const marker = trace.marker || {};
    const flat = trace.orientation === "h";
    trace.x.forEach((value, index) => {
      if (wait(value) || wait(trace.y[index])) return;
      const opacity = Array.isArray(marker.opacity) ? marker.opacity[index] : marker.opacity;
      const fill = color(Array.isArray(marker.color) ? marker.color[index] : marker.color);
      let [x0, x1, y0, y1] = [0, 0, 0, 0];
      if (flat) {
        [x0, x1] = [x.to(0), x.to(value)];
        [y0, y1] = [y.to(trace.y[index]) - 0.35 * y.step, y.to(trace.y[index]) + 0.35 * y.step];
      } else {
        const half = x.names ? 0 : (trace.width ? trace.width[index] : 1) / 2;
        [x0, x1] = x.names ? [x.to(value) - 0.35 * x.step, x.to(value) + 0.35 * x.step] : [x.to(value - half) + 0.5, x.to(value + half) - 0.5];
        [y0, y1] = [y.to(0), y.to(trace.y[index])];
      }
      node(root, "rect", {
        x: Math.min(x0, x1).toFixed(1), y: Math.min(y0, y1).toFixed(1), width: Math.max(0.8, Math.abs(x1 - x0)).toFixed(1),
        height: Math.abs(y1 - y0).toFixed(1), fill, "fill-opacity": opacity,
      });
    });
  }

  // Straight lines across the plot, at a value of one axis, with a label.
  function drawShapes(root, shapes, x, y, box) {
    for (const shape of shapes || []) {
      const upright = shape.yref === "paper";
      const place = upright ? x.to(shape.x0) : y.to(shape.y0);
      if (!(upright ? place >= box.left - 1 && place <= box.right + 1 : place >= box.top - 1 && place <= box.bottom + 1)) continue;
      if (shape.type === "rect") {
        const until = Math.min(box.right, x.to(shape.x1));
        node(root, "rect", { x: place.toFixed(1), width: Math.max(0, until - place).toFixed(1), y: box.top, height: box.bottom - box.top, fill: color(shape.fillcolor), "fill-opacity": shape.opacity });
        continue;
      }
      const ends = upright ? { x1: place, x2: place, y1: box.top, y2: box.bottom } : { x1: box.left, x2: box.right, y1: place, y2: place };
      node(root, "line", { ...ends, stroke: color(shape.line.color), "stroke-width": shape.line.width, "stroke-dasharray": dashes[shape.line.dash] });
      const text = shape.label && shape.label.text;
      if (!text) continue;
      const atEnd = upright && place > (box.left + box.right) / 2;
      const [left, top] = [upright ? place + (atEnd ? -4 : 4) : box.right - 4, upright ? box.top + 10 : place - 4];
      label(root, text, left, top, upright && !atEnd ? "start" : "end", color(shape.line.color), box);
    }
  }

  // A label, below those that stand where it would. Within a box it crosses no edge: it is moved, and if it is wider, broken.
  function label(root, text, from, y, anchor, fill, box) {
    const width = 6.6 * text.length;
    const spaces = [...text.matchAll(/ /g)].map((one) => one.index);
    if (box && spaces.length && width > box.right - box.left) {
      const middle = spaces.reduce((best, one) => (Math.abs(2 * one - text.length) < Math.abs(2 * best - text.length) ? one : best));
      for (const line of [text.slice(0, middle), text.slice(middle + 1)]) label(root, line, from, y, anchor, fill, box);
      return;
    }
    const x = !box ? from : anchor === "end" ? Math.max(from, box.left + width) : Math.min(from, box.right - width);
    const left = anchor === "end" ? x - width : x;
    const others = [...root.querySelectorAll("text.mark")].map((one) => one.label);
    let at = y;
    while (others.some((one) => Math.abs(one.y - at) < 12 && one.left < left + width && left < one.left + one.width)) at += 1;
    node(root, "text", { x, y: at, "text-anchor": anchor, class: "mark", fill }, text).label = { left, width, y: at };
  }

  function drawLegend(place, traces, layout) {
    const legend = place.querySelector(".legend") || place.appendChild(document.createElement("div"));
    legend.className = "legend";
    legend.replaceChildren();
    if (layout.showlegend === false) return;
    const named = traces.filter((trace) => trace.name && trace.showlegend !== false);
    named.push(...(layout.shapes || []).filter((shape) => shape.showlegend));
    for (const trace of named) {
      const item = legend.appendChild(document.createElement("span"));
      const key = item.appendChild(document.createElementNS(SVG, "svg"));
      key.setAttribute("viewBox", "0 0 22 10");
      const line = trace.line || {};
      if (trace.fillcolor) node(key, "rect", { width: 22, height: 10, ...filling(trace.fillcolor) });
      else if (trace.type === "bar" || trace.mode === "markers") node(key, "rect", { x: 6, width: 10, height: 10, fill: color((trace.marker || {}).color) });
      else node(key, "line", { x1: 0, x2: 22, y1: 5, y2: 5, stroke: color(line.color), "stroke-width": 2, "stroke-dasharray": dashes[line.dash] });
      item.append(trace.name);
    }
  }

  function leftMargin(y, layout) {
    const longest = Math.max(1, ...y.ticks.map((value) => y.text(value).length));
    const title = layout.yaxis.title && layout.yaxis.title.text;
    return Math.min(y.names ? 260 : 90, 12 + longest * (y.names ? 6.3 : 6.8)) + (title ? 16 : 0);
  }

  // Draws a figure into a place of the page; `width` [px] overrides that of the place.
  function draw(place, figure, options = {}) {
    const state = shown.get(place) || { view: {} };
    shown.set(place, Object.assign(state, { figure, options }));
    render(place, options.width);
  }

  // A place in a folded section is drawn when it is opened.
  function render(place, forced) {
    if (!forced && !(place.checkVisibility ? place.checkVisibility() : place.clientWidth)) return;
    const { figure, view } = shown.get(place);
    const layout = layoutOf(figure, view);
    const width = Math.max(160, Math.round(forced || place.clientWidth || 600));
    const height = place.classList.contains("tall") ? 300 : place.classList.contains("middle") ? 220 : place.classList.contains("square") ? Math.min(width, 440) : 150;
    const traces = stacked(figure.data);
    const old = place.querySelector("svg.plot");
    const root = document.createElementNS(SVG, "svg");
    root.setAttribute("class", "plot");
    root.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const panels = parts(traces, layout, width, height, view);
    for (const panel of panels) drawPanel(root, panel, layout);
    if (old) old.replaceWith(root); else place.prepend(root);
    place.dataset.drawn = "yes";
    drawLegend(place, traces, layout);
    Object.assign(shown.get(place), { root, panels });
    overlay(place);
    if (!shown.get(place).options.silent) listen(root, place, panels, layout);
    place.dispatchEvent(new CustomEvent("drawn", { bubbles: true }));
  }

  // The plots of a figure: one, or two side by side that share the vertical axis.
  function parts(traces, layout, width, height, view) {
    const axes = ["x", "x2"].filter((name) => name === "x" || layout.xaxis2);
    const title = layout.xaxis.title && layout.xaxis.title.text;
    const top = 10;
    const bottom = height - (title || layout.xaxis2 ? 40 : 22);
    const yAxis = { pad: 0.04, ...layout.yaxis };
    const marked = (layout.shapes || []).filter((shape) => shape.yref !== "paper" && shape.name === "limit").map((shape) => shape.y0);
    const markedX = (layout.shapes || []).filter((shape) => shape.yref === "paper" && shape.name === "limit").map((shape) => shape.x0);
    const inView = view.range ? traces.map((trace) => within(trace, view.range)) : traces;
    const upright = (axis) => scale(axis, [...extent(inView, "y"), ...marked], bottom, top, (bottom - top) / 42);
    let y = upright(yAxis);
    const left = leftMargin(y, layout);
    const room = width - left - 10;
    const xAxis = { ...layout.xaxis };
    if (yAxis.scaleanchor === "x") {
      // Both ranges are about zero; that of the longer side is extended, so that a unit is as long on both axes.
      const ratio = room / (bottom - top);
      xAxis.range = xAxis.range.map((end) => end * Math.max(1, ratio));
      y = upright({ ...yAxis, range: yAxis.range.map((end) => end * Math.max(1, 1 / ratio)) });
    }
    return axes.map((name, index) => {
      const axis = name === "x" ? xAxis : layout.xaxis2;
      const [from, to] = axis.domain || [0, 1];
      const box = { left: left + from * room, right: left + to * room, top, bottom };
      const own = traces.filter((trace) => (trace.xaxis || "x") === name);
      const pad = markedX.length ? 0.03 : 0;
      const x = scale({ pad, ...axis }, [...extent(own, "x"), ...(index === 0 ? markedX : [])], box.left, box.right, (box.right - box.left) / 80);
      return { x, y, box, axis, traces: own, first: index === 0 };
    });
  }

  function within(trace, [low, high]) {
    const keep = trace.x.map((value) => value >= low && value <= high);
    return { ...trace, x: trace.x.filter((_, index) => keep[index]), y: trace.y.filter((_, index) => keep[index]) };
  }

  let clips = 0;

  function drawPanel(root, panel, layout) {
    const { x, y, box } = panel;
    drawAxes(root, x, y, box, layout, panel.axis, panel.first);
    const name = `clip-${clips += 1}`;
    node(node(root, "clipPath", { id: name }), "rect", { x: box.left, y: box.top - 2, width: Math.max(0, box.right - box.left), height: box.bottom - box.top + 4 });
    const inside = node(root, "g", { "clip-path": `url(#${name})` });
    drawShapes(inside, panel.first ? (layout.shapes || []).filter((shape) => shape.type === "rect") : [], x, y, box);
    panel.traces.forEach((trace, index) => drawTrace(inside, trace, panel.traces[index - 1], x, y));
    if (panel.first) drawShapes(root, (layout.shapes || []).filter((shape) => shape.type !== "rect"), x, y, box);
    for (const note of panel.first ? layout.annotations || [] : []) {
      label(root, note.text, box.right - 4, box.top + 10, "end", "var(--muted)");
    }
    const title = layout.yaxis.title && layout.yaxis.title.text;
    if (title && panel.first) {
      const middle = (box.top + box.bottom) / 2;
      node(root, "text", { transform: `translate(11 ${middle}) rotate(-90)`, "text-anchor": "middle", class: "axis-title" }, title);
    }
  }

  function nearest(values, wanted) {
    let best = -1;
    let least = Infinity;
    for (let index = 0; index < values.length; index += 1) {
      if (wait(values[index])) continue;
      const distance = Math.abs(values[index] - wanted);
      if (distance < least) [least, best] = [distance, index];
    }
    return best;
  }

  function listen(root, place, panels, layout) {
    const cursor = node(root, "line", { class: "cursor", visibility: "hidden" });
    const across = (event) => {
      const bounds = root.getBoundingClientRect();
      const ratio = root.viewBox.baseVal.width / bounds.width;
      return [(event.clientX - bounds.left) * ratio, (event.clientY - bounds.top) * ratio];
    };
    root.addEventListener("pointermove", (event) => {
      const [left, top] = across(event);
      const panel = panels.find(({ box }) => left >= box.left && left <= box.right && top >= box.top - 4 && top <= box.bottom + 4);
      if (!panel) return hide(cursor);
      const lines = layout.yaxis.scaleanchor || panel.x.names || panel.y.names || panel.traces[0].type === "bar" || panel.traces[0].mode === "markers"
        ? single(panel, left, top) : unified(panel, left, layout, cursor);
      return lines.length ? show(event, lines) : hide(cursor);
    });
    root.addEventListener("pointerleave", () => hide(cursor));
    const [panel] = panels;
    if (place.classList.contains("tall") && !panel.x.names && !panel.y.names) zoom(root, place, panel, across);
    root.addEventListener("click", (event) => {
      const [left, top] = across(event);
      if (!shown.get(place).options.onPick) return marks.pick && marks.pick(place, panel, left, top);
      const found = hit(panel, left, top);
      return found && shown.get(place).options.onPick(found.trace, found.index);
    });
  }

  function unified(panel, left, layout, cursor) {
    const at = panel.x.from(left);
    const lines = [];
    for (const trace of panel.traces) {
      if (trace.hoverinfo === "skip" || !trace.hovertemplate) continue;
      const index = nearest(trace.x, at);
      if (index < 0 || wait(trace.y[index])) continue;
      if (!lines.length) {
        const place = panel.x.to(trace.x[index]).toFixed(1);
        for (const [key, value] of Object.entries({ x1: place, x2: place, y1: panel.box.top, y2: panel.box.bottom, visibility: "visible" })) cursor.setAttribute(key, value);
        lines.push(number(trace.x[index], 6) + (panel.axis.ticksuffix || ""));
      }
      lines.push(filled(trace.hovertemplate, { x: trace.x[index], y: trace.own ? trace.own[index] : trace.y[index] }));
    }
    return lines;
  }

  function hit(panel, left, top) {
    let best = null;
    for (const trace of panel.traces) {
      if (trace.hoverinfo === "skip") continue;
      for (let index = 0; index < trace.x.length; index += 1) {
        if (wait(trace.x[index]) || wait(trace.y[index])) continue;
        const dx = trace.type === "bar" && trace.orientation === "h" ? 0 : panel.x.to(trace.x[index]) - left;
        const dy = trace.type === "bar" && trace.orientation !== "h" ? 0 : panel.y.to(trace.y[index]) - top;
        const distance = dx * dx + dy * dy;
        if (!best || distance < best.distance) best = { trace, index, distance };
      }
    }
    return best && best.distance < 900 ? best : null;
  }

  function single(panel, left, top) {
    const found = hit(panel, left, top);
    if (!found || !found.trace.hovertemplate) return [];
    const { trace, index } = found;
    return [filled(trace.hovertemplate, { x: trace.x[index], y: trace.y[index], text: trace.text && trace.text[index] })];
  }

  function show(event, lines) {
    if (!tip.isConnected) document.body.appendChild(tip);
    tip.textContent = lines.join("\n");
    tip.hidden = false;
    const room = document.documentElement.clientWidth - tip.offsetWidth - 12;
    tip.style.left = `${Math.max(4, Math.min(event.clientX + 14, room)) + window.scrollX}px`;
    tip.style.top = `${event.clientY + 16 + window.scrollY}px`;
  }

  function hide(cursor) {
    tip.hidden = true;
    cursor.setAttribute("visibility", "hidden");
  }

  // Dragging across a tall chart shows a part of it, a double click all of it again.
  function zoom(root, place, panel, across) {
    let from = null;
    const mark = node(root, "rect", { class: "drag", y: panel.box.top, height: panel.box.bottom - panel.box.top, visibility: "hidden" });
    root.classList.add("zooms");
    root.addEventListener("pointerdown", (event) => {
      if (event.pointerType === "mouse") { [from] = across(event); event.preventDefault(); }
    });
    root.addEventListener("pointermove", (event) => {
      if (from === null) return;
      const [to] = across(event);
      mark.setAttribute("x", Math.min(from, to));
      mark.setAttribute("width", Math.abs(to - from));
      mark.setAttribute("visibility", "visible");
    });
    root.addEventListener("pointerup", (event) => {
      if (from === null) return;
      const ends = [from, across(event)[0]].map((end) => Math.min(panel.box.right, Math.max(panel.box.left, end))).sort((a, b) => a - b);
      from = null;
      if (ends[1] - ends[0] < 12) { mark.setAttribute("visibility", "hidden"); return; }
      shown.get(place).view = { range: ends.map(panel.x.from) };
      render(place);
    });
    root.addEventListener("dblclick", () => { shown.get(place).view = {}; render(place); });
  }

  function resize(widthOf) {
    for (const place of shown.keys()) render(place, widthOf ? widthOf(place) : undefined);
  }

  // Draws what was folded when it was to be drawn, and is not any more.
  function reveal() {
    for (const [place, { root }] of shown) if (!root) render(place);
  }

  // What marks the picked run in a chart, and what picks one by a click.
  const marks = { draw: null, pick: null };

  function onMark(draw, pick) {
    Object.assign(marks, { draw, pick });
    remark();
  }

  function overlay(place) {
    const { root, panels } = shown.get(place);
    if (!root || !marks.draw) return;
    const old = root.querySelector("g.picked");
    if (old) old.remove();
    marks.draw(place, node(root, "g", { class: "picked" }), panels[0]);
  }

  function remark() {
    for (const place of shown.keys()) overlay(place);
  }


  // Calls `act` with place, picture and plots of every chart that is drawn.
  function each(act) {
    for (const [place, { root, panels }] of shown) if (root) act(place, root, panels);
  }

  return { draw, resize, reveal, onMark, remark, number, nearest, filled, node, color, each };
})();
