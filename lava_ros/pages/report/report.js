'use strict';

(() => {
  const byId = (id) => document.getElementById(id);
  const data = JSON.parse(byId('data').textContent);
  const slider = byId('time');
  const play = byId('play');
  const map = byId('map');
  const size = data.rows * data.columns;
  const cells = {};      // name -> bytes of all frames; arrival: 16 bits a cell
  let layer = null;
  let pointed = null;    // the cell under the pointer
  let timer = 0;
  let relief = null;

  const inflate = async (text) => {
    const packed = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  };

  const unpack = async () => {
    for (const item of data.layers) {
      const bytes = await inflate(item.cells);
      if (bytes.length !== size * data.times.length) throw new Error(`${item.name} is incomplete`);
      for (let i = size; i < bytes.length; i += 1) bytes[i] ^= bytes[i - size];
      cells[item.name] = bytes;
    }
    if (data.arrival) {
      const bytes = await inflate(data.arrival.cells);
      if (bytes.length !== 2 * size) throw new Error('arrival is incomplete');
      cells.arrival = new Uint16Array(size);
      for (let i = 0; i < size; i += 1) cells.arrival[i] = bytes[2 * i] + 256 * bytes[2 * i + 1];
    }
  };

  const loadRelief = () => new Promise((resolve, reject) => {
    const image = new Image();
    image.onload = () => resolve(image);
    image.onerror = () => reject(new Error('the relief cannot be read'));
    image.src = data.relief;
  });

  const duration = (seconds) => {
    if (seconds < 120) return `${Math.round(seconds)} s`;
    const minutes = Math.round(seconds / 60);
    if (minutes < 120) return `${minutes} min`;
    if (minutes < 2880) {
      const rest = minutes % 60;
      return `${Math.floor(minutes / 60)} h${rest ? ` ${String(rest).padStart(2, '0')} min` : ''}`;
    }
    const hours = Math.round(seconds / 3600);
    return `${Math.floor(hours / 24)} d ${hours % 24} h`;
  };

  // The date of a simulated time, UTC.
  const date = (seconds) => {
    const text = new Date(1000 * (data.onset + seconds)).toISOString();
    return `${text.slice(0, 10)} ${text.slice(11, 16)} UTC`;
  };

  const rgb = (text) => [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16));

  const ramp = (stops) => {
    const colours = stops.map(rgb);
    return (fraction) => {
      const at = Math.min(Math.max(fraction, 0), 1) * (colours.length - 1);
      const low = Math.min(Math.floor(at), colours.length - 2);
      return colours[low].map((value, i) => value + (at - low) * (colours[low + 1][i] - value));
    };
  };

  const views = {};      // name -> view of a layer
  const makeViews = () => {
    for (const item of data.layers) {
      const value = (code) => item.low + code * item.step;
      if (item.classes.length) {
        const colours = item.colours.map(rgb);
        // number of the class, from 0
        const place = (code) => item.classes.findIndex(([end]) => value(code) <= end + 0.5);
        views[item.name] = {
          title: item.title,
          classes: item.classes.map(([, name], number) => [name, colours[number]]),
          colour: (number) => colours[number],
          fraction: place,
          describe: (code) => (code ? `${item.name} ${Math.round(value(code))}, ${item.classes[place(code)][1]}` : ''),
        };
        continue;
      }
      const low = item.name === 'temperature' ? item.low : 0;
      const high = Math.max(item.most, item.step);
      views[item.name] = {
        title: item.title,
        low: `${Math.round(low)} ${item.unit}`,
        high: `${Number(high.toPrecision(3))} ${item.unit}${item.saturated ? ' or more' : ''}`,
        colour: ramp(item.colours),
        fraction: (code) => (value(code) - low) / (high - low),
        describe: (code) => (code ? `${item.name} ${Number(value(code).toPrecision(3))} ${item.unit}`.trim() : ''),
      };
    }
    if (data.arrival) {
      const time = (code) => data.arrival.start + (code - 1) * data.arrival.step;
      views.arrival = {
        title: data.arrival.title,
        low: duration(data.start),
        high: duration(data.end),
        colour: ramp(data.arrival.colours),
        fraction: (code) => (time(code) - data.start) / Math.max(data.end - data.start, 1),
        time,
        describe: (code) => (code ? `lava arrived by ${duration(time(code))}` : ''),
      };
    }
  };

  const frame = () => Number(slider.value);

  const codeAt = (name, cell) => {
    if (name !== 'arrival') return cells[name][frame() * size + cell];
    const code = cells.arrival[cell];
    // Later arrivals are not shown.
    return code && views.arrival.time(code) <= data.times[frame()] + data.arrival.step ? code : 0;
  };

  const drawVents = (context, scale) => {
    const side = (map.width / 90) * Math.max(1, 640 / (map.clientWidth || 640));
    for (const [x, y] of data.vents) {
      const left = ((x - data.west) / data.cell) * scale;
      const top = (data.rows - (y - data.south) / data.cell) * scale;
      context.beginPath();
      context.moveTo(left, top - side);
      context.lineTo(left + 0.85 * side, top + 0.6 * side);
      context.lineTo(left - 0.85 * side, top + 0.6 * side);
      context.closePath();
      context.fillStyle = '#fff';
      context.strokeStyle = '#000';
      context.lineWidth = Math.max(1, side / 6);
      context.fill();
      context.stroke();
    }
  };

  const drawBarriers = (context, scale) => {
    const width = (map.width / 300) * Math.max(1, 640 / (map.clientWidth || 640));
    context.lineJoin = 'round';
    for (const crest of data.barriers) {
      context.beginPath();
      for (const [x, y] of crest) {
        const left = ((x - data.west) / data.cell) * scale;
        context.lineTo(left, (data.rows - (y - data.south) / data.cell) * scale);
      }
      for (const [factor, colour] of [[2, '#fff'], [1, '#3d2b1f']]) {
        context.lineWidth = factor * width;
        context.strokeStyle = colour;
        context.stroke();
      }
    }
  };

  const drawScaleBar = (context, scale) => {
    const least = (0.15 * data.columns * data.cell);
    const power = 10 ** Math.floor(Math.log10(least));
    const metres = [1, 2, 5, 10].map((step) => step * power).find((step) => step >= least);
    const length = (metres / data.cell) * scale;
    const text = metres >= 1000 ? `${metres / 1000} km` : `${metres} m`;
    const unit = (map.width / 60) * Math.max(1, 640 / (map.clientWidth || 640));
    const [left, bottom] = [unit, map.height - unit];
    context.font = `600 ${Math.round(1.5 * unit)}px system-ui, sans-serif`;
    context.lineJoin = 'round';
    for (const [width, colour] of [[0.9 * unit, '#fff'], [0.35 * unit, '#222']]) {
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.beginPath();
      context.moveTo(left, bottom);
      context.lineTo(left + length, bottom);
      context.stroke();
    }
    context.lineWidth = 0.4 * unit;
    context.strokeStyle = '#fff';
    context.fillStyle = '#222';
    context.textAlign = 'left';
    context.strokeText(text, left, bottom - unit);
    context.fillText(text, left, bottom - unit);
    const [x, y] = [map.width - 2 * unit, unit];
    context.textAlign = 'center';
    context.strokeText('N', x, y + 4 * unit);
    context.fillText('N', x, y + 4 * unit);
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x + 0.8 * unit, y + 2.2 * unit);
    context.lineTo(x - 0.8 * unit, y + 2.2 * unit);
    context.closePath();
    context.stroke();
    context.fill();
  };

  const lava = document.createElement('canvas');

  const draw = () => {
    const view = views[layer];
    const context = map.getContext('2d');
    const scale = map.width / data.columns;
    const pixels = lava.getContext('2d').createImageData(data.columns, data.rows);
    for (let cell = 0; cell < size; cell += 1) {
      const code = codeAt(layer, cell);
      if (code) {
        const colour = view.colour(view.fraction(code));
        // Row 0 is the southernmost.
        const row = data.rows - 1 - Math.floor(cell / data.columns);
        const at = 4 * (row * data.columns + (cell % data.columns));
        for (let i = 0; i < 3; i += 1) pixels.data[at + i] = colour[i];
        pixels.data[at + 3] = 235;
      }
    }
    lava.getContext('2d').putImageData(pixels, 0, 0);
    context.imageSmoothingEnabled = true;
    context.imageSmoothingQuality = 'high';
    context.drawImage(relief, 0, 0, map.width, map.height);
    context.imageSmoothingEnabled = false;
    context.drawImage(lava, 0, 0, map.width, map.height);
    drawBarriers(context, scale);
    drawVents(context, scale);
    drawScaleBar(context, scale);
    const time = data.times[frame()];
    const area = data.areas[frame()] / 1e6;
    map.setAttribute(
      'aria-label',
      `${view.title} after ${duration(time)}: ${area.toPrecision(2)} square kilometres of standing lava`,
    );
  };

  const textOf = (words) => {
    const span = document.createElement('span');
    span.textContent = words;
    return span;
  };

  const barOf = (colours, label) => {
    const bar = document.createElement('canvas');
    bar.width = colours.length;
    bar.height = 1;
    bar.setAttribute('role', 'img');
    bar.setAttribute('aria-label', label);
    const context = bar.getContext('2d');
    colours.forEach((colour, i) => {
      context.fillStyle = `rgb(${colour.map(Math.round).join(',')})`;
      context.fillRect(i, 0, 1, 1);
    });
    return bar;
  };

  const drawLegend = () => {
    const view = views[layer];
    byId('legend').classList.toggle('classes', Boolean(view.classes));
    if (view.classes) {
      const items = view.classes.flatMap(([name, colour]) => [
        barOf([colour], `colour of ${name}`), textOf(name),
      ]);
      byId('legend').replaceChildren(textOf(`${view.title}:`), ...items);
      return;
    }
    const colours = Array.from({ length: 256 }, (_, i) => view.colour(i / 255));
    byId('legend').replaceChildren(
      textOf(`${view.title} ${view.low}`),
      barOf(colours, `colours of ${view.title}, from ${view.low} to ${view.high}`),
      textOf(view.high),
    );
  };

  const valueAt = (curve, time) => {
    let found = null;
    for (let i = 0; i < curve.times.length && curve.times[i] <= time + 0.05; i += 1) found = curve.values[i];
    return found;
  };

  const moveCursors = () => {
    const time = data.times[frame()];
    const fraction = (time - data.start) / Math.max(data.end - data.start, 1e-9);
    for (const line of document.querySelectorAll('.cursor')) {
      const box = line.ownerSVGElement.viewBox.baseVal;
      const first = line.ownerSVGElement.querySelector('.grid');
      const [left, right] = [first.x1.baseVal.value, first.x2.baseVal.value];
      const x = Math.min(left + fraction * (right - left), box.width);
      line.setAttribute('x1', x);
      line.setAttribute('x2', x);
    }
    for (const output of document.querySelectorAll('output[data-curve]')) {
      const chart = data.charts.find((item) => item.key === output.dataset.curve);
      const value = valueAt(chart.curves[Number(output.dataset.index)], time);
      output.textContent = value === null ? 'none' : `${Number(value.toPrecision(4))} ${chart.unit}`;
    }
  };

  const readCell = () => {
    if (pointed === null) {
      byId('readout').textContent = '';
      return;
    }
    const [row, column] = pointed;
    const x = data.west + (column + 0.5) * data.cell + data.offset[0];
    const y = data.south + (row + 0.5) * data.cell + data.offset[1];
    const cell = row * data.columns + column;
    const lines = Object.keys(views).map((name) => views[name].describe(codeAt(name, cell))).filter(Boolean);
    const place = data.epsg
      ? `E ${Math.round(x)}, N ${Math.round(y)} (EPSG:${data.epsg})`
      : `x ${Math.round(x)} m, y ${Math.round(y)} m`;
    byId('readout').textContent = `${place}: ${lines.length ? lines.join(', ') : 'no lava'}`;
  };

  const show = () => {
    const time = data.times[frame()];
    const text = duration(time) + (data.onset === null ? '' : `, ${date(time)}`);
    byId('clock').textContent = text;
    slider.setAttribute('aria-valuetext', text);
    draw();
    moveCursors();
    readCell();
  };

  const choose = (name) => {
    layer = name;
    for (const input of document.querySelectorAll('input[name=layer]')) input.checked = input.value === name;
    drawLegend();
    show();
  };

  const stop = () => {
    clearInterval(timer);
    timer = 0;
    play.textContent = 'Play';
    play.setAttribute('aria-pressed', 'false');
  };

  const go = (to) => {
    slider.value = String(to);
    show();
  };

  const toggle = () => {
    if (timer) {
      stop();
      return;
    }
    const last = data.times.length - 1;
    if (last === 0) return;
    if (frame() >= last) go(0);
    play.textContent = 'Pause';
    play.setAttribute('aria-pressed', 'true');
    // The whole run in ten seconds, at any interval between its frames.
    const started = performance.now();
    const from = data.times[frame()];
    const rate = (data.end - data.start) / 10000;
    timer = setInterval(() => {
      const time = from + rate * (performance.now() - started);
      let next = frame();
      while (next < last && data.times[next + 1] <= time) next += 1;
      if (next !== frame()) go(next);
      if (next >= last) stop();
    }, 40);
  };

  const onKey = (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const target = event.target;
    const isControl = ['BUTTON', 'SUMMARY', 'A'].includes(target.tagName);
    const isRadio = target.name === 'layer';
    const last = data.times.length - 1;
    const names = Object.keys(views);
    if (event.key === ' ' && !isControl) toggle();
    else if (event.key === 'ArrowRight' && !isRadio) { stop(); go(Math.min(frame() + 1, last)); }
    else if (event.key === 'ArrowLeft' && !isRadio) { stop(); go(Math.max(frame() - 1, 0)); }
    else if (event.key === 'Home' && target === slider) { stop(); go(0); }
    else if (event.key === 'End' && target === slider) { stop(); go(last); }
    else if (/^[1-9]$/.test(event.key) && names[event.key - 1]) choose(names[event.key - 1]);
    else return;
    event.preventDefault();
  };

  const onPoint = (event) => {
    const box = map.getBoundingClientRect();
    const column = Math.floor(((event.clientX - box.left) / box.width) * data.columns);
    const row = data.rows - 1 - Math.floor(((event.clientY - box.top) / box.height) * data.rows);
    const inside = column >= 0 && column < data.columns && row >= 0 && row < data.rows;
    pointed = inside ? [row, column] : null;
    readCell();
  };

  const start = async () => {
    relief = await loadRelief();
    await unpack();
    makeViews();
    lava.width = data.columns;
    lava.height = data.rows;
    const scale = Math.max(1, Math.round(1200 / data.columns));
    map.width = data.columns * scale;
    map.height = data.rows * scale;
    slider.addEventListener('input', () => { stop(); show(); });
    play.addEventListener('click', toggle);
    document.addEventListener('keydown', onKey);
    // Markers and words keep their size on the screen.
    window.addEventListener('resize', draw);
    map.addEventListener('pointermove', onPoint);
    map.addEventListener('pointerdown', onPoint);
    for (const input of document.querySelectorAll('input[name=layer]')) {
      input.addEventListener('change', () => choose(input.value));
    }
    choose(Object.keys(views)[0]);
    document.documentElement.dataset.ready = 'true';
  };

  start().catch((error) => {
    byId('failed').textContent = `The map cannot be shown (${error.message}). A newer browser may help.`;
    byId('failed').hidden = false;
    console.error(error);
  });
})();
