// Frame, outlines, time line and cursor of the graphs. The server sends marks and receives events.
(() => {
"use strict";
const SVG = "http://www.w3.org/2000/svg";
const viewer = window.visionViewer = {};
let now = null;

const make = (tag, attributes = {}, parent = null) => {
  const one = tag.startsWith("svg:") ? document.createElementNS(SVG, tag.slice(4))
                                     : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes))
    if (name === "text") one.textContent = value; else one.setAttribute(name, value);
  if (parent) parent.append(one);
  return one;
};
const limited = (value, low, high) => Math.min(Math.max(value, low), high);
const empty = () => ({objects: [], candidates: [], events: [], contact: null, pivot: null, landing: null});
const send = (name, what) => window.emitEvent && window.emitEvent(name, what);

viewer.open = config => {
  const host = document.querySelector(config.host);
  if (!host) return setTimeout(() => viewer.open(config), 30);
  host.replaceChildren();
  const held = window.sessionStorage.getItem("vision-frame-" + config.clip);
  now = {...config, at: limited(Number(held) || 0, 0, Math.max(config.frames - 1, 0)), shown: -1,
         loading: -1, zoom: 1, left: 0, top: 0, mode: "", all: false, marks: empty(), charts: [],
         cross: null, drag: null, play: null, unseen: true, points: placed(config.points || [])};
  const words = config.words;
  const stage = make("div", {class: "vs-stage", tabindex: "0", role: "application",
                             "aria-label": words.stage, "data-test": "stage"}, host);
  const layer = make("div", {class: "vs-layer"}, stage);
  now.image = make("img", {alt: "", draggable: "false"}, layer);
  const view = {viewBox: `-0.5 -0.5 ${config.width} ${config.height}`, preserveAspectRatio: "none",
                "aria-hidden": "true"};
  now.under = make("svg:svg", {...view, "data-test": "under"}, layer);
  now.svg = make("svg:svg", view, layer);
  stage.style.aspectRatio = `${config.width} / ${config.height}`;
  // a tall clip fits on the screen
  stage.style.maxWidth = `calc(75vh * ${config.width / config.height})`;
  now.stage = stage;
  now.layer = layer;
  const line = make("div", {class: "vs-line"}, host);
  now.ticks = make("div", {class: "vs-ticks", "aria-hidden": "true"}, line);
  now.range = make("input", {type: "range", min: "0", max: String(Math.max(config.frames - 1, 0)),
                             step: "1", "aria-label": words.timeline, "data-test": "timeline"}, line);
  const row = make("div", {class: "vs-row"}, host);
  const button = (text, label, act, test) => {
    const one = make("button", {type: "button", class: "vs-button", "aria-label": label, title: label,
                                "data-test": test, text}, row);
    one.addEventListener("click", act);
    return one;
  };
  button("◀", words.back, () => viewer.go(now.at - 1), "frame-back");
  now.player = button("▶", words.play, play, "frame-play");
  button("▶|", words.forward, () => viewer.go(now.at + 1), "frame-forward");
  button("−", words.smaller, () => zoom(1 / 1.5), "zoom-out");
  button("+", words.larger, () => zoom(1.5), "zoom-in");
  now.label = make("span", {class: "vs-where", "data-test": "where"}, row);
  now.range.addEventListener("input", () => viewer.go(Number(now.range.value)));
  stage.addEventListener("keydown", key);
  stage.addEventListener("pointerdown", press);
  stage.addEventListener("pointermove", drag);
  stage.addEventListener("pointerup", release);
  stage.addEventListener("pointercancel", () => { now.drag = null; draw(); });
  stage.addEventListener("wheel", event => {
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    zoom(event.deltaY < 0 ? 1.2 : 1 / 1.2);
  }, {passive: false});
  new ResizeObserver(draw).observe(stage);
  now.image.addEventListener("load", loaded);
  now.image.addEventListener("error", () => {
    const wanted = now.loading;
    now.loading = -1;
    // not decoded yet
    setTimeout(() => { if (now && now.at === wanted) load(); }, 400);
  });
  viewer.go(now.at);
  if (config.marks) viewer.marks(config.marks);
  // the graphs may have come first
  if (viewer.linked) viewer.charts(viewer.linked);
};

