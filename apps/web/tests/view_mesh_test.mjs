// SPDX-License-Identifier: Apache-2.0
// The mesh in the viewer: beside splats and in their place, by colors and by a texture.
//   node view_mesh_test.mjs MODULES OUT CHROMIUM
import assert from 'node:assert/strict';
import {readFile} from 'node:fs/promises';
import {colorsAt} from './pictures.mjs';
import {isNear, ready, runAll, settled, shot, shown} from './view_page.mjs';
import {CAMERAS, plainPng, sceneFor, seenAt} from './view_scene.mjs';

const ORANGE = [230, 120, 40],
  BLUE = [30, 60, 200];
// Corners of a square behind the blobs, in the axes of the model.
const CORNERS = [
  [-1.5, -1.2, 1],
  [1.5, -1.2, 1],
  [1.5, 1.2, 1],
  [-1.5, 1.2, 1],
];

const linear = byte => {
  const c = byte / 255;
  return Math.round(255 * (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
};

/// A .glb as gemsplat writes it: turned by half a turn about z, with colors in linear light or with
/// a texture of one color.
function glbOf(color, hasTexture) {
  const parts = [
    Buffer.from(Float32Array.from(CORNERS.flatMap(([x, y, z]) => [-x, -y, z])).buffer),
    hasTexture
      ? Buffer.from(Float32Array.from([0, 0, 1, 0, 1, 1, 0, 1]).buffer)
      : Buffer.from(CORNERS.flatMap(() => [...color.map(linear), 255])),
    Buffer.from(Uint32Array.from([0, 1, 2, 0, 2, 3]).buffer),
    hasTexture ? plainPng(4, 4, color) : Buffer.alloc(0),
  ];
  let at = 0;
  const views = parts.map(({length: byteLength}) => {
    const byteOffset = at;
    at += Math.ceil(byteLength / 4) * 4;
    return {buffer: 0, byteOffset, byteLength};
  });
  const json = Buffer.from(
    JSON.stringify({
      asset: {version: '2.0'},
      meshes: [
        {
          primitives: [
            {
              attributes: {POSITION: 0, [hasTexture ? 'TEXCOORD_0' : 'COLOR_0']: 1},
              indices: 2,
              material: 0,
            },
          ],
        },
      ],
      materials: [
        {pbrMetallicRoughness: hasTexture ? {baseColorTexture: {index: 0}} : {metallicFactor: 0}},
      ],
      ...(hasTexture && {
        textures: [{source: 0}],
        images: [{bufferView: 3, mimeType: 'image/png'}],
      }),
      accessors: [
        {bufferView: 0, componentType: 5126, count: 4, type: 'VEC3'},
        hasTexture
          ? {bufferView: 1, componentType: 5126, count: 4, type: 'VEC2'}
          : {bufferView: 1, componentType: 5121, normalized: true, count: 4, type: 'VEC4'},
        {bufferView: 2, componentType: 5125, count: 6, type: 'SCALAR'},
      ],
      bufferViews: views,
      buffers: [{byteLength: at}],
    }),
  );
  const padded = (part, filler) =>
    Buffer.concat([part, Buffer.alloc((4 - (part.length % 4)) % 4, filler)]);
  const chunk = (kind, data) => {
    const head = Buffer.alloc(8);
    head.writeUInt32LE(data.length, 0);
    head.write(kind, 4, 'latin1');
    return Buffer.concat([head, data]);
  };
  const body = Buffer.concat([
    chunk('JSON', padded(json, ' ')),
    chunk('BIN\0', Buffer.concat(parts.map(part => padded(part, 0)))),
  ]);
  const head = Buffer.alloc(12);
  head.write('glTF', 0, 'latin1');
  head.writeUInt32LE(2, 4);
  head.writeUInt32LE(12 + body.length, 8);
  return Buffer.concat([head, body]);
}

const [camera] = CAMERAS;
const withMesh = glb => ({scene: sceneFor('file', {mesh: {name: 'mesh.glb'}}), mesh: () => glb});
const place = point => seenAt(camera, point);
const colors = async (page, places) => colorsAt(page, await page.screenshot(), places);
const view = more => ({at: `c=0&ui=0${more}`, width: camera.width, height: camera.height});
// The mesh is there when something of it is drawn.
const meshShown = async page => {
  await ready(page);
  await page.waitForFunction(() => app.viewer.stage.mesh.scene.children.length > 0);
  await settled(page);
};

const tests = {
  async 'the mesh is where the model is, in the colors of its file, and nothing is left of splats'(
    browser,
  ) {
    for (const hasTexture of [false, true]) {
      const page = await shown(browser, withMesh(glbOf(ORANGE, hasTexture)), view('&mesh=1'));
      await meshShown(page);
      const [middle, inside, outside] = await colors(page, [
        place([0, 0, 0]),
        place([1.4, 1.1, 1]),
        place([1.6, 1.1, 1]),
      ]);
      assert.ok(isNear(middle, ORANGE), `${middle}`);
      assert.ok(isNear(inside, ORANGE), `${inside}`);
      assert.ok(isNear(outside, [0, 0, 0]), `${outside}`);
      await page.close();
    }
  },

  async 'both are side by side, as the slider says; the mesh is fetched when it is wanted'(
    browser,
  ) {
    const page = await shown(browser, withMesh(glbOf(BLUE, false)), {at: 'c=0'});
    await ready(page);
    const [server] = browser.servers;
    assert.ok(!server.asked.includes('/mesh'));
    await page.getByRole('button', {name: 'Settings', exact: true}).click();
    await page
      .getByRole('group', {name: 'splats or mesh'})
      .getByRole('button', {name: 'Both'})
      .click();
    await meshShown(page);
    assert.ok(server.asked.includes('/mesh'));
    await page.waitForFunction(() => location.href.includes('mesh=0.5'));
    await shot(page, 'mesh-both');
    const {width, height} = page.viewportSize();
    const at = share => [Math.round(share * width), Math.round(height / 2)];
    const beside = await colors(page, [at(0.49), at(0.51)]);
    assert.ok(!isNear(beside[0], BLUE), `${beside[0]}`);
    assert.ok(isNear(beside[1], BLUE), `${beside[1]}`);
    await page.getByLabel('part of the picture with the mesh').fill('0.25');
    await settled(page);
    const moved = await colors(page, [at(0.51)]);
    assert.ok(!isNear(moved[0], BLUE), `${moved[0]}`);
    await page
      .getByRole('group', {name: 'look of the mesh'})
      .getByRole('button', {name: 'Shaded'})
      .click();
    await page.getByLabel('part of the picture with the mesh').fill('1');
    await settled(page);
    const [[r, g, b]] = await colors(page, [at(0.5)]);
    assert.ok(r > 150 && r === g && g === b, `${[r, g, b]}`);
    await page.close();
  },

  async 'a screenshot has the mesh, too'(browser) {
    const page = await shown(browser, withMesh(glbOf(ORANGE, false)), view('&mesh=1'));
    await meshShown(page);
    const [file] = await Promise.all([page.waitForEvent('download'), page.keyboard.press('k')]);
    const picture = await readFile(await file.path()),
      [color] = await colorsAt(page, picture, [place([0, 0, 0])]);
    assert.ok(isNear(color, ORANGE), `${color}`);
    await page.close();
  },

  async 'without a mesh nothing offers it; one that is damaged is a message'(browser) {
    const none = await shown(browser, {}, {at: 'c=0&mesh=1'});
    await ready(none);
    await none.getByRole('button', {name: 'Settings', exact: true}).click();
    assert.equal(await none.getByRole('group', {name: 'splats or mesh'}).count(), 0);
    await none.close();
    browser.isForgiving = true;
    const page = await shown(browser, withMesh(Buffer.from('no mesh at all, but some text')), {
      at: 'c=0&mesh=1',
    });
    await page.getByText('The mesh cannot be shown').waitFor();
    await page.close();
  },
};

await runAll(tests);
