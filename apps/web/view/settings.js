// SPDX-License-Identifier: Apache-2.0
// The Settings panel.
import {el, segmented} from '../shared/dom.js';
import {row, slider, toggleSwitch} from './parts.js';

const GROUNDS = {black: [0, 0, 0], gray: [0.5, 0.5, 0.5], white: [1, 1, 1]};

/// viewer: what the settings change. Returns {node, sync}; sync() brings the controls up to date
/// after a key has changed a setting.
export function settings(viewer) {
  const {scene, stage, rig, controls} = viewer;
  const isRemote = stage.isRemote;
  const frusta = toggleSwitch('frusta of the cameras', true, on => viewer.showFrusta(on));
  const motion = segmented('navigation', [['orbit', 'Orbit'], ['fly', 'Fly']], controls.mode, mode => viewer.navigate(mode));
  const speed = slider('speed of flight', {min: -2, max: 2, step: 0.1, value: 0}, x => `×${(2 ** x).toPrecision(2)}`, x => { controls.speed = 2 ** x; });
  const field = slider('field of view', {min: 20, max: 110, step: 1, value: 60}, x => `${x}°`, degrees => viewer.widen(degrees));
  const picture = isRemote && segmented('picture', [['color', 'Color'], ['depth', 'Depth'], ['normal', 'Normals']], stage.frames.mode, mode => viewer.showFrames(mode));
  const degree = scene.model?.sh_degree ?? 3;
  const button = (text, title, onclick) => el('button.button', {type: 'button', title, onclick}, text);
  const node = el('div.settings', {}, [
    picture && row('Picture', picture),
    row('Navigation', motion),
    row('Flying', speed.node),
    row('Field of view', field.node),
    scene.cameras.length > 0 && stage.frusta && row('Frusta', el('span.pair', {}, el('span.key', {}, el('i.dot.train'), 'training', el('i.dot.test'), 'test'), frusta.button)),
    !isRemote && row('Background', segmented('background', [['scene', 'Scene'], ...Object.keys(GROUNDS).map(name => [name, name[0].toUpperCase() + name.slice(1)])], 'scene',
                                             name => stage.splats.setBackground(GROUNDS[name] ?? scene.background))),
    !isRemote && degree > 0 && row('SH degree', segmented('degree of spherical harmonics', [...Array(degree + 1).keys()].map(d => [String(d), String(d)]), String(degree),
                                                           d => stage.splats.setShDegree(Number(d)))),
    !isRemote && row('While moving', segmented('resolution while the view moves', [['auto', 'Fewer pixels'], ['full', 'All pixels']], 'auto', which => stage.setFullSize(which === 'full'))),
    el('div.row.buttons', {}, button('Reset view', 'R', () => viewer.reset()), button('Level', 'L', () => rig.level()), button('Flip up', 'U', () => viewer.flipUp())),
  ].filter(Boolean));
  const sync = () => {
    if (picture) picture.press(stage.frames.mode);
    motion.press(controls.mode);
    frusta.set(stage.frusta?.visible ?? false);
    field.set(Math.round(viewer.fieldOfView()));
  };
  return {node, sync};
}
