// SPDX-License-Identifier: Apache-2.0
// The report of an experiment, section by section: means over seeds, every run as a dot, curves by
// config, links to the runs' reports, scenes, configs, provenance.
import uPlot from 'uplot';
import {chart} from '../shared/charts.js';
import {el, section, segmented, table} from '../shared/dom.js';
import {
  bytes,
  duration,
  fixed,
  isNumber,
  short,
  significant,
  spread,
  whole,
} from '../shared/format.js';
import {dotPlot} from './dots.js';
import {foot, head, notes, shortCommit, tiles} from './head.js';
import {PLOTS} from './plots.js';

// The numbers of a finished run that are compared. better: +1 if more is better, -1 if less is, 0
// if neither.
const METRICS = [
  {key: 'psnr', name: 'PSNR', unit: 'dB', digits: 2, better: 1, of: r => (r.test ?? r.train)?.psnr},
  {key: 'ssim', name: 'SSIM', unit: '', digits: 4, better: 1, of: r => (r.test ?? r.train)?.ssim},
  {key: 'flip', name: 'FLIP', unit: '', digits: 4, better: -1, of: r => (r.test ?? r.train)?.flip},
  {
    key: 'depth_error',
    name: 'depth error',
    unit: '',
    digits: 4,
    better: -1,
    of: r => (r.test ?? r.train)?.depth_error,
  },
  {
    key: 'lpips',
    name: 'LPIPS',
    unit: '',
    digits: 4,
    better: -1,
    of: r => (r.test ?? r.train)?.lpips,
  },
  {
    key: 'num_gaussians',
    name: 'Gaussians',
    unit: '',
    digits: 0,
    better: 0,
    of: r => r.num_gaussians,
  },
  {
    key: 'train_seconds',
    name: 'training',
    unit: 's',
    digits: 1,
    better: -1,
    of: r => r.train_seconds,
  },
  {
    key: 'peak_gpu_bytes',
    name: 'GPU memory',
    unit: 'MiB',
    digits: 0,
    better: -1,
    scale: 2 ** -20,
    of: r => r.peak_gpu_bytes,
  },
  {
    key: 'forecast_gpu_bytes',
    name: 'its forecast',
    unit: 'MiB',
    digits: 0,
    better: 0,
    scale: 2 ** -20,
    of: r => r.forecast_gpu_bytes,
  },
  {
    key: 'peak_host_bytes',
    name: 'memory',
    unit: 'MiB',
    digits: 0,
    better: -1,
    scale: 2 ** -20,
    of: r => r.peak_host_bytes,
  },
];

export function showExperiment(data) {
  const names = key => [...new Set(data.runs.map(run => run[key]))];
  const scenes = names('scene'),
    configs = names('config'),
    seeds = names('seed');
  const finished = data.runs.filter(run => run.results);
  const seconds = finished.reduce((sum, run) => sum + run.results.train_seconds, 0);
  return [
    ...head({
      title: data.title,
      over: 'Experiment',
      under: data.file,
      sections: [
        ['results', 'Results'],
        ['curves', 'Curves'],
        ['runs', 'Runs'],
        data.scenes && ['scenes', 'Scenes'],
        ['configs', 'Configs'],
        ['provenance', 'Provenance'],
      ].filter(Boolean),
      chips: [
        [
          `${finished.length} of ${data.runs.length} runs finished`,
          finished.length === data.runs.length ? 'good' : 'warn',
        ],
        [data.date.slice(0, 10)],
      ],
    }),
    tiles([
      {name: 'Scenes', value: scenes.length, more: few(scenes)},
      {name: 'Configs', value: configs.length, more: few(configs)},
      {name: 'Seeds', value: seeds.length, more: few(seeds)},
      {name: 'Runs', value: finished.length, unit: `of ${data.runs.length}`},
      {name: 'Training', value: duration(seconds), more: 'all runs together'},
    ]),
    notes(data.notes),
    results(data, scenes, configs),
    curves(data, scenes, configs),
    runs(data),
    data.scenes && sceneTable(data.scenes),
    configTable(data, configs),
    provenance(finished, data.provenance),
    foot(data),
  ].filter(Boolean);
}

