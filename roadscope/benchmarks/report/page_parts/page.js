"use strict";
(() => {
  const boards = JSON.parse(document.getElementById("content").textContent);
  const root = document.documentElement;
  root.classList.add("scripted");

  // Elements. Texts are set as text, never as HTML: names are those of strangers.
  const fill = (element, attributes, children) => {
    for (const [name, value] of Object.entries(attributes || {}))
      if (value !== null && value !== undefined) element.setAttribute(name, value);
    element.append(...children.flat().filter((child) => child !== null));
    return element;
  };
  const el = (tag, attributes, ...children) => fill(document.createElement(tag), attributes, children);
  const svg = (tag, attributes, ...children) =>
    fill(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
  const title = (text) => svg("title", null, text);
  const options = (select, pairs, chosen) => {
    select.replaceChildren(...pairs.map(([value, text]) => el("option", { value }, text)));
    if (pairs.some(([value]) => value === chosen)) select.value = chosen;
  };
  const shortened = (text, most) => (text.length > most ? text.slice(0, most - 1) + "\u2026" : text);
  const digits = (value) => {
    if (value === null) return "-";
    const size = Math.abs(value);
    return value.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : size >= 0.1 || size === 0 ? 2 : 3);
  };

  const inBrackets = (interval) => (interval ? ` [${interval}]` : "");

  const canvas = document.createElement("canvas").getContext("2d");
  const textWidth = (text, bold) => {
    canvas.font = `${bold ? "bold " : ""}12px ${getComputedStyle(document.body).fontFamily}`;
    return canvas.measureText(text).width + 2;
  };
  const fitted = (text, most, bold) => {
    let length = text.length;
    while (length > 1 && textWidth(shortened(text, length), bold) > most) length--;
    return shortened(text, length);
  };

  // Axes.
  const ticksOf = (low, high, count) => {
    const raw = (high - low) / count || 1;
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((k) => k * power).find((k) => k >= raw);
    const ticks = [];
    for (let k = Math.ceil(low / step); k * step <= high + step * 1e-6; k++) ticks.push(k * step);
    return ticks;
  };
  const logTicks = (low, high) => {
    const ticks = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power++)
      for (const k of [1, 2, 5]) if (k * 10 ** power >= low && k * 10 ** power <= high) ticks.push(k * 10 ** power);
    return ticks.length > 1 ? ticks : ticksOf(low, high, 4);
  };
  const tickText = (value) => String(Number(value.toPrecision(3)));
  const linear = (low, high, from, to) => (value) => from + ((value - low) / (high - low || 1)) * (to - from);

  const panel = (section) => {
    const board = boards[Number(section.dataset.board)];
    const find = (selector) => section.querySelector(selector);
    const rows = [...section.querySelectorAll("tbody tr[data-entry]")];
    const body = find(".ranks tbody");
    let chosen = 0;
    const redraws = [];

    // The table: sorting and filtering.
    const headings = [...section.querySelector(".ranks thead tr").children];
    const cellValue = (row, column) => {
      const value = row.children[column].dataset.value;
      return headings[column].dataset.better === "text" ? value : value === "" ? null : Number(value);
    };
    const sortBy = (column, direction) => {
      const sign = direction === "ascending" ? 1 : -1;
      const compare = (a, b) => {
        const [x, y] = [cellValue(a, column), cellValue(b, column)];
        if (x === null || y === null) return (x === null) - (y === null);
        return sign * (typeof x === "string" ? x.localeCompare(y) : x - y);
      };
      headings.forEach((heading, k) =>
        k === column ? heading.setAttribute("aria-sort", direction) : heading.removeAttribute("aria-sort"));
      body.append(...[...rows].sort(compare));
    };
    headings.forEach((heading, column) => {
      const button = heading.querySelector("button");
      if (button) button.addEventListener("click", () => {
        const before = heading.getAttribute("aria-sort");
        const first = heading.dataset.better === "higher" ? "descending" : "ascending";
        sortBy(column, before === null ? first : before === "ascending" ? "descending" : "ascending");
      });
    });
    const filter = () => {
      const wanted = find(".filter").value.trim().toLowerCase();
      let count = 0;
      for (const row of rows) {
        const entry = board.entries[Number(row.dataset.entry)];
        row.hidden = !entry.name.toLowerCase().includes(wanted) || (entry.mark !== null && !find(".marks").checked);
        count += !row.hidden;
      }
      find(".count").value = count === rows.length ? "" : `${count} of ${rows.length} entries`;
    };
    find(".filter").addEventListener("input", filter);
    find(".marks").addEventListener("change", filter);
    find(".every").addEventListener("change", (event) =>
      find(".ranks").classList.toggle("all-columns", event.target.checked));

    // The chosen entry.
    const choose = (index) => {
      chosen = index;
      find("select.entry").value = String(index);
      for (const row of rows) {
        const own = Number(row.dataset.entry) === index;
        row.classList.toggle("is-chosen", own);
        row.querySelector(".choose").setAttribute("aria-pressed", own);
      }
      redraws.forEach((redraw) => redraw());
    };
    rows.forEach((row) => row.querySelector(".choose").addEventListener("click", () => choose(Number(row.dataset.entry))));
    find("select.entry").addEventListener("change", (event) => choose(Number(event.target.value)));

    // Metric against time.
    const columnOf = (metric) => board.columns.findIndex((column) => column.metric === metric);
    const times = board.columns.filter((column) => column.timed);
    const metrics = board.columns.filter((column) => !column.timed);
    const timeSection = find(".times");
    const drawTimes = () => {
      const y = columnOf(timeSection.querySelector(".metric").value);
      const x = columnOf(timeSection.querySelector(".time").value);
      timeSection.querySelector(".plot").replaceChildren(scatter(board, x, y, chosen, choose, timeSection.clientWidth));
    };
    if (times.length && metrics.length) {
      options(timeSection.querySelector(".metric"), metrics.map((c) => [c.metric, c.heading]), board.headline);
      options(timeSection.querySelector(".time"), times.map((c) => [c.metric, c.heading]));
      timeSection.querySelectorAll("select").forEach((select) => select.addEventListener("change", drawTimes));
      redraws.push(drawTimes);
    } else timeSection.hidden = true;

    // Differences.
    const diffSection = find(".differences");
    const drawDifferences = () => {
      const metric = diffSection.querySelector(".metric").value;
      diffSection.querySelector(".plot").replaceChildren(
        forest(board, metric, columnOf(metric), chosen, choose, diffSection.clientWidth));
    };
    if (board.differences.length) {
      const compared = board.differences.map((each) => [each.metric, board.columns[columnOf(each.metric)].heading]);
      options(diffSection.querySelector(".metric"), compared, board.headline);
      diffSection.querySelector(".metric").addEventListener("change", drawDifferences);
      redraws.push(drawDifferences);
    } else diffSection.hidden = true;

    // Breakdown.
    const parts = find(".breakdown");
    if (parts) {
      const by = parts.querySelector(".by");
      const metric = parts.querySelector(".metric");
      const drawParts = () => {
        const breakdown = board.breakdowns[Number(by.value)];
        parts.querySelector(".hint").textContent = breakdown.note;
        parts.querySelector(".scroll").replaceChildren(bands(board, breakdown.parts[Number(metric.value)], chosen));
      };
      const showMetrics = () => {
        const before = metric.selectedOptions.length ? metric.selectedOptions[0].text : "";
        const names = board.breakdowns[Number(by.value)].parts.map((part, k) => [String(k), part.title.split(" by ")[0]]);
        const same = names.find(([, name]) => name === before);
        options(metric, names, same ? same[0] : "0");
        drawParts();
      };
      options(by, board.breakdowns.map((breakdown, k) => [String(k), breakdown.title]));
      by.addEventListener("change", showMetrics);
      metric.addEventListener("change", drawParts);
      redraws.push(drawParts);
      showMetrics();
    }

    if (find(".viewer")) redraws.push(replay(section, board, () => chosen));
    const own = board.entries.findIndex((entry) => entry.rank !== null && entry.name.includes(":"));
    choose(Math.max(own, 0));
    return { redraw: () => redraws.forEach((redraw) => redraw()) };
  };

  // Plots.
  const clickable = (element, action, text) => {
    fill(element, { tabindex: 0, role: "button", "aria-label": text }, [title(text)]);
    element.addEventListener("click", action);
    element.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === " ") { event.preventDefault(); action(); }
    });
    return element;
  };

  function scatter(board, x, y, chosen, choose, space) {
    const points = board.entries
      .map((entry, index) => ({ entry, index, x: entry.cells[x].ends[0], y: entry.cells[y].ends }))
      .filter((point) => point.x > 0 && point.y[0] !== null);
    const [width, height, left, right, top, bottom] = [space || 560, 330, 52, 14, 14, 42];
    const picture = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "group",
      "aria-label": `${board.columns[y].heading} against ${board.columns[x].heading}` });
    if (!points.length) { picture.append(svg("text", { x: 20, y: 30 }, "No entry has both figures.")); return picture; }
    const xs = points.map((point) => point.x);
    const ys = points.flatMap((point) => point.y.filter((value) => value !== null));
    const [lowX, highX] = [Math.min(...xs) / (points.length > 12 ? 1.2 : 1.4), Math.max(...xs) * (points.length > 12 ? 1.2 : 1.9)];
    const pad = (Math.max(...ys) - Math.min(...ys)) * 0.06 || 0.05;
    const [lowY, highY] = [Math.min(...ys) - pad, Math.max(...ys) + pad];
    const atX = (value) => linear(Math.log(lowX), Math.log(highX), left, width - right)(Math.log(value));
    const atY = linear(lowY, highY, height - bottom, top);
    for (const tick of ticksOf(lowY, highY, 5))
      picture.append(svg("line", { class: "axis", x1: left, x2: width - right, y1: atY(tick), y2: atY(tick) }),
        svg("text", { class: "soft", x: left - 6, y: atY(tick) + 4, "text-anchor": "end" }, tickText(tick)));
    for (const tick of logTicks(lowX, highX))
      picture.append(svg("line", { class: "axis", x1: atX(tick), x2: atX(tick), y1: top, y2: height - bottom }),
        svg("text", { class: "soft", x: atX(tick), y: height - bottom + 16, "text-anchor": "middle" }, tickText(tick)));
    const caption = svg("text", { class: "soft", x: (left + width) / 2, y: height - 6, "text-anchor": "middle" },
      `${board.columns[x].heading}, logarithmic (less is better)`);
    picture.append(caption);
    picture.append(svg("text", { class: "soft", x: 12, y: height / 2 - 10, transform: `rotate(-90 12 ${height / 2 - 10})`, "text-anchor": "middle" },
      `${board.columns[y].heading} (${board.columns[y].better} is better)`));

    const sign = board.columns[y].better === "lower" ? -1 : 1;
    let best = -Infinity;
    let path = "";
    for (const point of points.filter((p) => p.entry.mark === null).sort((a, b) => a.x - b.x || sign * (b.y[0] - a.y[0]))) {
      if (sign * point.y[0] <= best) continue;
      best = sign * point.y[0];
      path += path ? `H${atX(point.x)}V${atY(point.y[0])}` : `M${atX(point.x)} ${atY(point.y[0])}`;
    }
    picture.append(svg("path", { class: "front", d: path }));

    const taken = points.map((p) => [atX(p.x) - 6, atY(p.y[0]) - 6, atX(p.x) + 6, atY(p.y[0]) + 6]);
    const bars = points.filter((p) => p.y[1] !== null)
      .map((p) => [atX(p.x) - 1, atY(Math.max(...p.y)), atX(p.x) + 1, atY(Math.min(...p.y))]);
    const free = (box, obstacles) => box[0] >= left && box[2] <= width && box[1] >= 0 && box[3] <= height - bottom &&
      obstacles.every((other) => box[2] < other[0] || box[0] > other[2] || box[3] < other[1] || box[1] > other[3]);
    for (const point of [...points].sort((a, b) => (b.index === chosen) - (a.index === chosen))) {
      const [px, py] = [atX(point.x), atY(point.y[0])];
      const own = point.index === chosen ? " is-chosen" : "";
      const mark = point.entry.mark === null ? "" : " is-mark";
      const text = `${point.entry.name}: ${board.columns[y].heading} ${point.entry.cells[y].text}${inBrackets(point.entry.cells[y].interval)}, ${point.entry.cells[x].text} ${board.columns[x].heading}`;
      const group = clickable(svg("g", { class: "dot" }), () => choose(point.index), text);
      if (point.y[1] !== null)
        group.append(svg("line", { class: `point bar${own}`, x1: px, x2: px, y1: atY(point.y[1]), y2: atY(point.y[2]) }));
      group.append(svg("circle", { class: `point${mark}${own}`, cx: px, cy: py, r: own ? 6 : 4.5 }));
      // A name that does not fit, or finds no free place, gives way to the rank.
      const most = Math.min(180, width / 3);
      const name = fitted(point.entry.name, most, Boolean(own));
      const labels = own || name === point.entry.name ? [name] : [];
      if (!own && point.entry.rank !== null) labels.push(`#${point.entry.rank}`);
      for (const label of labels) {
        const size = textWidth(label, Boolean(own));
        const places = [[9, 4], [9, -8], [9, 16], [-9 - size, 4], [-9 - size, -8], [-9 - size, 16], [-size / 2, -12], [-size / 2, 20]];
        const beside = (obstacles) => places.find(([dx, dy]) => free([px + dx, py + dy - 10, px + dx + size, py + dy + 2], obstacles));
        const place = beside([...taken, ...bars]) || (own && beside(taken));
        if (!place) continue;
        taken.push([px + place[0], py + place[1] - 10, px + place[0] + size, py + place[1] + 2]);
        group.append(svg("text", { class: own.trim(), x: px + place[0], y: py + place[1] }, label));
        if (label !== name && !caption.textContent.includes("#")) caption.append("; #: rank");
        break;
      }
      picture.append(group);
    }
    return picture;
  }

  function forest(board, metric, column, chosen, choose, space) {
    const items = [];
    for (const [i, j, value, low, high] of board.differences.find((each) => each.metric === metric).pairs) {
      if (j === chosen) items.push([i, value, low, high]);
      if (i === chosen) items.push([j, -value, high === null ? null : -high, low === null ? null : -low]);
    }
    items.sort((a, b) => a[0] - b[0]);
    const better = board.columns[column].better === "lower" ? -1 : 1;
    const width = space || 560;
    const [left, right, rowHeight] = [Math.min(190, width * 0.34), 96, 24];
    const height = items.length * rowHeight + 52;
    const picture = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "group", "aria-label": `Differences in ${board.columns[column].heading}` });
    if (!items.length) { picture.append(svg("text", { x: 10, y: 24 }, "No other entry has figures on the same episodes.")); return picture; }
    const ends = items.flatMap((item) => item.slice(1)).filter((value) => value !== null).concat(0);
    const pad = (Math.max(...ends) - Math.min(...ends)) * 0.05 || 1;
    const [low, high] = [Math.min(...ends) - pad, Math.max(...ends) + pad];
    const at = linear(low, high, left, width - right);
    const base = items.length * rowHeight + 8;
    for (const tick of ticksOf(low, high, 4))
      picture.append(svg("line", { class: "axis", x1: at(tick), x2: at(tick), y1: 4, y2: base }),
        svg("text", { class: "soft", x: at(tick), y: base + 15, "text-anchor": "middle" }, tickText(tick)));
    picture.append(svg("line", { class: "zero", x1: at(0), x2: at(0), y1: 4, y2: base }));
    items.forEach(([index, value, from, to], row) => {
      const y = row * rowHeight + 18;
      const clear = from !== null && (from > 0 || to < 0);
      const kind = !clear ? "level" : better * value > 0 ? "better" : "worse";
      const figure = (value > 0 ? "+" : "") + digits(value);
      const text = `${board.entries[index].name}: ${figure}${from === null ? "" : inBrackets(`${digits(from)}, ${digits(to)}`)}` +
        (clear ? `, ${kind} than ${board.entries[chosen].name}` : "");
      const group = clickable(svg("g", { class: "difference" }), () => choose(index), text);
      group.append(svg("rect", { x: 0, y: y - 14, width, height: rowHeight, fill: "transparent" }),
        svg("text", { x: left - 8, y: y + 4, "text-anchor": "end" }, fitted(board.entries[index].name, left - 12)));
      if (from !== null) group.append(svg("line", { class: `bar ${kind}`, x1: at(from), x2: at(to), y1: y, y2: y }));
      group.append(kind === "level"
        ? svg("circle", { class: kind, cx: at(value), cy: y, r: 4 })
        : svg("path", { class: kind, d: `M${at(value)} ${y - 6}L${at(value) + (value > 0 ? 7 : -7)} ${y}L${at(value)} ${y + 6}Z` }),
        svg("text", { x: width - 4, y: y + 4, "text-anchor": "end" }, `${figure}${kind === "level" ? "" : ` ${kind}`}`));
      picture.append(group);
    });
    picture.append(svg("text", { class: "soft", x: width / 2, y: height - 6, "text-anchor": "middle" },
      fitted(`${board.columns[column].heading} less that of ${board.entries[chosen].name}`, width - 10)));
    return picture;
  }

  function bands(board, part, chosen) {
    const values = part.cells.map((cell) => cell[2]);
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const table = el("table", null, el("thead", null, el("tr", null, el("th", { scope: "col" }, "entry"),
      part.bands.map((band) => el("th", { scope: "col" }, band)))));
    const body = el("tbody");
    const behind = (index, band) => (part.remarks.find((each) => each[0] === index && each[1] === band) || [])[2];
    board.entries.forEach((entry, index) => {
      const cells = part.cells.filter((cell) => cell[0] === index);
      if (!cells.length) return;
      const row = el("tr", { class: index === chosen ? "is-chosen" : entry.mark ? "mark" : null }, el("th", { scope: "row" }, entry.name));
      part.bands.forEach((_, band) => {
        const cell = cells.find((each) => each[1] === band);
        if (!cell) { row.append(el("td", null, "-")); return; }
        const share = high > low ? (cell[2] - low) / (high - low) : 0;
        const bad = part.better === "lower" ? share : 1 - share;
        const remark = behind(index, band);
        const td = el("td", null, digits(cell[2]), remark === undefined ? null : ` (${remark})`,
          cell[3] === null || cell[3] === cell[4] ? null : el("small", null, `${digits(cell[3])}, ${digits(cell[4])}`));
        td.style.background = `color-mix(in srgb, var(--missed) ${Math.round(45 * bad)}%, var(--paper))`;
        row.append(td);
      });
      body.append(row);
    });
    table.append(body);
    return table;
  }

  // Replay.
  const unpacked = (motion) => {
    const poses = [];
    let [x, y, yaw] = [0, 0, 0];
    for (let k = 0; k < motion.length; k += 3) {
      x += motion[k]; y += motion[k + 1]; yaw += motion[k + 2];
      poses.push([x, -y, -yaw / 100]);  // The picture's y points down.
    }
    return poses;
  };
  const unpackedBox = ([number, first, states, length, width, motion, label]) => {
    const poses = unpacked(motion);
    let next = 0;
    const frames = [...states].map((state) => (state === "." ? null : { state, pose: poses[next++] }));
    return { number, first, length, width, label, at: (frame) => frames[frame - first] || null };
  };
  const corners = ([x, y, yaw], length, width) => {
    const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
    return [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([a, b]) =>
      [x + (a * cos * length - b * sin * width) / 2, y + (a * sin * length + b * cos * width) / 2]);
  };
  const polygon = (points) => points.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");
  const LEGEND = {
    boxes: [["ego", "ego"], ["truth m", "object, tracked or detected"], ["truth x", "object that is missed"], ["answer m", "answer on an object"],
      ["answer f", "false alarm"], ["answer s", "identity switch"], ["answer d", "detection before tracking or fusion"], ["truth i", "object that does not count"], ["answer i", "answer that does not count"]],
    poses: [["ego", "true ego and its way"], ["estimate", "estimated ego and its way"], ["gap", "error"]],
  };
  LEGEND.image = LEGEND.boxes.slice(1);
  const TAIL = 12;
  const LEAST_PLAY_MS = 3000;

  function replay(section, board, chosenEntry) {
    const find = (selector) => section.querySelector(selector);
    const [list, viewer, none] = [find(".moments"), find(".viewer"), find(".replay .none")];
    const [slider, zoom, play, names] = [find(".frame"), find(".zoom"), find(".play"), find(".names")];
    let [moment, scene, timer, moved] = [null, null, null, [0, 0]];

    const stop = () => { clearInterval(timer); timer = null; play.textContent = "Play"; };
    const load = (chosenMoment) => {
      stop();
      moment = chosenMoment;
      const inImage = moment.size_px[0] > 0 && !moment.ego.length;
      scene = {
        inImage, beside: { inImage: true, objects: moment.image_objects.map(unpackedBox), answers: moment.image_answers.map(unpackedBox) },
        ego: inImage ? moment.times_s.map(() => [0, 0, 0]) : unpacked(moment.ego), estimate: unpacked(moment.estimate),
        objects: moment.objects.map(unpackedBox), answers: moment.answers.map(unpackedBox),
        lanes: moment.lanes.map(([width, flat]) => {
          let [x, y] = [0, 0];
          const points = [];
          for (let k = 0; k < flat.length; k += 2) { x += flat[k]; y += flat[k + 1]; points.push([x, -y]); }
          return { width, points: polygon(points) };
        }),
      };
      slider.max = moment.times_s.length - 1;
      slider.value = moment.event;
      zoom.value = 0;
      moved = [0, 0];
      find(".event").textContent = `${moment.times_s[moment.event].toFixed(1)} s: ${moment.text}`;
      find(".scene").setAttribute("aria-label", `${inImage ? "Image" : "Bird's-eye view"}; arrow keys move it`);
      const legend = scene.estimate.length ? LEGEND.poses : inImage ? LEGEND.image : LEGEND.boxes;
      const states = (...boxes) => boxes.flat().map((box) => box[2]).join("");
      const seen = { truth: states(moment.objects, moment.image_objects), answer: states(moment.answers, moment.image_answers) };
      const isSeen = ([kind]) => { const [what, state] = kind.split(" "); return seen[what] === undefined || !state || seen[what].includes(state); };
      find(".legend").replaceChildren(...legend.filter(isSeen)
        .map(([kind, text]) => el("li", null, svg("svg", { viewBox: "0 0 30 16", "aria-hidden": "true" },
          svg("rect", { class: `box ${kind}`, x: 2, y: 2, width: 26, height: 12 })), text)));
      if (moment.answers.some((box) => box[6].endsWith("camera alone")))
        find(".legend").append(el("li", null, "thin line: detected by the camera alone, which gives no distance"));
      list.querySelectorAll("button").forEach((button) => button.setAttribute("aria-pressed", button.moment === moment));
      draw();
    };

    const narrow = () => window.matchMedia("(max-width: 40rem)").matches;
    const draw = () => {
      if (!moment) return;
      const frame = Number(slider.value);
      const ego = scene.ego[frame];
      const wide = narrow() ? 4 / 3 : 16 / 9;
      const [x, y, length, width] = moment.focus;
      // A drift is seen on the whole drive, all else around the ego.
      const anchor = moment.kind === "drift" ? scene.ego[moment.event] : ego;
      const [cx, cy] = [anchor[0] + x + moved[0], anchor[1] - y + moved[1]];
      const height = Math.max(2 * width, 2 * length / wide, 20) * 1.12 ** -Number(zoom.value);
      const unit = (height * wide) / (find(".scene").clientWidth || 700);  // Decimetres in a pixel.
      const picture = svg("svg", { viewBox: `${cx - height * wide / 2} ${cy - height / 2} ${height * wide} ${height}`, role: "img",
        class: scene.inImage ? "in-image" : null, "aria-label": scene.inImage ? "Image" : "Bird's-eye view: the ego drives to the right" });
      const text = words(unit);
      if (scene.inImage) drawImage(picture, frame);
      for (const lane of scene.lanes) picture.append(svg("polyline", { class: "lane-edge", points: lane.points, "stroke-width": lane.width + 2 }));
      for (const lane of scene.lanes) picture.append(svg("polyline", { class: "lane", points: lane.points, "stroke-width": lane.width - 2 }));
      const far = height * wide;
      const step = [50, 100, 200, 500, 1000, 2000, 5000].find((metres) => metres > far / 8) || 10000;
      for (let reach = step; !scene.inImage && reach < 1.6 * far + Math.hypot(x, y); reach += step)
        picture.append(svg("circle", { class: "ring", cx: ego[0], cy: ego[1], r: reach }),
          ...[[reach, 0], [-reach, 0], [0, reach], [0, -reach]].map(([dx, dy]) => text(ego[0] + dx, ego[1] + dy, `${reach / 10} m`, "soft")));
      picture.unit = unit;
      if (scene.estimate.length) drawPoses(picture, frame, unit, text);
      else drawBoxes(picture, scene, frame, unit, text);
      find(".scene").replaceChildren(picture);
      drawBeside(frame);
      find(".strip").replaceChildren(strip(frame));
      slider.setAttribute("aria-valuetext", `${moment.times_s[frame].toFixed(2)} seconds`);
      find(".state").textContent = stateText(frame);
    };

    // The camera's image of a moment that is seen from above.
    const drawBeside = (frame) => {
      const beside = find(".beside");
      beside.hidden = scene.inImage || !moment.size_px[0];
      if (beside.hidden) { beside.replaceChildren(); return; }
      const [x, y, length, width] = moment.image_focus;
      const wide = narrow() ? 4 / 3 : 16 / 9;
      const height = Math.max(2 * width, 2 * length / wide) * 1.12 ** -Number(zoom.value);
      const [left, top] = [[x, height * wide], [-y, height]].map(([middle, view], axis) =>
        Math.max(Math.min(middle - view / 2, 10 * moment.size_px[axis] - view), 0));
      const picture = svg("svg", { viewBox: `${left} ${top} ${height * wide} ${height}`, role: "img",
        class: "in-image", "aria-label": "Image of the camera" });
      const unit = (height * wide) / (beside.clientWidth || 700);
      drawImage(picture, frame);
      drawBoxes(picture, scene.beside, frame, unit, words(unit));
      beside.replaceChildren(picture);
    };
    const words = (unit) => (x, y, words, own) =>
      svg("text", { x, y, "font-size": 12 * unit, style: `font-size:${12 * unit}px;stroke-width:3px`, class: own || null }, words);
    const drawImage = (picture, frame) => {
      const [width, height] = moment.size_px.map((pixels) => 10 * pixels);
      const file = moment.images[frame];
      picture.append(svg("rect", { class: "plane", width, height }));
      if (file) picture.append(svg("image", { href: `data:image/jpeg;base64,${file}`, width, height, preserveAspectRatio: "none" }));
    };
    const car = (view, pose, length, width, kind) => {
      const group = svg("g");
      const [a, b, c, d] = corners(pose, length, width);
      const middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
      group.append(svg("polygon", { class: `box ${kind}`, points: polygon([a, b, c, d]) }));
      if (!view.inImage) group.append(svg("line", { class: `box ${kind}`, x1: pose[0], y1: pose[1], x2: middle[0], y2: middle[1] }));
      return group;
    };
    const egoMarker = (pose, kind) => {
      const [x, y, yaw] = pose;
      const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
      // The reference point is the rear axle.
      const points = [[38, 0], [26, 9], [-9, 9], [-9, -9], [26, -9]].map(([a, b]) => [x + a * cos - b * sin, y + a * sin + b * cos]);
      return svg("polygon", { class: kind, points: polygon(points) });
    };

    // A box in an image has its label beside its right top corner.
    const labelPlace = (view, box, [x, y]) => (view.inImage ? [x + box.length / 2, y - box.width / 2] : [x, y]);

    const drawBoxes = (picture, view, frame, unit, text) => {
      const labels = [];
      for (const box of view.answers) {
        const now = box.at(frame);
        if (!now || box.number < 0) continue;
        const past = [];
        for (let t = Math.max(0, frame - TAIL); t <= frame; t++) { const then = box.at(t); if (then) past.push(then.pose); }
        picture.append(svg("polyline", { class: `tail ${now.state}`, points: polygon(past) }));
      }
      for (const box of view.objects) {
        const now = box.at(frame);
        if (!now) continue;
        const group = car(view, now.pose, box.length, box.width, `truth ${now.state}`);
        const name = [box.label || "object", box.number < 0 ? "" : box.number].join(" ").trim();
        group.append(title(name));
        if (now.state === "x") {
          const [a, b, c, d] = corners(now.pose, box.length, box.width);
          for (const [p, q] of [[a, c], [b, d]]) group.append(svg("line", { class: "cross", x1: p[0], y1: p[1], x2: q[0], y2: q[1] }));
          labels.push([0, labelPlace(view, box, now.pose), name]);
        }
        picture.append(group);
      }
      for (const box of view.answers) {
        const now = box.at(frame);
        if (!now) continue;
        const group = car(view, now.pose, box.length, box.width, `answer ${now.state}`);
        if (box.number >= 0 || box.label) group.append(title(box.number >= 0 ? `track ${box.number}` : box.label));
        if (now.state === "s") group.append(svg("circle", { class: "halo", cx: now.pose[0], cy: now.pose[1], r: box.length * 0.6 + 6 * unit }));
        picture.append(group);
        if (box.number >= 0 && now.state !== "i") labels.push(["sfm".indexOf(now.state), now.pose, String(box.number)]);
        if (box.number < 0 && now.state === "f" && box.label) labels.push([1, labelPlace(view, box, now.pose), box.label]);
      }
      if (!view.inImage) picture.append(egoMarker(scene.ego[frame], "ego"));
      if (names.checked) placeLabels(picture, labels, unit, text);
    };
    // The most important first; those without room are left out.
    const placeLabels = (picture, labels, unit, text) => {
      const taken = [];
      for (const [, [x, y], words] of labels.sort((a, b) => a[0] - b[0])) {
        const size = textWidth(words) * unit;
        const corner = [[8, -8], [8, 16], [-8, -8], [-8, 16]].map(([dx, dy]) => [x + dx * unit - (dx < 0 ? size : 0), y + dy * unit])
          .find(([left, base]) => taken.every(([a, b, width]) =>
            left + size < a || left > a + width || Math.abs(base - b) > 13 * unit));
        if (!corner) continue;
        taken.push([...corner, size]);
        picture.append(text(...corner, words));
      }
    };
    const drawPoses = (picture, frame, unit, text) => {
      picture.append(svg("polyline", { class: "ego-line", points: polygon(scene.ego) }),
        svg("polyline", { class: "estimate-line", points: polygon(scene.estimate.slice(0, frame + 1)) }),
        svg("line", { class: "gap", x1: scene.ego[frame][0], y1: scene.ego[frame][1], x2: scene.estimate[frame][0], y2: scene.estimate[frame][1] }),
        egoMarker(scene.ego[frame], "ego"), egoMarker(scene.estimate[frame], "box estimate"));
      if (names.checked) picture.append(text(scene.estimate[frame][0] + 10 * unit, scene.estimate[frame][1] - 10 * unit, `${(moment.errors[frame] / 100).toFixed(2)} m off`));
    };

    const countsAt = (frame) => {
      const count = (boxes, letters) => boxes.filter((box) => { const now = box.at(frame); return now && letters.includes(now.state); }).length;
      return { right: count(scene.objects, "ms"), x: count(scene.objects, "x"), f: count(scene.answers, "f"), s: count(scene.answers, "s"), d: count(scene.answers, "d") };
    };
    const stateText = (frame) => {
      const time = `${moment.times_s[frame].toFixed(2)} s: `;
      if (scene.estimate.length) return `${time}${(moment.errors[frame] / 100).toFixed(2)} m off`;
      const { right, x, f, s, d } = countsAt(frame);
      const counted = (count, noun, more = "s") => `${count} ${noun}${count === 1 ? "" : more}`;
      return time + [`${counted(right, "object")} found`, `${x} missed`, counted(f, "false alarm"),
        s ? counted(s, "identity switch", "es") : "", d ? `${counted(d, "detection")} before tracking or fusion` : "",
        moment.size_px[0] && !moment.images[frame] ? "no image" : ""].filter(Boolean).join(", ");
    };
    const strip = (frame) => {
      const frames = moment.times_s.length;
      const [width, height, left] = [find(".strip").clientWidth || 700, 74, 148];
      const bar = Math.max((width - left) / frames - 1.5, 1.5);
      const [from, to] = [left + 8 + bar / 2, width - 10 - bar / 2];
      const at = linear(0, Math.max(frames - 1, 1), from, to);
      const picture = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": "What goes wrong over time" });
      if (scene.estimate.length) {
        const most = Math.max(...moment.errors, 1);
        picture.append(svg("text", { class: "soft", x: left - 8, y: 20, "text-anchor": "end" }, `${(most / 100).toFixed(1)} m off`),
          svg("polyline", { points: moment.errors.map((error, k) => `${at(k)},${54 - 44 * error / most}`).join(" ") }));
      } else {
        const lines = [["x", "missed"], ["f", "false alarms"], ["s", "switches"]].filter(([kind]) => kind !== "s" || moment.answers.some((box) => box[0] >= 0));
        const counts = moment.times_s.map((_, k) => countsAt(k));
        lines.forEach(([kind, name], row) => {
          const most = Math.max(...counts.map((count) => count[kind]));
          picture.append(svg("text", { class: "soft", x: left - 8, y: row * 18 + 14, "text-anchor": "end" }, `${name}, ${most ? `up to ${most}` : "none"}`));
          counts.forEach((count, k) => {
            const tall = most ? 15 * count[kind] / most : 0;
            if (tall) picture.append(svg("rect", { class: kind, x: at(k) - bar / 2, y: row * 18 + 17 - tall, width: bar, height: tall }));
          });
        });
      }
      picture.append(svg("line", { class: "cursor", x1: at(frame), x2: at(frame), y1: 0, y2: 56 }));
      const marks = [...new Set([0, moment.event, frames - 1])].filter((k) => k === moment.event || Math.abs(at(k) - at(moment.event)) > 50);
      for (const k of marks) picture.append(svg("text", { class: "soft", x: at(k), y: 70, "text-anchor": k === frames - 1 ? "end" : k ? "middle" : "start" }, `${moment.times_s[k].toFixed(1)} s`));
      picture.addEventListener("click", (event) => {
        const box = picture.getBoundingClientRect();
        const share = ((event.clientX - box.left) / box.width * width - from) / (to - from);
        slider.value = Math.round(share * (frames - 1));
        draw();
      });
      return picture;
    };

    slider.addEventListener("input", () => { stop(); draw(); });
    zoom.addEventListener("input", draw);
    // The picture is moved by dragging, and by the arrow keys.
    const shift = (dx, dy) => {
      const { unit } = find(".scene svg");
      moved = [moved[0] - dx * unit, moved[1] - dy * unit];
      draw();
    };
    const area = find(".scene");
    let held = null;
    area.addEventListener("pointerdown", (event) => { held = [event.clientX, event.clientY]; area.setPointerCapture(event.pointerId); });
    area.addEventListener("pointermove", (event) => {
      if (!held || !moment) return;
      shift(event.clientX - held[0], event.clientY - held[1]);
      held = [event.clientX, event.clientY];
    });
    for (const end of ["pointerup", "pointercancel"]) area.addEventListener(end, () => { held = null; });
    area.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40] }[event.key];
      if (!way || !moment) return;
      event.preventDefault();
      shift(...way);
    });
    names.addEventListener("change", draw);
    play.addEventListener("click", () => {
      if (timer) { stop(); return; }
      play.textContent = "Pause";
      if (Number(slider.value) >= Number(slider.max)) slider.value = 0;
      timer = setInterval(() => {
        if (Number(slider.value) >= Number(slider.max)) { stop(); return; }
        slider.value = Number(slider.value) + 1;
        draw();
      }, Math.max(120, LEAST_PLAY_MS / moment.times_s.length));
    });
    let shownEntry = null;
    return () => {
      const { name: entry, left_out: leftOut } = board.entries[chosenEntry()];
      if (entry === shownEntry) { draw(); return; }
      shownEntry = entry;
      const own = board.moments.filter((each) => each.entry === entry);
      const kinds = [...new Set(own.map((each) => each.kind))];
      own.sort((a, b) => kinds.indexOf(a.kind) - kinds.indexOf(b.kind));
      viewer.hidden = !own.length;
      none.hidden = own.length + leftOut > 0;
      const { mark, failure } = board.entries[chosenEntry()];
      none.textContent = `No moment of this entry is shown: ${failure ? `${failure}, see Failures below, and nothing else went wrong, or its answers are not kept`
        : mark === null ? "nothing went wrong, or its answers are not kept" : "it is a mark"}.`;
      find(".left-out").textContent = leftOut
        ? `${leftOut} ${own.length ? "more " : ""}moment${leftOut > 1 ? "s" : ""} of this entry ${leftOut > 1 ? "are" : "is"} left out, as the page would be too large.` : "";
      list.replaceChildren(...own.map((each) => {
        const place = [each.scenario, `seed ${each.seed}`, each.condition === "clear" ? "" : each.condition, each.inputs && !each.entry.endsWith(` on ${each.inputs}`) ? `detections of ${each.inputs}` : ""];
        const button = el("button", { type: "button", "aria-pressed": "false" }, `${each.kind}, ${each.times_s[each.event].toFixed(1)} s`,
          el("small", null, place.filter(Boolean).join(", ")));
        button.moment = each;
        button.addEventListener("click", () => load(each));
        return button;
      }));
      if (own.length) load(own[0]);
      else { stop(); moment = null; }
    };
  }

  // Boards, one at a time; light and dark.
  const sections = [...document.querySelectorAll("section.board")];
  const links = [...document.querySelectorAll("#boards a")];
  const panels = sections.map(panel);
  const show = () => {
    const wanted = Math.max(sections.findIndex((section) => `#${section.id}` === location.hash), 0);
    sections.forEach((section, k) => { section.hidden = k !== wanted; });
    links.forEach((link, k) => (k === wanted ? link.setAttribute("aria-current", "page") : link.removeAttribute("aria-current")));
    panels[wanted].redraw();
  };
  window.addEventListener("hashchange", show);
  window.addEventListener("resize", show);
  show();
  const theme = document.getElementById("theme");
  theme.hidden = false;
  theme.addEventListener("click", () => {
    const dark = root.dataset.theme ? root.dataset.theme === "dark" : window.matchMedia("(prefers-color-scheme: dark)").matches;
    root.dataset.theme = dark ? "light" : "dark";
  });
})();
