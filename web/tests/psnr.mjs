// SPDX-License-Identifier: Apache-2.0
// PSNR of two PNGs over all pixels and channels, in the browser, which can read them.
export const psnr = (page, a, b) => page.evaluate(async pictures => {
  const [x, y] = await Promise.all(pictures.map(async data => {
    const image = new Image();
    image.src = `data:image/png;base64,${data}`;
    await image.decode();
    const canvas = new OffscreenCanvas(image.naturalWidth, image.naturalHeight), context = canvas.getContext('2d');
    context.drawImage(image, 0, 0);
    return context.getImageData(0, 0, canvas.width, canvas.height);
  }));
  if (x.width !== y.width || x.height !== y.height) throw new Error(`${x.width} x ${x.height} against ${y.width} x ${y.height}`);
  let sum = 0;
  for (let i = 0; i < x.data.length; ++i) if (i % 4 < 3) sum += (x.data[i] - y.data[i]) ** 2;
  return -10 * Math.log10(Math.max(sum / (x.width * x.height * 3) / 255 ** 2, 1e-12));
}, [a, b].map(picture => picture.toString('base64')));
