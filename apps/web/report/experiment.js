// SPDX-License-Identifier: Apache-2.0
// The report of an experiment: means over seeds, figures of each run, curves by config, links to the runs' reports.
import uPlot from 'uplot';
import {chart} from '../shared/charts.js';
import {el, section, segmented, table} from '../shared/dom.js';
import {bytes, duration, fixed, isNumber, short, significant, spread, whole} from '../shared/format.js';
import {dotPlot} from './dots.js';
import {foot, head, notes, shortCommit, tiles} from './head.js';

// Figures of finished runs; `better`: +1 where more is better, -1 where less is, 0 where nobody can say.
const FIGURES = [
  {key: 'psnr', name: 'PSNR', unit: 'dB', digits: 2, better: 1, of: r => (r.test ?? r.train)?.psnr},
  {key: 'ssim', name: 'SSIM', unit: '', digits: 4, better: 1, of: r => (r.test ?? r.train)?.ssim},
  {key: 'lpips', name: 'LPIPS', unit: '', digits: 4, better: -1, of: r => (r.test ?? r.train)?.lpips},
  {key: 'num_gaussians', name: 'Gaussians', unit: '', digits: 0, better: 0, of: r => r.num_gaussians},
  {key: 'train_seconds', name: 'training', unit: 's', digits: 1, better: -1, of: r => r.train_seconds},
  {key: 'peak_gpu_bytes', name: 'GPU memory', unit: 'MiB', digits: 0, better: -1, scale: 2 ** -20, of: r => r.peak_gpu_bytes},
  {key: 'peak_host_bytes', name: 'memory', unit: 'MiB', digits: 0, better: -1, scale: 2 ** -20, of: r => r.peak_host_bytes},
];
const CURVES = [
  {key: 'loss', name: 'loss', tick: significant, log: true},
  {key: 'test_psnr', name: 'PSNR', tick: significant, format: value => `${fixed(value, 2)} dB`},
  {key: 'test_ssim', name: 'SSIM', tick: significant, format: value => fixed(value, 4)},
  {key: 'num_gaussians', name: 'Gaussians', tick: short, zero: true, format: whole},
  {key: 'steps_per_second', name: 'speed', tick: short, zero: true, format: value => `${fixed(value, 1)} steps/s`},
];

export function showExperiment(data) {
  const names = key => [...new Set(data.runs.map(run => run[key]))];
  const scenes = names('scene'), configs = names('config'), seeds = names('seed');
  const finished = data.runs.filter(run => run.results);
  const seconds = finished.reduce((sum, run) => sum + run.results.train_seconds, 0);
  return [
    ...head({
      title: data.title, over: 'Experiment', under: data.file,
      sections: [['figures', 'Figures'], ['curves', 'Curves'], ['runs', 'Runs'], ['configs', 'Configs'], ['origin', 'Origin']],
      chips: [[`${finished.length} of ${data.runs.length} runs finished`, finished.length === data.runs.length ? 'good' : 'warn'],
              [data.date.slice(0, 10)]],
    }),
    tiles([{name: 'Scenes', value: scenes.length, more: few(scenes)}, {name: 'Configs', value: configs.length, more: few(configs)},
           {name: 'Seeds', value: seeds.length, more: few(seeds)}, {name: 'Runs', value: finished.length, unit: `of ${data.runs.length}`},
           {name: 'Training', value: duration(seconds), more: 'all runs together'}]),
    notes(data.notes),
    figures(data, scenes, configs),
    curves(data, scenes, configs),
    runs(data),
    configTable(data, configs),
    origin(finished),
    foot(data),
  ].filter(Boolean);
}

const few = list => list.length > 3 ? `${list.slice(0, 3).join(', ')}, …` : list.join(', ');
const scaled = (figure, value) => isNumber(value) ? value * (figure.scale ?? 1) : null;
const title = figure => figure.unit ? `${figure.name} / ${figure.unit}` : figure.name;

function figures({summary, runs}, scenes, configs) {
  const known = FIGURES.filter(figure => summary.some(group => group[figure.key]));
  if (!known.length) return section('figures', 'Figures', null, el('p.card.muted', {}, 'No run is finished yet.'));
  const best = (scene, figure) => {
    const means = summary.filter(group => group.scene === scene && group[figure.key]).map(group => group[figure.key].mean);
    const shown = new Set(means.map(mean => fixed(scaled(figure, mean), figure.digits)));
    return figure.better && shown.size > 1 ? Math[figure.better > 0 ? 'max' : 'min'](...means) : null;
  };
  const rows = summary.map(group => [
    group.scene, group.config,
    ...known.map(figure => {
      const value = group[figure.key];
      return {align: 'number', className: value && value.mean === best(group.scene, figure) ? 'best' : null,
              text: value ? spread(scaled(figure, value.mean), scaled(figure, value.standard_deviation), figure.digits) : '–'};
    }), {text: `${group.finished}/${group.runs}`, align: 'number'}]);
  const holder = el('div');
  const draw = key => {
    const figure = known.find(each => each.key === key);
    holder.replaceChildren(dotPlot({
      title: title(figure), digits: figure.digits, scenes, configs,
      values: (scene, config) => runs.filter(run => run.scene === scene && run.config === config && run.results)
          .map(run => ({value: scaled(figure, figure.of(run.results)), name: `${scene}, ${config}, seed ${run.seed}`}))
          .filter(({value}) => isNumber(value)),
    }));
  };
  draw(known[0].key);
  return section('figures', 'Figures', null,
    el('div.card', {}, table(['scene', 'config', ...known.map(figure => ({text: title(figure), align: 'number'})), {text: 'runs', align: 'number'}],
                             rows, {label: 'means and standard deviations'}),
       el('p.note.muted', {}, 'Means ± standard deviations over seeds (n − 1). The best mean of each scene is green.')),
    el('div.card.dots', {}, el('div.chart-head', {}, el('h3', {}, 'Every run'),
       segmented('figure', known.map(figure => [figure.key, figure.name]), known[0].key, draw)), holder));
}

