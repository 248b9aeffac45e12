// SPDX-License-Identifier: Apache-2.0
// The tool "Lasso": a closed line of clicks around what is to go or to stay, as this view shows it,
// and the file that `gemsplat edit --drop lasso=FILE` reads (docs/reference/edit.md).
import {el, segmented, svg} from '../../shared/dom.js';
import {row} from '../panels/parts.js';
import {cameraEntry, rowsOfPose} from '../picture/lens.js';
import {quoted, save} from './clipboard.js';

const FORMAT = 'gemsplat lasso',
  VERSION = 1;

export class LassoTool {
  title = 'Lasso';
  picks = true; // clicks into the picture are for this tool while it is open

  constructor(viewer) {
    this.viewer = viewer;
    this.line = []; // [x, y] in CSS pixels of the window
    this.drops = true;
    this.said = el('p.said', {'aria-live': 'polite'});
    this.command = el('code.command', {tabindex: '0'});
    const button = (text, onclick) => el('button.button', {type: 'button', onclick}, text);
    this.saveButton = button('Save lasso.json', () =>
      save(new Blob([JSON.stringify(this.file)], {type: 'application/json'}), 'lasso.json'),
    );
    const choose = what => {
      this.drops = what === 'drop';
      this.tell();
    };
    this.node = el(
      'div.tool',
      {},
      row(
        'Inside',
        segmented(
          'inside of the lasso',
          [
            ['keep', 'Keep'],
            ['drop', 'Drop'],
          ],
          'drop',
          choose,
        ),
      ),
      this.said,
      el(
        'div.row.buttons',
        {},
        button('Undo', () => this.set(this.line.slice(0, -1))),
        button('Clear', () => this.set([])),
        this.saveButton,
      ),
      this.command,
    );
    this.tell();
  }

  // The view in which the line was drawn: another one does not show it.
  get place() {
    const {stage} = this.viewer;
    return JSON.stringify([rowsOfPose(stage.pose), stage.lens()]);
  }
  pick(x, y) {
    const isElsewhere = this.line.length > 0 && this.place !== this.drawnAt;
    this.set([...(isElsewhere ? [] : this.line), [x, y]]);
  }
  set(line) {
    const {stage} = this.viewer;
    this.line = line;
    this.drawnAt = this.place;
    this.view = {pose: stage.pose, lens: stage.lens()};
    this.tell();
    stage.request();
  }
  get isClosed() {
    return this.line.length > 2;
  }
  /// The words of the operation for a file of this name; null as long as there is no line.
  operation(file) {
    return this.isClosed ? `--${this.drops ? 'drop' : 'keep'} lasso=${file}` : null;
  }

  tell() {
    const {scene} = this.viewer;
    this.saveButton.disabled = this.command.hidden = !this.isClosed;
    this.said.textContent = this.isClosed
      ? 'What lies behind it counts, too: turn the view where that matters.'
      : 'Click corners of a line around Gaussians; the first and the last are joined.';
    this.command.textContent = `gemsplat edit ${quoted(scene.path ?? scene.title)} ${this.operation('lasso.json')} -o edited.ply`;
  }

  /// What `gemsplat edit --drop lasso=FILE` reads.
  get file() {
    const camera = cameraEntry(0, 'lasso', this.view.pose, this.view.lens);
    return {format: FORMAT, version: VERSION, camera, line: this.line};
  }

  draw() {
    if (!this.line.length || this.place !== this.drawnAt) return [];
    const points = this.line.map(at => at.join()).join(' ');
    return [
      svg('polygon', {points, class: 'lasso under'}),
      svg('polygon', {points, class: 'lasso'}),
      ...this.line.map(([cx, cy]) => svg('circle', {cx, cy, r: 4, class: 'path-dot'})),
    ];
  }
}
