// SPDX-License-Identifier: Apache-2.0
// The viewer as a whole: it owns the stage, the cameras, the comparison and the panels, and
// connects them. Start reading here; main.js makes one of these.
import {Quaternion, Vector3} from 'three';
import {el} from '../shared/dom.js';
import {isNumber} from '../shared/format.js';
import {Address, viewOf} from './address.js';
import {CameraList, cameraBar} from './panels/camera_list.js';
import {Compare} from './panels/compare.js';
import {Controls} from './controls.js';
import {helpDialog} from './panels/help.js';
import {bindKeys} from './keys.js';
import {lensOf, plainLens, poseFromRows} from './picture/lens.js';
import {Live} from './panels/live.js';
import {Messages} from './panels/messages.js';
import {modelFacts} from './panels/model_panel.js';
import {Overlay} from './picture/overlay.js';
import {iconButton, panel} from './panels/parts.js';
import {Player} from './panels/player.js';
import {Rig} from './rig.js';
import {takeToken} from './panels/run_buttons.js';
import {askForMesh, askForModel, askForScene, modelAddress} from './server.js';
import {settings} from './panels/settings.js';
import {Stage} from './picture/stage.js';
import {Switches} from './switches.js';
import {Turn} from './turn.js';
import {makeTools, ToolPanel} from './tools/tool_panel.js';

const FIELD_OF_VIEW = 60; // degrees, where there is no camera to take it from
// CSS pixels of page.css: the head or bar with a gap on both sides.
const HEAD = 70,
  HEAD_NARROW = 62,
  BAR_NARROW = 104,
  TIME_BAR = 50;
// CSS pixels: a narrower page has one column for all panels, and they start closed.
const NARROW = 720;

export class Viewer {
  constructor(app, scene) {
    this.app = app;
    app.viewer = this;
    this.scene = scene;
    this.center = new Vector3(...scene.center);
    this.rig = new Rig(() => {
      this.stage.touch();
      this.address.note();
    });
    this.rig.up.set(...scene.up).normalize();
    this.rig.target.copy(this.center);
    this.rig.lens = scene.cameras.length
      ? lensOf(scene.cameras[0])
      : plainLens(innerWidth, innerHeight, FIELD_OF_VIEW);
    this.messages = new Messages();
    this.stage = new Stage(scene, this.rig, {
      step: seconds => this.step(seconds),
      drawn: view => this.drawn(view),
      marginsOf: () => this.margins(),
      failed: error => this.messages.fail(error),
    });
    this.controls = new Controls(this.stage.canvas, this.rig, scene.radius, {
      hover: (x, y) => this.hover(x, y),
      click: (x, y) => this.click(x, y),
      double: (x, y) => this.orbitAround(x, y),
      wake: () => this.stage.request(),
      focal: () => this.stage.lens().fx,
      brush: () => this.toolPanel.picker?.brush ?? null,
    });
    this.compare = new Compare(this.stage.isRemote);
    this.list = new CameraList(scene.cameras, {
      go: index => this.goTo(index),
      mark: index => this.mark(index),
    });
    this.bar = cameraBar(
      scene.cameras,
      {step: by => this.stepCamera(by), nearest: () => this.goToNearest()},
      this.compare.controls,
    );
    if (scene.moves)
      this.player = new Player({
        time: scene.time ?? (scene.mode === 'live' ? 0.5 : 0),
        show: time => this.stage.setTime(time),
        wake: () => this.stage.request(),
      });
    this.facts = modelFacts(this);
    this.help = helpDialog(scene);
    this.address = new Address(this, options => this.show(options));
    this.hasLooks = scene.cameras.some(camera => camera.look);
    this.hasMesh = Boolean(scene.mesh) && !this.stage.isRemote;
    this.switches = new Switches(this, () => {
      this.settings.sync();
      this.address.note();
    });
    this.settings = settings(this);
    this.overlay = new Overlay(scene.radius);
    this.tools = makeTools(this);
    this.toolPanel = new ToolPanel(Object.values(this.tools), this.overlay, () =>
      this.stage.request(),
    );
    this.makePanels();
    this.compose();
    bindKeys(this);
  }

