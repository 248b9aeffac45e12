// SPDX-License-Identifier: Apache-2.0
// Charts on uPlot in the page's colors: lines, stacked areas and histograms, with a tooltip at the
// cursor.
import uPlot from 'uplot';
import {cssColor, el, segmented} from './dom.js';
import {isNumber, short, significant} from './format.js';

const HEIGHT = 230; // CSS pixels
const FEW_POINTS = 60;
export const COLORS = 10; // of theme.css
const FONT = '12px system-ui, -apple-system, "Segoe UI", Roboto, sans-serif';

export const seriesColor = index => cssColor(`--series-${index % COLORS}`);
const faint = (color, alpha) =>
  color +
  Math.round(alpha * 255)
    .toString(16)
    .padStart(2, '0');

// All charts of the page: they are drawn again when the system changes between light and dark.
const live = [];
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () =>
  live.forEach(chart => chart.build()),
);

// Ticks of an axis of log10: whole decades, and steps within them if the axis spans only a few.
const WITHIN_A_DECADE = [
  [0.4, [1, 1.2, 1.4, 1.6, 1.8, 2, 2.5, 3, 3.5, 4, 5, 6, 7, 8, 9]],
  [1.2, [1, 1.5, 2, 3, 4, 5, 7]],
  [3, [1, 2, 5]],
  [Infinity, [1]],
];
export function decades(from, to) {
  const steps = WITHIN_A_DECADE.find(([width]) => to - from < width)[1],
    ticks = [];
  for (let power = Math.floor(from); power <= to; ++power)
    for (const step of steps) ticks.push(power + Math.log10(step));
  return ticks.filter(tick => tick >= from - 1e-9 && tick <= to + 1e-9);
}

// uPlot's own logarithmic ticks need a scale that begins at a power of ten; these do not.
const logTicks = (plot, axis, from, to) =>
  decades(Math.log10(from), Math.log10(to)).map(power => 10 ** power);

// The tooltip: a box beside the cursor with x and the value of each series there.
function tooltip(spec) {
  let box;
  const fill = plot => {
    const i = plot.cursor.idx;
    const rows = spec.series
      .map(series => ({series, value: (series.own ?? series.values)[i]}))
      .filter(({series, value}) => isNumber(value) && !series.quiet);
    box.hidden = i === null || i === undefined || plot.cursor.left < 0 || rows.length === 0;
    if (box.hidden) return;
    box.replaceChildren(
      el('div.muted', {}, spec.x.describe(spec.x.values[i], i)),
      el(
        'ul',
        {},
        rows.map(({series, value}) =>
          el(
            'li',
            {},
            el('span.swatch', {style: `background:${seriesColor(series.color)}`}),
            series.name,
            el('b', {}, series.format(value)),
          ),
        ),
      ),
    );
    const left = plot.cursor.left + plot.over.offsetLeft,
      right = left + 14 + box.offsetWidth;
    box.style.left = `${right > plot.width ? Math.max(0, left - 14 - box.offsetWidth) : left + 14}px`;
    box.style.top = `${Math.max(0, Math.min(plot.cursor.top, plot.height - box.offsetHeight - 30))}px`;
  };
  return {
    hooks: {
      init: plot => {
        box = el('div.tip', {hidden: true});
        plot.root.querySelector('.u-wrap').append(box);
      },
      // A chart whose cursor only follows that of another chart shows no box.
      setCursor: plot => {
        if (plot.cursor.event || box.hidden === false) fill(plot);
      },
    },
  };
}

function seriesOptions(series, pointCount, isLog) {
  const color = seriesColor(series.color),
    opaque = series.alpha ?? 1;
  const paths =
    series.shape === 'bars'
      ? uPlot.paths.bars({size: [1, Infinity], gap: 1})
      : series.shape === 'steps'
        ? uPlot.paths.stepped({align: 1})
        : undefined;
  const fillAlpha = series.fill ?? 0;
  return {
    label: series.name,
    stroke: faint(color, opaque),
    width: series.width ?? 2,
    fill: fillAlpha ? faint(color, fillAlpha) : undefined,
    fillTo: isLog ? plot => plot.scales.y.min : undefined,
    paths,
    spanGaps: true,
    points: {
      show: series.points ?? (pointCount <= FEW_POINTS && !series.shape),
      size: 6,
      fill: color,
      stroke: color,
    },
  };
}

