// The table of cases, all attributes of the chosen one, the configuration and its origin; then the page begins.

const MOST_ROWS = 1000; // of the table
const STATES = ["complete", "running", "failed", "waiting", "damaged"];

/** Columns of the table: heading, value of a case, whether it is text, how it is written. */
function tableColumns() {
  const names = [...new Set(DATA.cases.flatMap((one) => Object.keys(one.facts ?? {})))];
  const facts = names.filter((name) => DATA.cases.some((one) => typeof one.facts?.[name] === "number"));
  const every = [
    { head: "number", value: (one) => one.number },
    ...DATA.keys.map((key, i) => ({ head: key.symbol, value: (one) => one.at[i], show: (one) => key.titles[one.at[i]].replace(`${key.symbol} = `, "") })),
    { head: "status", value: (one) => STATES.indexOf(one.state), show: (one) => one.state, text: true, state: true },
    { head: "warnings and reasons", value: (one) => [one.reason, ...(one.warnings ?? [])].filter(Boolean).join("; "), text: true, warning: true },
    { head: "steps", value: (one) => one.rows && one.rows - 1 },
    { head: "largest residual", value: (one) => one.residual },
    { head: "energy balance", value: (one) => one.balance, doubtful: (one) => one.open },
    { head: "time taken", value: (one) => one.seconds, show: (one) => one.took ?? "" },
    ...facts.map((name) => ({ head: escaped(words(name)), value: (one) => one.facts?.[name] })),
  ];
  const isEmpty = (value) => value === null || value === undefined || value === "";
  return every.filter((each) => !DATA.cases.every((one) => isEmpty(each.value(one))));
}

const TABLE = tableColumns();
const order = { by: 0, down: false };
const shownValue = (each, one) => (each.show ? each.show(one) : written(each.value(one), 3));

function sortedCases() {
  const { value } = TABLE[order.by], wanted = byId("state").value;
  const rank = (one) => value(one) ?? (typeof value(DATA.cases[0]) === "string" ? "" : Infinity);
  const compare = (a, b) => (rank(a) < rank(b) ? -1 : rank(a) > rank(b) ? 1 : a.number - b.number);
  const found = DATA.cases.filter((one) => !wanted || one.state === wanted).sort(compare);
  return order.down ? found.reverse() : found;
}

function tableRow(one) {
  const row = element("tr", { className: one === chosenCase && DATA.cases.length > 1 ? "chosen" : "" });
  if (DATA.first?.[0] === one.number && DATA.cases.length > 1) row.classList.add("first");
  TABLE.forEach((each, i) => {
    const cell = element("td", { className: each.text ? "text" : "" });
    if (i === 0 && one.columns) {
      const button = element("button", { type: "button", textContent: fileNumber(one) });
      button.addEventListener("click", () => choose(one));
      cell.append(button);
    } else if (i === 0) {
      cell.textContent = fileNumber(one);
    } else if (each.show) {
      cell.innerHTML = each.show(one);
    } else {
      cell.textContent = shownValue(each, one);
    }
    if (each.state) cell.classList.add(one.state);
    if (each.doubtful?.(one)) {
      cell.classList.add("warning");
      cell.textContent += " (open)";
    }
    if (each.warning) cell.classList.add("wide", ...(one.state === "waiting" || one.state === "running" ? [] : ["warning"]));
    row.append(cell);
  });
  return row;
}

function drawTable() {
  const heads = TABLE.map((each, i) => {
    const button = element("button", { type: "button", innerHTML: each.head });
    button.addEventListener("click", () => {
      order.down = order.by === i && !order.down;
      order.by = i;
      drawTable();
      byId("table").querySelectorAll("th button")[i].focus();
    });
    const head = element("th", { className: each.text ? "text" : "", scope: "col" }, button);
    if (order.by === i) {
      head.setAttribute("aria-sort", order.down ? "descending" : "ascending");
      button.append(order.down ? " ↓" : " ↑");
    }
    return head;
  });
  const cases = sortedCases(), left = cases.length - MOST_ROWS;
  const body = element("tbody", {}, ...cases.slice(0, MOST_ROWS).map(tableRow));
  byId("cases-left").textContent = left > 0 ? `The table shows the first ${MOST_ROWS} of ${cases.length}; the CSV has all.` : "";
  byId("table").replaceChildren(element("table", {}, element("thead", {}, element("tr", {}, ...heads)), body));
}

