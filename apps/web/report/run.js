// SPDX-License-Identifier: Apache-2.0
// The report of one run: figures, curves, views, histograms, settings, origin.
import {chart, decades, histogram, smoothed, stacked} from '../shared/charts.js';
import {el, section, segmented, table} from '../shared/dom.js';
import {bytes, duration, fixed, isNumber, short, significant, whole} from '../shared/format.js';
import {facts, foot, head, notes, shortCommit, tiles} from './head.js';
import {views} from './views.js';

const SMOOTH_FROM = 24;  // rows: fewer are shown as they are
const SYNC = 'steps';

export function showRun(data) {
  const {results, metrics} = data;
  const shown = results?.test ?? results?.train;
  const what = results?.test ? 'test views' : 'training views';
  const steps = metrics.step;
  const last = list => list.filter(isNumber).at(-1);
  const memory = results?.peak_gpu_bytes ?? results?.peak_host_bytes;
  const sections = [['training', 'Training'], data.views && ['views', 'Views'], data.histograms && ['gaussians', 'Gaussians'],
                    ['settings', 'Settings'], ['origin', 'Origin']].filter(Boolean);
  const device = results?.device;
  return [
    ...head({
      title: data.title, over: 'Training run', under: data.folder, sections,
      chips: [[data.state === 'finished' ? 'finished' : `unfinished, after step ${whole(steps.at(-1) ?? 0)}`,
               data.state === 'finished' ? 'good' : 'warn'],
              device && [device], results && [`seed ${results.seed}`], results && [results.date.slice(0, 10)]],
    }),
    tiles([
      shown && {name: 'PSNR', value: fixed(shown.psnr, 2), unit: 'dB', more: `${shown.num_views} ${what}`},
      shown && {name: 'SSIM', value: fixed(shown.ssim, 4), more: '11×11 window, zero padding'},
      {name: 'Gaussians', value: short(results?.num_gaussians ?? last(metrics.num_gaussians)),
       more: whole(results?.num_gaussians ?? last(metrics.num_gaussians))},
      {name: 'Training', value: duration(results?.train_seconds ?? last(metrics.seconds)),
       more: `${whole(results?.iterations ?? steps.at(-1) ?? 0)} steps`},
      isNumber(memory) && {name: 'Memory', value: bytes(memory), more: results.peak_gpu_bytes ? 'GPU, at most' : 'at most'},
    ]),
    notes(data.notes),
    training(data),
    data.views && views(data.views),
    data.histograms && gaussians(data.histograms, data.state),
    settings(data),
    facts('origin', 'Origin', [
      ['scene', data.scene], ['scene hash', results?.scene_hash], ['device', device], ['CPU', results?.cpu],
      ['driver', results?.driver], ['gemsplat', results && `${results.version} (${shortCommit(results.commit)})`],
      ['seed', results?.seed], ['finished', results?.date], ['folder', data.folder]]),
    foot(data),
  ].filter(Boolean);
}

// All curves, over steps or over the time spent in training.
function training(data) {
  const grid = el('div.charts');
  const draw = by => grid.replaceChildren(...charts(data, by));
  draw('step');
  const choice = segmented('x axis', [['step', 'steps'], ['seconds', 'time']], 'step', draw);
  const evaluations = data.metrics.test_psnr.filter(isNumber).length;
  const once = evaluations === 1 && el('p.note.muted', {}, 'PSNR and SSIM were measured once, at the end. Their curves come with ' +
      'more evaluations: --test-steps 1000,2000,...');
  return section('training', 'Training', data.metrics.step.length > 1 && choice, data.metrics.step.length > 1
      ? [grid, once] : el('p.card.muted', {}, 'No curves: metrics.csv has a row every train.log_every steps, and this run has fewer than two.'));
}

function charts({metrics, stages, memory, results}, by) {
  const axis = steps => timeAxis(metrics, steps, by);
  const x = axis(metrics.step);
  const plain = (title, unit, name, values, y, format, color, more = {}) => values.some(isNumber) && chart({
    title, unit, x, y, sync: SYNC, description: summary(title, unit, metrics.step, values, format),
    series: [{name, values, color, format}], ...more});
  const noisy = metrics.step.length >= SMOOTH_FROM;
  const list = [
    chart({
      title: 'Loss', unit: 'of single photos',
      x, y: {tick: significant, log: true}, sync: SYNC, description: summary('loss', '', metrics.step, metrics.loss, significant),
      series: noisy ? [{name: 'of the step', values: metrics.loss, color: 0, alpha: 0.35, width: 1, format: significant, points: false},
                       {name: 'running mean', values: smoothed(metrics.loss), color: 0, format: significant, points: false}]
                    : [{name: 'loss', values: metrics.loss, color: 0, format: significant}]}),
    quality(metrics, axis, 'PSNR', 'dB', metrics.test_psnr, value => fixed(value, 2), 2, results?.test),
    quality(metrics, axis, 'SSIM', '', metrics.test_ssim, value => fixed(value, 4), 3, results?.test),
    plain('Gaussians', '', 'Gaussians', metrics.num_gaussians, {tick: short, zero: true, log: false}, whole, 1,
          {series: [{name: 'Gaussians', values: metrics.num_gaussians, color: 1, format: whole, fill: 0.12}]}),
    stages && stageChart(stages, axis(stages.step)),
    memory && memoryChart(memory, axis(memory.step)),
    plain('Speed', 'steps per second', 'steps/s', metrics.steps_per_second, {tick: short, zero: true}, value => fixed(value, 1), 5),
  ].filter(Boolean);
  if (list.length % 2) list[0].classList.add('wide');
  return list;
}

