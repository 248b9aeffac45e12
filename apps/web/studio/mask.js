// SPDX-License-Identifier: Apache-2.0
// A photo in a dialog, on which a brush hides parts from training and shows them again.
import {el, segmented} from '../shared/dom.js';
import {button} from './jobs.js';

const COLOR = '#e6195a'; // of hidden parts, while they are painted
const SIZES = {least: 8, first: 48, most: 240, step: 8}; // of the brush, thousandths of the longer side
const SHORTEST = 0.01; // pixels: a line of no length is not drawn, and a dot is a line
const WORDS =
  'Paint over what is not to be trained, such as people, your shadow or the sky. The photo stays as it is.';

const loaded = async src => {
  const image = el('img', {src, alt: '', draggable: 'false'});
  await image.decode().catch(() => {
    throw new Error('The photo cannot be shown.');
  });
  return image;
};
const canvasOf = ({width, height}) => Object.assign(el('canvas'), {width, height});

// A mask (white: trained) as what hides: COLOR, as opaque as the mask is dark.
function hiddenIn(mask, size) {
  const canvas = canvasOf(size),
    pen = canvas.getContext('2d');
  pen.drawImage(mask, 0, 0, size.width, size.height);
  const pixels = pen.getImageData(0, 0, size.width, size.height),
    [red, green, blue] = [1, 3, 5].map(at => parseInt(COLOR.slice(at, at + 2), 16));
  for (let i = 0; i < pixels.data.length; i += 4)
    pixels.data.set([red, green, blue, 255 - pixels.data[i]], i);
  pen.putImageData(pixels, 0, 0);
  return canvas;
}

// What is painted: strokes over the mask that was there.
class Painting {
  constructor(size, base) {
    this.canvas = canvasOf(size);
    this.canvas.tabIndex = 0;
    this.pen = this.canvas.getContext('2d');
    Object.assign(this.pen, {lineCap: 'round', lineJoin: 'round', strokeStyle: COLOR});
    this.base = base;
    this.strokes = []; // {shows, width, points}; without points everything is shown
    this.draw();
  }
  begin(stroke) {
    this.strokes.push(stroke);
    this.drawStroke(stroke);
  }
  paint(point) {
    const stroke = this.strokes.at(-1);
    stroke.points.push(point);
    this.drawStroke({...stroke, points: stroke.points.slice(-2)});
  }
  clear() {
    this.begin({});
  }
  undo() {
    this.strokes.pop();
    this.draw();
  }
  draw() {
    const {pen, canvas} = this;
    pen.clearRect(0, 0, canvas.width, canvas.height);
    if (this.base) pen.drawImage(this.base, 0, 0);
    for (const stroke of this.strokes) this.drawStroke(stroke);
  }
  drawStroke({shows, width, points}) {
    const {pen, canvas} = this;
    if (!points) return pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.globalCompositeOperation = shows ? 'destination-out' : 'source-over';
    pen.lineWidth = width;
    pen.beginPath();
    pen.moveTo(points[0][0] - SHORTEST, points[0][1]);
    for (const point of points) pen.lineTo(...point);
    pen.stroke();
    pen.globalCompositeOperation = 'source-over';
    return undefined;
  }
  /// The mask as a PNG: white where pixels train.
  png() {
    const canvas = canvasOf(this.canvas),
      pen = canvas.getContext('2d');
    const fill = (how, color) => {
      Object.assign(pen, {globalCompositeOperation: how, fillStyle: color});
      pen.fillRect(0, 0, canvas.width, canvas.height);
    };
    pen.drawImage(this.canvas, 0, 0);
    fill('source-in', '#000');
    fill('destination-over', '#fff');
    return new Promise(done => canvas.toBlob(done, 'image/png'));
  }
}

