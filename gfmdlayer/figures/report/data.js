// The data of the page: decoding, the names of cases, numbers as text, files of comma-separated values.

const DATA = JSON.parse(document.getElementById("data").textContent);
const COLUMNS = new Map(DATA.columns.map((column) => [column.name, column]));
const COMPLETE = DATA.cases.filter((each) => each.columns);

const byId = (id) => document.getElementById(id);
const words = (name) => name.replaceAll("_", " ");

/** An element with properties and children. */
function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

/** Numbers of single precision from base64. */
function unpack(text) {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return new Float32Array(bytes.buffer);
}

/** An entry of packed numbers, decoded at its first use; empty where there is none. */
function numbers(held, name) {
  if (typeof held[name] === "string") held[name] = unpack(held[name]);
  return held[name] ?? new Float32Array(0);
}

const column = (one, name) => numbers(one.columns, name);

/** A label without tags, for lists of choices and files. */
const bare = (label) => label.replace(/<[^>]*>/g, "").replaceAll("&lt;", "<").replaceAll("&gt;", ">").replaceAll("&amp;", "&");

/** Text as a label: what stands in a file is never taken for tags. */
const escaped = (text) => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");

const fileNumber = (one) => String(one.number).padStart(4, "0");

/** The values of some swept keys in a case; its number where there are none. */
function caseTitle(one, keys = DATA.keys.map((_, i) => i)) {
  return keys.map((i) => DATA.keys[i].titles[one.at[i]]).join(", ") || `case ${fileNumber(one)}`;
}

/** A swept value alone: the number, or the title of a value that is none. */
const sweptValue = (one, i) => DATA.keys[i].values?.[one.at[i]] ?? bare(DATA.keys[i].titles[one.at[i]]);

/** A number with so many digits, without zeros at the end; text as it is. */
function written(value, digits = 7) {
  if (value === null || value === undefined || Number.isNaN(value)) return "";
  if (typeof value !== "number") return String(value);
  if (Number.isInteger(value)) return String(value);
  const short = Number(value.toPrecision(digits)), size = Math.abs(short);
  return size > 0 && size < 1e-3 ? short.toExponential() : String(short);
}

/** "x = 5 µm" from the label "x (µm)". */
function equals(label, value) {
  const [, symbol, unit] = bare(label).match(/^(.*?)(?: \(([^()]*)\))?$/);
  return `${symbol} = ${value}${unit ? ` ${unit}` : ""}`;
}

/** Save rows as a file of comma-separated values. */
function saveCsv(name, header, rows) {
  const cell = (value) => {
    const text = written(value);
    return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  const lines = [header, ...rows].map((row) => row.map(cell).join(","));
  const link = element("a", {
    href: URL.createObjectURL(new Blob([`${lines.join("\n")}\n`], { type: "text/csv" })),
    download: `${DATA.title.replace(/[^\w.-]+/g, "-")}-${name}.csv`,
  });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

/** Fill a list of choices with [value, text] pairs, and choose one. */
function choices(list, pairs, chosen) {
  list.replaceChildren(...pairs.map(([value, text]) => element("option", { value, textContent: text })));
  if (chosen !== undefined) list.value = chosen;
}

/** At most so many entries, evenly from the first to the last. */
function spread(entries, most) {
  if (entries.length <= most) return entries;
  return Array.from({ length: most }, (_, i) => entries[Math.round((i * (entries.length - 1)) / (most - 1))]);
}

/** Index of the value nearest to another. */
function nearest(values, wanted) {
  let best = 0;
  values.forEach((value, i) => { if (Math.abs(value - wanted) < Math.abs(values[best] - wanted)) best = i; });
  return best;
}
