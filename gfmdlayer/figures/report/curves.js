// Curves of the columns: the swept keys choose the cases, colour and dashes tell them apart.

const MOST_CURVES = 40;
const DASHES = ["solid", "dash", "dot", "dashdot", "longdash"];
const PLAIN_COLUMNS = DATA.columns.filter((each) => !each.bins);
const optionText = (each) => words(each.name) + unitOf(each);

/** The unit in the label of a column, with a space before it. */
function unitOf(each) {
  const unit = bare(each.label).match(/\([^()]*\)$/);
  return unit ? ` ${unit[0]}` : "";
}

/** The complete cases with the chosen values of the swept keys. */
function matching() {
  const wanted = DATA.keys.map((_, i) => byId(`key-${i}`).value);
  return COMPLETE.filter((one) => wanted.every((value, i) => value === "" || one.at[i] === Number(value)));
}

/** Each curve with its case, colour and dashes, and the keys in whose values the cases differ. */
function family() {
  const cases = matching();
  const places = DATA.keys.map((_, i) => [...new Set(cases.map((one) => one.at[i]))].sort((a, b) => a - b));
  const varied = places.map((_, i) => i).filter((i) => places[i].length > 1);
  const [colour, second] = varied;
  const dash = second !== undefined && places[second].length <= DASHES.length ? second : undefined;
  const curves = spread(cases, MOST_CURVES).map((one) => ({
    one,
    title: caseTitle(one, varied.length ? varied : undefined),
    colour: colour === undefined ? css("--accent") : curveColour(places[colour].indexOf(one.at[colour]), places[colour].length),
    dash: dash === undefined ? "solid" : DASHES[places[dash].indexOf(one.at[dash])],
  }));
  return { curves, among: cases.length };
}

function drawCurves() {
  const { curves, among } = family();
  const x = COLUMNS.get(byId("x").value);
  [0, 1].forEach((panel) => {
    const y = COLUMNS.get(byId(`y-${panel}`).value);
    const drawn = curves.filter(({ one }) => one.columns[x.name] && one.columns[y.name]);
    const traces = drawn.map(({ one, title, colour, dash }) => ({
      type: "scatter", mode: one.rows > 1 ? "lines" : "markers", name: title, x: column(one, x.name), y: column(one, y.name),
      line: { color: colour, dash, width: one === chosenCase && curves.length > 1 ? 3.5 : 2 },
      hovertemplate: `%{x:.5g}, %{y:.5g}<extra>${title}</extra>`,
    }));
    draw(`curve-${panel}`, traces, {
      xaxis: axis(x.label, { type: byId("log-x").checked ? "log" : "linear" }),
      yaxis: axis(y.label, { type: byId("log-y").checked ? "log" : "linear" }),
      uirevision: [x.name, y.name, byId("log-x").checked, byId("log-y").checked].join(),
    });
    byId(`curve-${panel}`).setAttribute("role", "img");
    byId(`curve-${panel}`).setAttribute("aria-label", `${optionText(y)} against ${optionText(x)}, ${drawn.length} curves`);
    const lacking = curves.length - drawn.length;
    byId(`meaning-${panel}`).textContent = y.meaning + (lacking ? `; ${lacking} of the cases have none` : "");
  });
  drawLegend(curves);
  const part = among > curves.length ? `${curves.length} of ${among} cases are drawn; choose values of the swept keys to see others. ` : "";
  byId("curves-note").textContent = part + (among ? "" : "No complete case has these values. ") + DATA.notes.curves;
}

function drawLegend(curves) {
  const dashes = { solid: "", dash: "7 4", dot: "2 3", dashdot: "7 3 2 3", longdash: "12 4" };
  byId("legend").hidden = curves.length < 2;
  byId("legend").replaceChildren(...curves.map(({ one, title, colour, dash }) => {
    const entry = element("button", { type: "button" });
    entry.innerHTML = `<svg width="30" height="6" aria-hidden="true"><line x1="0" y1="3" x2="30" y2="3" stroke="${colour}" stroke-width="3" stroke-dasharray="${dashes[dash]}"/></svg><span>${title}</span>`;
    entry.setAttribute("aria-pressed", one === chosenCase);
    entry.addEventListener("click", () => {
      choose(one);
      byId("legend").querySelector('[aria-pressed="true"]')?.focus();
    });
    return element("li", {}, entry);
  }));
}

function saveCurves() {
  const names = [...new Set([byId("x").value, byId("y-0").value, byId("y-1").value])];
  const header = ["case", ...DATA.keys.map((each) => each.key), ...names.map((name) => optionText(COLUMNS.get(name)) + scaled(name))];
  const rows = family().curves.flatMap(({ one }) => Array.from({ length: column(one, "time").length }, (_, row) => [
    one.number, ...DATA.keys.map((_, i) => sweptValue(one, i)), ...names.map((name) => column(one, name)[row]),
  ]));
  saveCsv("curves", header, rows);
}

/** The label of a column that is divided by a scale, for the head of a file. */
function scaled(name) {
  const symbol = bare(COLUMNS.get(name).symbol);
  return symbol.includes("/") ? ` [${symbol}]` : "";
}

/** Whether half of the rows of a case lie in the first thirtieth of its time, as where it relaxes over decades. */
function spansDecades(one) {
  const times = column(one, "time");
  return times.length > 2 && times[times.length >> 1] < times[times.length - 1] / 15;
}

function startCurves() {
  if (!COMPLETE.length) {
    byId("curves").replaceChildren(byId("curves-title"), element("p", { className: "empty", textContent: "No case is complete." }));
    return;
  }
  byId("keys").replaceChildren(...DATA.keys.map((key, i) => {
    const list = element("select", { id: `key-${i}` });
    choices(list, [["", `all ${key.titles.length}`], ...key.titles.map((title, at) => [at, bare(title)])], "");
    list.addEventListener("change", drawCurves);
    const symbol = words(bare(key.symbol));
    return element("label", {}, key.meaning === key.key ? key.key : `${key.meaning}${symbol.length < 12 ? ` ${symbol}` : ""}`, list);
  }));
  byId("log-x").checked = spansDecades(COMPLETE[0]);
  const options = PLAIN_COLUMNS.map((each) => [each.name, optionText(each)]);
  choices(byId("x"), options, "time");
  [0, 1].forEach((panel) => choices(byId(`y-${panel}`), options, DATA.shown[panel] ?? DATA.shown[0]));
  for (const id of ["x", "y-0", "y-1", "log-x", "log-y"]) byId(id).addEventListener("change", drawCurves);
  byId("curves-csv").addEventListener("click", saveCurves);
  redraws.push(drawCurves);
  followers.push(drawCurves);
  drawCurves();
  [0, 1].forEach((panel) => byId(`curve-${panel}`).on("plotly_click", (event) => {
    const title = event.points[0].data.name;
    choose(family().curves.find((curve) => curve.title === title).one);
  }));
}
