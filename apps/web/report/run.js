// SPDX-License-Identifier: Apache-2.0
// The report of one run, section by section: results, curves, views, histograms, settings,
// provenance.
import {decades, histogram} from '../shared/charts.js';
import {el, section, segmented, table} from '../shared/dom.js';
import {bytes, duration, fixed, isNumber, short, significant, whole} from '../shared/format.js';
import {facts, foot, head, notes, shortCommit, tiles} from './head.js';
import {runCharts} from './plots.js';
import {views} from './views.js';

const NETWORKS = {alex: 'AlexNet', vgg: 'VGG-16'}; // of LPIPS

export function showRun(data) {
  const {results, metrics} = data;
  const shown = results?.test ?? results?.train;
  const what = results?.test ? 'test views' : 'training views';
  const network = results?.lpips_network;
  const steps = metrics.step;
  const last = list => list?.filter(isNumber).at(-1);
  const memory = results?.peak_gpu_bytes ?? results?.peak_host_bytes;
  const sections = [
    ['training', 'Training'],
    data.views && ['views', 'Views'],
    data.histograms && ['gaussians', 'Gaussians'],
    data.mesh && ['mesh', 'Mesh'],
    ['settings', 'Settings'],
    ['provenance', 'Provenance'],
  ].filter(Boolean);
  const device = results?.device;
  return [
    ...head({
      title: data.title,
      over: 'Training run',
      under: data.folder,
      sections,
      chips: [
        [
          data.state === 'finished'
            ? 'finished'
            : `unfinished, after step ${whole(steps.at(-1) ?? 0)}`,
          data.state === 'finished' ? 'good' : 'warn',
        ],
        device && [device],
        results && [`seed ${results.seed}`],
        results && [results.date.slice(0, 10)],
      ],
    }),
    tiles([
      shown && {
        name: 'PSNR',
        value: fixed(shown.psnr, 2),
        unit: 'dB',
        more: `${shown.num_views} ${what}`,
      },
      shown && {name: 'SSIM', value: fixed(shown.ssim, 4), more: '11×11 window, zero padding'},
      isNumber(shown?.flip) && {name: 'FLIP', value: fixed(shown.flip, 4), more: 'lower is better'},
      isNumber(shown?.ws_psnr) && {
        name: 'WS-PSNR',
        value: fixed(shown.ws_psnr, 2),
        unit: 'dB',
        more: `panoramas as one picture · PSNR ${fixed(shown.psnr_panorama, 2)} dB`,
      },
      isNumber(shown?.depth_error) && {
        name: 'Depth error',
        value: fixed(100 * shown.depth_error, 1),
        unit: '%',
        more: 'of the distance, against the depth maps',
      },
      isNumber(shown?.lpips) && {
        name: 'LPIPS',
        value: fixed(shown.lpips, 4),
        more: `lower is better${network ? ` · ${NETWORKS[network.name]}` : ''}`,
      },
      {
        name: 'Gaussians',
        value: short(results?.num_gaussians ?? last(metrics.num_gaussians)),
        more: [
          whole(results?.num_gaussians ?? last(metrics.num_gaussians)),
          results?.removed_floaters && `${whole(results.removed_floaters)} floaters removed`,
        ]
          .filter(Boolean)
          .join(' · '),
      },
      {
        name: 'Training',
        value: duration(results?.train_seconds ?? last(metrics.seconds)),
        more: `${whole(results?.iterations ?? steps.at(-1) ?? 0)} steps`,
      },
      isNumber(memory) && {
        name: 'Memory',
        value: bytes(memory),
        more: results.peak_gpu_bytes ? 'peak on the GPU' : 'peak on the host',
      },
    ]),
    notes(data.notes),
    training(data),
    data.views && views(data.views),
    data.histograms && gaussians(data.histograms, data.state),
    data.mesh && mesh(data.mesh),
    settings(data),
    facts('provenance', 'Provenance', [
      ['scene', data.scene],
      ['scene hash', results?.scene_hash],
      ['device', device],
      ['CPU', results?.cpu],
      ['driver', results?.driver],
      ['gemsplat', results && `${results.version} (${shortCommit(results.commit)})`],
      ['LPIPS', network && `${NETWORKS[network.name]}, ${network.file}, XXH3 ${network.hash}`],
      ['seed', results?.seed],
      ['finished', results?.date],
      ['folder', data.folder],
    ]),
    foot(data),
  ].filter(Boolean);
}