  makePanels() {
    const title = this.scene.mode === 'live' ? 'Training' : 'Model';
    const make = (name, title, body) =>
      panel(name, title, body, open => {
        if (name === 'tools') this.toolPanel.show(open);
        if (open) this.opened(name);
      });
    this.panels = {}; // in the order of their buttons; visitors of an exported page have none
    if (this.scene.visitors) return;
    this.panels.model = make('model', title, this.modelBody());
    if (this.scene.cameras.length) this.panels.cameras = make('cameras', 'Cameras', this.list.node);
    this.panels.tools = make('tools', 'Tools', this.toolPanel.node);
    this.panels.settings = make('settings', 'Settings', this.settings.node);
    matchMedia(`(max-width: ${NARROW - 1}px)`).addEventListener('change', () =>
      this.opened(this.lastOpened),
    );
  }

  // Closes the panels that share a column of the page with the one that has just opened.
  opened(name) {
    if (!this.panels[name]?.isOpen) return;
    const columns =
      innerWidth < NARROW
        ? {}
        : {model: 'left', settings: 'right', cameras: 'right', tools: 'right'};
    for (const [other, each] of Object.entries(this.panels))
      if (other !== name && columns[other] === columns[name]) each.toggle(false);
    this.lastOpened = name;
    if (name === 'settings') this.settings.sync();
  }

  modelBody() {
    if (this.scene.mode !== 'live') return this.facts.node;
    this.live = new Live({
      token: takeToken(),
      snapshot: state => this.takeSnapshot(state),
      failed: error => this.messages.trouble('live', error),
    });
    return [this.live.node, this.facts.node];
  }

  compose() {
    const full = iconButton('full', 'full screen', () =>
      document.fullscreenElement ? document.exitFullscreen() : this.app.requestFullscreen(),
    );
    this.mat = el('div.mat', {'aria-hidden': 'true'});
    const buttons = Object.values(this.panels).map(each => each.button);
    this.head = el(
      'header.head',
      {},
      el(
        'div.title-card',
        {},
        el('span.mark', {'aria-hidden': 'true'}),
        el(
          'div.title-text',
          {},
          el('span.brand', {}, 'gemsplat'),
          el('h1', {title: this.scene.title}, this.scene.title),
        ),
      ),
      el(
        'div.tools',
        {role: 'toolbar', 'aria-label': 'panels'},
        buttons,
        iconButton('reset', 'reset view (R)', () => this.reset()),
        iconButton('help', 'mouse, fingers and keys (?)', () => this.help.showModal()),
        document.fullscreenEnabled && full,
      ),
    );
    this.app.replaceChildren(
      this.stage.node,
      this.mat,
      this.compare.node,
      this.overlay.node,
      el(
        'div.interface',
        {onclick: releaseFocus},
        this.head,
        Object.values(this.panels).map(each => each.node),
        el('div.bottom', {}, this.player?.node, !this.scene.visitors && this.bar.node),
        this.messages.node,
      ),
      this.help,
    );
  }

  async start(options) {
    this.setInterface(options.get('ui') !== '0');
    if (this.player) this.startPlayer(options);
    this.stage.resize();
    this.show(options, {jump: true});
    if (innerWidth >= NARROW) this.panels.model?.toggle(true);
    if (Turn.isWanted(this.scene, options)) this.turn = new Turn(this.scene, this.rig, this.stage);
    for (const note of this.scene.notes ?? []) this.messages.add(note);
    this.address.isOn = true;
    if (this.live) this.live.start();
    else if (!this.stage.isRemote) await this.load(0);
  }

  // Shows what an address says: switches, time and place.
  show(options, how) {
    this.switches.read(options);
    const time = Number.parseFloat(options.get('t')),
      view = viewOf(options, this.scene.cameras);
    if (this.player && Number.isFinite(time)) this.player.seek(time);
    if (!view) return this.place(how);
    if (view.camera !== undefined) return this.fly(view.camera, how);
    const {position, quaternion, target, lens} = view;
    this.rig.go(
      {position: new Vector3(...position), quaternion: new Quaternion(...quaternion), target, lens},
      how,
    );
  }

