// Distributions over bins, such as a histogram of the pressure, at the time of a row.

const BINNED = DATA.columns.filter((each) => each.bins);

/** Edges of the bins as they are drawn: an open bin at an end is as wide as its neighbour. */
function drawnEdges(edges) {
  const drawn = [...edges], last = drawn.length - 1;
  if (typeof drawn[0] === "string") drawn[0] = 2 * drawn[1] - drawn[2];
  if (typeof drawn[last] === "string") drawn[last] = 2 * drawn[last - 1] - drawn[last - 2];
  return drawn;
}

function shownDistribution() {
  const one = COMPLETE[Number(byId("distribution-case").value)], each = COLUMNS.get(byId("distribution-column").value);
  const count = each.bins.edges.length - 1, row = Number(byId("row").value);
  return { one, each, row, values: column(one, each.name).subarray(row * count, (row + 1) * count) };
}

function drawDistribution() {
  const { one, each, row, values } = shownDistribution();
  const steps = values.length ? [...values, values[values.length - 1]] : [];
  byId("row").max = column(one, "time").length - 1;
  byId("row-value").textContent = equals(COLUMNS.get("time").label, written(column(one, "time")[row], 5));
  draw("distribution-plot", [{
    type: "scatter", mode: "lines", x: drawnEdges(each.bins.edges), y: steps, line: { shape: "hv", color: css("--accent"), width: 2 }, fill: "tozeroy",
    hovertemplate: "from %{x:.4g}: %{y:.5g}<extra></extra>",
  }], { xaxis: axis(each.bins.label), yaxis: axis(each.label, { rangemode: "tozero" }), uirevision: each.name });
  byId("distribution-note").textContent = each.meaning + (values.length ? "" : "; the case has none");
}

function saveDistribution() {
  const { one, each, row, values } = shownDistribution();
  const rows = Array.from(values, (value, i) => [column(one, "time")[row], each.bins.edges[i], each.bins.edges[i + 1], value]);
  saveCsv(`${each.name}-${fileNumber(one)}`, ["time", "from", "to", each.name], rows);
}

function startDistributions() {
  if (!BINNED.length) {
    byId("distribution").remove();
    document.querySelector('nav a[href="#distribution"]').remove();
    return;
  }
  choices(byId("distribution-case"), caseOptions(COMPLETE), 0);
  choices(byId("distribution-column"), BINNED.map((each) => [each.name, words(each.name)]), BINNED[0].name);
  byId("row").max = column(COMPLETE[0], "time").length - 1;
  byId("row").value = byId("row").max;
  for (const id of ["row", "distribution-column"]) byId(id).addEventListener("input", drawDistribution);
  byId("distribution-case").addEventListener("change", () => choose(COMPLETE[Number(byId("distribution-case").value)]));
  byId("distribution-csv").addEventListener("click", saveDistribution);
  redraws.push(drawDistribution);
  followers.push(() => {
    byId("distribution-case").value = COMPLETE.indexOf(chosenCase);
    drawDistribution();
  });
  drawDistribution();
}