/// Shows the dialog; the mask is kept when Save is pressed.
export async function openMask(app, name) {
  const {server, details} = app,
    turn = details.turned[name] ?? 0,
    time = details.masked[name];
  const photo = await loaded(server.thumb(name, turn, true)),
    size = {width: photo.naturalWidth, height: photo.naturalHeight},
    longer = Math.max(size.width, size.height),
    base = time ? hiddenIn(await loaded(server.mask(name, turn, time)), size) : null;
  const painting = new Painting(size, base),
    {canvas} = painting;
  const said = el('p.said', {'aria-live': 'polite'}, WORDS),
    ring = el('div.brush-ring', {'aria-hidden': 'true'}),
    width = el('input', {
      type: 'range',
      id: 'brush-size',
      min: SIZES.least,
      max: SIZES.most,
      value: SIZES.first,
    });
  let shows = false,
    isWarned = false;
  const mode = segmented(
    'what the brush does',
    [
      ['hide', 'Hide'],
      ['show', 'Show again'],
    ],
    'hide',
    chosen => (shows = chosen === 'show'),
  );
  const choose = what => {
    shows = what === 'show';
    mode.press(what);
  };
  const changed = () => {
    undo.disabled = !painting.strokes.length;
    isWarned = false;
    said.textContent = WORDS;
  };
  const undo = button('Undo', () => (painting.undo(), changed())),
    clear = button('Clear', () => (painting.clear(), changed()));
  undo.disabled = true;

  const pointOf = event => {
    const box = canvas.getBoundingClientRect(),
      scale = canvas.width / box.width;
    ring.style.width = ring.style.height = `${(width.value * longer) / 1000 / scale}px`;
    ring.style.left = `${event.clientX - box.left}px`;
    ring.style.top = `${event.clientY - box.top}px`;
    return [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale];
  };
  let pointer = null; // that paints
  canvas.addEventListener('pointerdown', event => {
    if (pointer !== null || event.button !== 0) return;
    pointer = event.pointerId;
    canvas.setPointerCapture(pointer);
    painting.begin({shows, width: (width.value * longer) / 1000, points: [pointOf(event)]});
    changed();
  });
  canvas.addEventListener('pointermove', event => {
    const point = pointOf(event);
    if (event.pointerId === pointer) painting.paint(point);
  });
  for (const end of ['pointerup', 'pointercancel'])
    canvas.addEventListener(end, event => {
      if (event.pointerId === pointer) pointer = null;
    });

  const save = button(
    'Save',
    async () => {
      try {
        await server.paint(name, turn, await painting.png());
      } catch (error) {
        said.textContent = error.message;
        return;
      }
      dialog.close();
      await app.act(() => {});
      document.getElementById(`mask ${name}`)?.focus();
    },
    'primary',
  );
  const mayClose = () => {
    if (!painting.strokes.length || isWarned) return true;
    isWarned = true;
    said.textContent = 'This is not saved. Press Save, or close again to drop it.';
    return false;
  };
  const place = el('div.paint', {}, photo, canvas, ring);
  place.style.aspectRatio = `${size.width} / ${size.height}`;
  place.style.setProperty('--ratio', size.width / size.height);
  canvas.setAttribute('aria-label', `the photo ${name}, to be painted on`);
  const dialog = el(
    'dialog.mask-dialog',
    {
      'aria-label': `mask of ${name}`,
      onclose: () => dialog.remove(),
      oncancel: event => mayClose() || event.preventDefault(),
      onkeydown: event => {
        if (event.key === 'z' && (event.ctrlKey || event.metaKey)) undo.click();
        else if (event.ctrlKey || event.metaKey || event.altKey) return;
        else if (event.key === 'h') choose('hide');
        else if (event.key === 's') choose('show');
        else if (event.key === '[') width.value -= SIZES.step;
        else if (event.key === ']') width.value = Number(width.value) + SIZES.step;
        else return;
        event.preventDefault();
      },
    },
    el(
      'div.mask-head',
      {},
      el('h2', {}, name),
      button('Close', () => mayClose() && dialog.close()),
    ),
    place,
    el(
      'div.buttons',
      {},
      mode,
      el('label.brush-size', {for: width.id}, 'Size', width),
      undo,
      clear,
      save,
    ),
    said,
    el(
      'small.keys',
      {},
      'Keys: H hides, S shows again, [ and ] change the size, Ctrl+Z undoes, Esc closes.',
    ),
  );
  document.body.append(dialog);
  dialog.showModal();
  canvas.focus();
}
