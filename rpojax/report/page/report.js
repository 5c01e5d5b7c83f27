(() => {
  "use strict";
  const data = JSON.parse(document.getElementById("page-data").textContent);
  const buttons = [["toImage", "zoom2d", "pan2d", "resetScale2d"]];
  const config = { responsive: true, displaylogo: false, plotlyServerURL: "", modeBarButtons: buttons };
  const paperWidth = 690;
  const quiet = { ...config, displayModeBar: false };

  function drawNext(waiting) {
    const place = waiting.shift();
    if (!place) return;
    const chart = data.charts[place.dataset.chart];
    Plotly.newPlot(place, chart.data, chart.layout, place.classList.contains("tall") ? config : quiet);
    setTimeout(() => drawNext(waiting), 0);
  }

  // Plotly interprets markup in texts.
  function asText(name) {
    return name.replaceAll("&", "&amp;").replaceAll("<", "&lt;");
  }

  function fill(select, entries) {
    for (const [value, text] of entries) select.add(new Option(text, value));
  }

  function explore(explorer) {
    const metricPick = document.getElementById("pick-metric");
    const inputPick = document.getElementById("pick-input");
    const axis = { gridcolor: "#e3e8ee", zeroline: false, automargin: true, exponentformat: "none" };
    const font = { family: getComputedStyle(document.body).fontFamily, size: 12, color: "#1a2433" };
    const base = { font, paper_bgcolor: "white", plot_bgcolor: "white", showlegend: false, margin: { l: 60, r: 14, t: 10, b: 44 } };

    function strongest(metric) {
      return Object.entries(metric.rank).sort((a, b) => Math.abs(b[1]) - Math.abs(a[1]));
    }

    function drawRanks(metric, input) {
      const ranks = strongest(metric).slice(0, 12).reverse();
      const line = (x) => ({ type: "line", yref: "paper", y0: 0, y1: 1, x0: x, x1: x, line: { color: "#5b6776", dash: "dot", width: 1.5 } });
      const colors = ranks.map(([key]) => (key === input ? "#D55E00" : "#0072B2"));
      Plotly.react("rank-chart", [{
        type: "bar", orientation: "h", x: ranks.map((r) => r[1]), y: ranks.map((r) => asText(r[0])), customdata: ranks.map((r) => r[0]),
        marker: { color: colors, opacity: 0.8 }, hovertemplate: "%{y}: %{x:.3f}<extra></extra>",
      }], {
        ...base, shapes: metric.independence_limit === null ? [] : [line(metric.independence_limit), line(-metric.independence_limit)],
        xaxis: { ...axis, range: [-1, 1], title: { text: "Spearman rank correlation" } }, yaxis: { ...axis, tickfont: { size: 11 } },
      }, quiet);
      document.getElementById("rank-note").textContent = metric.independence_limit === null ? "" : "significance limit \u00b1" + metric.independence_limit.toFixed(3);
    }

    function drawScatter(metric, input) {
      const title = metric.title + (metric.unit ? " [" + metric.unit + "]" : "");
      Plotly.react("scatter-chart", [{
        type: "scatter", mode: "markers", x: explorer.inputs[input], y: metric.values, text: explorer.runs.map((run) => "run " + run),
        marker: { size: 5, color: "#0072B2", opacity: 0.5 }, hovertemplate: "%{text}<br>%{x}, %{y}<extra></extra>",
      }], { ...base, xaxis: { ...axis, title: { text: asText(input) } }, yaxis: { ...axis, title: { text: title } } }, quiet);
      const rank = metric.rank[input];
      document.getElementById("scatter-note").textContent = rank === undefined ? "" : "rank correlation " + rank.toFixed(3);
    }

    function draw() {
      const metric = explorer.metrics[metricPick.value];
      drawRanks(metric, inputPick.value);
      drawScatter(metric, inputPick.value);
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
    document.getElementById("rank-chart").on("plotly_click", (event) => {
      inputPick.value = event.points[0].customdata;
      draw();
    });
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

  const closed = [];

  // The print layout applies only while printing, so charts are resized to the widths of their containers on paper.
  function fitPaper() {
    for (const details of document.querySelectorAll("details:not([open])")) {
      details.open = true;
      closed.push(details);
    }
    for (const place of document.querySelectorAll(".js-plotly-plot")) {
      const columns = place.closest(".cards.two, .pair") ? 2 : place.closest(".cards") ? 3 : 1;
      Plotly.relayout(place, { autosize: false, width: paperWidth / columns - (columns > 1 ? 26 : 0) });
    }
  }

  function fitScreen() {
    closed.splice(0).forEach((details) => { details.open = false; });
    document.querySelectorAll(".js-plotly-plot").forEach((place) => Plotly.relayout(place, { autosize: true, width: null }));
  }

  if (window.matchMedia("(max-width: 700px)").matches) document.querySelector(".contents details").open = false;
  window.addEventListener("beforeprint", fitPaper);
  window.addEventListener("afterprint", fitScreen);
  drawNext([...document.querySelectorAll("[data-chart]")]);
  if (data.explorer) explore(data.explorer);
  followScroll();
})();