// The plots of plots.js, over steps or over training time.
function training(data) {
  const grid = el('div.charts');
  const draw = by => grid.replaceChildren(...runCharts(data, by));
  draw('step');
  const choice = segmented(
    'x axis',
    [
      ['step', 'steps'],
      ['seconds', 'time'],
    ],
    'step',
    draw,
  );
  const evaluations = data.metrics.test_psnr?.filter(isNumber).length;
  const once =
    evaluations === 1 &&
    el(
      'p.note.muted',
      {},
      'PSNR and SSIM were measured once, at the end. To see their curves, ' +
        'train with --test-steps 1000,2000,...',
    );
  return section(
    'training',
    'Training',
    data.metrics.step.length > 1 && choice,
    data.metrics.step.length > 1
      ? [grid, once]
      : el(
          'p.card.muted',
          {},
          'No curves: metrics.csv gets a row every train.log_every steps, and this run has fewer than two rows.',
        ),
  );
}

function gaussians({count, opacity, scales, out_of_range: left}, state) {
  const tick = value => significant(10 ** value);
  return section(
    'gaussians',
    'Gaussians',
    el(
      'span.muted',
      {},
      `${whole(count)} in the ${state === 'finished' ? 'final' : 'newest saved'} model`,
    ),
    el(
      'div.charts',
      {},
      histogram({
        title: 'Opacity',
        unit: 'Gaussians by opacity',
        histograms: [{name: 'Gaussians', ...opacity}],
        label: 'opacity',
        color: 0,
        tick: value => fixed(value, 2),
        format: whole,
        description: `Histogram of opacity, median ${fixed(opacity.median, 2)}`,
        note: `Median ${fixed(opacity.median, 2)}.`,
      }),
      histogram({
        title: 'Scale',
        unit: 'Gaussians by length of axis, world units',
        histograms: scales.map(scale => ({...scale, name: `${scale.name} axis`})),
        label: 'standard deviation along the axis, world units',
        color: 1,
        tick,
        splits: decades,
        format: whole,
        description: scales
          .map(({name, median}) => `${name} axis: median ${tick(median)}`)
          .join('; '),
        note: `Medians: ${scales.map(({name, median}) => `${name} ${tick(median)}`).join(', ')}.${
          left ? ` ${whole(left)} with values that are not numbers are left out.` : ''
        }`,
      }),
    ),
  );
}

// Photos, and the mesh as their cameras see it.
function mesh({name, triangles, vertices, texture, pictures, views, psnr, ssim, covered}) {
  const figures = views
    ? `in ${views} views ${fixed(psnr, 2)} dB, SSIM ${fixed(ssim, 4)}, ` +
      `${fixed(100 * covered, 1)} % of the pixels covered`
    : 'no photo is in the folder to compare it with';
  const size = texture ? `a texture of ${texture.join('×')}` : 'colors of vertices';
  return section(
    'mesh',
    'Mesh',
    el('span.muted', {}, name),
    el('p', {}, `${whole(triangles)} triangles, ${whole(vertices)} vertices, ${size}; ${figures}.`),
    el(
      'div.charts',
      {},
      pictures.flatMap(view =>
        ['photo', 'mesh'].map(kind =>
          el(
            'figure.card.picture',
            {},
            el('img', {src: view[kind], alt: `${kind} of ${view.name}`}),
            el('figcaption.muted', {}, `${view.name}: ${kind}`),
          ),
        ),
      ),
    ),
  );
}

function settings({config, changed}) {
  const copy = el(
    'button.button',
    {
      type: 'button',
      onclick: async () => {
        try {
          await navigator.clipboard.writeText(config);
          copy.textContent = 'copied';
        } catch {
          // not every browser lets a local file write to the clipboard
          getSelection().selectAllChildren(copy.nextElementSibling);
          copy.textContent = 'selected';
        }
      },
    },
    'copy',
  );
  return section(
    'settings',
    'Settings',
    null,
    el(
      'div.card',
      {},
      el(
        'h3',
        {},
        changed.length ? 'What differs from the defaults' : 'All settings have their defaults',
      ),
      changed.length > 0 &&
        table(
          ['setting', 'value', 'default'],
          changed.map(({key, value, usual}) => [
            el('code', {}, key),
            el('code', {}, value),
            el('code.muted', {}, usual),
          ]),
          {label: 'changed settings'},
        ),
      config &&
        el(
          'details',
          {},
          el('summary', {}, 'the whole config.toml'),
          el('div.config', {}, copy, el('pre', {tabindex: '0'}, config)),
        ),
    ),
  );
}
