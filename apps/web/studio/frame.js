// SPDX-License-Identifier: Apache-2.0
// The viewer in a frame, and the versions of a model that it shows.
import {el} from '../shared/dom.js';

/// The words behind `gemsplat view`, or of another verb: the model, and the scene of a file, which does
/// not know it as a run does.
export const modelWords = (details, path) =>
  details.scene && modelAt(details, path)?.kind === 'file' ? [path, '-d', details.scene] : [path];

export const modelAt = (details, path) => details.models.find(model => model.path === path);

/// The version that is shown: the chosen one, or the newest.
export const currentModel = details =>
  modelAt(details, details.model) ? details.model : (details.models.at(-1)?.path ?? null);

/// A frame with the viewer of a model. `frame.viewer()` is what its page offers, when it is there;
/// keys(event) gets the keys pressed in it that it does not use.
export function viewFrame(address, title, keys) {
  const said = el('p.said', {'aria-live': 'polite'}, 'The viewer begins.'),
    frame = el('iframe', {title, allow: 'fullscreen'});
  frame.hidden = true;
  frame.addEventListener('load', () =>
    frame.contentWindow.addEventListener(
      'keydown',
      event => event.defaultPrevented || keys?.(event),
    ),
  );
  address.then(
    src => {
      said.remove();
      frame.hidden = false;
      frame.src = src;
    },
    error => {
      said.textContent = error.message;
    },
  );
  return {
    node: el('div.viewer', {}, said, frame),
    async viewer() {
      const {gemsplatViewer} = frame.contentWindow ?? {};
      if (!gemsplatViewer) throw new Error('The viewer is not there yet.');
      await gemsplatViewer.ready;
      return gemsplatViewer;
    },
  };
}

/// The frame of a model stays, with what people have set in it, as long as it is the same model.
export function viewOfModel(app, path) {
  const {time} = modelAt(app.details, path),
    key = `${app.id}/${path}/${time}`;
  if (app.view?.key !== key || !app.view.node.isConnected) {
    const address = app.server.view(modelWords(app.details, path), time);
    app.view = {key, ...viewFrame(address, `the model ${path}`, event => app.keys?.(event))};
  }
  return app.view;
}

/// What a screen shows that needs a model where there is none.
export const noModel = app => ({
  node: el(
    'main',
    {},
    el(
      'section.card',
      {},
      el('h2', {}, 'There is no model yet'),
      el('p', {}, 'Train one first, or drop one onto the screen Photos.'),
    ),
  ),
  update: () => {},
});
