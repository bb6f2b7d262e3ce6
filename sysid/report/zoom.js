// Draws every figure of the page, and again when the page turns dark or light; zoom and legend stay.
(() => {
  if (!window.Plotly) return;  // the page was taken away from its script: the pictures stay
  const DARK = {
    "#1f2933": "#e6eaee", "#c2410c": "#fb8c4c", "#2f6f8f": "#6fb7d9", "#7a8794": "#98a5b2", "#dbe7ee": "#22333f",
    "#e4e7eb": "#2e3842", "#9aa5b1": "#53606c", "#2f855a": "#5fc48e", "#805ad5": "#b79cf2", "#b7791f": "#e0ac55",
    "#d53f8c": "#f28cba", "rgba(194,65,12,0.22)": "rgba(251,140,76,0.28)",
  };
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const coloured = (value) => {
    if (typeof value === "string") return (dark.matches && DARK[value]) || value;
    if (Array.isArray(value)) return value.map(coloured);
    if (value && typeof value === "object")
      return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, coloured(each)]));
    return value;
  };
  const config = { responsive: true, displaylogo: false, scrollZoom: false, doubleClick: "reset+autosize",
                   modeBarButtons: [["toImage", "zoom2d", "pan2d", "autoScale2d", "resetScale2d"]], plotlyServerURL: "" };
  const draw = (box, figure) => {
    const shown = coloured(figure), layout = shown.layout;
    const [paper, wash] = dark.matches ? ["#1d252d", "#2e3842"] : ["#ffffff", "#f5f7f8"];
    layout.hoverlabel = { ...layout.hoverlabel, bgcolor: paper, bordercolor: shown.layout.font.color,
                          font: { color: layout.font.color } };
    layout.modebar = { bgcolor: "rgba(0,0,0,0)", color: dark.matches ? "#98a5b2" : "#7a8794" };
    for (const menu of layout.updatemenus || [])
      Object.assign(menu, { bgcolor: wash, bordercolor: layout.modebar.color, showactive: false,
                            font: { color: layout.font.color, size: 11 } });
    if (box.clientWidth < 520) narrow(layout);
    box.style.height = `${layout.height}px`;
    return Plotly.react(box, { data: shown.data, layout, frames: shown.frames, config });
  };
  const narrow = (layout) => {  // a phone: no room beside the axes
    layout.margin = { ...layout.margin, l: 50, r: 6 };
    layout.font = { ...layout.font, size: 10.5 };
    layout.legend = { ...layout.legend, x: 0, xanchor: "left", y: 0, yref: "container", yanchor: "bottom" };
    stack(layout);
    layout.dragmode = layout.scene ? "orbit" : false;  // a finger scrolls the page; the mode bar zooms
  };
  const stack = (layout) => {  // panels that stand beside each other go below each other
    const n = layout.meta?.beside;
    if (!(n > 1)) return;
    for (let k = 0; k < n; k++) {
      const suffix = k ? k + 1 : "", top = 1 - (k * 1.3) / (1.3 * n - 0.3);
      layout["xaxis" + suffix].domain = [0, 1];
      layout["yaxis" + suffix].domain = [Math.max(top - 1 / (1.3 * n - 0.3), 0), top];
      Object.assign(layout.annotations[k], { x: 0, y: top });
    }
    layout.height *= 0.8 * n;
  };
  const figures = [...document.querySelectorAll("script[data-for]")].map((data) => [
    document.getElementById(data.dataset.for), JSON.parse(data.textContent),
  ]);
  // Only what comes into view is drawn, so that a page of many figures opens at once.
  const seen = new IntersectionObserver((entries) => entries.filter((e) => e.isIntersecting).forEach((e) => {
    seen.unobserve(e.target);
    const found = figures.find(([box]) => box === e.target);
    draw(...found).then(() => [found[0], found[0].closest("figure")].forEach((each) => each?.classList.add("drawn")));
  }), { rootMargin: "600px" });
  figures.forEach(([box]) => { box.closest("figure")?.classList.add("zoomed"); seen.observe(box); });
  addEventListener("beforeprint", () => document.querySelectorAll(".fold").forEach((part) => { part.open = true; }));
  dark.addEventListener("change", () => figures.filter(([box]) => box.classList.contains("drawn"))
    .forEach(([box, figure]) => draw(box, figure)));
})();