const few = list => (list.length > 3 ? `${list.slice(0, 3).join(', ')}, …` : list.join(', '));
const scaled = (metric, value) => (isNumber(value) ? value * (metric.scale ?? 1) : null);
const title = metric => (metric.unit ? `${metric.name} / ${metric.unit}` : metric.name);

function results(data, scenes, configs) {
  const {summary, runs} = data;
  const known = METRICS.filter(metric => summary.some(group => group[metric.key]));
  if (!known.length)
    return section('results', 'Results', null, el('p.card.muted', {}, 'No run is finished yet.'));
  const best = (scene, metric) => {
    const means = summary
      .filter(group => group.scene === scene && group[metric.key])
      .map(group => group[metric.key].mean);
    const shown = new Set(means.map(mean => fixed(scaled(metric, mean), metric.digits)));
    return metric.better && shown.size > 1
      ? Math[metric.better > 0 ? 'max' : 'min'](...means)
      : null;
  };
  const rows = summary.map(group => [
    group.scene,
    group.config,
    ...known.map(metric => {
      const value = group[metric.key];
      return {
        align: 'number',
        className: value && value.mean === best(group.scene, metric) ? 'best' : null,
        text: value
          ? spread(
              scaled(metric, value.mean),
              scaled(metric, value.standard_deviation),
              metric.digits,
            )
          : '–',
      };
    }),
    {text: `${group.finished}/${group.runs}`, align: 'number'},
  ]);
  const holder = el('div');
  const draw = key => {
    const metric = known.find(each => each.key === key);
    holder.replaceChildren(
      dotPlot({
        title: title(metric),
        digits: metric.digits,
        scenes,
        configs,
        values: (scene, config) =>
          runs
            .filter(run => run.scene === scene && run.config === config && run.results)
            .map(run => ({
              value: scaled(metric, metric.of(run.results)),
              name: `${scene}, ${config}, seed ${run.seed}`,
            }))
            .filter(({value}) => isNumber(value)),
      }),
    );
  };
  draw(known[0].key);
  return section(
    'results',
    'Results',
    null,
    el(
      'div.card',
      {},
      table(
        [
          'scene',
          'config',
          ...known.map(metric => ({text: title(metric), align: 'number'})),
          {text: 'runs', align: 'number'},
        ],
        rows,
        {label: 'means and standard deviations'},
      ),
      el(
        'p.note.muted',
        {},
        'Means ± standard deviations over seeds (n − 1). The best mean of each scene is green.',
      ),
    ),
    sceneMeans(data, known),
    differences(data, known),
    el(
      'div.card.dots',
      {},
      el(
        'div.chart-head',
        {},
        el('h3', {}, 'Every run'),
        segmented(
          'metric',
          known.map(metric => [metric.key, metric.name]),
          known[0].key,
          draw,
        ),
      ),
      holder,
    ),
  );
}

const numbers = texts => texts.map(text => ({text, align: 'number'}));

function sceneMeans({scene_means: means}, known) {
  if (!means?.length) return null;
  const rows = means.map(mean => [
    mean.config,
    ...numbers(
      known.map(metric => {
        const value = mean[metric.key];
        return value
          ? spread(
              scaled(metric, value.mean),
              scaled(metric, value.standard_deviation),
              metric.digits,
            )
          : '–';
      }),
    ),
    {text: `${mean.finished}/${mean.seeds}`, align: 'number'},
  ]);
  return el(
    'div.card.means',
    {},
    el('h3', {}, 'Means over scenes'),
    table(['config', ...numbers(known.map(title)), {text: 'seeds', align: 'number'}], rows, {
      label: 'means over scenes',
    }),
    el(
      'p.note.muted',
      {},
      'Of seeds whose runs have finished in every scene; means ± standard deviations over seeds.',
    ),
  );
}

