"use strict";
(() => {
  const root = document.documentElement;
  const charts = JSON.parse(document.getElementById("charts").textContent);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const themeButton = document.getElementById("theme");
  const plots = [];
  let view = "both";
  let printing = false;

  const style = (name) => getComputedStyle(root).getPropertyValue(name).trim();
  let colours = {};
  const readColours = () => {
    for (const name of ["before", "after", "explained", "limit", "ink", "grid", "held-out", "band"]) {
      colours[name] = style("--" + name);
    }
  };

  // Four digits, and no more letters than needed.
  const shown = (value) => {
    if (value == null) return "–";
    const size = Math.abs(value);
    if (size !== 0 && (size < 1e-3 || size >= 1e5)) return value.toExponential(2);
    return String(Number(value.toPrecision(4)));
  };

  const raised = (power) => "10" + String(power).replace(/./g, (c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]);
  // On logarithmic axes the powers of ten alone.
  const ticks = (logarithmic) => (_, splits) => splits.map((value) => {
    if (value == null) return "";
    if (!logarithmic) return shown(value);
    const power = Math.log10(value);
    if (Math.abs(power - Math.round(power)) > 1e-6) return "";
    return Math.abs(power) < 1.5 ? shown(value) : raised(Math.round(power));
  });

  const inView = (curve) => curve.views.includes(view);

  // The same scale in every view, so that before and after can be compared; nothing is cut off.
  const heights = (entry) => () => {
    const { chart, span } = entry;
    let least = Infinity, most = -Infinity;
    const reach = (value) => {
      if (value == null || (chart.logarithmic && value <= 0)) return;
      if (value < least) least = value;
      if (value > most) most = value;
    };
    for (let row = 0; row < chart.x.length; row++) {
      if (chart.x[row] < span.min || chart.x[row] > span.max) continue;
      for (const curve of chart.curves) {
        const value = curve.y[row];
        reach(value);
        if (value != null && curve.error) {
          reach(value - curve.error[row]);
          reach(value + curve.error[row]);
        }
      }
    }
    if (least > most) return chart.logarithmic ? [0.1, 10] : [-1, 1];
    if (chart.logarithmic) return uPlot.rangeLog(least, most, 10, false);
    const margin = most > least ? 0.06 * (most - least) : Math.abs(most) || 1;
    return [least - margin, most + margin];
  };

  const dots = (radius, fill) => (plot, index) => {
    const context = plot.ctx;
    const { scales, data, bbox } = plot;
    const x = data[0], y = data[index];
    const r = radius * devicePixelRatio;
    context.save();
    context.beginPath();
    context.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    context.clip();
    context.fillStyle = fill();
    context.beginPath();
    for (let row = 0; row < x.length; row++) {
      if (y[row] == null || x[row] < scales.x.min || x[row] > scales.x.max) continue;
      const at = plot.valToPos(x[row], "x", true), height = plot.valToPos(y[row], "y", true);
      context.moveTo(at + r, height);
      context.arc(at, height, r, 0, 2 * Math.PI);
    }
    context.fill();
    context.restore();
    return null;
  };

  const seriesOf = (curve, chart) => {
    const ink = () => colours[curve.ink];
    const common = {
      label: curve.label, show: inView(curve), stroke: ink, spanGaps: false,
      value: (_, value) => shown(value), points: { show: false },
    };
    switch (curve.look) {
      case "thin": return { ...common, width: 1, spanGaps: chart.group != null && curve.sparse };
      case "line": return { ...common, width: 2, spanGaps: curve.sparse };
      case "dash": return { ...common, width: 1, dash: [5, 4] };
      case "dots": return { ...common, paths: dots(1.1, () => colours[curve.ink] + "80") };
      default: return { ...common, paths: dots(2.6, ink) };
    }
  };

  const drawUnder = (chart) => (plot) => {
    const { ctx, bbox } = plot;
    const at = (x) => Math.max(bbox.left, Math.min(bbox.left + bbox.width, plot.valToPos(x, "x", true)));
    ctx.save();
    for (const shade of chart.shades) {
      if (shade.kind === "held_out") {
        ctx.fillStyle = colours["held-out"];
        ctx.fillRect(at(shade.from), bbox.top, at(shade.to) - at(shade.from), bbox.height);
      } else {
        ctx.strokeStyle = colours.explained;
        ctx.lineWidth = 1.5 * devicePixelRatio;
        ctx.setLineDash([6 * devicePixelRatio, 4 * devicePixelRatio]);
        for (const x of [shade.from, shade.to]) {
          if (x <= plot.scales.x.min || x >= plot.scales.x.max) continue;
          ctx.beginPath();
          ctx.moveTo(at(x), bbox.top);
          ctx.lineTo(at(x), bbox.top + bbox.height);
          ctx.stroke();
        }
      }
    }
    ctx.restore();
  };

  const drawOver = (chart) => (plot) => {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.lineWidth = devicePixelRatio;
    ctx.strokeStyle = colours.limit;
    for (const level of chart.levels) {
      const height = plot.valToPos(level, "y", true);
      ctx.beginPath();
      ctx.moveTo(bbox.left, height);
      ctx.lineTo(bbox.left + bbox.width, height);
      ctx.stroke();
    }
    ctx.lineWidth = 1.5 * devicePixelRatio;
    for (const curve of chart.curves) {
      if (!curve.error || !inView(curve)) continue;
      ctx.strokeStyle = colours[curve.ink];
      ctx.beginPath();
      curve.y.forEach((value, row) => {
        if (value == null || curve.error[row] == null) return;
        const x = plot.valToPos(chart.x[row], "x", true);
        ctx.moveTo(x, plot.valToPos(value - curve.error[row], "y", true));
        ctx.lineTo(x, plot.valToPos(value + curve.error[row], "y", true));
      });
      ctx.stroke();
    }
    ctx.restore();
  };

  const ends = (chart) => [chart.x[0], chart.x[chart.x.length - 1]];

  // Zooms and moves within what there is; a group of plots together.
  const setSpan = (entry, low, high) => {
    const [first, last] = ends(entry.chart);
    const log = entry.chart.logarithmic;
    const to = log ? Math.log10 : (x) => x, from = log ? (x) => 10 ** x : (x) => x;
    let a = to(low), b = to(high);
    const all = to(last) - to(first);
    const width = Math.min(Math.max(b - a, all * 1e-4), all);
    const centre = (a + b) / 2;
    a = Math.max(to(first), Math.min(to(last) - width, centre - width / 2));
    const span = { min: from(a), max: from(a + width) };
    for (const other of plots) {
      if (other === entry || (entry.chart.group && other.chart.group === entry.chart.group)) {
        other.span = span;
        other.plot.setScale("x", span);
      }
    }
  };

  const act = (entry, name) => {
    const { plot, chart } = entry;
    const { min, max } = plot.scales.x;
    const log = chart.logarithmic;
    const to = log ? Math.log10 : (x) => x, from = log ? (x) => 10 ** x : (x) => x;
    const a = to(min), b = to(max), width = b - a;
    const index = plot.cursor.idx;
    const focus = index != null && chart.x[index] >= min && chart.x[index] <= max ? to(chart.x[index]) : (a + b) / 2;
    switch (name) {
      case "in": return setSpan(entry, from(focus - width / 4), from(focus + width / 4));
      case "out": return setSpan(entry, from((a + b) / 2 - width), from((a + b) / 2 + width));
      case "left": return setSpan(entry, from(a - width / 4), from(b - width / 4));
      case "right": return setSpan(entry, from(a + width / 4), from(b + width / 4));
      default: return setSpan(entry, ...ends(chart));
    }
  };

  const point = (entry, x) => {
    entry.plot.setCursor({ left: entry.plot.valToPos(x, "x"), top: entry.plot.over.clientHeight / 2 });
  };

  const stepCursor = (entry, direction, fast) => {
    const { plot, chart } = entry;
    const { min, max } = plot.scales.x;
    const left = plot.cursor.left >= 0 ? plot.cursor.left : plot.over.clientWidth / 2;
    const moved = left + direction * (fast ? 40 : 4);
    point(entry, Math.max(min, Math.min(max, plot.posToVal(moved, "x"))));
    const row = plot.cursor.idx;
    const values = chart.curves.filter((curve) => inView(curve) && curve.label && curve.y[row] != null)
      .map((curve) => `${curve.label} ${shown(curve.y[row])}`);
    entry.told.textContent = `${chart.xLabel} ${shown(chart.x[row])}: ${values.join(", ")}`;
  };

  const onKey = (entry) => (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const name = { "+": "in", "=": "in", "-": "out", "0": "all", Escape: "all", PageUp: "left", PageDown: "right" }[event.key];
    if (name) act(entry, name);
    else if (event.key === "ArrowLeft") stepCursor(entry, -1, event.shiftKey);
    else if (event.key === "ArrowRight") stepCursor(entry, 1, event.shiftKey);
    else return;
    event.preventDefault();
  };

  // One finger reads, two zoom; up and down stay with the page.
  const onTouch = (entry) => {
    const over = entry.plot.over;
    let start = null;
    const place = (touch) => touch.clientX - over.getBoundingClientRect().left;
    const pinch = (touches) => ({
      centre: (place(touches[0]) + place(touches[1])) / 2,
      width: Math.max(10, Math.abs(place(touches[0]) - place(touches[1]))),
    });
    over.addEventListener("touchstart", (event) => {
      if (event.touches.length === 2) {
        const { min, max } = entry.plot.scales.x;
        start = { ...pinch(event.touches), min, max };
      }
    }, { passive: true });
    over.addEventListener("touchmove", (event) => {
      if (event.touches.length === 1 && !start) {
        point(entry, entry.plot.posToVal(place(event.touches[0]), "x"));
      } else if (event.touches.length === 2 && start && !entry.chart.logarithmic) {
        event.preventDefault();
        const now = pinch(event.touches);
        const perPixel = (start.max - start.min) / over.clientWidth;
        const width = (start.max - start.min) * start.width / now.width;
        const held = start.min + start.centre * perPixel;
        const low = held - now.centre * width / over.clientWidth;
        setSpan(entry, low, low + width);
      }
    }, { passive: false });
    over.addEventListener("touchend", (event) => { if (event.touches.length === 0) start = null; });
  };

  const make = (holder) => {
    const chart = charts[Number(holder.dataset.chart)];
    for (const curve of chart.curves) curve.sparse = curve.look === "line" && chart.curves.some((c) => c.error);
    if (chart.group) for (const curve of chart.curves) if (curve.look === "thin") curve.sparse = chart.curves.some((c) => c.look === "marks");
    const axis = (label, size) => ({
      label, labelSize: 22, size, stroke: () => colours.ink, labelFont: "13px system-ui, sans-serif",
      font: "12px system-ui, sans-serif", grid: { stroke: () => colours.grid, width: 1 },
      ticks: { stroke: () => colours.grid, width: 1 },
      values: ticks(chart.logarithmic),
    });
    const distribution = chart.logarithmic ? 3 : 1;
    const [first, last] = ends(chart);
    const entry = { chart, holder, span: { min: first, max: last } };
    const plot = new uPlot({
      width: holder.clientWidth || 600,
      height: 260,
      padding: [8, 12, 0, 0],
      scales: {
        x: { time: false, distr: distribution, range: (_, low, high) => [low, high] },
        y: { distr: distribution, range: heights(entry) },
      },
      axes: [
        axis(chart.xLabel, 34),
        axis(chart.yLabel, 58),
      ],
      series: [
        { label: chart.xLabel, value: (_, value) => shown(value) },
        ...chart.curves.map((curve) => seriesOf(curve, chart)),
      ],
      bands: chart.bands.map(([upper, lower]) => ({ series: [upper + 1, lower + 1], fill: () => colours.band })),
      legend: { live: true },
      cursor: {
        drag: { x: true, y: false, setScale: false },
        points: { size: 7 },
        // What is drawn sparsely is read at its nearest point.
        dataIdx: (self, series, nearest) => {
          const values = self.data[series];
          if (series === 0 || values[nearest] != null) return nearest;
          for (let off = 1; off < 60; off++) {
            if (values[nearest - off] != null) return nearest - off;
            if (values[nearest + off] != null) return nearest + off;
          }
          return nearest;
        },
        sync: chart.group ? { key: chart.group, setSeries: false } : undefined,
      },
      hooks: {
        drawClear: [drawUnder(chart)],
        draw: [drawOver(chart)],
        setSelect: [(self) => {
          const { left, width } = self.select;
          if (width > 4) setSpan(entry, self.posToVal(left, "x"), self.posToVal(left + width, "x"));
          self.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
        }],
      },
    }, [chart.x, ...chart.curves.map((curve) => curve.y)], holder);
    entry.plot = plot;
    entry.told = document.createElement("p");
    entry.told.className = "told";
    entry.told.setAttribute("aria-live", "polite");
    holder.append(entry.told);
    // Curves without a name are the second edges of bands.
    const rows = holder.querySelectorAll(".u-legend .u-series");
    chart.curves.forEach((curve, index) => {
      if (!curve.label) rows[index + 1].classList.add("unnamed");
      rows[index + 1].style.display = inView(curve) && curve.label ? "" : "none";
    });
    entry.rows = rows;
    plot.over.addEventListener("dblclick", () => act(entry, "all"));
    holder.addEventListener("keydown", onKey(entry));
    onTouch(entry);
    for (const button of holder.parentElement.querySelectorAll(".tools button")) {
      button.addEventListener("click", () => act(entry, button.dataset.act));
    }
    plots.push(entry);
    return entry;
  };

  const show = (which) => {
    view = which;
    for (const { plot, chart, rows } of plots) {
      plot.batch(() => {
        chart.curves.forEach((curve, index) => {
          plot.setSeries(index + 1, { show: inView(curve) });
          rows[index + 1].style.display = inView(curve) && curve.label ? "" : "none";
        });
      });
    }
  };

  const isDark = () => !printing && (root.dataset.theme ? root.dataset.theme === "dark" : dark.matches);
  const recolour = () => {
    readColours();
    themeButton.setAttribute("aria-pressed", String(isDark()));
    for (const { plot, chart, rows } of plots) {
      plot.redraw(false);
      chart.curves.forEach((curve, index) => {
        const marker = rows[index + 1].querySelector(".u-marker");
        if (marker) marker.style.borderColor = colours[curve.ink];
      });
    }
  };
  themeButton.addEventListener("click", () => {
    root.dataset.theme = isDark() ? "light" : "dark";
    recolour();
  });
  dark.addEventListener("change", recolour);

  const fit = (entry) => {
    const width = entry.holder.clientWidth;
    if (width > 0 && width !== entry.plot.width) entry.plot.setSize({ width, height: 260 });
  };
  addEventListener("beforeprint", () => {
    printing = true;
    root.classList.add("printing");
    recolour();
    plots.forEach(fit);
  });
  addEventListener("afterprint", () => {
    printing = false;
    root.classList.remove("printing");
    recolour();
    plots.forEach((entry) => entry.plot.setSize({ width: entry.holder.clientWidth, height: 260 }));
  });

  readColours();
  document.querySelectorAll(".plot").forEach(make);
  recolour();
  const observer = new ResizeObserver((changes) => {
    for (const { target } of changes) {
      const entry = plots.find((it) => it.holder === target);
      if (entry && !printing) fit(entry);
    }
  });
  for (const { holder } of plots) observer.observe(holder);
  for (const choice of document.querySelectorAll('input[name="view"]')) {
    choice.addEventListener("change", () => show(choice.value));
    if (choice.checked) show(choice.value);
  }
})();
