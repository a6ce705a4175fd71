// The surface of a case over time: punch, surface and pressure along x, maps of pressure and gap; distributions.

const NOTICEABLE = 1e-4; // of the largest pressure; a solver may leave less out of contact
const WITH_SURFACE = COMPLETE.filter((one) => one.surface);
const FRAME = 500; // milliseconds of a snapshot
let views = new Map(); // case -> its extent, found once

/** One snapshot of a field, along x, then y. */
function snapshot(surface, name, at) {
  const size = numbers(surface.axes, "x").length * (surface.axes.y ? numbers(surface.axes, "y").length : 1);
  return numbers(surface.fields, name).subarray(at * size, (at + 1) * size);
}

const surfaceCase = () => COMPLETE[Number(byId("surface-case").value)];

/** The range of x (or y) around all contact; all of it where there is none. */
function extent(surface, name) {
  const all = numbers(surface.fields, "pressure"), axis = numbers(surface.axes, name);
  const ny = surface.axes.y ? numbers(surface.axes, "y").length : 1, size = numbers(surface.axes, "x").length * ny;
  let low = Infinity, high = -Infinity;
  surface.times.forEach((_, at) => {
    const part = all.subarray(at * size, (at + 1) * size);
    const peak = part.reduce((a, b) => Math.max(a, b), 0);
    part.forEach((p, i) => {
      if (!(p > NOTICEABLE * peak)) return;
      const place = axis[name === "x" ? Math.floor(i / ny) : i % ny];
      low = Math.min(low, place);
      high = Math.max(high, place);
    });
  });
  if (low > high) return [axis[0], axis[axis.length - 1]];
  const margin = 0.5 * (high - low) + 4 * (axis[1] - axis[0]);
  return [Math.max(axis[0], low - margin), Math.min(axis[axis.length - 1], high + margin)];
}

/** What all snapshots of a case have in common: the extent of the contact, largest values, heights, the first cut. */
function view(one) {
  if (!views.has(one)) {
    const { surface } = one, p = numbers(surface.fields, "pressure"), u = numbers(surface.fields, "displacement");
    const most = (values) => values.reduce((a, b) => Math.max(a, b), -Infinity);
    const least = (values) => values.reduce((a, b) => Math.min(a, b), Infinity);
    const [low, high] = [least(u), most(u)], room = high - low || 1e-12;
    const last = snapshot(surface, "pressure", surface.times.length - 1);
    const ny = surface.axes.y ? numbers(surface.axes, "y").length : 1;
    views.set(one, {
      x: extent(surface, "x"), y: surface.axes.y && extent(surface, "y"), cut: last.indexOf(most(last)) % ny,
      pressure: most(p) > 0 ? most(p) : 1, attraction: Math.min(0, least(p)),
      gap: surface.fields.gap ? most(numbers(surface.fields, "gap")) : 1, heights: [low - 0.15 * room, high + 0.6 * room],
    });
  }
  return views.get(one);
}

/** The columns of the profile: x, surface, punch where the file has the gap, pressure. */
function profile(one) {
  const { surface } = one, at = Number(byId("time").value);
  const ny = surface.axes.y ? numbers(surface.axes, "y").length : 1, cut = surface.axes.y ? Number(byId("cut").value) : 0;
  const along = (name) => snapshot(surface, name, at).filter((_, i) => i % ny === cut);
  const found = { x: numbers(surface.axes, "x"), surface: along("displacement") };
  if (surface.fields.gap) found.punch = along("gap").map((g, i) => g + found.surface[i]);
  return { ...found, pressure: along("pressure") };
}

