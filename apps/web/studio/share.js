// SPDX-License-Identifier: Apache-2.0
// The screen "Share": the model in other formats, with size and measured loss, and a page of its own.
import {el, table} from '../shared/dom.js';
import {bytes, fixed, whole} from '../shared/format.js';
import {currentModel, modelWords, noModel} from './frame.js';
import {button, jobList, nameOf, saveLink} from './jobs.js';

// Ending, for whom.
const FORMATS = [
  ['html', 'a page that needs no server', true],
  ['spz', 'small; phones, Niantic, Babylon.js', true],
  ['sog', 'small; SuperSplat, PlayCanvas', true],
  ['ply', 'everything; Blender, Unity, Unreal', true],
  ['compressed.ply', 'a quarter of it; SuperSplat', false],
  ['glb', 'glTF with Gaussians', false],
  ['splat', 'old web viewers', false],
  ['rad', 'levels of detail for streaming', false],
  ['npz', 'NumPy', false],
];

// How the files are placed, in this order: the option of `gemsplat edit`, its label, and numbers that
// change nothing.
const PLACES = [
  ['turn', 'Turn about x, y, z, degrees', [0, 0, 0]],
  ['scale', 'Times as large', [1]],
  ['move', 'Move along x, y, z, world units', [0, 0, 0]],
];

function outcomeTable(app, {files = []}) {
  return table(
    ['File', {text: 'Size', align: 'number'}, {text: 'PSNR', align: 'number'}, ''],
    files.map(({file, bytes: size, psnr}) => [
      nameOf(file),
      {text: bytes(size), align: 'number'},
      {
        text: psnr ? `${fixed(psnr, 1)} dB` : '–',
        align: 'number',
        title: 'PSNR of its pictures against those of the model; more is better',
      },
      saveLink(app, file),
    ]),
    {label: 'exported files'},
  );
}

/// Fields for one of PLACES, and the words that they mean: none while nothing is changed.
function placeFields([option, label, start]) {
  const inputs = start.map((value, k) =>
    el('input', {
      type: 'number',
      step: 'any',
      id: start.length > 1 ? `${option}-${'xyz'[k]}` : option,
      value,
      'aria-label': start.length > 1 ? `${label}: ${'xyz'[k]}` : label,
    }),
  );
  return {
    node: el('div.field', {}, el('span', {}, label), el('div.numbers', {}, inputs)),
    words: () => {
      const numbers = inputs.map(({value}, k) => (value === '' ? start[k] : Number(value)));
      return numbers.every((value, k) => value === start[k])
        ? []
        : [`--${option}`, numbers.join(',')];
    },
  };
}

export function showShare(app) {
  const {details} = app,
    current = currentModel(details);
  if (!current) return noModel(app);
  const boxes = FORMATS.map(([ending, words, isOn]) => {
    const box = el('input', {type: 'checkbox', id: `format-${ending}`, checked: isOn});
    return {
      ending,
      box,
      node: el(
        'label.format',
        {for: box.id},
        box,
        el('span', {}, el('b', {}, `.${ending}`), el('small', {}, words)),
      ),
    };
  });
  const name = app.id.replaceAll(/[^\w-]+/g, '_');
  const level = el('input', {type: 'checkbox', id: 'level'});
  const places = PLACES.map(placeFields);
  const write = () => {
    const files = boxes
      .filter(({box}) => box.checked)
      .map(({ending}) => `share/{id}/${name}.${ending}`);
    if (!files.length) return app.fail(new Error('Choose a format.'));
    return app.act(async server => {
      const words = modelWords(details, current);
      const placing = [
        ...(level.checked ? ['--straighten'] : []),
        ...places.flatMap(place => place.words()),
      ];
      if (!placing.length) return server.run(['export', current, ...files, ...words.slice(1)]);
      const {id} = await server.run(['edit', ...words, ...placing, '-o', 'share/{id}/placed.ply']);
      return server.run(['export', `share/${id}/placed.ply`, ...files]);
    });
  };
  const writeMesh = () =>
    app.act(server =>
      server.run(['mesh', ...modelWords(details, current), '-o', `share/{id}/${name}-mesh.glb`]),
    );
  const list = jobList(
    app,
    ['export', 'mesh'],
    ({id, words}) => `${words[0] === 'mesh' ? 'Mesh' : 'Export'} ${id}: ${words[1]}`,
    outcome =>
      outcome.triangles
        ? el('p', {}, `${whole(outcome.triangles)} triangles. `, saveLink(app, outcome.output))
        : outcomeTable(app, outcome),
  );
  return {
    node: el(
      'main',
      {},
      el(
        'section.card',
        {},
        el('h2', {}, `Take ${current} along`),
        el(
          'div.formats',
          {},
          boxes.map(({node}) => node),
        ),
        el(
          'label.field.check',
          {for: 'level'},
          level,
          el('span', {}, 'turn it so that its floor is level, with its middle at the origin'),
        ),
        el(
          'div.fields',
          {},
          places.map(({node}) => node),
        ),
        el('div.buttons', {}, button('Write these', write, 'primary')),
      ),
      el(
        'section.card',
        {},
        el('h2', {}, 'As triangles'),
        el(
          'p.muted',
          {},
          'The surface that the photos see, as a .glb for Blender and game engines. ' +
            'Surfaces are cleaner after training with the preset surface.',
        ),
        el('div.buttons', {}, button('Write a mesh', writeMesh)),
      ),
      list.node,
    ),
    update: list.update,
  };
}
