// How all figures look: light or dark, their axes, the colours of curves and maps; the case that is shown.

const redraws = []; // of all figures, after a change of theme
const followers = []; // what shows the chosen case
const COARSE = matchMedia("(pointer: coarse)").matches; // a touch on a figure scrolls the page
const NARROW = matchMedia("(max-width: 760px)");

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const isDark = () => document.documentElement.dataset.theme === "dark";

function setTheme(dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  byId("theme").textContent = dark ? "Light" : "Dark";
  byId("theme").setAttribute("aria-label", dark ? "Change to light colours" : "Change to dark colours");
  for (const redraw of redraws) redraw();
}

const SYSTEM = matchMedia("(prefers-color-scheme: dark)");
SYSTEM.addEventListener("change", (event) => setTheme(event.matches));
byId("theme").addEventListener("click", () => setTheme(!isDark()));

function axis(title, more = {}) {
  return {
    title: { text: title, standoff: 6 },
    color: css("--text"), gridcolor: css("--grid"), linecolor: css("--line"), zerolinecolor: css("--line"),
    automargin: true, exponentformat: "power", showexponent: "all", nticks: NARROW.matches ? 5 : 8, ...more,
  };
}

/** Draw a figure in a part of the page, or change it. */
function draw(id, traces, layout) {
  const common = {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false, hovermode: "closest",
    font: { family: "system-ui, sans-serif", size: 14, color: css("--text") },
    hoverlabel: { bgcolor: css("--card"), bordercolor: css("--line"), font: { color: css("--text") } },
    modebar: { bgcolor: "rgba(0,0,0,0)", color: css("--soft"), activecolor: css("--accent") },
    margin: { l: 10, r: 12, t: 12, b: 10 }, dragmode: COARSE ? false : "zoom",
  };
  return Plotly.react(byId(id), traces, { ...common, ...layout }, {
    responsive: true, displaylogo: false, displayModeBar: COARSE ? false : "hover",
    modeBarButtonsToRemove: ["lasso2d", "select2d"], toImageButtonOptions: { format: "svg", filename: id },
  });
}

/** Colour i of n, from dark to light, clear of the background. */
function curveColour(i, n) {
  const [first, last] = isDark() ? [0.3, 1.0] : [0.0, 0.82];
  const scale = DATA.colours.curves;
  return scale[Math.round((first + ((last - first) * i) / Math.max(n - 1, 1)) * (scale.length - 1))];
}

/** A scale of colours as Plotly has it. */
const colourScale = (use) => DATA.colours[use].map((colour, i, all) => [i / (all.length - 1), colour]);

let chosenCase = COMPLETE[0];

/** Show a case wherever a single one is shown. */
function choose(one) {
  chosenCase = one;
  for (const follow of followers) follow();
}
