// SPDX-License-Identifier: Apache-2.0
// The screen "Film": paths of the camera, key frames of the viewer's tool, and the films.
import {el} from '../shared/dom.js';
import {currentModel, modelWords, noModel, viewOfModel} from './frame.js';
import {button, jobList, saveLink} from './jobs.js';

const ALL_AROUND = '3840x1920'; // of a film to look around in
const SIZES = ['1280x720', '1920x1080', '1080x1920', '3840x2160', '640x360', ALL_AROUND];
const sizeWords = text => {
  const [width, height] = text.split('x').map(Number);
  const more = text === ALL_AROUND ? ', 360 degrees' : height > width ? ', upright' : '';
  return `${width} × ${height}${more}`;
};

export function showFilm(app) {
  const {details} = app,
    current = currentModel(details);
  if (!current) return noModel(app);
  const view = viewOfModel(app, current);
  const seconds = el('input', {
      type: 'number',
      id: 'seconds',
      min: 0.5,
      max: 600,
      step: 0.5,
      value: 8,
    }),
    size = el(
      'select',
      {id: 'size'},
      SIZES.map(text => el('option', {value: text}, sizeWords(text))),
    ),
    fps = el('input', {type: 'number', id: 'fps', min: 1, max: 120, value: 30});
  const render = (path, more = []) =>
    app.act(server =>
      server.run([
        'render',
        ...modelWords(details, current),
        '--path',
        path,
        '-o',
        'films/{id}.mp4',
        '--size',
        size.value,
        '--fps',
        fps.value,
        ...(size.value === ALL_AROUND ? ['--lens', 'equirectangular'] : []),
        ...more,
      ]),
    );
  const length = () => ['--seconds', seconds.value];
  const filmKeys = async () => {
    const path = await (await view.viewer()).path();
    if (!path) throw new Error('A path needs two views or more: add them in the picture first.');
    await render(await app.server.keep('path', path));
  };
  const field = (label, input) => el('label.field', {for: input.id}, el('span', {}, label), input);
  const list = jobList(
    app,
    ['render'],
    job => `Film ${job.id}`,
    ({output}) =>
      output?.endsWith('.mp4') &&
      el(
        'div',
        {},
        el('video', {
          src: app.server.file(output),
          controls: true,
          playsinline: true,
          preload: 'metadata',
        }),
        saveLink(app, output, 'a.button'),
      ),
  );
  return {
    view,
    side: el(
      'div.side',
      {},
      el(
        'section.card',
        {},
        el('h2', {}, 'Film'),
        el(
          'div.fields',
          {},
          field('Seconds', seconds),
          field('Size', size),
          field('Pictures a second', fps),
        ),
        el(
          'div.buttons',
          {},
          button('Circle around', () => render('orbit', length()), 'primary'),
          button('Fly along the photos', () => render('flythrough', length())),
        ),
      ),
      el(
        'section.card',
        {},
        el('h2', {}, 'Your own path'),
        el(
          'p.muted',
          {},
          'Move the picture, press “Add this view” in its tool Path, and repeat. “Preview” flies along.',
        ),
        el(
          'div.buttons',
          {},
          button('Show the tool', async () => (await view.viewer()).openTool('Path')),
          button('Film this path', () => filmKeys().catch(app.fail), 'primary'),
        ),
      ),
      list.node,
    ),
    update: list.update,
  };
}
