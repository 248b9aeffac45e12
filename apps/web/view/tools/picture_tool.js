// SPDX-License-Identifier: Apache-2.0
// The tool "Picture": screenshots, the address of this view, and the PSNR of a camera's picture.
import {el} from '../../shared/dom.js';
import {fixed} from '../../shared/format.js';
import {row} from '../panels/parts.js';
import {copyButton, save} from './clipboard.js';
import {psnrOf, screenshot} from './picture.js';

export class PictureTool {
  title = 'Picture';

  constructor(viewer) {
    this.viewer = viewer;
    const {stage} = viewer;
    const take = times => () => this.take(times).catch(error => viewer.messages.fail(error));
    this.said = el('span.said', {'aria-live': 'polite'});
    this.psnr = el(
      'button.button',
      {
        type: 'button',
        title: 'M',
        onclick: () => this.measure().catch(error => viewer.messages.fail(error)),
      },
      'PSNR against the photo',
    );
    this.node = el(
      'div.tool',
      {},
      row(
        'Screenshot',
        el(
          'span.pair',
          {},
          el('button.button', {type: 'button', title: 'K', onclick: take(1)}, 'PNG'),
          el('button.button', {type: 'button', onclick: take(2)}, 'PNG, twice as large'),
        ),
      ),
      row(
        'This view',
        copyButton(
          'Copy its address',
          () => `${location.href.split('#')[0]}#${viewer.address.text}`,
        ),
      ),
      !stage.isRemote && row('This camera', this.psnr),
      this.said,
    );
    this.show(null);
  }

  // camera: of whose photo this exactly is the view, or null
  show(camera) {
    if (camera === this.camera) return;
    this.camera = camera;
    this.psnr.disabled = !camera?.photo;
    this.said.textContent =
      camera?.photo || this.viewer.stage.isRemote
        ? ''
        : 'PSNR needs the view of a camera with a photo.';
  }

  async take(times) {
    save(await screenshot(this.viewer.stage, times), `${this.viewer.scene.title}.png`);
  }

  async measure() {
    const {camera} = this;
    if (!camera?.photo) return;
    this.said.textContent = 'measuring';
    const dB = await psnrOf(this.viewer.stage, camera);
    if (camera !== this.camera) return;
    this.said.textContent = `${camera.name}: ${fixed(dB, 2)} dB`;
  }

  draw() {
    return [];
  }
}