viewer.frames = count => {
  if (!now || count === now.frames) return;
  now.frames = count;
  now.range.max = String(Math.max(count - 1, 0));
  viewer.go(now.at);
};

viewer.marks = url => fetch(url).then(got => got.ok ? got.json() : empty()).then(found => {
  if (!now) return;
  now.marks = found;
  for (const one of [...found.objects, ...found.candidates])
    one.rows = new Map(one.frame.map((frame, row) => [frame, row]));
  now.fps = found.fps || now.fps;
  const first = now.unseen && found.objects.length > 0;
  if (first) now.unseen = false;
  ticks();
  // a new clip opens where something happens
  const event = found.contact ? found.contact[0] : found.events.length ? found.events[0].frame : 0;
  viewer.go(first && now.at === 0 ? event : now.at);
  draw();
});

viewer.mode = mode => {
  if (!now) return;
  now.mode = mode;
  const ball = mode === "outline" && now.marks.objects.find(one => one.kind === "ball");
  const there = ball || now.points.find(one => one.kind === mode), row = there && there.rows.get(now.shown);
  now.cross = !mode ? null
    : there && row >= 0 ? [there.x[row], there.y[row]] : [(now.width - 1) / 2, (now.height - 1) / 2];
  now.stage.classList.toggle("vs-pointing", Boolean(mode));
  if (mode) now.stage.focus({preventScroll: true});
  draw();
};

// points that are in every frame; each may be joined to another one by a line
const placed = points => points.map(one => ({...one, x: [one.x], y: [one.y], r: [0],
                                             rows: {get: () => 0}}));
viewer.points = points => { if (now) { now.points = placed(points); draw(); } };

viewer.at = kind => now.points.filter(one => one.kind === kind).flatMap(one => [one.x[0], one.y[0]]);

// drawn by the server, below everything else
viewer.under = svg => { if (now) now.under.innerHTML = svg; };

viewer.size = () => now ? [now.width, now.height] : [0, 0];

viewer.all = shown => { if (now) { now.all = shown; draw(); } };

viewer.go = frame => {
  if (!now || !now.frames) return;
  now.at = limited(Math.round(frame), 0, now.frames - 1);
  window.sessionStorage.setItem("vision-frame-" + now.clip, now.at);
  now.range.value = String(now.at);
  const time = now.fps ? `, ${(now.at / now.fps).toFixed(4)} s` : "";
  now.label.textContent = `${now.words.frame} ${now.at} / ${now.frames - 1}${time}`;
  now.range.setAttribute("aria-valuetext", now.label.textContent);
  load();
  // drawing the graphs takes longer than a frame
  if (!now.marking) now.marking = setTimeout(() => { now.marking = null; cursors(); }, 120);
};

const address = frame => `/frame/${now.clip}/${frame}`;
function load() {
  if (now.loading >= 0) return;
  if (now.shown === now.at) return draw();
  now.loading = now.at;
  now.image.src = address(now.at);
}
function loaded() {
  now.shown = now.loading;
  now.loading = -1;
  now.stage.dataset.shown = now.shown;
  draw();
  if (now.shown !== now.at) return load();
  for (const next of [now.at + 1, now.at - 1])
    if (next >= 0 && next < now.frames) new Image().src = address(next);
}
function play() {
  if (now.play) { clearInterval(now.play); now.play = null; }
  else now.play = setInterval(() => viewer.go(now.at + 1 < now.frames ? now.at + 1 : 0), 40);
  now.player.textContent = now.play ? "❚❚" : "▶";
}

