// The present instant of a playback in every chart over time and in the timeline; a click in them goes there.
(() => {
  "use strict";
  const overTime = (panel) => panel.axis.ticksuffix === " s" && panel.x.from;
  const marks = new Map();
  let [run, now] = [null, null];

  // A line over the plot, and for each trace a dot and its value.
  function prepare(place, root, panels) {
    const [panel] = panels;
    if (!overTime(panel)) return place.dataset.chart && place.dataset.chart.endsWith("box-place") ? prepareSpot(place, root, panel) : null;
    const group = Charts.node(root, "g", { class: "playhead" });
    const line = Charts.node(group, "line", { y1: panel.box.top, y2: panel.box.bottom });
    const traces = panel.traces.filter((one) => one.hoverinfo !== "skip" && one.hovertemplate).map((trace) => {
      const tone = Charts.color((trace.line && trace.line.color) || (trace.marker && trace.marker.color));
      return { trace, dot: Charts.node(group, "circle", { r: 3.2, fill: tone }), text: Charts.node(group, "text", { class: "mark", fill: tone }) };
    });
    root.addEventListener("click", (event) => {
      const bounds = root.getBoundingClientRect();
      const left = ((event.clientX - bounds.left) * root.viewBox.baseVal.width) / bounds.width;
      if (left >= panel.box.left && left <= panel.box.right) document.dispatchEvent(new CustomEvent("seek", { detail: panel.x.from(left) }));
    });
    return { root, panel, group, line, traces };
  }

  function prepareSpot(place, root, panel) {
    const number = Number(place.dataset.chart.split("-")[0]);
    return { root, panel, number, spot: Charts.node(root, "circle", { r: 6, class: "playhead" }) };
  }

  // Values of lines are those at or next to the time; points count if they are within a hundredth of the plot.
  function valueAt(trace, time, panel) {
    const index = Charts.nearest(trace.x, time);
    if (index < 0) return null;
    const off = Math.abs(panel.x.to(trace.x[index]) - panel.x.to(time));
    const value = trace.y[index];
    return off > 0.01 * (panel.box.right - panel.box.left) + 1 || value === null || value === undefined ? null : { at: trace.x[index], value, index };
  }

  function move({ panel, group, line, traces }, time) {
    const place = panel.x.to(time);
    const inside = place >= panel.box.left - 0.5 && place <= panel.box.right + 0.5;
    group.setAttribute("visibility", inside ? "visible" : "hidden");
    if (!inside) return;
    for (const end of ["x1", "x2"]) line.setAttribute(end, place.toFixed(1));
    const flip = place > panel.box.left + 0.75 * (panel.box.right - panel.box.left);
    const shown = [];
    for (const { trace, dot, text } of traces) {
      const found = valueAt(trace, time, panel);
      const high = found && panel.y.to(found.value);
      const seen = found && high >= panel.box.top - 1 && high <= panel.box.bottom + 1;
      dot.setAttribute("visibility", seen ? "inherit" : "hidden");
      text.setAttribute("visibility", found ? "inherit" : "hidden");
      if (!found) continue;
      if (seen) { dot.setAttribute("cx", place.toFixed(1)); dot.setAttribute("cy", high.toFixed(1)); }
      text.textContent = Charts.filled(trace.hovertemplate, { x: found.at, y: trace.own ? trace.own[found.index] : found.value }).replace(/^.*: /, "").replace(/ at .*$/, "");
      shown.push({ text, high: Math.min(panel.box.bottom, Math.max(panel.box.top + 10, high)) });
    }
    shown.sort((a, b) => a.high - b.high);
    shown.forEach(({ text }, index) => {
      const above = index ? shown[index - 1].high + 12 : -Infinity;
      shown[index].high = Math.max(shown[index].high - 4, above);
      text.setAttribute("x", (place + (flip ? -7 : 7)).toFixed(1));
      text.setAttribute("y", shown[index].high.toFixed(1));
      text.setAttribute("text-anchor", flip ? "end" : "start");
    });
  }

  function moveSpot({ panel, number, spot }, seen) {
    const one = seen.servicers[number];
    const box = one && one.flag.box_present && one.row("box_px");
    const place = box ? [panel.x.to(box[0] + 0.5 * box[2]), panel.y.to(box[1] + 0.5 * box[3])] : [NaN, NaN];
    const inside = place.every(Number.isFinite) && place[0] >= panel.box.left && place[0] <= panel.box.right && place[1] >= panel.box.top && place[1] <= panel.box.bottom;
    spot.setAttribute("visibility", inside ? "visible" : "hidden");
    if (inside) { spot.setAttribute("cx", place[0].toFixed(1)); spot.setAttribute("cy", place[1].toFixed(1)); }
  }

  function moveAll() {
    if (!now) return;
    Charts.each((place, root, panels) => {
      if (!marks.has(place) || marks.get(place).root !== root) {
        const made = prepare(place, root, panels);
        if (!made) return;
        marks.set(place, made);
      }
      const mark = marks.get(place);
      if (mark.spot) moveSpot(mark, now); else move(mark, run.time.numbers[now.now.frame]);
    });
    for (const bar of document.querySelectorAll(".timeline .bar")) {
      const head = bar.querySelector(".playhead") || bar.appendChild(Object.assign(document.createElement("span"), { className: "playhead" }));
      head.style.left = `${(100 * now.now.time) / run.duration_s}%`;
    }
  }

  document.addEventListener("drawn", () => document.dispatchEvent(new Event("repaint")));
  for (const bar of document.querySelectorAll(".timeline .bar")) {
    bar.addEventListener("click", (event) => {
      const bounds = bar.getBoundingClientRect();
      if (run) document.dispatchEvent(new CustomEvent("seek", { detail: ((event.clientX - bounds.left) / bounds.width) * run.duration_s }));
    });
  }
  Playback.onMove((found, seen) => { [run, now] = [found, seen]; moveAll(); });
})();