  // The scene plays, unless the program or the address named a time, the user wants little motion,
  // or the model is one that trains.
  startPlayer(options) {
    const isStill =
      options.has('t') ||
      isNumber(this.scene.time) ||
      this.scene.mode === 'live' ||
      matchMedia('(prefers-reduced-motion: reduce)').matches;
    if (this.stage.isRemote) this.player.take({duration: 0, loaded: 1});
    this.player.play(options.has('play') ? options.get('play') !== '0' : !isStill);
  }

  // The first view: where the first camera stood, upright if the way up is known; without cameras,
  // one that has the whole model in front of it, or the place inside that the server names.
  reset(options) {
    this.address.leave();
    this.place(options);
  }
  place(options) {
    const [first] = this.scene.cameras;
    if (!first) {
      const {radius, eye} = this.scene,
        lens = plainLens(this.stage.width, this.stage.height, FIELD_OF_VIEW);
      return this.rig.goInFrontOf(
        this.center,
        radius,
        eye ? new Vector3(...eye) : null,
        lens,
        options,
      );
    }
    if (this.scene.up_is_known === false)
      return this.rig.goToCamera(first, null, this.center, options);
    this.rig.goLevelTo(first, this.center, options);
  }

  async load(version) {
    const bar = this.messages.progress(this.stage.splats.gaussians ? null : 'Loading the model');
    try {
      const isStreamed = this.scene.model.format === 'rad';
      const read = isStreamed
        ? {address: modelAddress(version)}
        : await askForModel(version, this.scene.model.bytes, share => bar.set(share));
      await this.stage.splats.load(this.scene.model, read, played => this.player.take(played));
      this.facts.show();
      await this.stage.shown();
    } catch (error) {
      throw new Error(`The model cannot be shown: ${error.message ?? error}`);
    } finally {
      bar.end();
    }
  }

  // The mesh is fetched when it is first wanted.
  async showMesh(share) {
    this.stage.mesh.setShare(share);
    if (share === 0 || this.meshAsked) return;
    this.meshAsked = true;
    const bar = this.messages.progress('Loading the mesh');
    try {
      await this.stage.mesh.load(await askForMesh());
    } catch (error) {
      this.meshAsked = false;
      this.messages.fail(new Error(`The mesh cannot be shown: ${error.message ?? error}`));
    } finally {
      bar.end();
    }
  }

  // Shows a newer model of a run. Returns whether that worked.
  async takeSnapshot(state) {
    let trouble = null;
    try {
      this.scene.model = (await askForScene()).model;
      await this.load(state.version);
    } catch (error) {
      trouble = error;
    }
    this.messages.trouble('snapshot', trouble);
    return trouble === null;
  }

  step(seconds) {
    this.controls.step(seconds);
    this.turn?.step(seconds);
    this.player?.step(performance.now());
    return (
      this.tools.path.step(performance.now()) ||
      this.controls.isHeld ||
      Boolean(this.turn?.isOn) ||
      Boolean(this.player?.isPlaying)
    );
  }

  drawn(view) {
    const camera = this.scene.cameras[view.at] ?? null,
      place = view.lens.picture;
    this.mat.classList.toggle('is-on', camera !== null);
    for (const side of ['left', 'top', 'width', 'height'])
      this.mat.style[side] = `${place[side]}px`;
    this.compare.show(camera, place);
    this.overlay.draw(view);
    this.facts.frame();
    if (view.at === this.shownAt) return;
    this.shownAt = view.at;
    this.bar.show(view.at);
    this.tools.picture.show(camera);
    this.showColors(this.switches.get('colors'));
    if (camera) this.list.select(view.at);
  }

  goTo(index, options) {
    if (!this.scene.cameras[index]) return;
    this.address.leave();
    this.fly(index, options);
  }
  fly(index, options) {
    const camera = this.scene.cameras[index];
    this.current = index;
    this.stage.frusta?.hide(index);
    this.rig.goToCamera(camera, index, this.center, options);
  }

  stepCamera(by) {
    const index = this.list.neighbor(this.current ?? -1, by);
    if (index !== null) this.goTo(index);
  }

  goToNearest() {
    const {cameras} = this.scene,
      ahead = this.rig.axis(0, 0, -1);
    let best = null,
      least = Infinity;
    cameras.forEach((camera, i) => {
      const m = camera.world_from_camera,
        center = new Vector3(m[3], m[7], m[11]);
      const far =
        center.distanceTo(this.rig.position) / this.scene.radius +
        1 -
        ahead.dot(new Vector3(m[2], m[6], m[10]));
      if (far < least) [best, least] = [i, far];
    });
    if (best !== null) this.goTo(best);
  }