// px of the clip for one of the screen; zoomed in, lines grow less than the picture
const pixel = () => now.width / Math.max(now.stage.clientWidth, 1) / Math.sqrt(now.zoom);
function circle(x, y, r, kind, label) {
  const unit = pixel();
  make("svg:circle", {cx: x, cy: y, r, class: "vs-" + kind, "stroke-width": 1.6 * unit}, now.svg);
  make("svg:circle", {cx: x, cy: y, r: 1.2 * unit, class: "vs-dot vs-" + kind}, now.svg);
  // the pendulum's below: in contact the names would cover each other
  if (label) name(x + r + 3 * unit, kind === "mass" ? y + r + 9 * unit : y - r, label);
}
function name(x, y, text) {
  const unit = pixel(), left = x > 0.85 * now.width;
  make("svg:text", {x: left ? x - 24 * unit : x, y: Math.max(y, 14 * unit), "font-size": 12 * unit,
                    class: "vs-text", "text-anchor": left ? "end" : "start", "stroke-width": 3 * unit,
                    text}, now.svg);
}
function draw() {
  if (!now) return;
  now.svg.replaceChildren();
  now.layer.style.transform = `translate(${now.left}px, ${now.top}px) scale(${now.zoom})`;
  const unit = pixel(), marks = now.marks, frame = now.shown;
  const ball = marks.objects.find(one => one.kind === "ball");
  // what is found before the end is drawn at once
  const early = !marks.objects.length, path = ball || marks.candidates.find(one => one.measured);
  if (path) {
    const points = path.frame.map((at, row) => at <= frame ? `${path.x[row]},${path.y[row]}` : "");
    make("svg:polyline", {points: points.filter(Boolean).join(" "), class: "vs-path",
                          "stroke-width": 1.1 * unit}, now.svg);
  }
  for (const one of marks.objects) {
    const row = one.rows.get(frame);
    if (row === undefined) continue;
    const moved = now.drag && now.drag.object === one ? now.drag.place : [one.x[row], one.y[row]];
    if (one.kind === "mass" && marks.pivot)
      make("svg:line", {x1: marks.pivot[0], y1: marks.pivot[1], x2: moved[0], y2: moved[1],
                        class: "vs-mass", "stroke-width": unit}, now.svg);
    const named = one.kind !== "other" || now.all;
    circle(...moved, one.r[row], one.kind, named ? now.words.objects[one.name] || one.name : "");
  }
  if (now.all || now.mode || early) for (const one of marks.candidates) {
    const row = one.rows.get(frame), kind = one.measured ? "ball" : "found";
    if (row !== undefined && (early || !one.measured))
      circle(one.x[row], one.y[row], one.r[row], kind, one.measured ? now.words.objects.ball : "");
  }
  const at = one => now.drag && now.drag.object === one ? now.drag.place : [one.x[0], one.y[0]];
  for (const one of now.points) {
    const joined = now.points.find(other => other !== one && other.kind === one.join);
    const [x, y] = at(one);
    cross([x, y], "point", one.label);
    if (!joined) continue;
    const [x2, y2] = at(joined);
    make("svg:line", {x1: x, y1: y, x2, y2, class: "vs-point", "stroke-width": 1.6 * unit}, now.svg);
  }
  if (now.cross) cross(now.cross, "cross");
}
function cross([x, y], kind, label) {
  const unit = pixel(), arm = 9 * unit;
  if (label) name(x + arm, y - arm, label);
  make("svg:path", {d: `M${x - arm},${y}H${x + arm}M${x},${y - arm}V${y + arm}`, class: "vs-" + kind,
                    "stroke-width": 1.6 * unit}, now.svg);
}
function ticks() {
  now.ticks.replaceChildren();
  const part = frame => `${100 * frame / Math.max(now.frames - 1, 1)}%`;
  const contact = now.marks.contact;
  if (contact) make("span", {class: "vs-contact", style: `left:${part(contact[0])};width:max(4px, ` +
    `${100 * (contact[1] - contact[0]) / Math.max(now.frames - 1, 1)}%)`}, now.ticks);
  for (const event of now.marks.events)
    make("span", {class: "vs-tick", style: `left:${part(event.frame)}`,
                  title: now.words.events[event.name] || event.name}, now.ticks);
}

