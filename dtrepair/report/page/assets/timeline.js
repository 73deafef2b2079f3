// The timeline: all frames in one chart. `drawTimeline(data, choose)` calls `choose(frame)`.
function drawTimeline(data, choose) {
  const place = document.getElementById("chart");
  if (!place || typeof uPlot === "undefined" || data.labels.length < 2) return null;
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const label = (value) => {
    const at = data.x.indexOf(value);
    return at >= 0 ? data.labels[at] : String(value);
  };
  let band = null;
  const digits = (value) => Math.abs(value) >= 1 ? value.toFixed(1) : value.toPrecision(2);
  const series = data.series.map((own) => ({
    label: own.name,
    scale: own.scale,
    show: own.show,
    stroke: () => colour(own.colour),
    fill: own.fill ? () => colour(own.colour) + "33" : undefined,
    width: own.scale === "mark" ? 0 : 1.6,
    points: own.scale === "mark" || data.labels.length < 40
      ? { show: true, size: own.scale === "mark" ? 9 : 5, fill: () => colour(own.colour) }
      : { show: false },
    spanGaps: false,
    value: (chart, value) => {
      if (value === null || value === undefined) return "–";
      if (own.scale === "mark") return "yes";
      return own.scale === "percent" ? digits(value) + " %" : String(value);
    },
  }));
  // No mark at half a frame, nor at half a triangle.
  const whole = [1, 10, 100, 1e3, 1e4, 1e5, 1e6, 1e7].flatMap((k) => [k, 2 * k, 5 * k]);
  const frames = data.x.every(Number.isInteger) ? { incrs: whole } : {};
  const axis = (own) => ({
    stroke: () => colour("--soft"),
    grid: { stroke: () => colour("--line"), width: 1 },
    ticks: { stroke: () => colour("--line"), width: 1 },
    ...own,
  });
  const percent = data.series.some((own) => own.scale === "percent");
  const options = {
    width: Math.max(place.clientWidth, 300),
    height: 300,
    cursor: { drag: { x: true, y: false }, focus: { prox: 24 } },
    scales: { x: { time: false }, count: { range: (u, low, high) => [0, Math.max(high, 1) * 1.08] },
      percent: { range: (u, low, high) => [Math.min(low, 0), Math.max(high, 1e-6) * 1.08] },
      mark: { range: [0, 1] } },
    series: [{ label: "frame", value: (u, value) => value === null ? "–" : label(value) }, ...series],
    axes: [
      axis({ label: "frame", ...frames, values: (u, ticks) => ticks.map((t) => data.numbered ? t : label(t)) }),
      axis({ scale: "count", label: "triangles", size: 64, incrs: whole }),
      ...(percent ? [axis({ scale: "percent", side: 1, label: "% of size or volume", size: 64,
        grid: { show: false }, values: (u, ticks) => ticks.map((t) => t + " %") })] : []),
    ],
    hooks: {
      drawClear: [(u) => {
        if (!band) return;
        const [from, to] = [u.valToPos(band[0], "x", true), u.valToPos(band[1], "x", true)];
        u.ctx.fillStyle = colour("--mark");
        u.ctx.fillRect(from - 3, u.bbox.top, Math.max(to - from, 1) + 6, u.bbox.height);
      }],
    },
  };
  const chart = new uPlot(options, [data.x, ...data.series.map((own) => own.values)], place);
  // A drag zooms, a click goes to the frame: only where the pointer stayed is it a click.
  let pressed = null;
  chart.over.addEventListener("mousedown", (event) => { pressed = event.clientX; });
  chart.over.addEventListener("click", (event) => {
    const stayed = pressed === null || Math.abs(event.clientX - pressed) < 4;
    if (stayed && chart.cursor.idx !== null && chart.cursor.idx !== undefined) {
      choose(chart.cursor.idx);
    }
  });
  new ResizeObserver(() => chart.setSize({ width: Math.max(place.clientWidth, 300), height: 300 }))
    .observe(place);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => chart.redraw());
  return {
    chart,
    mark(first, last) { band = [data.x[first], data.x[last]]; chart.redraw(false); },
  };
}
