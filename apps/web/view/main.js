// SPDX-License-Identifier: Apache-2.0
// Entry point of the viewer: asks the server for the scene (docs/reference/viewer_http.md) and
// builds the page, or says why that failed.
import {el} from '../shared/dom.js';
import {NO_SIZE} from './picture/shaders.js';
import {askForScene} from './server.js';
import {Viewer} from './viewer.js';

const app = document.getElementById('app');

async function start() {
  const scene = await askForScene();
  document.title = scene.visitors ? scene.title : `${scene.title} · gemsplat`;
  const viewer = new Viewer(app, scene);
  await viewer.start(new URLSearchParams(location.hash.slice(1)));
  return viewer;
}

const started = start();
// For tests and scripts: docs/reference/viewer.md.
window.gemsplatViewer = {
  ready: started.then(() => undefined),
  setCamera: async index => (await started).goTo(index, {jump: true}),
  setPose: async pose => (await started).setPose(pose),
  setTime: async time => (await started).player?.seek(time),
  play: async on => (await started).player?.play(on),
  setInterface: async shown => (await started).setInterface(shown),
  resize: async () => (await started).stage.resize(),
  settled: async () => (await started).stage.settled(),
  state: () => app.viewer?.state() ?? null,
  // For the studio (apps/web/studio), which shows this page in a frame.
  openTool: async title => {
    const {panels, toolPanel} = await started;
    panels.tools.toggle(true);
    toolPanel.open(title);
  },
  crop: async () => (await started).tools.crop?.region.operation ?? null,
  lasso: async () => {
    const {lasso} = (await started).tools;
    return lasso?.isClosed ? {file: lasso.file, drops: lasso.drops} : null;
  },
  // Takes back the last corner or stroke of the open tool; false: there is none.
  undo: async () => (await started).toolPanel.undo(),
  filter: async ({opacity = 0, size = NO_SIZE}) => {
    const {splats} = (await started).stage;
    splats.setEffect('filterOpacity', opacity);
    splats.setEffect('filterSize', size);
  },
  path: async () => {
    const {path} = (await started).tools;
    return path.spline ? path.file : null;
  },
};
started.catch(error => {
  app.replaceChildren(el('p.card.failure', {role: 'alert'}, error.message));
  console.warn(error);
});
