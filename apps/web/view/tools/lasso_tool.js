// SPDX-License-Identifier: Apache-2.0
// The tool "Lasso": a closed line of clicks around what is to go or to stay, or a brush over it, as
// this view shows it, and the file that `gemsplat edit --drop lasso=FILE` reads
// (docs/reference/edit.md).
import {el, segmented, svg} from '../../shared/dom.js';
import {row} from '../panels/parts.js';
import {cameraEntry, rowsOfPose} from '../picture/lens.js';
import {quoted, save} from './clipboard.js';

const FORMAT = 'gemsplat lasso',
  VERSION = 1;
const RADII = [6, 16, 40]; // of brushes, CSS pixels

export class LassoTool {
  title = 'Lasso';
  picks = true; // clicks into the picture are for this tool while it is open

  constructor(viewer) {
    this.viewer = viewer;
    this.line = []; // [x, y] in CSS pixels of the window
    this.strokes = []; // of the brush, each a list of such points
    this.radius = 0; // of the brush, CSS pixels; 0: a line of clicks
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
    const chooseShape = shape => {
      this.radius = Number(shape);
      this.set([]);
    };
    this.node = el(
      'div.tool',
      {},
      row(
        'Shape',
        segmented(
          'shape of the lasso',
          [['0', 'Line'], ...RADII.map((r, i) => [String(r), `Brush ${'SML'[i]}`])],
          '0',
          chooseShape,
        ),
      ),
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
        button('Undo', () => this.undo()),
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
  get isElsewhere() {
    return this.place !== this.drawnAt;
  }
  pick(x, y) {
    if (!this.radius) this.set([...(this.isElsewhere ? [] : this.line), [x, y]]);
  }
  /// What the drags of one pointer are for while a brush is chosen.
  get brush() {
    return this.radius ? this : null;
  }
  begin(x, y) {
    this.set([], [...(this.isElsewhere ? [] : this.strokes), [[x, y]]]);
  }
  paint(x, y) {
    const stroke = this.strokes.at(-1),
      [lastX, lastY] = stroke.at(-1);
    if (Math.hypot(x - lastX, y - lastY) < this.radius / 4) return;
    stroke.push([x, y]);
    this.set([], this.strokes);
  }
  set(line, strokes = []) {
    const {stage} = this.viewer;
    Object.assign(this, {line, strokes});
    this.drawnAt = this.place;
    this.view = {pose: stage.pose, lens: stage.lens()};
    this.tell();
    stage.request();
  }
  /// Takes back the last corner or stroke; false: there is none.
  undo() {
    if (!this.line.length && !this.strokes.length) return false;
    this.set(this.line.slice(0, -1), this.strokes.slice(0, -1));
    return true;
  }
  get isClosed() {
    return this.line.length > 2 || this.strokes.length > 0;
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
      : this.radius
        ? 'Drag over Gaussians; the wheel, the right button and two fingers move the view.'
        : 'Click corners of a line around Gaussians; the first and the last are joined.';
    this.command.textContent = `gemsplat edit ${quoted(scene.path ?? scene.title)} ${this.operation('lasso.json')} -o edited.ply`;
  }

  /// What `gemsplat edit --drop lasso=FILE` reads.
  get file() {
    const camera = cameraEntry(0, 'lasso', this.view.pose, this.view.lens),
      {line, strokes, radius} = this;
    return {format: FORMAT, version: VERSION, camera, ...(radius ? {strokes, radius} : {line})};
  }

  draw() {
    if (this.isElsewhere) return [];
    const pointsOf = places => places.map(at => at.join()).join(' ');
    const painted = this.strokes.map(stroke =>
      svg('polyline', {
        points: pointsOf([stroke[0], ...stroke]), // a dot is a line of no length
        class: 'brush',
        'stroke-width': 2 * this.radius,
      }),
    );
    if (!this.line.length) return painted;
    const points = pointsOf(this.line);
    return [
      svg('polygon', {points, class: 'lasso under'}),
      svg('polygon', {points, class: 'lasso'}),
      ...this.line.map(([cx, cy]) => svg('circle', {cx, cy, r: 4, class: 'path-dot'})),
    ];
  }
}
