// SPDX-License-Identifier: Apache-2.0
// Draws the chosen outcome against every parameter that varied.
const columns = JSON.parse(document.getElementById('columns').textContent);
const pick = document.getElementById('figure');
function draw() {
  for (const [i, x] of columns.varied.entries()) {
    const y = columns.figures[pick.value];
    const traces = [[true, 'kept', '#2E8B57'], [false, 'left', '#D62728']].map(([kept, name, colour]) => {
      const at = columns.kept.flatMap((value, k) => value === kept ? [k] : []);
      return {type: 'scatter', mode: 'markers', name: name, marker: {color: colour, size: 5,
              opacity: 0.6}, x: at.map(k => x.values[k]), y: at.map(k => y.values[k]),
              text: at.map(k => 'run ' + columns.run[k])};
    });
    traces.push({type: 'bar', name: 'share kept', yaxis: 'y2', x: x.centres, y: x.shares,
                 width: x.widths, marker: {color: 'rgba(46, 139, 87, 0.18)'}, hoverinfo: 'y',
                 error_y: {type: 'data', array: x.above, arrayminus: x.below, thickness: 1,
                           color: 'rgba(46, 139, 87, 0.6)'}});
    Plotly.react('plot' + i, traces, {height: 320, margin: {t: 10, r: 50, b: 45, l: 65},
      xaxis: {title: {text: x.name}, ...(x.ticks && {tickvals: x.ticks.at, ticktext: x.ticks.text})}, yaxis: {title: {text: y.label}, type: y.log ? 'log' : 'linear'},
      yaxis2: {overlaying: 'y', side: 'right', range: [0, 1.05], tickmode: 'linear', dtick: 0.25, title: {text: 'share kept'},
               showgrid: false}, legend: {orientation: 'h', y: 1.12}},
      {displaylogo: false, responsive: true});
  }
}
pick.addEventListener('change', draw);
draw();
