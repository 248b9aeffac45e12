// SPDX-License-Identifier: Apache-2.0
// The tool "Path": key frames set from the view, a preview, and the file that `gemsplat render
// --path FILE` reads (docs/reference/rendering.md).
import {Vector3} from 'three';
import {el, segmented} from '../../shared/dom.js';
import {fixed} from '../../shared/format.js';
import {cameraEntry} from '../picture/lens.js';
import {iconButton, row, toggleSwitch} from '../panels/parts.js';
import {Spline} from '../spline.js';
import {quoted, save} from './clipboard.js';

const DRAWN = 96; // points of the line
const SECONDS_PER_KEY = 3; // where nobody has said how long the path takes
const FORMAT = 'gemsplat key frames',
  VERSION = 1;

export class PathTool {
  title = 'Path';

  constructor(viewer) {
    this.viewer = viewer;
    this.keys = []; // {pose: {position, quaternion}, lens, time}
    this.isClosed = false;
    this.pace = 'even';
    this.list = el('ol.keys');
    this.said = el('p.said', {'aria-live': 'polite'});
    this.seconds = el('input', {
      type: 'number',
      min: 0.1,
      max: 86400,
      step: 0.1,
      'aria-label': 'seconds of the path',
      onchange: () => {
        this.hasSeconds = true;
        this.changed();
      },
    });
    this.command = el('code.command', {tabindex: '0'});
    const button = (text, onclick) => el('button.button', {type: 'button', onclick}, text);
    this.play = button('Preview', () => (this.isPlaying ? this.stop() : this.start()));
    this.saveButton = button('Save path.json', () => this.save());
    this.node = el(
      'div.tool',
      {},
      el(
        'div.row.buttons',
        {},
        el(
          'button.button',
          {type: 'button', title: 'V', onclick: () => this.add()},
          'Add this view',
        ),
        this.play,
        this.saveButton,
      ),
      this.list,
      row('Seconds', this.seconds),
      row(
        'Pace',
        segmented(
          'pace',
          [
            ['even', 'Even'],
            ['keys', 'By keys'],
          ],
          'even',
          pace => {
            this.pace = pace;
            this.changed();
          },
        ),
      ),
      row(
        'Closed',
        toggleSwitch('closed path', false, on => {
          this.isClosed = on;
          this.changed();
        }).button,
      ),
      this.said,
      this.command,
    );
    this.changed();
  }

  add() {
    const {stage, rig, player} = this.viewer;
    this.keys.push({pose: stage.pose, lens: {...rig.lens}, time: player?.time ?? null});
    this.changed();
  }
  replace(index) {
    const {stage, rig, player} = this.viewer;
    this.keys[index] = {pose: stage.pose, lens: {...rig.lens}, time: player?.time ?? null};
    this.changed();
  }
  remove(index) {
    this.keys.splice(index, 1);
    this.changed();
  }
  move(index, by) {
    const [key] = this.keys.splice(index, 1);
    this.keys.splice(index + by, 0, key);
    this.changed();
  }

  changed() {
    this.stop();
    this.spline =
      this.keys.length > 1
        ? new Spline(
            this.keys.map(({pose}) => pose),
            this.isClosed,
          )
        : null;
    if (this.spline && this.spline.end === 0) this.spline = null;
    if (!this.hasSeconds)
      this.seconds.value =
        SECONDS_PER_KEY * Math.max(1, this.keys.length - (this.isClosed ? 0 : 1));
    this.play.disabled = this.saveButton.disabled = !this.spline;
    this.said.textContent = this.spline
      ? ''
      : this.keys.length > 1
        ? 'All keys are at the same place.'
        : 'A path needs two views or more.';
    this.command.hidden = !this.spline;
    this.command.textContent = `gemsplat render ${quoted(this.viewer.scene.path ?? this.viewer.scene.title)} --path path.json -o film.mp4`;
    this.showKeys();
    this.viewer.stage.request();
  }

  showKeys() {
    const last = this.keys.length - 1;
    this.list.replaceChildren(
      ...this.keys.map(({time}, i) =>
        el(
          'li',
          {},
          el(
            'button.key-name',
            {type: 'button', title: 'go there', onclick: () => this.go(i)},
            `View ${i + 1}${time === null ? '' : ` at ${fixed(time, 2)}`}`,
          ),
          iconButton('up', `move view ${i + 1} up`, () => this.move(i, -1), {disabled: i === 0}),
          iconButton('reset', `set view ${i + 1} to what is shown now`, () => this.replace(i)),
          iconButton('close', `remove view ${i + 1}`, () => this.remove(i)),
        ),
      ),
    );
    this.list.hidden = last < 0;
  }

  go(index) {
    const {rig} = this.viewer,
      {pose, lens, time} = this.keys[index];
    this.viewer.address.leave();
    if (time !== null) this.viewer.player?.seek(time);
    rig.go({
      position: pose.position.clone(),
      quaternion: pose.quaternion.clone(),
      lens,
      target: this.ahead(pose),
    });
  }
  // The center of orbits stays as far ahead as it is.
  ahead({position, quaternion}) {
    return position
      .clone()
      .addScaledVector(new Vector3(0, 0, -1).applyQuaternion(quaternion), this.viewer.rig.distance);
  }

  get length() {
    return Math.max(0.1, Number(this.seconds.value) || SECONDS_PER_KEY);
  }

  start() {
    if (!this.spline) return;
    this.isPlaying = true;
    this.since = performance.now();
    this.play.textContent = 'Stop';
    this.viewer.stage.request();
  }
  stop() {
    this.isPlaying = false;
    this.play.textContent = 'Preview';
  }
  opened() {
    this.isOpen = true;
  }
  closed() {
    this.isOpen = false;
    this.stop();
  }

  /// Goes on with the preview in each frame; true while it plays.
  step(now) {
    if (!this.isPlaying) return false;
    const share = Math.max(0, now - this.since) / 1000 / this.length,
      pose = this.spline.along(share, this.pace);
    const first = this.keys[0],
      last = this.keys.at(-1);
    this.viewer.rig.arrive({...pose, lens: first.lens, target: this.ahead(pose)});
    if (first.time !== null)
      this.viewer.player?.seek(first.time + (last.time - first.time) * Math.min(1, share));
    if (share >= 1) this.stop();
    return this.isPlaying;
  }

  /// What `gemsplat render --path FILE` reads.
  get file() {
    const keys = this.keys.map(({pose, lens, time}, i) => ({
      ...cameraEntry(i, `key ${i + 1}`, pose, lens),
      ...(time === null ? {} : {time}),
    }));
    return {
      format: FORMAT,
      version: VERSION,
      closed: this.isClosed,
      pace: this.pace,
      seconds: this.length,
      keys,
    };
  }
  save() {
    save(
      new Blob([`${JSON.stringify(this.file, null, 1)}\n`], {type: 'application/json'}),
      'path.json',
    );
  }

  draw(overlay) {
    if (!this.isOpen || !this.spline || this.isPlaying) return [];
    const points = Array.from(
      {length: DRAWN + 1},
      (_, i) => this.spline.along(i / DRAWN, 'even').position,
    );
    return [
      ...points
        .slice(1)
        .flatMap((point, i) => overlay.line(points[i], point, {class: 'path-line'})),
      ...this.keys.flatMap(({pose}, i) => [
        ...overlay.circle(pose.position, 4, {class: 'path-dot'}),
        ...overlay.words(pose.position, String(i + 1), {dy: -8}),
      ]),
    ];
  }
}
