// SPDX-License-Identifier: Apache-2.0
// The plots of training curves: one row of PLOTS is one plot in the report of a run. The report of
// an experiment draws the rows with a column, too, with one line for each config.
//
// To add a plot:
//   1. Write its numbers while a run trains: as a column of metrics.csv (MetricsObserver in
//      gs_app/observers/train_observers.cpp), or as rows of profile.csv (gs_app/observers/profile_observer.cpp).
//   2. Check that they are in the report's data: `gemsplat report RUN --json`. Every column of metrics.csv is there as
//      metrics.COLUMN without further code; what profile.csv brings is gathered in gs_app/report/report_curves.cpp.
//   3. Add a row to PLOTS below, and its title to the list in apps/web/tests/report_test.mjs.
//   4. Build the target gemsplat, which the page is part of, and look: `gemsplat report RUN`.
import {bytes, duration, fixed, isNumber, short, significant, whole} from '../shared/format.js';
import {chart, smoothed, stacked} from '../shared/charts.js';

const SMOOTH_FROM = 24; // rows: shorter curves are shown without a running mean
const SYNC = 'steps'; // charts with this key move their cursors together

/// Each row has a title and either
///   column       a column of metrics.csv, with
///     unit         caption beside the title
///     color        index of a series color in shared/theme.css
///     format       a value as text, with its unit;  tick: a value at the axis (default: significant)
///     zero         whether the axis begins at 0
///     log          true or false: which scale is shown first; undefined: linear, without a switch
///     smooth       whether a running mean is drawn over the values
///     isEvaluated  whether only steps with an evaluation have a value
///     fill         opacity of the area below the line
/// or
///   draw(data, axis)  makes the chart from the report's data; axis(steps) gives its x axis. Null: there is no data.
export const PLOTS = [
  {
    title: 'Loss',
    column: 'loss',
    unit: 'of single photos',
    color: 0,
    format: significant,
    log: true,
    smooth: true,
  },
  {
    title: 'PSNR',
    column: 'test_psnr',
    unit: 'dB',
    color: 2,
    format: value => `${fixed(value, 2)} dB`,
    isEvaluated: true,
  },
  {
    title: 'SSIM',
    column: 'test_ssim',
    unit: '',
    color: 3,
    format: value => fixed(value, 4),
    isEvaluated: true,
  },
  {
    title: 'Gaussians',
    column: 'num_gaussians',
    unit: '',
    color: 1,
    format: whole,
    tick: short,
    zero: true,
    log: false,
    fill: 0.12,
  },
  {title: 'Time per stage', draw: stageChart},
  {title: 'Memory', draw: memoryChart},
  {title: 'PSNR over time', draw: momentsChart},
  {
    title: 'Speed',
    column: 'steps_per_second',
    unit: 'steps per second',
    color: 5,
    format: value => `${fixed(value, 1)} steps/s`,
    tick: short,
    zero: true,
  },
];

/// The charts of a run's data, over steps (by = 'step') or over training time (by = 'seconds').
export function runCharts(data, by) {
  const axis = steps => timeAxis(data.metrics, steps, by);
  const charts = PLOTS.map(plot =>
    plot.draw ? plot.draw(data, axis) : curveChart(plot, data, axis),
  ).filter(Boolean);
  if (charts.length % 2) charts[0].classList.add('wide');
  return charts;
}

// The chart of one column, or null if it has no numbers to draw.
function curveChart(plot, {metrics, results}, axis) {
  const rows = metrics.step
    .map((step, i) => [step, metrics[plot.column]?.[i]])
    .filter(([, value]) => isNumber(value) || !plot.isEvaluated);
  const steps = rows.map(([step]) => step),
    values = rows.map(([, value]) => value);
  if (values.filter(isNumber).length < (plot.isEvaluated ? 2 : 1)) return null;
  const views =
    plot.isEvaluated && (results?.test ? `${results.test.num_views} test views` : 'test views');
  return chart({
    title: plot.title,
    unit: [plot.unit, views].filter(Boolean).join(', '),
    x: axis(steps),
    sync: SYNC,
    y: {tick: plot.tick ?? significant, zero: plot.zero, log: plot.log},
    series: seriesOf(plot, values),
    description: summary(plot, steps, values),
  });
}

function seriesOf({title, color, format, smooth, isEvaluated, fill}, values) {
  const line = {name: title, values, color, format, fill, points: isEvaluated};
  if (!smooth) return [line];
  if (values.length < SMOOTH_FROM) return [{...line, points: false}];
  return [
    {...line, name: 'of the step', alpha: 0.35, width: 1, points: false},
    {...line, name: 'running mean', values: smoothed(values), points: false},
  ];
}