  setPose({world_from_camera: rows, lens}) {
    const pose = poseFromRows(rows),
      ahead = new Vector3(0, 0, -1).applyQuaternion(pose.quaternion);
    const target = pose.position.clone().addScaledVector(ahead, this.rig.distance);
    this.rig.arrive({...pose, target, lens: lens ? lensOf(lens) : this.rig.lens});
  }

  orbitAround(x, y) {
    // Where no Gaussian is hit, the point at the depth of the target.
    this.rig.setTarget(this.stage.pointAt(x, y) ?? this.stage.worldAt(x, y, this.rig.distance));
  }

  cameraAt(x, y) {
    return this.stage.frusta?.pick(x, y, this.stage.pose, this.stage.lens()) ?? null;
  }
  mark(index) {
    if (this.stage.frusta?.setMarked(index)) this.stage.request();
  }
  hover(x, y) {
    const index = x === null ? null : this.cameraAt(x, y);
    this.mark(index);
    this.stage.canvas.style.cursor = index === null ? '' : 'pointer';
    this.stage.canvas.title = index === null ? '' : this.scene.cameras[index].name;
  }
  click(x, y) {
    if (this.toolPanel.picker) return this.toolPanel.picker.pick(x, y);
    const index = this.cameraAt(x, y);
    if (index !== null) this.goTo(index);
  }

  // The colors of the scene, or those of the photo that was shown last.
  showColors(colors) {
    const index = this.shownAt ?? this.current ?? 0,
      look = colors === 'photo' ? (this.scene.cameras[index]?.look ?? null) : null;
    if (!this.stage.isRemote) return this.stage.splats.setLook(look);
    const wanted = look ? index : null;
    if (this.stage.frames.look === wanted) return;
    this.stage.frames.look = wanted;
    this.stage.touch();
  }
  flipUp() {
    this.switches.set('up', this.switches.get('up') === 'up' ? 'down' : 'up');
    this.rig.level();
  }
  fieldOfView() {
    const {lens} = this.rig;
    return (
      (2 * Math.atan(Math.min(lens.width / lens.fx, lens.height / lens.fy) / 2) * 180) / Math.PI
    );
  }
  widen(degrees) {
    this.rig.lens = plainLens(this.stage.width, this.stage.height, degrees);
    this.rig.moved();
  }

  setInterface(shown) {
    this.app.classList.toggle('is-bare', !shown);
    this.isBare = !shown;
    this.address.note();
    if (this.stage.frusta) this.stage.frusta.isSuppressed = !shown;
    this.stage.resize();
  }

  // What the head and the camera bar cover of the window, in CSS pixels; a camera's picture lies
  // between them. The bar counts as if it always offered the comparison, so that the picture does
  // not jump from camera to camera.
  margins() {
    if (this.isBare) return {above: 0, below: 0};
    const hasPhotos = this.scene.cameras.some(camera => camera.photo),
      time = this.player ? TIME_BAR : 0;
    if (this.scene.visitors) return {above: 0, below: 0};
    return innerWidth < NARROW
      ? {above: HEAD_NARROW, below: (hasPhotos ? BAR_NARROW : HEAD_NARROW) + time}
      : {above: HEAD, below: HEAD + time};
  }

  state() {
    const {rig, stage} = this;
    return {
      mode: this.scene.mode,
      camera: rig.at,
      gaussians: stage.splats?.gaussians ?? this.scene.model?.gaussians ?? null,
      position: rig.position.toArray(),
      quaternion: rig.quaternion.toArray(),
      target: rig.target.toArray(),
      lens: {...rig.lens},
      version: this.live?.version ?? null,
      compare: this.compare.mode,
      time: this.player?.time ?? null,
      isPlaying: this.player?.isPlaying ?? null,
      loaded: this.player?.loaded ?? null,
      latency: stage.frames?.latency ?? null,
    };
  }
}

// A button that was pressed with a pointer loses the focus, so that keys go to the picture again.
function releaseFocus(event) {
  if (event.detail > 0) event.target.closest('button')?.blur();
}
