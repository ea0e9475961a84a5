'use strict';
(function () {
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  const plots = read('plots');
  const frames = read('frames');
  const timed = [];  // plots over the time of the run: zoomed together, with a cursor
  const config = {responsive: true, displaylogo: false,
                  modeBarButtonsToRemove: ['select2d', 'lasso2d', 'autoScale2d'],
                  toImageButtonOptions: {format: 'svg'}};

  // A relayout that we cause must not be passed on again.
  let echo = false;
  function follow(source, change) {
    if (echo) return;
    const reset = change['xaxis.autorange'];
    const range = change['xaxis.range[0]'] !== undefined
      ? [change['xaxis.range[0]'], change['xaxis.range[1]']] : null;
    if (!reset && !range) return;
    echo = true;
    Promise.all(timed.filter((plot) => plot !== source).map((plot) => Plotly.relayout(
      plot, reset ? {'xaxis.autorange': true} : {'xaxis.range': range.slice()}))
    ).finally(() => { echo = false; });
  }

  const slider = document.getElementById('time');
  const clock = document.getElementById('clock');
  const button = document.getElementById('play');
  const arm = document.getElementById('arm');

  function show(index) {
    clock.textContent = frames.t[index].toFixed(2) + ' s';
    const change = {};
    for (const [k, axis] of frames.axes.entries()) {
      change[axis] = frames.traces.map((trace) => trace[index][k]);
    }
    return Plotly.restyle(arm, change, frames.traces.map((_, i) => i));
  }

  function cursor() {
    const t = frames.t[Number(slider.value)];
    for (const plot of timed) {
      const last = 'shapes[' + (plot.layout.shapes.length - 1) + ']';
      Plotly.relayout(plot, {[last + '.x0']: t, [last + '.x1']: t, [last + '.opacity']: 0.8});
    }
  }

  let playing = null;
  function stop() {
    playing = null;
    button.textContent = '▶ play';
    cursor();
  }
  function play() {
    if (playing) { stop(); return; }
    button.textContent = '❚❚ pause';
    const last = frames.t.length - 1;
    if (Number(slider.value) >= last) slider.value = 0;
    // Short runs in real time, long ones within 20 s.
    const speed = Math.max(1, (frames.t[last] - frames.t[0]) / 20);
    const run = playing = {from: frames.t[Number(slider.value)], began: performance.now()};
    const step = () => {
      if (playing !== run) return;
      const t = run.from + speed * (performance.now() - run.began) / 1000;
      let index = Number(slider.value);
      while (index < last && frames.t[index + 1] <= t) index += 1;
      if (index !== Number(slider.value)) {
        slider.value = index;
        show(index);
      }
      if (index >= last) stop(); else setTimeout(step, 30);
    };
    setTimeout(step, 30);
  }

  function jump(t) {
    let index = 0;
    while (index < frames.t.length - 1 && frames.t[index + 1] <= t) index += 1;
    slider.value = index;
    show(index);
    cursor();
  }

  const drawn = plots.map((plot) => {
    const place = document.getElementById(plot.id);
    const options = Object.assign({}, config, {
      toImageButtonOptions: {format: 'svg', filename: plot.id}});
    return Plotly.newPlot(place, plot.data, plot.layout, options).then(() => {
      if (!plot.time) return;
      timed.push(place);
      place.on('plotly_relayout', (change) => follow(place, change));
      if (frames) place.on('plotly_click', (event) => jump(event.points[0].x));
    });
  });

  if (frames) {
    slider.addEventListener('input', () => { playing = null; show(Number(slider.value)); });
    slider.addEventListener('change', stop);
    button.addEventListener('click', play);
  }

  for (const zoom of document.querySelectorAll('.zoom')) {
    let close = 0;
    zoom.addEventListener('click', () => {
      close = 1 - close;
      zoom.textContent = close ? 'show the whole set' : 'zoom to the errors';
      for (const plot of plots) {
        if (plot.section === zoom.dataset.section && plot.zoom) {
          Plotly.relayout(plot.id, {'yaxis.range': plot.zoom[close].slice()});
        }
      }
    });
  }

  for (const chip of document.querySelectorAll('.bags button')) {
    chip.addEventListener('click', () => {
      const off = chip.classList.toggle('off');
      for (const plot of plots) {
        const place = document.getElementById(plot.id);
        const which = [];
        place.data.forEach((trace, i) => {
          if (trace.meta && String(trace.meta.bag) === chip.dataset.bag) which.push(i);
        });
        if (which.length) Plotly.restyle(place, {visible: !off}, which);
      }
    });
  }

  Promise.all(drawn).then(() => { document.body.dataset.drawn = String(plots.length); });
})();
