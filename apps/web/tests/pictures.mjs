// SPDX-License-Identifier: Apache-2.0
// What PNGs show, read by the browser that a test drives.

// Runs in the page: the pixels of a PNG in base64.
const READ = `async data => {
  const image = new Image();
  image.src = 'data:image/png;base64,' + data;
  await image.decode();
  const context = new OffscreenCanvas(image.naturalWidth, image.naturalHeight).getContext('2d', {willReadFrequently: true});
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, image.naturalWidth, image.naturalHeight);
}`;

const inPage = (page, body, png, ...values) =>
  page.evaluate(`(async () => {
  const read = ${READ}, pictures = await Promise.all(${JSON.stringify(png.map(each => each.toString('base64')))}.map(read));
  return (${body})(pictures, ...${JSON.stringify(values)});
})()`);

/// Colors [r, g, b] of a PNG (a Buffer) at places [[x, y], ...].
export const colorsAt = (page, png, places) =>
  inPage(
    page,
    String(([{data, width}], places) =>
      places.map(([x, y]) => {
        const at = 4 * (Math.floor(y) * width + Math.floor(x));
        return [data[at], data[at + 1], data[at + 2]];
      }),
    ),
    [png],
    places,
  );

/// PSNR in dB of two PNGs of one size, over all channels and all pixels, or those of a box [left, top,
/// right, bottom].
export const psnr = (page, a, b, box) =>
  inPage(
    page,
    String(([x, y], box) => {
      if (x.width !== y.width || x.height !== y.height)
        throw new Error(`${x.width} x ${x.height} against ${y.width} x ${y.height}`);
      const [left, top, right, bottom] = box ?? [0, 0, x.width, x.height];
      let sum = 0;
      for (let row = top; row < bottom; ++row)
        for (let i = 4 * (row * x.width + left); i < 4 * (row * x.width + right); ++i)
          if (i % 4 < 3) sum += (x.data[i] - y.data[i]) ** 2;
      return (
        -10 * Math.log10(Math.max(sum / ((right - left) * (bottom - top) * 3) / 255 ** 2, 1e-12))
      );
    }),
    [a, b],
    ...(box ? [box] : []),
  );
