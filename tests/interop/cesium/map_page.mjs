// SPDX-License-Identifier: Apache-2.0
// CesiumJS in a page of its own: no globe, no sky, no network, a black background, and a pinhole
// camera that stands where it is told.
import {createReadStream, existsSync, statSync} from 'node:fs';
import {createServer} from 'node:http';
import {join, normalize} from 'node:path';

const TYPES = {
  '.html': 'text/html', '.js': 'text/javascript', '.json': 'application/json', '.css': 'text/css',
  '.wasm': 'application/wasm'};
const PAGE = `<!doctype html><html><head><meta charset="utf-8"><title>map</title><link rel="icon" href="data:,">
<style>html, body, #map, .cesium-widget, canvas { margin: 0; width: 100%; height: 100%; display: block; overflow: hidden; background: #000 }</style></head>
<body><div id="map"></div><script>window.CESIUM_BASE_URL = '/cesium/'</script><script src="/cesium/Cesium.js"></script></body></html>`;

/// Serves the page at /, CesiumJS at /cesium/ and the folder `files` at /files/.
export async function serveMap(modules, files) {
  const roots = {'/cesium/': join(modules, 'cesium', 'Build', 'Cesium'), '/files/': files};
  const server = createServer((request, response) => {
    const path = normalize(decodeURIComponent(new URL(request.url, 'http://x').pathname));
    if (path === '/') return response.writeHead(200, {'Content-Type': 'text/html'}).end(PAGE);
    const root = Object.keys(roots).find(prefix => path.startsWith(prefix));
    const file = root && join(roots[root], path.slice(root.length));
    if (!file || !existsSync(file) || !statSync(file).isFile()) return response.writeHead(404).end();
    response.writeHead(200, {'Content-Type': TYPES[file.match(/\.[^.]*$/)?.[0]] ?? 'application/octet-stream'});
    createReadStream(file).pipe(response);
  });
  await new Promise(done => server.listen(0, '127.0.0.1', done));
  return {url: `http://127.0.0.1:${server.address().port}/`, close: () => new Promise(done => server.close(done))};
}

/// Runs in the page: starts CesiumJS and loads a tileset. Cameras look from `position` along
/// `direction`, all in meters east, north, up of `place` (longitude, latitude, height), by Cesium's
/// own geodesy.
const START = `async (url, place, screenSpaceError) => {
  Cesium.Ion.defaultAccessToken = '';
  const widget = new Cesium.CesiumWidget('map', {
    globe: false, baseLayer: false, skyBox: false, skyAtmosphere: false, msaaSamples: 1,
    showRenderLoopErrors: false,
    creditContainer: document.createElement('div'), contextOptions: {webgl: {alpha: false}}});
  const {scene} = widget;
  for (const part of ['sun', 'moon']) if (scene[part]) scene[part].show = false;
  scene.backgroundColor = Cesium.Color.BLACK;
  scene.highDynamicRange = false;
  scene.postProcessStages.fxaa.enabled = false;
  scene.screenSpaceCameraController.enableInputs = false;
  const failures = [];
  scene.renderError.addEventListener((_, error) => failures.push(String(error)));
  const tileset = await Cesium.Cesium3DTileset.fromUrl(
      url, {maximumScreenSpaceError: screenSpaceError});
  tileset.tileFailed.addEventListener(({url, message}) => failures.push(url + ': ' + message));
  scene.primitives.add(tileset);
  const toEarth = Cesium.Transforms.eastNorthUpToFixedFrame(Cesium.Cartesian3.fromDegrees(...place));
  const turned = v => Cesium.Matrix4.multiplyByPointAsVector(toEarth, new Cesium.Cartesian3(...v), new Cesium.Cartesian3());
  window.map = {
    tileset, failures, scene,
    look({position, direction, up, fieldOfView}) {
      scene.camera.frustum = new Cesium.PerspectiveFrustum({
        fov: fieldOfView, aspectRatio: scene.canvas.clientWidth / scene.canvas.clientHeight,
        near: 0.1, far: 1e5});
      scene.camera.setView({
        destination: Cesium.Matrix4.multiplyByPoint(
            toEarth, new Cesium.Cartesian3(...position), new Cesium.Cartesian3()),
        orientation: {direction: turned(direction), up: turned(up)}});
    },
    // What is drawn, once CesiumJS has nothing left to do: for 40 frames the same tiles are selected,
    // all their Gaussians are drawn, and no sort and no new set of tiles is under way. It may wait
    // for 30 frames before it takes new tiles.
    async settled() {
      const state = () => {
        const splats = tileset.gaussianSplatPrimitive, tiles = tileset._selectedTiles;
        const wanted = tiles.reduce((sum, tile) => sum + tile.content.pointsLength, 0), drawn = splats?._numSplats ?? 0;
        const isIdle = drawn > 0 && drawn === wanted && tileset.tilesLoaded && splats.isStable && !splats._needsSnapshotRebuild &&
            !splats._pendingSnapshot && !splats._sorterPromise;
        return {selected: tiles.map(tile => tile.content.url).sort(), wanted, drawn, isIdle};
      };
      const frame = () => new Promise(done => { const stop = scene.postRender.addEventListener(() => { stop(); done(); }); });
      let last = '', frames = 0;
      for (const begin = performance.now(); performance.now() - begin < 100000;) {
        await frame();
        const now = state(), text = JSON.stringify(now);
        frames = now.isIdle && text === last ? frames + 1 : 0;
        last = text;
        if (frames >= 40) return now;
      }
      throw new Error('CesiumJS does not settle: ' + last + ' ' + failures.join('; '));
    },
    // Longitude, latitude (degrees) and height of a point of the root tile's frame.
    placeOf(point) {
      const at = Cesium.Matrix4.multiplyByPoint(tileset.root.computedTransform, new Cesium.Cartesian3(...point), new Cesium.Cartesian3());
      const {longitude, latitude, height} = Cesium.Cartographic.fromCartesian(at);
      return [Cesium.Math.toDegrees(longitude), Cesium.Math.toDegrees(latitude), height];
    },
  };
}`;

export const startMap = (page, url, place, screenSpaceError = 16) =>
  page.evaluate(`(${START})(${JSON.stringify(url)}, ${JSON.stringify(place)}, ${screenSpaceError})`);
