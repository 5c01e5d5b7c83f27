// Folded sections: opened by links to them, and by what asks for them.
const Sections = (() => {
  "use strict";

  function open(id) {
    const place = document.getElementById(id);
    if (!place) return;
    for (let part = place.querySelector(":scope > details.fold") || place; part; part = part.parentElement) {
      if (part.tagName === "DETAILS") part.open = true;
    }
    place.scrollIntoView();
  }

  function start() {
    document.addEventListener("click", (event) => {
      const link = event.target.closest('a[href^="#"]');
      if (link) open(decodeURIComponent(link.hash.slice(1)));
    });
    window.addEventListener("hashchange", () => open(decodeURIComponent(location.hash.slice(1))));
    if (location.hash) open(decodeURIComponent(location.hash.slice(1)));
  }

  return { open, start };
})();

(() => {
  "use strict";
  const data = JSON.parse(document.getElementById("page-data").textContent);
  const paperWidth = 700;

  function drawNext(waiting) {
    const place = waiting.shift();
    if (!place) return;
    const chart = data.charts[place.dataset.chart];
    Charts.draw(place, chart);
    setTimeout(() => drawNext(waiting), 0);
  }

  function fill(select, entries) {
    for (const [value, text] of entries) select.add(new Option(text, value));
  }

  function explore(explorer) {
    const metricPick = document.getElementById("pick-metric");
    const inputPick = document.getElementById("pick-input");
    const titled = (text) => ({ title: { text } });

    function strongest(metric) {
      return Object.entries(metric.rank).sort((a, b) => Math.abs(b[1]) - Math.abs(a[1]));
    }

    function drawRanks(metric, input) {
      const ranks = strongest(metric).slice(0, 12).reverse();
      const line = (x) => ({ type: "line", yref: "paper", x0: x, x1: x, line: { color: "#5b6776", dash: "dot", width: 1.5 } });
      const limit = metric.independence_limit;
      Charts.draw(document.getElementById("rank-chart"), {
        data: [{
          type: "bar", orientation: "h", x: ranks.map((r) => r[1]), y: ranks.map((r) => r[0]),
          marker: { color: ranks.map(([key]) => (key === input ? "#D55E00" : "#0072B2")), opacity: 0.8 }, hovertemplate: "%{y}: %{x:.3f}",
        }],
        layout: {
          showlegend: false, shapes: limit === null ? [] : [line(limit), line(-limit)],
          xaxis: { range: [-1, 1], ...titled("Spearman rank correlation") }, yaxis: { type: "category" },
        },
      }, { onPick: (trace, index) => { inputPick.value = trace.y[index]; draw(); } });
      document.getElementById("rank-note").textContent = limit === null ? "" : "significance limit \u00b1" + limit.toFixed(3);
    }

    function drawScatter(name, metric, input) {
      const values = data.runs.values[name];
      const [low, high] = metric.ends;
      const beyond = values.filter((value) => value !== null && (value < low || value > high)).length;
      const place = document.getElementById("scatter-chart");
      place.dataset.metric = name;
      place.inputs = explorer.inputs[input];
      const title = metric.title + (metric.unit ? " [" + metric.unit + "]" : "");
      const limits = metric.limits.map(({ value, text }) => (
        { type: "line", y0: value, y1: value, name: "limit", label: { text }, line: { color: "#D55E00", width: 1.4 } }));
      Charts.draw(document.getElementById("scatter-chart"), {
        data: [{
          type: "scatter", mode: "markers", x: explorer.inputs[input], y: values.map((value) => (value === null ? null : Math.min(Math.max(value, low), high))),
          text: data.runs.ids.map((run, index) => `run ${run}: ${Charts.number(values[index])}`),
          marker: { size: 5, color: "#0072B2", opacity: 0.5 }, hovertemplate: "%{text} at %{x}",
        }],
        layout: { showlegend: false, shapes: limits, xaxis: { pad: 0.03, ...titled(input) }, yaxis: titled(title), annotations: beyond ? [{ text: `${beyond} beyond, at the edge` }] : [] },
      });
      const rank = metric.rank[input];
      document.getElementById("scatter-note").textContent = rank === undefined ? "" : "rank correlation " + rank.toFixed(3);
    }

    function draw() {
      const metric = explorer.metrics[metricPick.value];
      drawRanks(metric, inputPick.value);
      drawScatter(metricPick.value, metric, inputPick.value);
    }

    function chooseStrongest() {
      const first = strongest(explorer.metrics[metricPick.value])[0];
      if (first) inputPick.value = first[0];
      draw();
    }

    fill(metricPick, Object.entries(explorer.metrics).map(([name, metric]) => [name, metric.title]));
    fill(inputPick, Object.keys(explorer.inputs).map((key) => [key, key]));
    metricPick.addEventListener("change", chooseStrongest);
    inputPick.addEventListener("change", draw);
    chooseStrongest();
  }

  // Channels of the chosen worst run over those of the median one.
  function compareRuns(detail) {
    const pick = document.getElementById("pick-run");
    const line = (series, name, channel, color, width, dash) => ({
      type: "scatter", mode: "lines", x: series.time_s, y: series[channel.from || channel.name], name, line: { color, width, dash },
      hovertemplate: `${name}: %{y:.4g} ${channel.unit}`,
    });

    function draw() {
      const run = pick ? pick.value : null;
      for (const channel of detail.channels) {
        const place = document.getElementById(`detail-${channel.name}`);
        if (!place) continue;
        const traces = [];
        const add = (id, word, color) => {
          const series = detail.runs[id];
          if (!series || !series[channel.name]) return;
          traces.push(line(series, `${word} (run ${id})`, channel, color, 1.6));
          if (channel.name !== "nav_relative_error_m" || !series.nav_relative_sigma3_m) return;
          traces.push(line(series, `3 sigma of run ${id}`, { ...channel, from: "nav_relative_sigma3_m" }, color, 1.2, "dot"));
        };
        add(detail.median, run ? "median" : "run", "#0072B2");
        if (run && run !== String(detail.median)) add(run, "beside it", "#D55E00");
        const values = traces.flatMap((trace) => trace.y.filter((value) => value > 0));
        // Of a range that is far greater than the others the axis is logarithmic, too.
        const wide = Math.max(...values) / Math.min(...values);
        const log = channel.log ? wide > 5 : channel.name === "range_m" && wide > 50;
        if (log) for (const trace of traces) trace.y = trace.y.map((value) => (value > 0 ? value : null));
        Charts.draw(place, { data: traces, layout: {
          xaxis: { ticksuffix: " s" }, yaxis: { ...(log ? { type: "log" } : { rangemode: "tozero" }), title: { text: channel.unit ? `[${channel.unit}]` : "[-]" } },
          shapes: channel.limits.map(({ value, text }) => ({ type: "line", y0: value, y1: value, name: "limit", label: { text }, line: { color: "#D55E00", width: 1.6, dash: "dash" } })),
        } });
      }
      for (const row of document.querySelectorAll("[data-run]")) row.hidden = row.dataset.run !== run;
    }

    if (pick) pick.addEventListener("change", draw);
    draw();
  }

  function followScroll() {
    const links = new Map([...document.querySelectorAll(".contents a")].map((a) => [a.hash.slice(1), a]));
    const watcher = new IntersectionObserver((entries) => {
      for (const entry of entries) {
        if (!entry.isIntersecting) continue;
        links.forEach((link) => link.classList.remove("here"));
        links.get(entry.target.id).classList.add("here");
      }
    }, { rootMargin: "-10% 0px -80% 0px" });
    links.forEach((_, id) => watcher.observe(document.getElementById(id)));
  }

  // Tables that are wider than the screen say so.
  function hintTables() {
    for (const wide of document.querySelectorAll(".wide")) wide.classList.toggle("scrolls", wide.scrollWidth > wide.clientWidth + 1);
  }

  const closed = [];

  // What is folded is drawn when it is opened.
  document.addEventListener("toggle", () => { Charts.reveal(); hintTables(); }, true);

  // The print layout applies only while printing, so charts are drawn anew for the widths of their containers on paper.
  function fitPaper() {
    if (document.body.classList.contains("brief")) return;
    for (const details of document.querySelectorAll("details:not([open])")) {
      if (details.classList.contains("screen")) continue;
      details.open = true;
      closed.push(details);
    }
    Charts.resize((place) => {
      const columns = place.closest(".cards.two, .pair") ? 2 : place.closest(".cards, .three") ? 3 : 1;
      return paperWidth / columns - (columns > 1 ? 26 : 0);
    });
  }

  function fitScreen() {
    if (document.body.classList.contains("brief")) return;
    closed.splice(0).forEach((details) => { details.open = false; });
    Charts.resize();
  }

  const contents = document.querySelector(".contents details");
  if (contents && window.matchMedia("(max-width: 700px)").matches) contents.open = false;
  window.addEventListener("beforeprint", fitPaper);
  window.addEventListener("afterprint", fitScreen);
  let pending = 0;
  let before = window.innerWidth;
  window.addEventListener("resize", () => {
    if (window.innerWidth === before) return;
    before = window.innerWidth;
    clearTimeout(pending);
    pending = setTimeout(() => { Charts.resize(); hintTables(); }, 120);
  });
  drawNext([...document.querySelectorAll("[data-chart]")]);
  if (data.explorer) explore(data.explorer);
  if (data.detail) compareRuns(data.detail);
  Scene.start(data.scene);
  hintTables();
  Tables.start();
  Runs.start(data);
  Sections.start();
  if (contents) followScroll();
})();
