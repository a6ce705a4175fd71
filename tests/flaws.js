// What a reader of a page would miss: text that is cut off or outside the window, and text too pale to read
// (contrast below AA of WCAG 2.2: 4.5, or 3 for large letters). Text in a box that scrolls is all right, except
// in boxes that match `unscrolled`.
([root, unscrolled]) => {
  const found = [], width = document.documentElement.clientWidth;
  const say = (what, e) => found.push(`${what}: <${e.tagName.toLowerCase()}> ${e.textContent.trim().slice(0, 60)}`);
  const style = (e) => getComputedStyle(e);
  const parents = function* (e) { for (let p = e; p; p = p.parentElement) yield p; };
  const pen = document.createElement("canvas").getContext("2d", {willReadFrequently: true});
  const rgba = (colour) => {
    pen.clearRect(0, 0, 1, 1); pen.fillStyle = colour; pen.fillRect(0, 0, 1, 1);
    return [...pen.getImageData(0, 0, 1, 1).data].map((c, i) => i < 3 ? c : c / 255);
  };
  const over = (top, below) => below.map((c, i) => i < 3 ? top[3] * top[i] + (1 - top[3]) * c : 1);
  const ground = (e) => [...parents(e)].map((p) => rgba(style(p).backgroundColor)).filter((c) => c[3] > 0)
    .reduceRight((below, top) => over(top, below), [255, 255, 255, 1]);
  const light = (colour) => colour.slice(0, 3).map((c) => c / 255)
    .map((c) => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4)
    .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
  if (document.documentElement.scrollWidth > width) found.push("the page is wider than the window");
  for (const e of document.querySelectorAll(unscrolled || "none"))
    if (e.scrollWidth > e.clientWidth + 1) say("scrolls", e);
  const texts = document.createTreeWalker(document.querySelector(root), NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const e = texts.currentNode.parentElement, range = document.createRange();
    if (!texts.currentNode.data.trim() || e.closest("script, style, option, noscript, math, .skip, .headerlink")) continue;
    if (!e.checkVisibility({opacityProperty: true, visibilityProperty: true})) continue;
    range.selectNodeContents(texts.currentNode);
    const box = range.getBoundingClientRect();
    if (box.width < 2) continue;
    const clip = [...parents(e)].find((p) => style(p).overflowX !== "visible" && !(p instanceof SVGElement));
    if (!clip || clip === document.body || clip === document.documentElement) {
      if (box.right > width + 1 || box.left < -1) say("outside", e);
    } else if (["hidden", "clip"].includes(style(clip).overflowX)) {
      const edge = clip.getBoundingClientRect();
      if (box.right > edge.right + 1 || box.left < edge.left - 1) say("cut off", e);
    }
    if (e.closest(":disabled")) continue;
    const below = ground(e), ink = over(rgba(e instanceof SVGElement ? style(e).fill : style(e).color), below);
    const [least, most] = [light(ink), light(below)].sort((a, b) => a - b);
    const size = parseFloat(style(e).fontSize), bold = parseFloat(style(e).fontWeight) >= 700;
    const enough = size >= 24 || (bold && size >= 18.66) ? 3 : 4.5;
    if ((most + 0.05) / (least + 0.05) < enough - 0.005) say(`contrast ${((most + 0.05) / (least + 0.05)).toFixed(2)}`, e);
  }
  return [...new Set(found)];
}