// Figures of the held-out views; few of them, so without the steps between.
function quality(metrics, axis, title, unit, values, format, color, test) {
  const rows = metrics.step.map((step, i) => [step, values[i]]).filter(([, value]) => isNumber(value));
  if (rows.length < 2) return null;
  const steps = rows.map(([step]) => step);
  return chart({
    title, unit: [unit, test ? `${test.num_views} test views` : 'test views'].filter(Boolean).join(', '), x: axis(steps), y: {tick: significant}, sync: SYNC,
    description: summary(title, unit, steps, rows.map(([, value]) => value), format),
    series: [{name: title, values: rows.map(([, value]) => value), color, format: value => `${format(value)}${unit && ` ${unit}`}`, points: true}],
  });
}

function stageChart(stages, x) {
  const means = stages.milliseconds.map(list => mean(list.filter(isNumber)));
  const order = stages.names.map((_, i) => i).sort((a, b) => means[b] - means[a]);
  const format = value => `${significant(value)} ms`;
  return chart({
    title: 'Time per stage', unit: 'ms of one step, stacked', x, y: {tick: significant, zero: true}, sync: SYNC,
    description: `Mean milliseconds per step: ${order.map(i => `${stages.names[i]} ${significant(means[i])}`).join(', ')}`,
    series: stacked(order.map((i, rank) => ({name: stages.names[i], values: stages.milliseconds[i], color: rank, format}))),
  });
}

function memoryChart(memory, x) {
  const series = [['GPU', memory.gpu, 3], ['host', memory.host, 5]]
      .filter(([, values]) => values?.some(isNumber))
      .map(([name, values, color]) => ({name, values: values.map(v => isNumber(v) ? v / 2 ** 20 : null), color, fill: 0.1,
                                        format: value => bytes(value * 2 ** 20)}));
  return series.length > 0 && chart({
    title: 'Memory', unit: series.length > 1 ? 'MiB' : `MiB, ${series[0].name}`, x, y: {tick: short, zero: true}, series, sync: SYNC,
    description: `Memory at the end: ${series.map(({name, values}) => `${name} ${short(values.at(-1))} MiB`).join(', ')}`});
}

const mean = list => list.length ? list.reduce((sum, value) => sum + value, 0) / list.length : 0;

// The seconds of a step between two rows follow from those of the rows.
function timeAxis(metrics, steps, by) {
  const describe = (_, i) => `step ${whole(steps[i])}${isNumber(seconds[i]) ? ` · ${duration(seconds[i])}` : ''}`;
  const seconds = steps.map(step => {
    const next = metrics.step.findIndex(row => row >= step);
    if (next < 0) return metrics.seconds.at(-1) ?? null;
    const [s0, t0] = next ? [metrics.step[next - 1], metrics.seconds[next - 1]] : [0, 0];
    return t0 + (metrics.seconds[next] - t0) * (step - s0) / (metrics.step[next] - s0 || 1);
  });
  const end = by === 'step' ? metrics.step.at(-1) : metrics.seconds.at(-1);
  const range = (plot, min, max) => plot.data[0].length && (min > plot.data[0][0] || max < plot.data[0].at(-1))
      ? [min, max] : [0, end || 1];
  return by === 'step' ? {label: 'step', values: steps, tick: short, describe, range}
                       : {label: 'training time', values: seconds, tick: duration, describe, range};
}

function summary(title, unit, steps, values, format) {
  const known = values.map((value, i) => [steps[i], value]).filter(([, value]) => isNumber(value));
  if (!known.length) return title;
  const [[s0, v0], [s1, v1]] = [known[0], known.at(-1)];
  return `${title}: ${format(v0)}${unit && ` ${unit}`} at step ${s0}, ${format(v1)} at step ${s1}`;
}

function gaussians({count, opacity, scales, out_of_range: left}, state) {
  const tick = value => significant(10 ** value);
  return section('gaussians', 'Gaussians', el('span.muted', {}, `${whole(count)} in the ${state === 'finished' ? 'final' : 'newest saved'} model`), el('div.charts', {},
    histogram({title: 'Opacity', unit: 'Gaussians by opacity', histograms: [{name: 'Gaussians', ...opacity}], label: 'opacity', color: 0,
               tick: value => fixed(value, 2), format: whole,
               description: `Histogram of opacity, median ${fixed(opacity.median, 2)}`,
               note: `Median ${fixed(opacity.median, 2)}.`}),
    histogram({title: 'Scale', unit: 'Gaussians by length of axis, world units',
               histograms: scales.map(scale => ({...scale, name: `${scale.name} axis`})), label: 'standard deviation along the axis, world units', color: 1,
               tick, splits: decades, format: whole, description: scales.map(({name, median}) => `${name} axis: median ${tick(median)}`).join('; '),
               note: `Medians: ${scales.map(({name, median}) => `${name} ${tick(median)}`).join(', ')}.${
                   left ? ` ${whole(left)} with values that are not numbers are left out.` : ''}`})));
}

function settings({config, changed}) {
  const copy = el('button.button', {type: 'button', onclick: async () => {
    try {
      await navigator.clipboard.writeText(config);
      copy.textContent = 'copied';
    } catch {  // not every browser lets a file do so
      getSelection().selectAllChildren(copy.nextElementSibling);
      copy.textContent = 'selected';
    }
  }}, 'copy');
  return section('settings', 'Settings', null, el('div.card', {},
    el('h3', {}, changed.length ? 'What differs from the defaults' : 'All settings have their defaults'),
    changed.length > 0 && table(['setting', 'value', 'default'], changed.map(({key, value, usual}) =>
        [el('code', {}, key), el('code', {}, value), el('code.muted', {}, usual)]), {label: 'changed settings'}),
    config && el('details', {}, el('summary', {}, 'config.toml, whole'), el('div.config', {}, copy, el('pre', {tabindex: '0'}, config)))));
}