function curves({runs}, scenes, configs) {
  const known = CURVES.filter(({key}) => runs.some(run => run.metrics?.[key]?.some(isNumber)));
  if (!known.length) return section('curves', 'Curves', null, el('p.card.muted', {}, 'No run has written a row of metrics.csv yet.'));
  const grid = el('div.charts');
  const draw = key => {
    const curve = known.find(each => each.key === key);
    grid.replaceChildren(...scenes.map(scene => curveChart(runs.filter(run => run.scene === scene), scene, configs, curve)).filter(Boolean));
  };
  draw(known[0].key);
  return section('curves', 'Curves', segmented('curve', known.map(({key, name}) => [key, name]), known[0].key, draw), grid);
}

// The mean of each config's runs, bold, over the single runs.
function curveChart(runs, scene, configs, curve) {
  const format = curve.format ?? significant;
  const drawn = runs.map(run => ({run, rows: (run.metrics?.step ?? []).map((step, i) => [step, run.metrics[curve.key][i]])
                                                .filter(([, value]) => isNumber(value))})).filter(({rows}) => rows.length);
  if (!drawn.length) return null;
  const [steps, ...lists] = uPlot.join(drawn.map(({rows}) => [rows.map(row => row[0]), rows.map(row => row[1])]));
  const single = drawn.map(({run}, i) => ({name: `${run.config}, seed ${run.seed}`, values: lists[i], color: configs.indexOf(run.config),
                                           alpha: 0.3, width: 1, points: false, quiet: true, format}));
  const means = configs.map((config, color) => {
    const own = lists.filter((_, i) => drawn[i].run.config === config);
    return own.length && {name: config, color, format, values: steps.map((_, i) => meanOf(own.map(list => list[i])))};
  }).filter(Boolean);
  return chart({
    title: scene, unit: `${curve.name}, means over seeds`, sync: 'curves',
    x: {label: 'step', values: steps, tick: short, describe: step => `step ${whole(step)}`},
    y: {tick: curve.tick, zero: curve.zero, log: curve.log},
    series: [...single, ...means],
    description: `${curve.name} of ${scene}: ${means.map(({name, values}) => `${name} ${format(values.findLast(isNumber))}`).join(', ')} at the end`,
  });
}

const linkTo = path => `./${path.split('/').map(encodeURIComponent).join('/')}`;

function meanOf(values) {
  const known = values.filter(isNumber);
  return known.length ? known.reduce((sum, value) => sum + value, 0) / known.length : null;
}

function runs({runs: list}) {
  const chip = state => el(`span.chip.${state === 'finished' ? 'good' : 'warn'}`, {}, state);
  return section('runs', 'Runs', null, el('div.card', {}, table(
    ['run', 'state', {text: 'PSNR / dB', align: 'number'}, {text: 'SSIM', align: 'number'}, {text: 'Gaussians', align: 'number'},
     {text: 'training', align: 'number'}, {text: 'memory', align: 'number'}],
    list.map(run => {
      const r = run.results, quality = r?.test ?? r?.train, name = `${run.scene} / ${run.config} / seed ${run.seed}`;
      return [run.report ? el('a', {href: linkTo(run.report)}, name) : name, chip(run.state),
              ...[fixed(quality?.psnr, 2), fixed(quality?.ssim, 4), whole(r?.num_gaussians), duration(r?.train_seconds),
                  bytes(r?.peak_gpu_bytes ?? r?.peak_host_bytes)].map(text => ({text, align: 'number'}))];
    }), {label: 'all runs'}), el('p.note.muted', {}, 'Links go to the reports in the runs\' folders, beside this file.')));
}

function configTable({runs: list}, configs) {
  return section('configs', 'Configs', null, el('div.card', {}, table(['config', 'what differs from the defaults'], configs.map(config => {
    const settings = Object.entries(list.find(run => run.config === config)?.settings ?? {})
        .filter(([key]) => key !== 'dataset.source' && key !== 'train.seed');
    return [config, settings.length ? el('div.settings', {}, settings.map(([key, value]) => el('code', {}, `${key} = ${
        typeof value === 'string' ? value : JSON.stringify(value)}`))) : el('span.muted', {}, 'nothing')];
  }), {label: 'configs'})));
}

// One row for each way in which runs were made: usually one.
function origin(finished) {
  const keys = ['version', 'commit', 'device', 'cpu', 'driver'];
  const seen = new Map(finished.map(({results}) => keys.map(key => key === 'commit' ? shortCommit(results[key]) : results[key] ?? '–'))
                           .map(row => [row.join('\n'), row]));
  return section('origin', 'Origin', null, el('div.card', {}, seen.size
      ? table(['gemsplat', 'commit', 'device', 'CPU', 'driver'], [...seen.values()], {label: 'made with'}) : 'No run is finished yet.'));
}
