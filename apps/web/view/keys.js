// SPDX-License-Identifier: Apache-2.0
// Binds keys to actions. help.js lists them for people: change both together.

const OF_PAGES = ['r', 'l', 'u', 'o', 'h', '?', 'j', ',', '.', '[', ']', 'Home', 'End'];  // for visitors, too

export function bindKeys(viewer) {
  const {panels, rig, controls, compare, player, switches, tools, scene} = viewer;
  const actions = {
    ArrowLeft: () => viewer.stepCamera(-1), ArrowRight: () => viewer.stepCamera(1), n: () => viewer.goToNearest(),
    f: () => switches.set('frusta', !switches.get('frusta')), c: () => compare.next(), g: () => panels.cameras?.toggle(), p: () => panels.settings.toggle(),
    i: () => panels.model.toggle(), h: () => viewer.setInterface(viewer.isBare), r: () => viewer.reset(), l: () => rig.level(), u: () => viewer.flipUp(),
    o: () => switches.set('navigation', switches.get('navigation') === 'orbit' ? 'fly' : 'orbit'), '?': () => viewer.help.showModal(),
    1: () => switches.set('show', 'color'), 2: () => switches.set('show', 'depth'), 3: () => switches.set('show', 'normal'),
    4: () => viewer.hasLooks && switches.set('colors', switches.get('colors') === 'photo' ? 'neutral' : 'photo'),
    5: () => switches.set('points', switches.get('points') ? 0 : 2),
    t: () => panels.tools.toggle(), k: () => tools.picture.take(1).catch(error => viewer.messages.fail(error)), m: () => { panels.tools.toggle(true); viewer.toolPanel.open('Picture'); tools.picture.measure().catch(error => viewer.messages.fail(error)); }, v: () => viewer.tools.path.add(),
    j: () => player?.setLoop(!player.loops), ',': () => player?.nudge(-1), '.': () => player?.nudge(1),
    '[': () => player?.changeSpeed(-1), ']': () => player?.changeSpeed(1), Home: () => player?.seek(0), End: () => player?.seek(1),
    Escape: () => Object.values(panels).forEach(panel => panel.toggle(false)),
  };
  const types = target => target.closest?.('input:not([type=range]), select, textarea, dialog') !== null;
  addEventListener('keydown', event => {
    if (event.ctrlKey || event.metaKey || types(event.target)) return;
    const isFlip = event.key.toLowerCase() === 'x' || event.key === ' ' && !player;
    if (isFlip && !event.target.closest?.('button')) {
      compare.flip(true);
      return event.preventDefault();
    }
    if (event.key === ' ' && !event.target.closest?.('button')) {
      if (!event.repeat) player.toggle();
      return event.preventDefault();
    }
    if (controls.press(event)) return event.preventDefault();
    const ranges = event.target.closest?.('input[type=range]') && event.key.startsWith('Arrow');
    const steps = [',', '.'].includes(event.key);
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const act = !scene.visitors || OF_PAGES.includes(key) ? actions[key] : null;
    if (!act || event.repeat && !steps && !event.key.startsWith('Arrow') || ranges || event.altKey) return;
    event.preventDefault();
    act();
  });
  addEventListener('keyup', event => {
    controls.release(event);
    if ([' ', 'x', 'X'].includes(event.key)) compare.flip(false);
  });
}