function differences({differences: list, baseline}, known) {
  if (!list?.length) return null;
  const rows = list.map(difference => [
    difference.config,
    difference.scene ?? 'all',
    ...numbers(
      known.map(metric => {
        const value = difference[metric.key];
        if (!value) return '–';
        const text = spread(
          scaled(metric, Math.abs(value.mean)),
          scaled(metric, value.standard_error),
          metric.digits,
        );
        const isZero = !/[1-9]/.test(text.split(' ')[0]);
        return isZero ? text : `${value.mean < 0 ? '−' : '+'}${text}`;
      }),
    ),
    {text: `${difference.finished}/${difference.pairs}`, align: 'number'},
  ]);
  return el(
    'div.card.means',
    {},
    el('h3', {}, `Differences to ${baseline}`),
    table(
      ['config', 'scene', ...numbers(known.map(title)), {text: 'pairs', align: 'number'}],
      rows,
      {label: 'differences to the baseline'},
    ),
    el(
      'p.note.muted',
      {},
      'Config minus baseline, paired by scene and seed; means ± standard errors.',
    ),
  );
}

// The plots of plots.js that have a column, one at a time, with a chart for each scene.
function curves({runs}, scenes, configs) {
  const known = PLOTS.filter(
    ({column}) => column && runs.some(run => run.metrics?.[column]?.some(isNumber)),
  );
  if (!known.length)
    return section(
      'curves',
      'Curves',
      null,
      el('p.card.muted', {}, 'No run has written a row of metrics.csv yet.'),
    );
  const grid = el('div.charts');
  const draw = column => {
    const plot = known.find(each => each.column === column);
    grid.replaceChildren(
      ...scenes
        .map(scene =>
          curveChart(
            runs.filter(run => run.scene === scene),
            scene,
            configs,
            plot,
          ),
        )
        .filter(Boolean),
    );
  };
  draw(known[0].column);
  return section(
    'curves',
    'Curves',
    segmented(
      'curve',
      known.map(({column, title}) => [column, title]),
      known[0].column,
      draw,
    ),
    grid,
  );
}

// One scene: the mean of each config's runs as a bold line over the lines of the runs.
function curveChart(runs, scene, configs, {title, column, format, tick, zero, log}) {
  const drawn = runs
    .map(run => ({
      run,
      rows: (run.metrics?.step ?? [])
        .map((step, i) => [step, run.metrics[column]?.[i]])
        .filter(([, value]) => isNumber(value)),
    }))
    .filter(({rows}) => rows.length);
  if (!drawn.length) return null;
  const [steps, ...lists] = uPlot.join(
    drawn.map(({rows}) => [rows.map(row => row[0]), rows.map(row => row[1])]),
  );
  const single = drawn.map(({run}, i) => ({
    name: `${run.config}, seed ${run.seed}`,
    values: lists[i],
    color: configs.indexOf(run.config),
    alpha: 0.3,
    width: 1,
    points: false,
    quiet: true,
    format,
  }));
  const means = configs
    .map((config, color) => {
      const own = lists.filter((_, i) => drawn[i].run.config === config);
      return (
        own.length && {
          name: config,
          color,
          format,
          values: steps.map((_, i) => meanOf(own.map(list => list[i]))),
        }
      );
    })
    .filter(Boolean);
  return chart({
    title: scene,
    unit: `${title}, means over seeds`,
    sync: 'curves',
    x: {label: 'step', values: steps, tick: short, describe: step => `step ${whole(step)}`},
    y: {tick: tick ?? significant, zero, log},
    series: [...single, ...means],
    description: `${title} of ${scene}: ${means.map(({name, values}) => `${name} ${format(values.findLast(isNumber))}`).join(', ')} at the end`,
  });
}

const linkTo = path => `./${path.split('/').map(encodeURIComponent).join('/')}`;

function meanOf(values) {
  const known = values.filter(isNumber);
  return known.length ? known.reduce((sum, value) => sum + value, 0) / known.length : null;
}