function options(spec, width, isLog) {
  const count = spec.x.values.length;
  const axis = {
    stroke: cssColor('--muted'),
    grid: {stroke: cssColor('--grid'), width: 1},
    ticks: {stroke: cssColor('--line'), width: 1, size: 4},
    font: FONT,
  };
  const range = (plot, min, max) => {
    if (!isNumber(min) || !isNumber(max)) return isLog ? [1, 10] : [0, 1];
    if (isLog) return spec.y.zero ? [Math.min(0.7, min), max * 1.3] : [min / 1.12, max * 1.12];
    const margin = (max - min || Math.abs(max) || 1) * 0.08;
    return [spec.y.zero ? 0 : min - margin, max + margin];
  };
  return {
    width,
    height: spec.height ?? HEIGHT,
    padding: [10, 12, 0, 0],
    scales: {x: {time: false, range: spec.x.range}, y: {distr: isLog ? 3 : 1, range}},
    axes: [
      {
        ...axis,
        values: (_, ticks) => ticks.map(value => spec.x.tick(value)),
        space: 60,
        label: spec.x.label,
        labelFont: FONT,
        labelSize: 20,
        labelGap: 0,
        size: 28,
        splits: spec.x.splits,
      },
      {
        ...axis,
        values: (_, ticks) => ticks.map(value => spec.y.tick(value)),
        splits: isLog ? logTicks : undefined,
        filter: isLog ? (_, ticks) => ticks : undefined,
        size: (_, values) => 14 + 7.2 * Math.max(2, ...(values ?? []).map(text => text.length)),
      },
    ],
    series: [
      {label: spec.x.label},
      ...spec.series.map(series => seriesOptions(series, count, isLog)),
    ],
    legend: {show: false},
    cursor: {
      sync: spec.sync ? {key: spec.sync} : undefined,
      drag: {x: true, y: false, setScale: true},
      points: {size: 8},
      y: false,
    },
    plugins: [tooltip(spec)],
  };
}

/// A card with one chart.
///   spec.title, unit, note   texts above and below the chart
///   spec.x       {label, values, tick(value), describe(value, index), range}
///   spec.series  [{name, values, color, format(value), own, width, alpha, fill, shape, points, quiet}]; the tooltip
///                shows `own` where `values` are sums; a `quiet` series is in neither tooltip nor legend
///   spec.y       {tick(value), zero, log: undefined | false | true}; if `log` is given, the reader can switch it
export function chart(spec) {
  const holder = el('div.chart', {role: 'img', 'aria-label': spec.description ?? spec.title});
  let plot = null,
    isLog = spec.y.log === true;
  const build = () => {
    if (!holder.isConnected || !holder.clientWidth) return;
    plot?.destroy();
    const values = spec.series.map(series =>
      isLog ? series.values.map(v => (v > 0 ? v : null)) : series.values,
    );
    plot = new uPlot(options(spec, holder.clientWidth, isLog), [spec.x.values, ...values], holder);
  };
  new ResizeObserver(() => {
    if (!plot) build();
    else if (plot.width !== holder.clientWidth)
      plot.setSize({width: holder.clientWidth, height: plot.height});
  }).observe(holder);
  live.push({build});
  const named = spec.series.filter(series => !series.quiet);
  return el(
    'div.card.chart-card',
    {'data-chart': spec.title},
    el(
      'div.chart-head',
      {},
      el(
        'div.chart-title',
        {},
        el('h3', {}, spec.title),
        spec.unit && el('span.unit', {}, spec.unit),
      ),
      spec.y.log !== undefined &&
        smallSegmented(spec, isLog, value => {
          isLog = value;
          build();
        }),
    ),
    named.length > 1 && legend(named),
    holder,
    spec.note && el('p.note.muted', {}, spec.note),
  );
}

function smallSegmented(spec, isLog, choose) {
  const group = segmented(
    `scale of ${spec.title}`,
    [
      ['linear', 'linear'],
      ['log', 'log'],
    ],
    isLog ? 'log' : 'linear',
    value => choose(value === 'log'),
  );
  group.classList.add('small');
  return group;
}

function legend(series) {
  return el(
    'ul.legend',
    {},
    series.map(({name, color, alpha}) =>
      el(
        'li',
        {},
        el('span.swatch', {
          style: `background:var(--series-${color % COLORS});opacity:${alpha ?? 1}`,
        }),
        name,
      ),
    ),
  );
}

// A centered running mean, which shows the trend behind the noise of single photos.
export function smoothed(values) {
  const reach = Math.max(1, Math.round(values.length / 40));
  return values.map((_, i) => {
    const near = Math.min(reach, i, values.length - 1 - i);
    const known = values.slice(i - near, i + near + 1).filter(isNumber);
    return known.length ? known.reduce((sum, value) => sum + value, 0) / known.length : null;
  });
}

// Series as areas stacked on one another, the first at the bottom.
export function stacked(series) {
  const sums = series[0].values.map(() => 0);
  const areas = series.map(each => ({
    ...each,
    own: each.values,
    width: 1,
    fill: 1,
    points: false,
    values: each.values.map((value, i) => (sums[i] += value ?? 0)),
  }));
  return areas.reverse(); // the tallest area is drawn first, the others over it
}

/// A card with a histogram. spec.histograms: [{name, from, to, counts}]: bars for one, lines for
/// several.
export function histogram(spec) {
  const {from, to, counts} = spec.histograms[0];
  const width = (to - from) / counts.length;
  const values = counts.map((_, i) => from + (i + 0.5) * width);
  return chart({
    ...spec,
    x: {
      label: spec.label,
      values,
      tick: spec.tick,
      range: () => [from, to],
      splits: spec.splits && (() => spec.splits(from, to)),
      describe: (_, i) => `${spec.tick(from + i * width)} to ${spec.tick(from + (i + 1) * width)}`,
    },
    y: {tick: short, zero: true, log: false},
    series: spec.histograms.map(({name, counts}, i) => ({
      name,
      values: counts,
      color: spec.color + i,
      format: spec.format ?? significant,
      fill: spec.histograms.length > 1 ? 0.12 : 0.75,
      width: spec.histograms.length > 1 ? 2 : 0,
      shape: spec.histograms.length > 1 ? undefined : 'bars',
      points: false,
    })),
  });
}