function zoom(factor) {
  const room = now.stage.getBoundingClientRect();
  const before = now.zoom;
  now.zoom = limited(before * factor, 1, 12);
  for (const [side, length] of [["left", room.width], ["top", room.height]])
    now[side] = limited(length / 2 - (length / 2 - now[side]) * now.zoom / before,
                        length * (1 - now.zoom), 0);
  draw();
}
function place(event) {
  const room = now.layer.getBoundingClientRect();
  return [(event.clientX - room.left) / room.width * now.width - 0.5,
          (event.clientY - room.top) / room.height * now.height - 0.5];
}
function grabbed([x, y]) {
  const slack = 8 * now.width / now.layer.getBoundingClientRect().width;
  let best = null, least = Infinity;
  for (const one of [...now.points, ...now.marks.objects]) {
    const row = one.kind === "other" ? undefined : one.rows.get(now.shown);
    if (row === undefined) continue;
    const far = Math.hypot(x - one.x[row], y - one.y[row]);
    if (far < Math.max(one.r[row], slack) && far < least) [best, least] = [one, far];
  }
  return best;
}
function press(event) {
  if (event.button !== 0) return;
  now.stage.focus({preventScroll: true});
  const at = place(event);
  if (now.mode) { now.cross = at; now.drag = {kind: "cross"}; }
  else {
    const object = grabbed(at);
    const row = object && object.rows.get(now.shown);
    now.drag = object
      ? {kind: "object", object, place: at, from: [object.x[row] - at[0], object.y[row] - at[1]], far: 0,
         start: [event.clientX, event.clientY]}
      : {kind: "pan", x: event.clientX - now.left, y: event.clientY - now.top};
    if (object) now.drag.place = [object.x[row], object.y[row]];
  }
  now.stage.setPointerCapture(event.pointerId);
  draw();
}
function drag(event) {
  if (!now.drag) return;
  const at = place(event), one = now.drag;
  if (one.kind === "cross") now.cross = at;
  else if (one.kind === "object") {
    one.place = [at[0] + one.from[0], at[1] + one.from[1]];
    one.far = Math.max(one.far, Math.hypot(event.clientX - one.start[0], event.clientY - one.start[1]));
  } else if (now.zoom > 1) {
    const room = now.stage.getBoundingClientRect();
    now.left = limited(event.clientX - one.x, room.width * (1 - now.zoom), 0);
    now.top = limited(event.clientY - one.y, room.height * (1 - now.zoom), 0);
  }
  draw();
}
function release() {
  const one = now.drag;
  now.drag = null;
  if (!one) return;
  if (one.kind === "cross") settle();
  // a click without a movement changes nothing
  else if (one.kind === "object" && one.far > 2)
    send("vision_moved", {object: one.object.kind, frame: now.shown, x: one.place[0], y: one.place[1]});
  draw();
}
function settle() {
  const [x, y] = now.cross;
  send("vision_pointed", {object: now.mode, frame: now.shown, x, y});
}
function key(event) {
  const steps = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]};
  const step = steps[event.key], size = event.shiftKey ? 10 : event.altKey && now.mode ? 0.1 : 1;
  if (now.mode && (step || event.key === "Enter" || event.key === "Escape")) {
    if (step) now.cross = now.cross.map((one, axis) => one + size * step[axis]);
    else if (event.key === "Enter") settle();
    else send("vision_pointed", {object: ""});
    draw();
  } else if (step && step[0]) viewer.go(now.at + size * step[0]);
  else if (event.key === "Home") viewer.go(0);
  else if (event.key === "End") viewer.go(now.frames - 1);
  else if (event.key === " ") play();
  else if (event.key === "+") zoom(1.5);
  else if (event.key === "-") zoom(1 / 1.5);
  else if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z")
    send(event.shiftKey ? "vision_redo" : "vision_undo", {});
  else return;
  event.preventDefault();
}