function stageChart({stages}, axis) {
  if (!stages) return null;
  const means = stages.milliseconds.map(list => mean(list.filter(isNumber)));
  const order = stages.names.map((_, i) => i).sort((a, b) => means[b] - means[a]);
  const format = value => `${significant(value)} ms`;
  return chart({
    title: 'Time per stage',
    unit: 'ms of one step, stacked',
    x: axis(stages.step),
    y: {tick: significant, zero: true},
    sync: SYNC,
    description: `Mean milliseconds per step: ${order.map(i => `${stages.names[i]} ${significant(means[i])}`).join(', ')}`,
    series: stacked(
      order.map((i, rank) => ({
        name: stages.names[i],
        values: stages.milliseconds[i],
        color: rank,
        format,
      })),
    ),
  });
}

function memoryChart({memory}, axis) {
  const series = [
    ['GPU', memory?.gpu, 3],
    ['host', memory?.host, 5],
  ]
    .filter(([, values]) => values?.some(isNumber))
    .map(([name, values, color]) => ({
      name,
      values: values.map(v => (isNumber(v) ? v / 2 ** 20 : null)),
      color,
      fill: 0.1,
      format: value => bytes(value * 2 ** 20),
    }));
  if (!series.length) return null;
  return chart({
    title: 'Memory',
    unit: series.length > 1 ? 'MiB' : `MiB, ${series[0].name}`,
    x: axis(memory.step),
    y: {tick: short, zero: true},
    series,
    sync: SYNC,
    description: `Memory at the end: ${series.map(({name, values}) => `${name} ${short(values.at(-1))} MiB`).join(', ')}`,
  });
}

// The PSNR of the views over their times, in a scene that moves.
function momentsChart({views}) {
  const timed = (views?.list ?? [])
    .filter(view => isNumber(view.time) && isNumber(view.psnr))
    .sort((a, b) => a.time - b.time);
  if (timed.length < 2) return null;
  const worst = timed.reduce((low, view) => (view.psnr < low.psnr ? view : low));
  return chart({
    title: 'PSNR over time',
    unit: `dB, ${views.split} views at their moments, 0 to 1`,
    x: {
      label: 'time of the scene',
      values: timed.map(view => view.time),
      tick: significant,
      describe: (_, i) => `${timed[i].name} at ${significant(timed[i].time)}`,
      range: () => [0, 1],
    },
    y: {tick: significant},
    series: [
      {
        name: 'PSNR',
        values: timed.map(view => view.psnr),
        color: 2,
        points: true,
        format: value => `${fixed(value, 2)} dB`,
      },
    ],
    description: `PSNR over the time of the scene; the worst moment is ${significant(worst.time)} with ${fixed(worst.psnr, 2)} dB`,
  });
}

const mean = list => (list.length ? list.reduce((sum, value) => sum + value, 0) / list.length : 0);

// The x axis of values at these steps. The time of a step between two rows of metrics.csv is
// interpolated.
function timeAxis(metrics, steps, by) {
  const describe = (_, i) =>
    `step ${whole(steps[i])}${isNumber(seconds[i]) ? ` · ${duration(seconds[i])}` : ''}`;
  const seconds = steps.map(step => {
    const next = metrics.step.findIndex(row => row >= step);
    if (next < 0) return metrics.seconds.at(-1) ?? null;
    const [s0, t0] = next ? [metrics.step[next - 1], metrics.seconds[next - 1]] : [0, 0];
    return t0 + ((metrics.seconds[next] - t0) * (step - s0)) / (metrics.step[next] - s0 || 1);
  });
  const end = by === 'step' ? metrics.step.at(-1) : metrics.seconds.at(-1);
  const range = (plot, min, max) =>
    plot.data[0].length && (min > plot.data[0][0] || max < plot.data[0].at(-1))
      ? [min, max]
      : [0, end || 1];
  return by === 'step'
    ? {label: 'step', values: steps, tick: short, describe, range}
    : {label: 'training time', values: seconds, tick: duration, describe, range};
}

// The chart in words, for screen readers.
function summary({title, format}, steps, values) {
  const known = values.map((value, i) => [steps[i], value]).filter(([, value]) => isNumber(value));
  const [[s0, v0], [s1, v1]] = [known[0], known.at(-1)];
  return `${title}: ${format(v0)} at step ${s0}, ${format(v1)} at step ${s1}`;
}