function drawProfile(one) {
  const lines = profile(one), seen = view(one), whole = byId("whole").checked;
  const line = (name, colour, more) => ({
    type: "scatter", mode: "lines", name, x: lines.x, y: lines[name], line: { color: css(colour), width: 2, ...more },
    hovertemplate: `%{x:.5g}, %{y:.5g}<extra>${name}</extra>`,
  });
  const traces = [line("surface", "--surface", {}), { ...line("pressure", "--pressure", {}), yaxis: "y2", fill: "tozeroy" }];
  if (lines.punch) {
    const touched = lines.surface.map((u, i) => (lines.punch[i] <= u ? u : NaN));
    traces.push(line("punch", "--punch", { dash: "dash" }), {
      type: "scatter", mode: "lines+markers", name: "contact", x: lines.x, y: touched, hoverinfo: "skip",
      line: { color: DATA.contact, width: 5 }, marker: { color: DATA.contact, size: 5 },
    });
  }
  const top = { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" };
  draw("profile", traces, {
    showlegend: true, legend: top, margin: { l: 10, r: 12, t: 40, b: 10 }, uirevision: `${one.number},${whole}`,
    xaxis: axis(DATA.fields.x, { anchor: "y2", range: whole ? undefined : seen.x }),
    yaxis: axis(DATA.fields.displacement, { domain: [0.46, 1], range: seen.heights }),
    yaxis2: axis(DATA.fields.pressure, { domain: [0, 0.38], range: [1.08 * seen.attraction, 1.08 * seen.pressure] }),
  });
}

/** A field as rows along y; null where there is contact, the gap being zero. */
function rowsOfMap(surface, name, at) {
  const nx = numbers(surface.axes, "x").length, ny = numbers(surface.axes, "y").length;
  const values = snapshot(surface, name, at);
  const value = (i) => (name === "gap" && values[i] <= 0 ? null : values[i]);
  return Array.from({ length: ny }, (_, j) => Array.from({ length: nx }, (_, i) => value(i * ny + j)));
}

/** The entry of the legend for the contact, which the maps of the gap leave open to their background. */
const CONTACT_SPOTS = {
  type: "scatter", mode: "markers", name: "contact", x: [null], y: [null], marker: { color: DATA.contact, symbol: "square", size: 12 },
};

function drawMaps(one) {
  const { surface } = one, at = Number(byId("time").value), seen = view(one), whole = byId("whole").checked;
  const x = numbers(surface.axes, "x"), y = numbers(surface.axes, "y"), cut = y[Number(byId("cut").value)];
  for (const name of ["pressure", "gap"]) {
    byId(`map-${name}`).hidden = !surface.fields[name];
    if (!surface.fields[name]) continue;
    const ends = name === "gap" ? [0, seen.gap] : [seen.attraction, seen.pressure];
    draw(`map-${name}`, [{
      type: "heatmap", x, y, z: rowsOfMap(surface, name, at), zmin: ends[0], zmax: ends[1], colorscale: colourScale(name),
      hoverongaps: false, hovertemplate: "%{x:.4g}, %{y:.4g}: %{z:.5g}<extra></extra>",
      colorbar: { title: { text: DATA.fields[name], side: NARROW.matches ? "top" : "right" }, thickness: 14, outlinewidth: 0, exponentformat: "power", nticks: 6 },
    }, ...(name === "gap" ? [CONTACT_SPOTS] : [])], {
      showlegend: name === "gap", legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" }, margin: { l: 10, r: 12, t: 30, b: 10 },
      xaxis: axis(DATA.fields.x, { range: whole ? undefined : seen.x, constrain: "domain", constraintoward: "right", showgrid: false, zeroline: false }),
      yaxis: axis(DATA.fields.y, { range: whole ? undefined : seen.y, scaleanchor: "x", constrain: "domain", showgrid: false, zeroline: false }),
      plot_bgcolor: name === "gap" ? DATA.contact : "rgba(0,0,0,0)", uirevision: `${one.number},${whole}`,
      shapes: [{ type: "line", xref: "x domain", x0: 0, x1: 1, y0: cut, y1: cut, line: { color: "#8a8f98", width: 1.5, dash: "dash" } }],
    });
  }
}

/** The von Mises stress below the surface; along x, where the pressure of a surface is largest. */
function drawInside(one) {
  const { surface } = one, at = Number(byId("time").value);
  const x = numbers(surface.axes, "x"), z = surface.inside && numbers(surface.inside, "z");
  const all = surface.inside && numbers(surface.inside, "von_mises"), size = z && z.length * x.length;
  const values = all && all.subarray(at * size, (at + 1) * size);
  byId("inside").hidden = !values || Number.isNaN(values[0]);
  if (byId("inside").hidden) return;
  draw("inside", [{
    type: "heatmap", x, y: z, z: Array.from(z, (_, k) => values.subarray(k * x.length, (k + 1) * x.length)),
    zmin: 0, zmax: all.reduce((a, b) => (b > a ? b : a), 0), colorscale: colourScale("curves"),
    hovertemplate: "%{x:.4g}, %{y:.4g}: %{z:.5g}<extra></extra>",
    colorbar: { title: { text: DATA.fields.von_mises, side: NARROW.matches ? "top" : "right" }, thickness: 14, outlinewidth: 0, exponentformat: "power", nticks: 6 },
  }], {
    margin: { l: 10, r: 12, t: 30, b: 10 },
    xaxis: axis(DATA.fields.x, { range: byId("whole").checked ? undefined : view(one).x, showgrid: false, zeroline: false }),
    yaxis: axis(DATA.fields.z, { autorange: "reversed", showgrid: false, zeroline: false }),
    uirevision: `${one.number},${byId("whole").checked}`,
  });
}

function drawSurface() {
  const one = surfaceCase(), { surface } = one, at = Number(byId("time").value);
  const inPlane = Boolean(surface.axes.y);
  byId("time-value").textContent = equals(DATA.fields.snapshot, written(surface.times[at], 5));
  byId("time").setAttribute("aria-valuetext", byId("time-value").textContent);
  if (inPlane) byId("cut-value").textContent = equals(DATA.fields.y, written(numbers(surface.axes, "y")[Number(byId("cut").value)], 4));
  drawProfile(one);
  if (inPlane) drawMaps(one);
  drawInside(one);
}

function showSurface() {
  const one = surfaceCase(), { surface } = one, inPlane = Boolean(surface.axes.y);
  byId("time").max = surface.times.length - 1;
  byId("time").value = Math.min(Number(byId("time").value), surface.times.length - 1);
  byId("time").disabled = byId("play").disabled = surface.times.length < 2;
  byId("cut-label").hidden = byId("maps").hidden = byId("maps-csv").hidden = !inPlane;
  if (inPlane) {
    byId("cut").max = numbers(surface.axes, "y").length - 1;
    byId("cut").value = view(one).cut;
  }
  const said = [surface.note && `Reduced for the page: ${surface.note}.`, one.facts.frame && `Frame: ${one.facts.frame}.`, one.facts.axes && `Axis: ${one.facts.axes}.`];
  if (inPlane) said.push("Profiles along the cut; in the map of the gap the contact is orange.");
  byId("surface-note").textContent = [...said, DATA.notes.surfaces].filter(Boolean).join(" ");
  drawSurface();
}

let playing;

/** Show one snapshot after another, from the first again after the last. */
function play() {
  clearInterval(playing);
  byId("play").textContent = (playing = playing ? undefined : setInterval(() => {
    byId("time").value = (Number(byId("time").value) + 1) % surfaceCase().surface.times.length;
    drawSurface();
  }, FRAME)) ? "Stop" : "Play";
}

function saveProfile() {
  const one = surfaceCase(), lines = profile(one), names = Object.keys(lines);
  const label = { x: DATA.fields.x, pressure: DATA.fields.pressure, surface: DATA.fields.displacement, punch: DATA.fields.displacement };
  const header = names.map((name) => (name === "x" ? bare(label.x) : `${name} [${bare(label[name])}]`));
  saveCsv(`profile-${fileNumber(one)}`, ["time", ...header], Array.from(lines.x, (_, i) => [one.surface.times[Number(byId("time").value)], ...names.map((name) => lines[name][i])]));
}

function saveMaps() {
  const one = surfaceCase(), { surface } = one, at = Number(byId("time").value);
  const x = numbers(surface.axes, "x"), y = numbers(surface.axes, "y"), names = Object.keys(surface.fields);
  const values = names.map((name) => snapshot(surface, name, at));
  const header = ["x", "y", ...names].map((name) => (name.length > 1 ? `${name} [${bare(DATA.fields[name])}]` : bare(DATA.fields[name])));
  saveCsv(`maps-${fileNumber(one)}`, header, Array.from(values[0], (_, i) => [x[Math.floor(i / y.length)], y[i % y.length], ...values.map((each) => each[i])]));
}

const caseOptions = (cases) => cases.map((one) => [COMPLETE.indexOf(one), bare(DATA.keys.length ? `${fileNumber(one)}: ${caseTitle(one)}` : caseTitle(one))]);

function startSurfaces() {
  if (!WITH_SURFACE.length) {
    const said = COMPLETE.length ? "No snapshots of the surface; output.snapshots sets their times." : "No case is complete.";
    byId("surface").replaceChildren(byId("surface-title"), element("p", { className: "empty", textContent: said }));
    return;
  }
  choices(byId("surface-case"), caseOptions(WITH_SURFACE), COMPLETE.indexOf(WITH_SURFACE[0]));
  byId("surface-case").addEventListener("change", () => choose(surfaceCase()));
  byId("time").value = WITH_SURFACE[0].surface.times.length - 1;
  byId("time").max = byId("time").value;
  for (const id of ["time", "cut"]) byId(id).addEventListener("input", drawSurface);
  byId("whole").addEventListener("change", drawSurface);
  byId("play").addEventListener("click", play);
  byId("profile-csv").addEventListener("click", saveProfile);
  byId("maps-csv").addEventListener("click", saveMaps);
  redraws.push(drawSurface);
  followers.push(() => {
    if (!chosenCase.surface) return;
    byId("surface-case").value = COMPLETE.indexOf(chosenCase);
    showSurface();
  });
  showSurface();
}
