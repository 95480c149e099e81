// Plots of one case, drawn with Plotly from the JSON inside its article when the case is opened.
"use strict";
const Plots = (() => {
  // Okabe and Ito's palette, which colour-blind readers tell apart; symbols repeat what the colours say.
  const LIGHT = ["#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#8c7a00"];
  const DARK = ["#56B4E9", "#E69F00", "#2bbf94", "#CC79A7", "#b0c4de", "#F0E442"];
  const SYMBOLS = ["circle", "square", "diamond", "triangle-up", "cross", "triangle-down"];
  const OUTSIDE = "#D55E00";
  const GRID = 200; // points of a curve
  const NAMES = {
    delta: "(ρ − ρ<sub>0</sub>) / ρ<sub>0</sub>", ratio: "ρ / ρ<sub>0</sub>", rho: "density ρ", energy: "energy density ρ e",
  };
  const plain = (text) => String(text).replace(/[<>&]/g, " "); // Plotly reads some tags in its texts
  function short(value, digits = 6) {
    const size = Math.abs(value);
    if (!Number.isFinite(value) || value === 0 || (size >= 1e-4 && size < 1e6)) return String(Number(value.toPrecision(digits)));
    return value.toExponential(digits - 1).replace(/\.?0*e\+?/, "e");
  }
  const rough = (value) => short(value, 3); // sizes come with 8 binary digits

  function numbers(text) {
    // See lammps_cases.report.plots: the prefix says how many bytes a number has; first bytes come first.
    const width = { d: 8, f: 4, b: 2 }[text[0]];
    const planes = atob(text.slice(2)), count = planes.length / width;
    const size = Math.max(width, 4), lead = size - width; // the upper half of a float32 follows two zeros
    const bytes = new Uint8Array(size * count);
    for (let i = 0; i < count; i += 1) for (let k = 0; k < width; k += 1) bytes[size * i + lead + k] = planes.charCodeAt(k * count + i);
    return Array.from(width === 8 ? new Float64Array(bytes.buffer) : new Float32Array(bytes.buffer));
  }

  function column(value, count) {
    // A constant or packed numbers; an array of columns.
    if (Array.isArray(value)) return value.map((one) => column(one, count));
    return typeof value === "number" ? Array(count).fill(value) : numbers(value);
  }

  function derive(field) {
    // As the comparison does: no ratio where either side or the bound is not a finite number.
    field.reference = field.lammps.map((value, i) => value - field.difference[i]);
    field.difference = field.difference.map(Math.abs);
    field.ratio = field.difference.map((size, i) => (!Number.isFinite(size) || !Number.isFinite(field.bound[i]) ? Infinity : size === 0 ? 0 : size / field.bound[i]));
  }

  // ---- axes: decades drawn on a linear axis, so that zero and "not finite" have a place of their own

  const power = (k, sign = "") => (k === 0 ? `${sign}1` : k === 1 ? `${sign}10` : `${sign}10<sup>${String(k).replace("-", "−")}</sup>`);

  function decades(low, high, most) {
    const step = Math.max(1, Math.ceil((high - low) / most));
    const found = [];
    for (let k = Math.ceil(low); k <= high; k += step) found.push(k);
    return found;
  }

  function linear() {
    return { of: (v) => v, axis: { exponentformat: "power" } };
  }

  function logarithmic(values) {
    const sizes = values.filter((v) => v > 0 && Number.isFinite(v)).map(Math.log10);
    const ticks = decades(Math.floor(Math.min(...sizes)), Math.ceil(Math.max(...sizes)), 7);
    return { of: (v) => Math.log10(v), axis: { tickvals: ticks, ticktext: ticks.map((k) => power(k)) } };
  }

  function symlog(values, lowest) {
    // |v| below 10**lowest is drawn linearly between -1 and 1, each decade above it one unit further out.
    const of = (v) => {
      const size = Math.abs(v) / 10 ** lowest;
      return size <= 1 ? Math.sign(v) * size : Math.sign(v) * (1 + Math.log10(size));
    };
    const drawn = values.map(of).filter(Number.isFinite);
    const high = Math.max(...drawn, 0), low = Math.min(...drawn, 0);
    const most = high > 0 && low < 0 ? 4 : 7;
    const step = Math.max(1, Math.ceil(Math.max(high, -low) / most));
    const outward = (end) => decades(1, end, Infinity).filter((u) => u % step === 0); // zero stays clear of its neighbours
    const up = outward(high), down = outward(-low);
    const ticks = [...down.map((u) => -u).reverse(), 0, ...up];
    const text = ticks.map((u) => (u === 0 ? "0" : power(Math.abs(u) - 1 + lowest, u < 0 ? "−" : "")));
    return { of, axis: { tickvals: ticks, ticktext: text, zeroline: true } };
  }

  function sizes(values, zero, infinite) {
    // Sizes on a log axis: zero at the floor, anything that is not finite at the ceiling.
    const drawn = values.filter((v) => v > 0 && Number.isFinite(v)).map(Math.log10);
    const low = drawn.length ? Math.floor(Math.min(...drawn)) : 0, high = drawn.length ? Math.ceil(Math.max(...drawn)) : 0;
    const gap = Math.max(1, Math.round((high - low) / 8));
    const floor = low - gap, ceiling = high + gap;
    const inner = decades(low, high, 7);
    const ticks = [...inner], text = inner.map((k) => power(k));
    if (values.some((v) => v === 0)) { ticks.unshift(floor); text.unshift(zero); }
    if (values.some((v) => !Number.isFinite(v))) { ticks.push(ceiling); text.push(infinite); }
    const of = (v) => (v === 0 ? floor : Number.isFinite(v) ? Math.log10(v) : ceiling);
    const ends = [Math.min(low, ticks[0]), Math.max(high, ticks[ticks.length - 1])];
    return { of, axis: { tickvals: ticks, ticktext: text, range: [ends[0] - gap / 2, ends[1] + gap / 2] } };
  }

  function scaled(spec, values) {
    if (spec.kind === "log") return logarithmic(values);
    return spec.kind === "symlog" ? symlog(values, spec.decade) : linear();
  }

  // ---- look

  function theme(print) {
    const dark = !print && matchMedia("(prefers-color-scheme: dark)").matches;
    return dark
      ? { ink: "#e4e7ea", line: "#363c44", axis: "#8a949e", paper: "#14171b", panel: "#1d2126", colours: DARK, dark: true }
      : { ink: "#1b1f24", line: "#e1e5ea", axis: "#59636e", paper: "#ffffff", panel: "#f5f6f8", colours: LIGHT, dark: false };
  }

  function axis(look, title, extra) {
    return {
      title: { text: title, standoff: 8 }, gridcolor: look.line, linecolor: look.axis, zerolinecolor: look.axis, zeroline: false,
      showline: true, mirror: true, ticks: "outside", tickangle: 0, tickcolor: look.axis, automargin: true, ...extra,
    };
  }

  function layout(look, extra) {
    return {
      paper_bgcolor: look.paper, plot_bgcolor: look.paper, margin: { l: 60, r: 14, t: 34, b: 46 },
      font: { color: look.ink, size: 12, family: "system-ui, 'Liberation Sans', Arial, sans-serif" },
      hoverlabel: { align: "left", bgcolor: look.panel, bordercolor: look.axis, font: { color: look.ink } }, hovermode: "closest",
      uirevision: "same", // zoom and camera stay when the step changes
      legend: { orientation: "h", x: 0, y: 1.01, yanchor: "bottom", bgcolor: "rgba(0,0,0,0)", font: { size: 11 } }, ...extra,
    };
  }

  // ---- figures

  function when(data, name) {
    // The step of what is drawn: of the model the field's own, of an audit that of the sample kept.
    const step = data.steps ? data.steps[name] : data.step;
    return step === undefined || step === null ? "" : `, step ${step}`;
  }

  function hover(data, name) {
    const field = data.fields[name];
    const kind = (i) => (data.phase ? (data.phase[i] ? ", solid" : ", fluid") : "");
    const state = (i) => (data.steps ? [] : [`ρ ${short(data.rho[i])}`, `(ρ − ρ0)/ρ0 ${short(data.delta[i])}`]);
    return data.id.map((id, i) => [
      `atom ${id}, type ${data.type[i]}${kind(i)}`, ...state(i),
      `${plain(name)} ${short(field.lammps[i], data.steps ? 5 : 6)}`, `|difference| ${rough(field.difference[i])}`,
      `bound ${rough(field.bound[i])}`, `difference/bound ${rough(field.ratio[i])}`,
    ].join("<br>"));
  }

  function style(type, types, look) {
    const at = types.indexOf(type), count = look.colours.length; // as many symbols: 36 different pairs
    return { color: look.colours[at % count], symbol: SYMBOLS[(at + Math.floor(at / count)) % SYMBOLS.length] };
  }

  function atoms(data, field, type) {
    // Atoms of a type, those outside the bound last: they are drawn on top, and the legend shows the first.
    const picked = [...data.id.keys()].filter((i) => data.type[i] === type);
    return [...picked.filter((i) => field.ratio[i] <= 1), ...picked.filter((i) => !(field.ratio[i] <= 1))];
  }

  function marker(data, field, picked, type, look) {
    const { color, symbol } = style(type, data.types, look);
    const inside = picked.map((i) => field.ratio[i] <= 1);
    return { color: inside.map((is) => (is ? color : OUTSIDE)), symbol: inside.map((is) => (is ? symbol : "x")), size: inside.map((is) => (is ? 6 : 8)) };
  }

  function lawFigure(data, law, look) {
    const field = data.fields.pressure;
    const values = data[law.quantity] ?? data.rho.map((rho) => rho / law.rho0);
    const picked = atoms(data, field, law.type);
    const x = scaled(law.scale, [...law.x, ...picked.map((i) => values[i])]);
    const y = scaled(law.pscale, [...law.p, ...picked.map((i) => field.lammps[i])]);
    const text = hover(data, "pressure");
    const missing = picked.filter((i) => !Number.isFinite(field.lammps[i])).length;
    const traces = [
      { x: law.x.map(x.of), y: law.p.map(y.of), mode: "lines", name: "reference law", hoverinfo: "skip", line: { color: look.axis, width: 1.6 } },
      {
        x: picked.map((i) => x.of(values[i])), y: picked.map((i) => y.of(field.lammps[i])), text: picked.map((i) => text[i]),
        mode: "markers", name: "LAMMPS", hoverinfo: "text", marker: { ...marker(data, field, picked, law.type, look), line: { width: 0.5, color: look.paper } },
      },
    ];
    const note = missing ? `${missing} LAMMPS values are not finite and cannot be drawn here` : "";
    const extra = { xaxis: axis(look, NAMES[law.quantity], x.axis), yaxis: axis(look, "pressure", y.axis) };
    return { title: `Type ${law.type}: ${plain(law.style)}`, note, traces, layout: layout(look, extra) };
  }

  function errorFigure(data, name, look) {
    const field = data.fields[name];
    const offsets = data.delta.some(Number.isFinite);
    const gas = !offsets || (data.laws.length > 0 && data.laws.every((law) => law.quantity === "energy"));
    const wide = !gas && data.laws.some((law) => law.quantity === "ratio"); // there |rho/rho0 - 1| would pile up at 1
    const values = (gas ? data.rho : wide ? data.delta.map((delta) => 1 + delta) : data.delta).map(Math.abs);
    const title = gas ? "|ρ|" : wide ? "|ρ / ρ<sub>0</sub>|" : "|ρ / ρ<sub>0</sub> − 1|";
    const x = sizes(values, "0", "no law");
    const y = sizes([...field.difference, ...field.bound.filter(Number.isFinite)], "equal", "not finite");
    const text = hover(data, name);
    const traces = [];
    for (const type of data.types) {
      const picked = atoms(data, field, type);
      const at = picked.map((i) => x.of(values[i]));
      const { color } = style(type, data.types, look);
      const label = data.types.length > 1 ? `type ${type} ` : "";
      const common = { x: at, mode: "markers", hoverinfo: "text", text: picked.map((i) => text[i]) };
      traces.push({ ...common, y: picked.map((i) => (Number.isFinite(field.bound[i]) ? y.of(field.bound[i]) : NaN)), name: `${label}bound`, marker: { symbol: "line-ew-open", color, size: 7, line: { width: 1.5, color } } });
      traces.push({ ...common, y: picked.map((i) => y.of(field.difference[i])), name: `${label}LAMMPS − reference`, marker: { ...marker(data, field, picked, type, look), opacity: 0.8, line: { width: 0 } } });
    }
    const equal = field.difference.filter((v) => v === 0).length;
    const note = `${equal} of ${field.difference.length} atoms drawn have no difference at all${equal ? ": on the line “equal”" : ""}`;
    const extra = { xaxis: axis(look, title, x.axis), yaxis: axis(look, `|difference of ${plain(name)}|`, y.axis) };
    return { title: `Difference and bound: ${plain(name)}${when(data, name)}`, note, traces, layout: layout(look, extra) };
  }

  function outline(data, look) {
    if (!data.box) return [];
    const lo = data.box.slice(0, 3), hi = data.box.slice(3, 6), [xy, xz, yz] = data.box.length > 6 ? data.box.slice(6) : [0, 0, 0];
    const corner = (bits) => {
      const at = [0, 1, 2].map((c) => (bits >> c) & 1), [x, y, z] = at.map((end, c) => (end ? hi[c] : lo[c]));
      return [x + at[1] * xy + at[2] * xz, y + at[2] * yz, z];
    };
    // A walk along the edges that meets them all; in 2D the first five corners are the rectangle.
    const walk = [0, 1, 3, 2, 0, ...(data.x.length === 3 ? [4, 5, 1, 5, 7, 3, 7, 6, 2, 6, 4] : [])].map(corner);
    const [x, y, z] = [0, 1, 2].map((c) => walk.map((point) => point[c]));
    return [{ ...place(data, [x, y, z]), mode: "lines", hoverinfo: "skip", showlegend: false, line: { color: look.axis, width: 1.5 } }];
  }

  function place(data, [x, y, z]) {
    return data.x.length === 3 ? { type: "scatter3d", x, y, z } : { type: "scatter", x, y };
  }

  function particles(data, picked, text, marker, name) {
    const at = data.x.map((column) => picked.map((i) => column[i]));
    return { ...place(data, at), mode: "markers", hoverinfo: "text", text: picked.map((i) => text[i]), marker, name, showlegend: false };
  }

  function points(data, picked, look) {
    // The symbols of the types, as in the plots of the laws; 3D has too few of them.
    return data.x.length === 3 ? { size: 4 } : { size: data.steps ? spot(data) : 6, symbol: picked.map((i) => style(data.type[i], data.types, look).symbol) };
  }

  function spot(data) {
    return data.x.length === 3 ? 5 : Math.max(6, Math.min(14, 150 / Math.sqrt(data.natoms)));
  }

  function particleLayout(data, look) {
    const names = ["x", "y", "z"];
    if (data.x.length !== 3) {
      const equal = { scaleanchor: "x", scaleratio: 1 };
      return layout(look, { xaxis: axis(look, "x", { constrain: "domain" }), yaxis: axis(look, "y", { ...equal, constrain: "domain" }) });
    }
    const axes = names.map((name) => [`${name}axis`, { title: { text: name }, gridcolor: look.line, color: look.ink, backgroundcolor: look.paper, zeroline: false }]);
    const camera = { eye: { x: 1.5, y: 1.5, z: 1.1 } };
    return layout(look, { margin: { l: 0, r: 0, t: 6, b: 6 }, scene: { ...Object.fromEntries(axes), aspectmode: "data", camera } });
  }

  function valueFigure(data, name, look) {
    const field = data.fields[name];
    const scale = scaled(field.scale, field.lammps);
    const finite = [...data.id.keys()].filter((i) => Number.isFinite(field.lammps[i]));
    const others = [...data.id.keys()].filter((i) => !Number.isFinite(field.lammps[i]));
    const text = hover(data, name);
    const colorbar = { thickness: 12, outlinewidth: 0, len: 0.9, exponentformat: "power", ...(scale.axis.tickvals ? { tickmode: "array", tickvals: scale.axis.tickvals, ticktext: scale.axis.ticktext } : {}) };
    const shown = { ...points(data, finite, look), color: finite.map((i) => scale.of(field.lammps[i])), colorscale: "Cividis", colorbar, line: { width: 0.5, color: look.axis } };
    const traces = [...outline(data, look), particles(data, finite, text, shown, plain(name))];
    if (others.length) traces.push(particles(data, others, text, { size: 9, symbol: "x", color: OUTSIDE }, "not finite"));
    const note = others.length ? `${others.length} not finite: orange crosses` : "";
    return { title: `Particles: ${plain(name)} of LAMMPS${when(data, name)}`, note, traces, layout: particleLayout(data, look) };
  }

  function ratioFigure(data, name, look) {
    const field = data.fields[name];
    const inside = [...data.id.keys()].filter((i) => field.ratio[i] <= 1);
    const outside = [...data.id.keys()].filter((i) => !(field.ratio[i] <= 1));
    const text = hover(data, name);
    const colorbar = { thickness: 12, outlinewidth: 0, len: 0.9 };
    const top = Math.max(...inside.map((i) => field.ratio[i]), 0) || 1;
    const shown = { ...points(data, inside, look), color: inside.map((i) => field.ratio[i]), cmin: 0, cmax: top, colorscale: "Cividis", colorbar, line: { width: 0.5, color: look.axis } };
    const traces = outline(data, look);
    if (inside.length) traces.push(particles(data, inside, text, shown, "inside the bound"));
    if (outside.length) traces.push(particles(data, outside, text, { size: 8, symbol: "diamond", color: OUTSIDE, line: { width: 1, color: look.ink } }, "outside the bound"));
    const here = outside.length ? `${outside.length} atoms drawn lie outside the bound: orange diamonds` : `all inside the bound; largest ratio ${rough(Math.max(...field.ratio))}`;
    const [step, ratio] = data.elsewhere?.[name] ?? [];
    const note = step === undefined ? here : `${here}; largest at step ${step}: ${rough(numbers(ratio)[0])}`;
    return { title: `Particles: difference/bound of ${plain(name)}${when(data, name)}`, note, traces, layout: particleLayout(data, look) };
  }

  // ---- the particle model: a field at one of its steps

  const LOWEST = -6; // decades of difference/bound below which the colour stays the same

  function sides(data) {
    return data.other === "twin" ? ["LAMMPS", "its twin"] : ["LAMMPS", "reference"];
  }

  function heat(field, look) {
    // Blue inside the bound, orange to dark red beyond it, each by decades; grey without any difference.
    const every = Object.values(field.at).flatMap((at) => at.ratio); // one scale for all steps
    const finite = every.filter((v) => v > 0 && Number.isFinite(v)).map(Math.log10);
    const top = Math.max(1, Math.ceil(Math.max(...finite, 0)));
    const low = Math.min(-1, Math.max(LOWEST, Math.floor(Math.min(...finite, 0))));
    const outside = Math.max(...every) > 1;
    const cmax = outside ? top : 0;
    const bound = (0 - low) / (cmax - low);
    const inside = look.dark ? ["#16324a", "#6cb6ee"] : ["#d6e6f5", "#2474b5"];
    const beyond = look.dark ? ["#ffb27d", "#ff5630"] : ["#f6b26b", "#8c1d04"];
    const colorscale = outside ? [[0, inside[0]], [bound, inside[1]], [bound, beyond[0]], [1, beyond[1]]] : [[0, inside[0]], [1, inside[1]]];
    const ticks = [...new Set([...decades(low, 0, outside && top > 3 ? 1 : 4), 0, ...(outside ? decades(0, cmax, 5) : [])])].sort((a, b) => a - b);
    const colorbar = { thickness: 12, outlinewidth: 0, len: 0.95, tickmode: "array", tickvals: ticks, ticktext: ticks.map((k) => (k === 0 ? "bound" : power(k))) };
    const of = (v) => (v === 0 ? low : Number.isFinite(v) ? Math.max(low, Math.log10(v)) : cmax);
    return { of, axis: { cmin: low, cmax, colorscale, colorbar } };
  }

  function byType(data, field, look, size, make) {
    // A trace per type with its symbol, the atoms furthest outside last, on top; the legend has traces of its own.
    const heated = heat(field, look);
    const symbols = data.x.length === 3 && size.three ? ["circle", "square", "diamond", "cross", "x", "circle-open"] : SYMBOLS;
    return data.types.flatMap((type, at) => {
      const picked = [...data.id.keys()].filter((i) => data.type[i] === type).sort((a, b) => heated.of(field.ratio[a]) - heated.of(field.ratio[b]));
      const phases = new Set(data.phase ? picked.map((i) => data.phase[i] !== 0) : []);
      const solid = phases.size === 1 && phases.has(true);
      const name = `type ${type}${phases.size === 1 ? (solid ? " (solid)" : " (fluid)") : ""}`;
      const symbol = symbols[at % symbols.length];
      const line = { width: solid ? 1.6 : 0.6, color: look.ink };
      const made = make(picked);
      const color = picked.map((i) => heated.of(field.ratio[i]));
      const drawn = { ...made, mode: "markers", hoverinfo: "text", showlegend: false, legendgroup: name, marker: { symbol, size: size.of, color, coloraxis: "coloraxis", line } };
      if (data.types.length < 2) return [drawn];
      const empty = Object.fromEntries(["x", "y", "z"].filter((key) => key in made).map((key) => [key, [null]]));
      return [drawn, { type: made.type ?? "scatter", ...empty, mode: "markers", name, legendgroup: name, hoverinfo: "skip", marker: { symbol, size: size.of, color: look.axis } }];
    });
  }

  function modelFigures(data, name, look) {
    const field = data.fields[name];
    const text = hover(data, name);
    const at = when(data, name);
    const heated = heat(field, look);
    const take = (column, picked) => picked.map((i) => column[i]);
    const labelled = (picked) => ({ text: take(text, picked) });
    const [one, other] = sides(data);
    const outside = field.ratio.filter((v) => !(v <= 1)).length;
    const equal = field.difference.filter((v) => v === 0).length;
    const count = `${outside} outside the bound, ${equal} equal, of ${data.n} drawn`;

    const spots = byType(data, field, look, { of: spot(data), three: true }, (picked) => ({ ...place(data, data.x.map((c) => take(c, picked))), ...labelled(picked) }));
    const map = {
      title: `Particles: difference/bound of ${plain(name)}${at}`, note: `${count}; positions of the last step`,
      traces: [...outline(data, look), ...spots], layout: { ...particleLayout(data, look), coloraxis: heated.axis },
    };

    const scale = scaled(field.scale, [...field.lammps, ...field.reference]);
    const pairs = byType(data, field, look, { of: 7 }, (picked) => ({ x: take(field.reference, picked).map(scale.of), y: take(field.lammps, picked).map(scale.of), ...labelled(picked) }));
    const drawn = [...field.lammps, ...field.reference].filter(Number.isFinite).map(scale.of);
    const ends = [Math.min(...drawn), Math.max(...drawn)];
    const diagonal = { x: ends, y: ends, mode: "lines", hoverinfo: "skip", showlegend: false, line: { color: look.axis, width: 1.2 } };
    const scatter = {
      title: `${one} against ${other}: ${plain(name)}${at}`, note: "on the line: equal; of vectors and tensors the component closest to its bound",
      traces: drawn.length ? [diagonal, ...pairs] : pairs,
      layout: layout(look, { coloraxis: heated.axis, xaxis: axis(look, other, scale.axis), yaxis: axis(look, one, scale.axis) }),
    };

    const x = sizes(field.bound, "0", "not finite"), y = sizes(field.difference, "equal", "not finite");
    const errors = byType(data, field, look, { of: 7 }, (picked) => ({ x: take(field.bound, picked).map(x.of), y: take(field.difference, picked).map(y.of), ...labelled(picked) }));
    const range = x.axis.range;
    const limit = { x: range, y: range, mode: "lines", hoverinfo: "skip", showlegend: false, line: { color: OUTSIDE, width: 1.5, dash: "dash" } };
    const error = {
      title: `Difference against bound: ${plain(name)}${at}`, note: "below the dashed line: inside the bound",
      traces: [limit, ...errors], layout: layout(look, { coloraxis: heated.axis, xaxis: axis(look, "bound", x.axis), yaxis: axis(look, "|difference|", y.axis) }),
    };
    return [map, scatter, error, valueFigure(data, name, look)];
  }

  function checksFigure(checks, look) {
    const y = sizes([...checks.ratio, 1], "equal", "not finite");
    const several = new Set(checks.field).size > 1;
    const labels = [...checks.step.keys()].map((i) => (several ? `${checks.field[i]}, ` : "") + (checks.type[i] ? `type ${checks.type[i]}` : "all types"));
    const keys = [...new Set(labels.map((label, i) => `${label}|${checks.run[i]}`))].sort();
    const runs = new Set(checks.run).size > 1;
    const kinds = [...new Set(labels)].sort();
    const traces = keys.map((key) => {
      const [label, number] = key.split("|");
      const run = Number(number);
      const picked = [...checks.step.keys()].filter((i) => labels[i] === label && checks.run[i] === run).sort((a, b) => checks.step[a] - checks.step[b]);
      return {
        x: picked.map((i) => checks.step[i]), y: picked.map((i) => y.of(checks.ratio[i])), mode: "lines+markers", line: { width: 1 },
        marker: { size: 5, ...style(label, kinds, look) }, name: `${label}${runs ? `, run ${run}` : ""}`, hoverinfo: "text",
        text: picked.map((i) => `step ${checks.step[i]}, run ${run}, ${label}<br>largest difference/bound ${short(checks.ratio[i])}`),
      };
    });
    const limit = { type: "line", xref: "paper", x0: 0, x1: 1, y0: 0, y1: 0, line: { color: OUTSIDE, width: 1.5, dash: "dash" } };
    const label = { xref: "paper", x: 0.01, xanchor: "left", y: 0, yanchor: "bottom", text: "bound", showarrow: false, font: { color: OUTSIDE, size: 11 } };
    const extra = { shapes: [limit], annotations: [label], xaxis: axis(look, "step", {}), yaxis: axis(look, "largest difference/bound", y.axis) };
    const note = checks.total > checks.step.length ? `${checks.step.length} of ${checks.total} samples shown: the worst, the others evenly spaced` : "";
    return { title: "Checks over time", note, traces, layout: layout(look, extra) };
  }

  // ---- drawing

  function figures(data, name, look) {
    const found = data.checks ? [checksFigure(data.checks, look)] : [];
    if (!name) return found;
    if (data.steps) return [...found, ...modelFigures(data, name, look)];
    if (name === "pressure") found.push(...data.laws.map((law) => lawFigure(data, law, look)));
    return [...found, errorFigure(data, name, look), valueFigure(data, name, look), ratioFigure(data, name, look)];
  }

  function element(tag, name, text) {
    const made = document.createElement(tag);
    if (name) made.className = name;
    if (text) made.textContent = text;
    return made;
  }

  function load(article) {
    const script = article.querySelector("script.data");
    if (!script) return null;
    const data = JSON.parse(script.textContent);
    for (const key of ["x", "id", "type", "rho", "energy", "phase"]) if (key in data) data[key] = column(data[key], data.n);
    if (data.box) data.box = numbers(data.box);
    if (data.rho) data.delta = data.rho.map((rho, i) => (rho - (data.rho0[data.type[i]] ?? NaN)) / data.rho0[data.type[i]]);
    const more = JSON.parse(article.querySelector("script.more")?.textContent ?? "{}");
    for (const [name, field] of Object.entries(data.fields ?? {})) {
      Object.assign(field, more[name]);
      const { lammps, difference, bound, scale } = field;
      field.worst = data.steps?.[name] ?? 0;
      field.at = { ...field.at, [field.worst]: { lammps, difference, bound, scale } };
      for (const at of Object.values(field.at)) {
        for (const key of ["lammps", "difference", "bound"]) at[key] = column(at[key], data.n);
        derive(at);
      }
    }
    at(data);
    if (data.pairs) data.pairs = looks(data.pairs);
    for (const law of data.laws ?? []) for (const key of ["x", "p"]) law[key] = column(law[key], GRID);
    if (data.checks) for (const key of ["step", "run", "type", "ratio"]) data.checks[key] = numbers(data.checks[key]);
    return data;
  }

  function at(data, step) {
    // Show every field at a step, or at its worst one.
    for (const [name, field] of Object.entries(data.fields ?? {})) {
      const shown = step in field.at ? step : field.worst;
      Object.assign(field, field.at[shown]);
      if (data.steps) data.steps[name] = Number(shown);
    }
  }

  function looks(pairs) {
    // The pairs of one atom after one step each; they come in columns.
    const count = pairs.shown.reduce((sum, more) => sum + more, 0);
    const id = column(pairs.id, count), r = column(pairs.r, count);
    const terms = column(pairs.pair, count), sums = column(pairs.sum, pairs.atom.length);
    let begin = 0;
    return pairs.atom.map((atom, k) => {
      const rows = [...Array(pairs.shown[k]).keys()].map((row) => begin + row);
      begin += pairs.shown[k];
      return {
        atom, step: pairs.step[k], count: pairs.count[k], sum: sums.map((of) => of[k]),
        names: pairs.names.map((name) => name.replace("pressure_force", "of pressure").replace("force ", "f_")),
        pairs: rows.map((row) => ({ id: id[row], r: r[row], adds: terms.map((of) => of[row]) })),
      };
    });
  }

  function slider(article, data, name) {
    const steps = Object.keys(data.fields[name].at).map(Number).sort((a, b) => a - b);
    const all = steps.length === data.compared;
    const kept = all ? "" : `; ${data.compared} steps compared, eos-ref run ${article.dataset.case} shows all`;
    const says = () => `${data.steps[name]}${data.steps[name] === data.fields[name].worst ? " (worst)" : ""} of ${steps.join(", ")}${kept}`;
    const label = element("label", "choice step", "Step ");
    const input = element("input");
    Object.assign(input, { type: "range", min: 0, max: steps.length - 1, step: 1, disabled: steps.length < 2 });
    const shown = element("output");
    const show = () => {
      input.value = steps.indexOf(data.steps[name]);
      input.setAttribute("aria-valuetext", says());
      shown.textContent = says();
    };
    input.addEventListener("input", () => {
      article.querySelector(".plots").dataset.step = steps[input.value];
      at(data, steps[input.value]);
      show();
      redraw(article, data, name);
    });
    label.append(input, shown);
    show();
    return label;
  }

  function choice(article, names, chosen) {
    const label = element("label", "choice", "Field ");
    const select = element("select");
    for (const name of names) select.append(new Option(name, name, false, name === chosen));
    select.addEventListener("change", () => draw(article, { name: select.value }));
    label.append(select);
    return label;
  }

  let plotly; // its script is unpacked for the first picture
  function ready() {
    plotly ??= unpacked(document.getElementById("plotly")).then((text) => {
      const script = element("script");
      script.textContent = text;
      document.head.append(script);
    });
    return plotly;
  }

  // ---- an atom pinned: ringed in all plots, its numbers in a table

  function ring(plot, at, look) {
    const pinned = plot.data.findIndex((trace) => trace.name === "pinned");
    if (pinned >= 0) Plotly.deleteTraces(plot, pinned);
    const spots = plot.data.flatMap((trace) => [...(trace.customdata ?? []).keys()].filter((k) => trace.customdata[k] === at).map((k) => [trace, k]));
    if (!spots.length) return;
    const axes = ["x", "y", "z"].filter((key) => key in spots[0][0]);
    const places = Object.fromEntries(axes.map((key) => [key, spots.map(([trace, k]) => trace[key][k])]));
    const marker = { symbol: "circle-open", size: 17, color: look.ink, line: { color: look.ink, width: 2.5 } };
    Plotly.addTraces(plot, { type: spots[0][0].type ?? "scatter", ...places, mode: "markers", name: "pinned", hoverinfo: "skip", showlegend: false, marker });
  }

  function rows(table, headings, body, links) {
    // A table of numbers, the first column of names; ``links``: atoms that a click on the name pins.
    const line = (part, tag, values, link) => values.reduce((row, text, k) => {
      const cell = element(tag, k ? "number" : "", k || !link ? text : "");
      if (!k && link) cell.append(Object.assign(element("button", "neighbour", text), { type: "button" }));
      row.append(cell);
      return row;
    }, part.insertRow());
    line(table.createTHead(), "th", headings);
    const part = table.createTBody();
    body.forEach((values, k) => line(part, "td", values, links?.[k]));
    return (values) => line(table.createTFoot(), "td", values);
  }

  function neighbours(data, look) {
    const part = element("section");
    const whose = data.other === "twin" ? "the original run, by the reference" : "the reference";
    const box = element("div", "scroll neighbours");
    box.tabIndex = 0;
    const table = element("table", "fields");
    const nearest = look.pairs.length < look.count ? `, the nearest ${look.pairs.length} of which are listed` : "";
    const caption = `${look.count} ${look.count === 1 ? "neighbour" : "neighbours"} at step ${look.step}${nearest}, and what each pair adds (${whose})`;
    const body = look.pairs.map(({ id, r, adds }) => [String(id), short(r, 4), ...adds.map(rough)]);
    const foot = rows(table, ["particle", "r", ...look.names], body, look.pairs.map(({ id }) => data.id.includes(id)));
    foot(["sum", "", ...look.sum.map((value) => short(value, 4))]);
    box.append(table);
    part.append(element("h4", "", caption), box);
    return part;
  }

  function pinned(name, data, field, at) {
    const box = element("div", "atom");
    const kind = data.phase ? (data.phase[at] ? ", solid" : ", fluid") : "";
    const part = element("section");
    part.append(element("h4", "", `Atom ${data.id[at]}, type ${data.type[at]}${kind}, at ${data.x.map((column) => short(column[at], 5)).join(", ")}`));
    const table = element("table", "fields"), scroll = element("div", "scroll");
    const body = Object.entries(data.fields).map(([name, field]) => [
      name, ...(data.steps ? [String(data.steps[name])] : []), short(field.lammps[at]), short(field.reference[at]),
      ...[field.difference, field.bound, field.ratio].map((column) => rough(column[at])),
    ]);
    rows(table, ["field", ...(data.steps ? ["step"] : []), ...sides(data), "|difference|", "bound", "difference/bound"], body);
    scroll.append(table);
    part.append(scroll);
    box.append(part);
    if (!data.steps) return box;
    const step = data.steps[field], kept = (data.pairs ?? []).filter(({ atom }) => atom === data.id[at]);
    const look = kept.find((one) => one.step === step) ?? kept[0];
    if (look) box.append(neighbours(data, look));
    if (look?.step !== step) {
      const words = element("p", "note", `Its neighbours at step ${step}, and what each pair adds: `);
      words.append(element("code", "", `eos-ref explain ${name} --atom ${data.id[at]} --step ${step}`));
      box.append(words);
    }
    return box;
  }

  function pin(article, data, at) {
    const panel = article.querySelector(".plots");
    panel.querySelector(".atom")?.remove();
    const found = at >= 0;
    panel.dataset.atom = found ? data.id[at] : "";
    if (found) panel.querySelector("figure").before(pinned(article.dataset.case, data, panel.dataset.field, at));
    for (const plot of panel.querySelectorAll(".plot")) ring(plot, at, theme(false));
    article.dispatchEvent(new CustomEvent("pinned"));
  }

  function pinAgain(article, data) {
    const { atom } = article.querySelector(".plots").dataset;
    pin(article, data, atom ? data.id.indexOf(Number(atom)) : -1);
  }

  function drawing(data, name, print) {
    // The figures, each trace with the atoms of its points.
    const index = new Map(name ? hover(data, name).map((text, i) => [text, i]) : []);
    const found = figures(data, name, theme(print));
    for (const { traces } of found) for (const trace of traces) if (Array.isArray(trace.text)) trace.customdata = trace.text.map((text) => index.get(text));
    return found;
  }

  function entitle(caption, { title, note }) {
    caption.replaceChildren(title, ...(note ? [element("small", "", note)] : []));
  }

  function redraw(article, data, name) {
    const boxes = article.querySelectorAll(".plots figure");
    drawing(data, name, false).forEach((figure, k) => {
      entitle(boxes[k].querySelector("figcaption"), figure);
      Plotly.react(boxes[k].querySelector(".plot"), figure.traces, figure.layout);
    });
    pinAgain(article, data);
  }

  async function draw(article, { name, atom, step, print = false, show = false } = {}) {
    const data = load(article);
    if (!data) return;
    await ready();
    if (article.hidden) return; // left meanwhile
    remove(article);
    const panel = article.querySelector(".plots");
    const names = Object.keys(data.fields ?? {});
    const wanted = name ?? panel.dataset.field;
    const field = names.includes(wanted) ? wanted : data.first ?? (names.includes("pressure") ? "pressure" : names[0]);
    if (field) panel.dataset.field = field;
    if (atom !== undefined) panel.dataset.atom = atom;
    if (step !== undefined) panel.dataset.step = step;
    if (panel.dataset.step) at(data, panel.dataset.step);
    for (const button of article.querySelectorAll(".pick")) button.setAttribute("aria-pressed", String(button.dataset.field === field));
    if (names.length > 1) panel.append(choice(article, names, field));
    if (data.steps && field && data.compared > 1) panel.append(slider(article, data, field));
    if (data.id) {
      const thinned = data.id.length < data.natoms ? ": the worst by difference/bound, the others evenly by density" : "";
      panel.append(element("p", "note", `${data.id.length} of ${data.natoms} atoms shown in the plots${thinned}. Click an atom to pin it.`));
    }
    for (const { title, note, traces, layout } of drawing(data, field, print)) {
      const figure = element("figure");
      const caption = element("figcaption"), plot = element("div", "plot");
      entitle(caption, { title, note });
      figure.append(caption, plot);
      panel.append(figure);
      const buttons = layout.scene ? ["orbitRotation", "pan3d", "resetCameraDefault3d"] : ["zoom2d", "pan2d", "resetScale2d"];
      // Before printing the window still has its own width: draw for the paper's.
      const size = print ? { width: 640, height: 400, autosize: false } : {};
      Plotly.newPlot(plot, traces, { ...layout, ...size }, { responsive: true, displaylogo: false, modeBarButtons: [["toImage", ...buttons]] });
      plot.on("plotly_click", ({ points }) => {
        const at = points[0].customdata;
        if (at !== undefined) pin(article, data, data.id[at] === Number(panel.dataset.atom) ? -1 : at);
      });
    }
    panel.onclick = ({ target }) => {
      if (target.matches(".neighbour")) pin(article, data, data.id.indexOf(Number(target.textContent)));
    };
    if (data.id) pinAgain(article, data);
    if (show) panel.scrollIntoView({ block: "nearest" });
  }

  function remove(article) {
    const panel = article.querySelector(".plots");
    if (!panel) return;
    for (const canvas of panel.querySelectorAll("canvas")) {
      // A browser keeps only some 16 WebGL contexts, and purge leaves them to the garbage collector.
      (canvas.getContext("webgl2") ?? canvas.getContext("webgl"))?.getExtension("WEBGL_lose_context")?.loseContext();
    }
    for (const plot of panel.querySelectorAll(".plot")) Plotly.purge(plot);
    panel.replaceChildren();
  }

  function again(print) {
    const open = document.querySelector("article.case:not([hidden])");
    if (open) draw(open, { print });
  }
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => again(false));
  window.addEventListener("beforeprint", () => again(true));
  window.addEventListener("afterprint", () => again(false));

  return { draw, remove };
})();