function saveCases() {
  const header = ["number", ...DATA.keys.map((key) => key.key), ...TABLE.slice(1 + DATA.keys.length).map((each) => bare(each.head))];
  const rows = sortedCases().map((one) => [
    one.number, ...DATA.keys.map((_, i) => sweptValue(one, i)),
    ...TABLE.slice(1 + DATA.keys.length).map((each) => (each.show ? bare(each.show(one)) : each.value(one))),
  ]);
  saveCsv("cases", header, rows);
}

/** Attributes of the chosen case, and its lists, such as instabilities. */
function drawFacts() {
  for (const row of byId("table").querySelectorAll("tr")) row.classList.remove("chosen");
  [...byId("table").querySelectorAll("td button")].find((each) => each.textContent === fileNumber(chosenCase))?.closest("tr").classList.toggle("chosen", DATA.cases.length > 1);
  const parts = Object.entries(chosenCase.facts).flatMap(([name, value]) => [element("dt", { textContent: words(name) }), element("dd", { textContent: written(value) })]);
  const shown = [element("h3", { innerHTML: `Case ${fileNumber(chosenCase)}${DATA.keys.length ? `: ${caseTitle(chosenCase)}` : ""}` }), element("dl", {}, ...parts)];
  if (chosenCase.lists.length) {
    const lists = chosenCase.lists.map((each) => ({ ...each, held: numbers(each, "values") }));
    const heads = lists.map(({ name, about }) => element("th", { title: about.long_name ?? "" }, element("button", { disabled: true, textContent: words(name) + (about.units && about.units !== "1" ? ` (${about.units})` : "") })));
    const rows = Array.from({ length: Math.max(...lists.map(({ held }) => held.length)) }, (_, i) => element("tr", {}, ...lists.map(({ held }) => element("td", { textContent: written(held[i], 6) }))));
    shown.push(element("div", { className: "scroll", tabIndex: 0 }, element("table", {}, element("thead", {}, element("tr", {}, ...heads)), element("tbody", {}, ...rows))));
  }
  byId("facts").replaceChildren(...shown);
}

/** What a reader should know before the curves: warnings and failures with their cases. */
function drawDoubts() {
  const named = (cases) => cases.slice(0, 6).flatMap((number, i) => {
    const one = DATA.cases.find((each) => each.number === number);
    const button = element("button", { type: "button", textContent: fileNumber(one), disabled: !one.columns });
    button.addEventListener("click", () => choose(one));
    return i ? [" ", button] : [button];
  });
  const line = (kind, text, cases) => element("li", { className: kind === "first" ? "" : "warning" }, text, DATA.cases.length > 1 ? " " : "", ...(DATA.cases.length > 1 ? named(cases) : []), cases.length > 6 ? ` and ${cases.length - 6} more` : "");
  const lines = DATA.doubts.map((each) => line(each.kind, `${each.kind}: ${each.text}`, each.cases));
  if (DATA.first && DATA.cases.length > 1) lines.unshift(line("first", `Look first at the case with: ${DATA.first[1]}`, [DATA.first[0]]));
  if (!lines.length) lines.push(element("li", { className: "complete", textContent: "No warning." }));
  byId("doubts").replaceChildren(...lines);
}

function startTables() {
  const counts = STATES.map((state) => [state, DATA.cases.filter((one) => one.state === state).length]).filter(([, count]) => count);
  const total = DATA.cases.length;
  byId("summary").textContent = `${total} case${total === 1 ? "" : "s"}: ${counts.map(([state, count]) => `${count} ${state}`).join(", ")}. Page written ${DATA.written}.`;
  choices(byId("state"), [["", "all"], ...counts.map(([state, count]) => [state, `${state} (${count})`])], "");
  byId("state").addEventListener("change", drawTable);
  byId("cases-csv").addEventListener("click", saveCases);
  drawTable();
  drawDoubts();
  if (chosenCase) {
    drawFacts();
    followers.push(drawFacts);
  }
  byId("config").textContent = DATA.config;
  byId("origin").replaceChildren(...Object.entries(DATA.provenance).flatMap(([name, value]) => [element("dt", { textContent: name }), element("dd", { textContent: value })]));
}

setTheme(SYSTEM.matches);
startTables();
startCurves();
startSurfaces();
startDistributions();
document.documentElement.dataset.ready = "yes";
