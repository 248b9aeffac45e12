// SPDX-License-Identifier: Apache-2.0
// The screen "Clean": operations of `gemsplat edit`. Each one writes a new version; undo and redo go
// from one to another, and nothing is overwritten.
import {el, segmented} from '../shared/dom.js';
import {bytes, whole} from '../shared/format.js';
import {currentModel, modelAt, modelWords, noModel, viewOfModel} from './frame.js';
import {button, isActive, jobList} from './jobs.js';

// A value that a slider sets: label, the option for a value, what it means, its range, and what the
// viewer hides of the model for a value at once, if it can tell.
const SLIDERS = [
  [
    'Faint ones',
    v => ['--drop', `opacity=..${v}`],
    'drop Gaussians with less opacity than',
    0.01,
    0.5,
    0.01,
    0.05,
    opacity => ({opacity}),
  ],
  [
    'Large ones',
    v => ['--drop', `size=${v}..`],
    'drop Gaussians larger than, in world units',
    0.01,
    3,
    0.01,
    1,
    size => ({size}),
  ],
  [
    'Floaters',
    v => ['--drop', `floaters=${v}`],
    'drop what stands nearer to a camera than this share of the depth behind it',
    0.05,
    0.8,
    0.05,
    0.35,
  ],
  [
    'Fewer',
    v => ['--decimate', `${Math.round(v * 100)}%`],
    'leave this share, merged',
    0.05,
    0.95,
    0.05,
    0.5,
  ],
];

// The words of a job without its places: "--drop opacity=..0.05".
const operationOf = words =>
  words
    .slice(2)
    .filter((word, i, all) => !['-o', '-d'].includes(word) && !['-o', '-d'].includes(all[i - 1]))
    .join(' ');

export function showClean(app) {
  const {details} = app,
    current = currentModel(details);
  if (!current) return noModel(app);
  const view = viewOfModel(app, current);
  const said = el('p.said', {'aria-live': 'polite'});
  const isBusy = () => app.project.jobs.some(isActive);

  const words = operation => ['edit', ...modelWords(details, current), ...operation];
  const preview = async operation => {
    said.textContent = 'counting …';
    try {
      const {steps} = await app.server.question(words(operation));
      const {before} = steps[0],
        {after} = steps.at(-1);
      said.textContent = `${whole(after)} of ${whole(before)} Gaussians remain.`;
    } catch (error) {
      said.textContent = error.message;
    }
  };
  const apply = operation =>
    app.act(async server => {
      if (isBusy()) throw new Error('Another job runs in this project; wait until it has ended.');
      const {id} = await server.run([...words(operation), '-o', 'edits/{id}.ply']);
      app.showWhenDone(id, `edits/${id}.ply`);
    });
  const regionOf = async () => {
    const operation = await (await view.viewer()).crop();
    if (!operation) throw new Error('This model is too large to be cropped here.');
    return operation.split(' ');
  };
  const lassoOf = async () => {
    const lasso = await (await view.viewer()).lasso();
    if (!lasso) throw new Error('Click three corners or more in the picture first, or paint.');
    return [
      lasso.drops ? '--drop' : '--keep',
      `lasso=${await app.server.keep('lasso', lasso.file)}`,
    ];
  };
  // A part of the screen for what is chosen in the picture.
  const inPicture = (title, words, tool, operation) =>
    el(
      'section.card',
      {},
      el('h2', {}, title),
      el('p.muted', {}, words),
      el(
        'div.buttons',
        {},
        button('Show the tool', async () => (await view.viewer()).openTool(tool)),
        button('Count', async () => preview(await operation())),
        button('Apply', async () => apply(await operation())),
      ),
    );

  const hide = async what => (await view.viewer()).filter(what);
  const slider = ([label, option, meaning, min, max, step, value, hidden]) => {
    const number = el('output', {}, String(value)),
      id = `slide-${label}`;
    const field = el('input', {
      type: 'range',
      id,
      min,
      max,
      step,
      value,
      oninput: () => {
        number.textContent = field.value;
        hide(hidden?.(Number(field.value)) ?? {}).catch(() => {}); // without a viewer there is none
      },
      onchange: () => preview(option(Number(field.value))),
    });
    return el(
      'div.operation',
      {},
      el('label', {for: id}, el('b', {}, label), ' ', number, el('small', {}, meaning)),
      field,
      el(
        'div.buttons',
        {},
        button('Count', () => preview(option(Number(field.value)))),
        button('Apply', () => apply(option(Number(field.value)))),
        hidden && button('Show all', () => hide({})),
      ),
    );
  };

  const show = path => path && app.act(server => server.change({model: path}));
  const before = modelAt(details, current).from,
    after = details.models.filter(({from}) => from === current).at(-1)?.path;
  const undo = button('Undo', () => show(before)),
    redo = button('Redo', () => show(after));
  undo.title = 'Ctrl+Z';
  redo.title = 'Ctrl+Shift+Z';
  undo.disabled = !before;
  redo.disabled = !after;
  // The last corner of a lasso goes before the last version.
  const undoInPicture = async () => {
    try {
      return await (await view.viewer()).undo();
    } catch {
      return false; // there is no viewer
    }
  };
  app.keys = async event => {
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== 'z') return;
    if (event.target.closest?.('input:not([type=range]), select')) return; // its own undo
    event.preventDefault();
    if (event.shiftKey) show(after);
    else if (!(await undoInPicture())) show(before);
  };
  const versions = segmented(
    'versions',
    details.models.map(({path}) => [path, path]),
    current,
    show,
  );
  const list = jobList(app, ['edit'], ({words}) => operationOf(words));
  return {
    view,
    side: el(
      'div.side',
      {},
      el(
        'section.card',
        {},
        el('div.job-head', {}, el('h2', {}, 'Versions'), el('div.buttons', {}, undo, redo)),
        versions,
        el('p.muted', {}, bytes(modelAt(details, current).bytes || null)),
      ),
      inPicture(
        'Crop',
        'Drag the handles of the box or the sphere in the picture.',
        'Crop',
        regionOf,
      ),
      inPicture(
        'Lasso and brush',
        'Click corners around what is to go in the picture, or drag a brush over it.',
        'Lasso',
        lassoOf,
      ),
      el('section.card', {}, el('h2', {}, 'Filters'), SLIDERS.map(slider)),
      said,
      list.node,
    ),
    update: list.update,
  };
}
