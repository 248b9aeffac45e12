// SPDX-License-Identifier: Apache-2.0
// A dot plot: one dot for every run and one row for each config, which shows the distance between
// configs beside the spread over seeds.
import {COLORS} from '../shared/charts.js';
import {el, svg} from '../shared/dom.js';
import {fixed} from '../shared/format.js';

const ROW = 30,
  FOOT = 26; // px

// About `wanted` round numbers between low and high.
function ticksOf(low, high, wanted = 5) {
  const rough = (high - low) / wanted,
    power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map(factor => factor * power).find(each => each >= rough);
  const ticks = [];
  for (let i = Math.ceil(low / step); i * step <= high; ++i) ticks.push(i * step);
  return ticks;
}

function meanAndDeviation(values) {
  const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
  const squares = values.reduce((sum, value) => sum + (value - mean) ** 2, 0);
  return [mean, values.length > 1 ? Math.sqrt(squares / (values.length - 1)) : 0];
}

// One plot for each scene. spec: {title, digits, scenes, configs, values(scene, config) -> [{value,
// name}]}
export function dotPlot(spec) {
  return el('div.dot-plots', {}, spec.scenes.map(scene => scenePlot(spec, scene)).filter(Boolean));
}

function scenePlot({title, digits, configs, values}, scene) {
  const rows = configs
    .map((config, color) => ({config, color, dots: values(scene, config)}))
    .filter(({dots}) => dots.length);
  if (!rows.length) return null;
  const all = rows.flatMap(({dots}) => {
    const values = dots.map(({value}) => value),
      [mean, deviation] = meanAndDeviation(values);
    return [...values, mean - deviation, mean + deviation];
  });
  let [low, high] = [Math.min(...all), Math.max(...all)];
  const margin = (high - low || Math.abs(high) * 0.02 || 1) * 0.12;
  [low, high] = [low - margin, high + margin];
  const place = value => `${((100 * (value - low)) / (high - low)).toFixed(2)}%`;
  const height = rows.length * ROW + FOOT;
  const lines = ticksOf(low, high).map(tick => [
    svg('line', {x1: place(tick), x2: place(tick), y1: 0, y2: rows.length * ROW, class: 'tick'}),
    svg(
      'text',
      {x: place(tick), y: rows.length * ROW + 16, class: 'tick-text'},
      fixed(tick, Math.min(digits, 3)),
    ),
  ]);
  const marks = rows.map(({color, dots, config}, i) => {
    const y = (i + 0.5) * ROW,
      [mean, deviation] = meanAndDeviation(dots.map(({value}) => value));
    const fill = `fill:var(--series-${color % COLORS});stroke:var(--series-${color % COLORS})`;
    return svg(
      'g',
      {style: fill},
      svg('line', {
        x1: place(mean - deviation),
        x2: place(mean + deviation),
        y1: y,
        y2: y,
        class: 'deviation',
      }),
      svg('line', {x1: place(mean), x2: place(mean), y1: y - 9, y2: y + 9, class: 'mean'}),
      dots.map(({value, name}) =>
        svg(
          'circle',
          {cx: place(value), cy: y, r: 5},
          svg('title', {}, `${name}: ${fixed(value, digits)}`),
        ),
      ),
      svg('title', {}, `${config}: ${fixed(mean, digits)} ± ${fixed(deviation, digits)}`),
    );
  });
  return el(
    'figure.dot-plot',
    {},
    el('figcaption', {}, el('b', {}, scene), el('span.muted', {}, ` ${title}`)),
    el(
      'div.dot-rows',
      {style: `--row:${ROW}px`},
      el(
        'div.dot-names',
        {},
        rows.map(({config}) => el('span', {title: config}, config)),
      ),
      svg(
        'svg',
        {width: '100%', height, role: 'img', 'aria-label': `${title} of every run of ${scene}`},
        lines,
        marks,
      ),
    ),
  );
}