function runs({runs: list}) {
  const chip = state => el(`span.chip.${state === 'finished' ? 'good' : 'warn'}`, {}, state);
  return section(
    'runs',
    'Runs',
    null,
    el(
      'div.card',
      {},
      table(
        [
          'run',
          'state',
          {text: 'PSNR / dB', align: 'number'},
          {text: 'SSIM', align: 'number'},
          {text: 'Gaussians', align: 'number'},
          {text: 'training', align: 'number'},
          {text: 'memory', align: 'number'},
        ],
        list.map(run => {
          const r = run.results,
            quality = r?.test ?? r?.train,
            name = `${run.scene} / ${run.config} / seed ${run.seed}`;
          return [
            run.report ? el('a', {href: linkTo(run.report)}, name) : name,
            chip(run.state),
            ...[
              fixed(quality?.psnr, 2),
              fixed(quality?.ssim, 4),
              whole(r?.num_gaussians),
              duration(r?.train_seconds),
              bytes(r?.peak_gpu_bytes ?? r?.peak_host_bytes),
            ].map(text => ({text, align: 'number'})),
          ];
        }),
        {label: 'all runs'},
      ),
      el('p.note.muted', {}, "Links go to the reports in the runs' folders, beside this file."),
    ),
  );
}

const listOf = settings => {
  const all = Object.entries(settings ?? {});
  return all.length
    ? el(
        'div.settings',
        {},
        all.map(([key, value]) =>
          el('code', {}, `${key} = ${typeof value === 'string' ? value : JSON.stringify(value)}`),
        ),
      )
    : el('span.muted', {}, 'none');
};

// One row for each scene, or several where configs change its views or their size.
function sceneTable(scenes) {
  const rows = scenes.flatMap(scene =>
    (scene.views.length ? scene.views : [null]).map(views => [
      scene.name,
      listOf(scene.settings),
      views && scene.views.length > 1 ? views.configs.join(', ') : 'all',
      {text: whole(views?.train_views), align: 'number'},
      {text: whole(views?.test_views), align: 'number'},
      views?.size ?? '–',
      el('code', {}, views?.scene_hash.slice(0, 10) ?? '–'),
    ]),
  );
  return section(
    'scenes',
    'Scenes',
    null,
    el(
      'div.card',
      {},
      table(
        [
          'scene',
          'its own settings',
          'configs',
          {text: 'training views', align: 'number'},
          {text: 'test views', align: 'number'},
          'size / px',
          'hash',
        ],
        rows,
        {label: 'scenes'},
      ),
      el('p.note.muted', {}, "A scene's own settings override those of the configs."),
    ),
  );
}

function configTable({runs: list, configs: described}, configs) {
  const settingsOf = name =>
    described
      ? described.find(config => config.name === name)?.settings
      : list.find(run => run.config === name)?.settings;
  return section(
    'configs',
    'Configs',
    null,
    el(
      'div.card',
      {},
      table(
        ['config', 'settings that differ from the defaults'],
        configs.map(name => [name, listOf(settingsOf(name))]),
        {label: 'configs'},
      ),
    ),
  );
}

// The machines and builds that the runs were made with, each once.
function provenance(finished, made) {
  const keys = ['version', 'commit', 'uncommitted', 'compiler', 'cuda', 'device', 'cpu', 'driver'];
  const seen = new Map(
    finished
      .map(({results}) =>
        keys.map(key => (key === 'commit' ? shortCommit(results[key]) : (results[key] ?? '–'))),
      )
      .map(row => [row.join('\n'), row]),
  );
  return section(
    'provenance',
    'Provenance',
    null,
    el(
      'div.card',
      {},
      seen.size
        ? table(
            ['gemsplat', 'commit', 'uncommitted', 'compiler', 'CUDA', 'device', 'CPU', 'driver'],
            [...seen.values()],
            {label: 'made with'},
          )
        : 'No run is finished yet.',
      made &&
        el(
          'p.note.muted',
          {},
          'Tables by ',
          el('code', {}, made.command.join(' ')),
          made.uncommitted &&
            ` with uncommitted changes of ${made.uncommitted.files.length} files: ${made.uncommitted.diff}`,
        ),
    ),
  );
}