// graphs: a click goes to the nearest point's frame, and the frame is marked
viewer.charts = charts => {
  viewer.linked = charts;
  if (!now) return;
  now.charts = charts.map(one => ({...one, chart: null, points: []}));
  now.stage.dataset.graphs = "";
  attach(40);
};
function attach(tries) {
  let missing = false;
  for (const one of now.charts) {
    if (one.chart) continue;
    const element = window.getElement ? window.getElement(one.id) : null;
    const options = element && element.chart && element.chart.getOption();
    if (!options || !options.series || !options.series.length) { missing = true; continue; }
    one.chart = element.chart;
    one.points = options.series.flatMap(part =>
      (part.data || []).filter(row => row.length > 2).map(row => [...row, part.name]));
    paint(one.chart);
    const zr = one.chart.getZr();
    zr.on("click", event => { const row = nearest(one, event); if (row) viewer.go(row[2]); });
    if (one.time) select(one, zr);
  }
  if (!missing) now.stage.dataset.graphs = "ready";
  else if (tries > 0) setTimeout(() => attach(tries - 1), 100);
  cursors();
}
function paint(chart) {
  const style = getComputedStyle(document.body), color = style.getPropertyValue("--ink").trim();
  const line = {lineStyle: {color: style.getPropertyValue("--muted").trim()}};
  const axis = {axisLabel: {color}, nameTextStyle: {color}, axisLine: line, axisTick: line};
  chart.setOption({legend: {textStyle: {color}}, xAxis: axis, yAxis: axis});
}
// light or dark is a class of the body, by the switch or by the system
new MutationObserver(() => {
  if (!now) return;
  for (const one of now.charts) if (one.chart && !one.chart.isDisposed()) paint(one.chart);
  cursors();
}).observe(document.body, {attributes: true, attributeFilter: ["class"]});
function nearest(one, event) {
  let best = null, least = Infinity;
  for (const row of one.points) {
    const [x, y] = one.chart.convertToPixel("grid", row.slice(0, 2));
    const far = Math.hypot(x - event.offsetX, one.time ? 0.2 * (y - event.offsetY) : y - event.offsetY);
    if (far < least) [best, least] = [row, far];
  }
  return best;
}
// a span is dragged: of the series that is nearest to its start
function select(one, zr) {
  let from = null, start = null;
  const shade = to => {
    const ends = [from, to].map(row => ({xAxis: row[0]}));
    one.chart.setOption({series: [{id: "fit", type: "line", data: [], silent: true, name: "",
      markArea: {silent: true, itemStyle: {opacity: .15}, data: [ends]}}]});
  };
  const same = event => {
    const time = one.chart.convertFromPixel("grid", [event.offsetX, event.offsetY])[0];
    const rows = one.points.filter(row => row[3] === from[3]);
    return rows.reduce((best, row) => Math.abs(row[0] - time) < Math.abs(best[0] - time) ? row : best);
  };
  zr.on("mousedown", event => {
    start = event.event.ctrlKey || event.event.metaKey ? null : event.offsetX;
    from = start === null ? null : nearest(one, event);
  });
  zr.on("mousemove", event => {
    if (from && Math.abs(event.offsetX - start) > 6) shade(same(event));
  });
  zr.on("mouseup", event => {
    const far = from && Math.abs(event.offsetX - start) > 6;
    const to = far ? same(event) : null;
    if (to) send("vision_span", {series: `${one.name}: ${from[3]}`, from: from[2], to: to[2]});
    from = null;
  });
  zr.on("globalout", () => { from = null; });
}
viewer.fitted = (number, curve) => {
  const color = getComputedStyle(document.body).getPropertyValue("--ink").trim();
  now.charts.forEach((one, place) => {
    if (!one.chart || one.chart.isDisposed()) return;
    const data = place === number ? curve : [];
    const ends = data.length ? [[{xAxis: data[0][0]}, {xAxis: data[data.length - 1][0]}]] : [];
    one.chart.setOption({series: [{id: "fit", type: "line", data, showSymbol: false, silent: true,
      name: "", z: 8, lineStyle: {color, width: 2, type: "dashed"},
      markArea: {silent: true, itemStyle: {opacity: .12}, data: ends}}]});
  });
};
function cursors() {
  const color = getComputedStyle(document.body).getPropertyValue("--accent").trim();
  for (const one of now.charts) {
    if (!one.chart || one.chart.isDisposed()) continue;
    let best = null;
    for (const row of one.points)
      if (!best || Math.abs(row[2] - now.at) < Math.abs(best[2] - now.at)) best = row;
    const near = best && Math.abs(best[2] - now.at) <= 1;
    const points = near ? one.points.filter(row => row[2] === best[2]).map(row => row.slice(0, 2)) : [];
    const x = one.time && near ? best[0] : null;
    one.chart.setOption({series: [{id: "cursor", type: "line", data: points, lineStyle: {opacity: 0},
      symbol: "circle", symbolSize: 11, showSymbol: true, silent: true, z: 9,
      itemStyle: {color: "transparent", borderColor: color, borderWidth: 2},
      markLine: {silent: true, symbol: "none", label: {show: false}, animation: false,
                 lineStyle: {color, type: "solid", width: 1}, data: x === null ? [] : [{xAxis: x}]}}]});
  }
}
})();
